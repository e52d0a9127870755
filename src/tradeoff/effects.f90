!> Computes how published numbers change with the order of a process and with the length of its fit.
!>
!> Each variant is compared with the highest order or the longest fit of the same process, on the
!> same number of samples, with the same random numbers and force. Standard errors are those of the
!> paired differences (jackknife over samples).
module tradeoff_effects
   use campaign_comparison, only: change_of_ratios, compare_slip, numerical_error
   use core_kinds, only: wp
   use statistics_estimates, only: statistic_type
   use tradeoff_task_results, only: band_ratio, n_published, slip, slip_std, task_result
   use tradeoff_tasks, only: tradeoff_type, variant_task
   implicit none(type, external)
   private
   public :: variant_row, variant_rows_of

   !> Measured variant: its largest changes over force levels and dofs, each with its standard
   !> error.
   type :: variant_row
      integer :: variant = 0                   !! number in scope%variants
      logical :: is_reference = .false.        !! the others of its family are compared with it
      real(wp) :: seconds = 0.0_wp             !! processor time of its fit
      real(wp) :: change(n_published) = 0.0_wp   !! changes of slip, slip_std and band_ratio
      real(wp) :: error(n_published) = 0.0_wp    !! standard errors of the changes
   end type variant_row

contains

   !> Rows of the variants that have a solution, in their order.
   pure function variant_rows_of(tradeoff) result(rows)
      type(tradeoff_type), intent(in) :: tradeoff
      type(variant_row), allocatable :: rows(:)
      type(variant_row) :: row
      integer :: i, k, reference, reference_task, task

      allocate (rows(0))
      do i = 1, size(tradeoff%scope%variants)
         reference = reference_of(tradeoff, i)
         row = variant_row(variant=i, is_reference=i == reference)
         if (.not. tradeoff%scope%variant_models(i)%is_solved) cycle
         row%seconds = tradeoff%scope%variant_models(i)%seconds
         do k = 1, size(tradeoff%levels)
            task = task_of(tradeoff, i, k)
            reference_task = task_of(tradeoff, reference, k)
            if (min(task, reference_task) > 0) &
               call compare(tradeoff%results(task), tradeoff%results(reference_task), row)
         end do
         rows = [rows, row]
      end do
   end function variant_rows_of

   !> Number of the last solved variant of the same family: highest order, or longest fit.
   pure integer function reference_of(tradeoff, variant)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: variant

      associate (all => tradeoff%scope%variants)
         reference_of = findloc(all%process == all(variant)%process .and. &
                                (all%is_of_fit .eqv. all(variant)%is_of_fit) .and. &
                                tradeoff%scope%variant_models%is_solved, .true., 1, back=.true.)
      end associate
   end function reference_of

   !> Number of the task of a variant at a level; 0: none.
   pure integer function task_of(tradeoff, variant, level)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: variant, level

      task_of = findloc(tradeoff%tasks%kind == variant_task .and. &
                        tradeoff%tasks%row == variant .and. tradeoff%tasks%level == level, &
                        .true., 1)
   end function task_of

   !> Compares two marches of one level; keeps the changes in the row that are larger than before.
   pure subroutine compare(tested, reference, row)
      type(task_result), intent(in) :: tested, reference
      type(variant_row), intent(inout) :: row
      integer, parameter :: endless = huge(1)   ! number of samples that the change is stated for
      type(numerical_error) :: errors

      call compare_slip(tested%slip_fraction, reference%slip_fraction, endless, errors)
      call keep_largest(errors%slip_mean, row%change(slip), row%error(slip))
      call keep_largest(errors%slip_std, row%change(slip_std), row%error(slip_std))
      if (allocated(tested%ratio_without)) &
         call keep_largest(change_of_ratios(tested%ratio_without, reference%ratio_without, &
                                            endless), row%change(band_ratio), row%error(band_ratio))
   end subroutine compare

   !> Keeps the largest change, if it is larger than the one so far, with its standard error.
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
