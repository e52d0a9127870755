!> Effects of the order of a process and of the length of its fit on published numbers.
!>
!> Against the highest order or the longest fit of the same process, on as many samples with the
!> random numbers and the force in common. Standard errors are those of the paired differences
!> (jackknife over samples): what is left when the friction does not follow the same numbers.
module tradeoff_effects
   use campaign_comparison, only: change_of_ratios, compare_slip, numerical_error
   use core_kinds, only: wp
   use statistics_estimates, only: statistic_type
   use tradeoff_task_results, only: band_ratio, n_published, slip, slip_std, task_result
   use tradeoff_tasks, only: of_variant, tradeoff_type
   implicit none(type, external)
   private
   public :: variant_row, variant_rows_of

   !> A variant measured. Changes are the largest over levels of force and dofs, with the standard
   !> error that each of them has; none where it is what the others are compared with.
   type :: variant_row
      integer :: variant = 0                   !! of the tradeoff's scope
      logical :: is_reference = .false.
      real(wp) :: seconds = 0.0_wp             !! of a processor, to fit it
      real(wp) :: change(n_published) = 0.0_wp   !! of slip, slip_std and band_ratio
      real(wp) :: error(n_published) = 0.0_wp    !! standard errors of the changes
   end type variant_row

contains

   !> The variants that were marched, in their order.
   pure function variant_rows_of(tradeoff) result(rows)
      type(tradeoff_type), intent(in) :: tradeoff
      type(variant_row), allocatable :: rows(:)
      type(variant_row) :: row
      integer :: i, k, ours, reference, theirs

      allocate (rows(0))
      do i = 1, size(tradeoff%scope%variants)
         reference = reference_of(tradeoff, i)
         row = variant_row(variant=i, is_reference=i == reference)
         if (.not. tradeoff%scope%variant_models(i)%is_solved) cycle
         row%seconds = tradeoff%scope%variant_models(i)%seconds
         do k = 1, size(tradeoff%levels)
            ours = task_of(tradeoff, i, k)
            theirs = task_of(tradeoff, reference, k)
            if (min(ours, theirs) > 0) &
               call compare(tradeoff%found(ours), tradeoff%found(theirs), row)
         end do
         rows = [rows, row]
      end do
   end function variant_rows_of

   !> The last of its family with a solution: the highest order, or the longest fit.
   pure integer function reference_of(tradeoff, variant)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: variant

      associate (all => tradeoff%scope%variants)
         reference_of = findloc(all%process == all(variant)%process .and. &
                                (all%is_of_fit .eqv. all(variant)%is_of_fit) .and. &
                                tradeoff%scope%variant_models%is_solved, .true., 1, back=.true.)
      end associate
   end function reference_of

   pure integer function task_of(tradeoff, variant, level)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: variant, level

      task_of = findloc(tradeoff%tasks%kind == of_variant .and. &
                        tradeoff%tasks%row == variant .and. tradeoff%tasks%level == level, &
                        .true., 1)
   end function task_of

   !> Compares two marches of one level.
   pure subroutine compare(tested, reference, row)
      type(task_result), intent(in) :: tested, reference
      type(variant_row), intent(inout) :: row
      integer, parameter :: endless = huge(1)   ! samples that are meant
      type(numerical_error) :: errors

      call compare_slip(tested%slip_fraction, reference%slip_fraction, endless, errors)
      call keep_largest(errors%slip_mean, row%change(slip), row%error(slip))
      call keep_largest(errors%slip_std, row%change(slip_std), row%error(slip_std))
      if (allocated(tested%ratio_without)) &
         call keep_largest(change_of_ratios(tested%ratio_without, reference%ratio_without, &
                                            endless), row%change(band_ratio), row%error(band_ratio))
   end subroutine compare

   pure subroutine keep_largest(change, largest, error_of_largest)
      type(statistic_type), intent(in) :: change(:)   !! (joint or dof)
      real(wp), intent(inout) :: largest, error_of_largest
      integer :: place

      place = maxloc(abs(change%value), 1, back=.true.)
      if (abs(change(place)%value) < abs(largest)) return
      largest = change(place)%value
      error_of_largest = change(place)%error
   end subroutine keep_largest

end module tradeoff_effects
