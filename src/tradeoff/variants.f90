!> Lists variants of the processes of a scene: other orders (m_max of the direct method), and other
!> lengths of the simulated series that positive processes are fitted to.
!>
!> Each variant is fitted and its friction marched with the same random numbers and force
!> (tradeoff_front). Entropy and the correlation length that is not imposed depend on the
!> autocovariance alone: compare_orders computes them without a march, from the process without sign
!> constraint.
module tradeoff_variants
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_direct_fit, only: fit_unconstrained
   use process_model, only: process_model_type, process_request
   use process_reference, only: is_reference
   implicit none(type, external)
   private
   public :: order_row, variant_type, compare_orders, list_variants

   !> A kind of process of the scene with one order.
   type :: order_row
      character(:), allocatable :: method       !! 'autoregressive' or 'direct'
      character(:), allocatable :: correlation  !! imposed length, 'L0' or 'L1'
      real(wp) :: correlation_length = 0.0_wp
      integer :: order = 0                      !! M or m_max
      logical :: is_own = .false.               !! a process of the scene has this order
      real(wp) :: entropy_lost = 0.0_wp         !! entropy per point below white noise's [nat]
      real(wp) :: other_length = 0.0_wp         !! L1 if L0 is imposed, L0 if L1 is
      real(wp) :: milliseconds = 0.0_wp         !! processor time of the fit
   end type order_row

   !> A process of the plan with another order or length of its fit.
   type :: variant_type
      integer :: process = 0          !! number of the process in the plan
      logical :: is_of_fit = .false.  !! true: the length of the fit is varied; false: the order
      logical :: is_own = .false.     !! has the order and the length of the scene
      type(process_request) :: request
   end type variant_type

contains

   !> Fits every kind of process in the plan with several orders, ascending; a row for each order
   !> with a solution. Reference laws have no order.
   subroutine compare_orders(plan, rows)
      type(plan_type), intent(in) :: plan
      type(order_row), allocatable, intent(out) :: rows(:)
      integer, parameter :: orders(*) = [1, 2, 3, 4, 5, 7, 10, 15, 20]
      integer :: highest, i, order

      allocate (rows(0))
      do i = 1, size(plan%processes)
         if (is_reference(plan%processes(i))) cycle
         if (any(same_kind(plan%processes(:i - 1), plan%processes(i)))) cycle
         associate (kind => plan%processes(i))
            ! lower if L1 > 1 is imposed on the direct method, which has 2^m_max sequences of signs
            highest = max(merge(10, 20, kind%method == 'direct' .and. kind%correlation == 'L1' &
                                .and. kind%correlation_length > 1.0_wp), kind%order)
            do order = 1, highest
               if (any(order == orders) .or. &
                   any(same_kind(plan%processes, kind) .and. plan%processes%order == order)) &
                  call add_row(plan%processes, kind, order, rows)
            end do
         end associate
      end do
   end subroutine compare_orders

   !> True if two processes differ at most in order, mean, std or positivity.
   elemental logical function same_kind(a, b)
      type(process_request), intent(in) :: a, b

      same_kind = a%method == b%method .and. a%correlation == b%correlation &
                  .and. abs(a%correlation_length - b%correlation_length) <= 0.0_wp &
                  .and. abs(a%second_length - b%second_length) <= 0.0_wp
   end function same_kind

   !> Fits one order of a kind of process and adds its row if it has a solution.
   subroutine add_row(processes, kind, order, rows)
      type(process_request), intent(in) :: processes(:), kind
      integer, intent(in) :: order
      type(order_row), allocatable, intent(inout) :: rows(:)
      type(process_request) :: request
      type(process_model_type) :: model
      type(error_type), allocatable :: error
      type(order_row) :: row
      real(wp) :: before, after

      request = kind
      request%order = order
      call cpu_time(before)
      call fit_unconstrained(request, model, error)
      call cpu_time(after)
      if (allocated(error)) return
      row%method = trim(kind%method)
      row%correlation = trim(kind%correlation)
      row%correlation_length = kind%correlation_length
      row%order = order
      row%is_own = any(same_kind(processes, kind) .and. processes%order == order)
      row%entropy_lost = model%entropy_bound - model%entropy
      row%other_length = merge(model%l1, model%l0, kind%correlation == 'L0')
      row%milliseconds = 1.0e3_wp*(after - before)
      rows = [rows, row]
   end subroutine add_row

   !> Lists the variants of one process of every kind that friction is drawn from, that with the
   !> largest std over mean: orders ascending, then lengths of its fit ascending, each with the
   !> scene's own. Reference laws and given values have none.
   pure subroutine list_variants(plan, models, variants)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)   !! (process), solved
      type(variant_type), allocatable, intent(out) :: variants(:)
      integer, parameter :: orders(*) = [1, 2, 3, 5, 10, 20]
      integer, parameter :: lengths(*) = [256, 1024, 4096, 16384, 65536]
      type(process_request) :: request
      integer :: highest, i, k

      allocate (variants(0))
      do i = 1, size(models)
         if (is_reference(plan%processes(i)) .or. .not. any(plan%cases%process == i)) cycle
         if (i /= representative(plan, i)) cycle
         request = plan%processes(i)
         associate (own => models(i)%order)
            highest = max(10, min(2*own, own + 10))
            call add(i, request, .false., &
                     pack([(k, k=1, highest)], [(any(k == [orders, own, highest]), &
                                                 k=1, highest)]), own, variants)
            ! only the fit of positive processes simulates values, and not at order 1
            if (.not. request%positive .or. own < 1) cycle
            if (own == 1 .and. request%method == 'autoregressive') cycle
            request%order = own
            call add(i, request, .true., [pack([request%fit_steps], &
                                               [all(lengths /= request%fit_steps)]), lengths], &
                     request%fit_steps, variants)
         end associate
      end do
   end subroutine list_variants

   !> Adds a variant for each value of the order or of the length of the fit.
   pure subroutine add(process, request, is_of_fit, values, own, variants)
      integer, intent(in) :: process
      type(process_request), intent(in) :: request
      logical, intent(in) :: is_of_fit   !! true: values are lengths of the fit; false: orders
      integer, intent(in) :: values(:)
      integer, intent(in) :: own         !! value of the scene
      type(variant_type), allocatable, intent(inout) :: variants(:)
      type(variant_type) :: variant
      integer :: i

      do i = 1, size(values)
         variant = variant_type(process, is_of_fit, values(i) == own, request)
         if (is_of_fit) then
            variant%request%fit_steps = values(i)
         else
            variant%request%order = values(i)
         end if
         variants = [variants, variant]
      end do
   end subroutine add

   !> Number of the first process with the largest std over mean among those that friction is drawn
   !> from and that differ at most in order, mean or std.
   pure integer function representative(plan, process)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: process
      integer :: i

      associate (all => plan%processes, own => plan%processes(process))
         representative = maxloc(all%std/max(abs(all%mean), tiny(1.0_wp)), 1, &
                                 mask=same_kind(all, own) .and. (all%positive .eqv. own%positive) &
                                 .and. (all%sampler == own%sampler .or. .not. own%positive) &
                                 .and. [(any(plan%cases%process == i), i=1, size(all))])
      end associate
   end function representative

end module tradeoff_variants
