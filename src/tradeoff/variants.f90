!> The processes of a scene fitted otherwise: with other orders (m_max of the direct method), and to
!> other numbers of simulated values.
!>
!> An order is a choice of the model and a length of the fit one of its accuracy; what either does
!> to what is published shows in marches with friction drawn from each, the random numbers and the
!> force in common, against the highest order or the longest fit. What an order does to entropy and
!> to the correlation length that is not imposed is compared without a march, on the process without
!> sign constraint: it is a matter of its autocovariance.
module tradeoff_variants
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_direct_fit, only: fit_unconstrained
   use process_model, only: process_model_type, process_request
   use process_reference, only: is_reference
   implicit none(type, external)
   private
   public :: order_row, variant_type, compare_orders, list_variants, remember_alike

   !> One order of a kind of process of the scene.
   type :: order_row
      character(:), allocatable :: method       !! 'autoregressive' or 'direct'
      character(:), allocatable :: correlation  !! 'L0' or 'L1', imposed
      real(wp) :: correlation_length = 0.0_wp
      integer :: order = 0                      !! M or m_max
      logical :: is_own = .false.               !! the scene's
      real(wp) :: entropy_lost = 0.0_wp         !! against white noise, per point [nat]
      real(wp) :: other_length = 0.0_wp         !! L1 where L0 is imposed and the reverse
      real(wp) :: milliseconds = 0.0_wp         !! of a processor, to fit it
   end type order_row

   !> A process of the plan with another order or length of its fit.
   type :: variant_type
      integer :: process = 0          !! of the plan, that is varied
      logical :: is_of_fit = .false.  !! the length of the fit is varied, else the order
      logical :: is_own = .false.     !! as the scene has it
      type(process_request) :: request
   end type variant_type

contains

   !> Compares the orders of every kind of process in the plan, a row for each, orders ascending.
   !> Orders without a solution and laws of reference have no row.
   subroutine compare_orders(plan, rows)
      type(plan_type), intent(in) :: plan
      type(order_row), allocatable, intent(out) :: rows(:)
      integer :: i, order

      allocate (rows(0))
      do i = 1, size(plan%processes)
         if (is_reference(plan%processes(i))) cycle
         if (any(same_kind(plan%processes(:i - 1), plan%processes(i)))) cycle
         do order = 1, highest(plan%processes(i))
            if (is_shown(order, plan%processes, plan%processes(i))) &
               call add_row(plan%processes, plan%processes(i), order, rows)
         end do
      end do
   end subroutine compare_orders

   !> True if two processes differ at most in order, mean, std or sign.
   elemental logical function same_kind(a, b)
      type(process_request), intent(in) :: a, b

      same_kind = a%method == b%method .and. a%correlation == b%correlation &
                  .and. abs(a%correlation_length - b%correlation_length) <= 0.0_wp &
                  .and. abs(a%second_length - b%second_length) <= 0.0_wp
   end function same_kind

   !> Highest order; where L1 > 1 is imposed on the direct method it gives 2^m_max sequences of
   !> signs.
   pure integer function highest(request)
      type(process_request), intent(in) :: request

      highest = max(20, request%order)
      if (request%method == 'direct' .and. request%correlation == 'L1' &
          .and. request%correlation_length > 1.0_wp) highest = max(10, request%order)
   end function highest

   pure logical function is_shown(order, processes, kind)
      integer, intent(in) :: order
      type(process_request), intent(in) :: processes(:), kind
      integer, parameter :: usual(*) = [1, 2, 3, 4, 5, 7, 10, 15, 20]

      is_shown = any(order == usual) .or. any(same_kind(processes, kind) &
                                              .and. processes%order == order)
   end function is_shown

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

   !> Lists, for the process of largest std over mean of every kind that friction is drawn from, its
   !> orders ascending, then lengths of its fit ascending; the scene's own among either. Laws of
   !> reference, given values among them, have neither.
   pure subroutine list_variants(plan, models, variants)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)   !! (process), solved
      type(variant_type), allocatable, intent(out) :: variants(:)
      integer, parameter :: usual(*) = [1, 2, 3, 5, 10, 20]
      integer, parameter :: lengths(*) = [256, 1024, 4096, 16384, 65536]   ! of fits
      type(process_request) :: request
      integer :: highest, i, k

      allocate (variants(0))
      do i = 1, size(models)
         if (is_reference(plan%processes(i)) .or. .not. any(plan%cases%process == i)) cycle
         if (i /= representative(plan, i)) cycle
         request = plan%processes(i)
         associate (own => models(i)%order)
            ! up to ten beyond the scene's, or to twice of it where that is less, but not below ten
            highest = max(10, min(2*own, own + 10))
            call add(i, request, .false., &
                     pack([(k, k=1, highest)], [(any(k == [usual, highest, own]), k=1, highest)]), &
                     own, variants)
            ! values are simulated to be matched by positive ones, but for the first order
            if (.not. request%positive .or. own < 1) cycle
            if (own == 1 .and. request%method == 'autoregressive') cycle
            request%order = own
            call add(i, request, .true., [pack([request%fit_steps], &
                                               [all(lengths /= request%fit_steps)]), lengths], &
                     request%fit_steps, variants)
         end associate
      end do
   end subroutine list_variants

   !> Adds a process with each of some orders, or lengths of its fit, one of them the scene's own.
   pure subroutine add(process, request, is_of_fit, values, own, variants)
      integer, intent(in) :: process
      type(process_request), intent(in) :: request
      logical, intent(in) :: is_of_fit   !! lengths of the fit, else orders
      integer, intent(in) :: values(:), own
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

   !> The process of the same kind with the largest std over mean, the first of equals.
   pure integer function representative(plan, process)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: process
      logical :: is_candidate(size(plan%processes))
      integer :: i

      is_candidate = [(drawn_alike(plan%processes(i), plan%processes(process)) .and. &
                       any(plan%cases%process == i), i=1, size(is_candidate))]
      representative = maxloc(plan%processes%std/max(abs(plan%processes%mean), &
                                                     tiny(1.0_wp)), 1, mask=is_candidate)
   end function representative

   !> True if two processes differ at most in order, mean or std, so that one variant serves both.
   pure logical function drawn_alike(a, b)
      type(process_request), intent(in) :: a, b

      drawn_alike = same_kind(a, b) .and. (a%positive .eqv. b%positive)
      if (drawn_alike .and. a%positive) drawn_alike = a%sampler == b%sampler
   end function drawn_alike

   !> Lets all one-at-a-time samplers begin as many values before the first that counts: the same
   !> random numbers then make the same points of all.
   pure subroutine remember_alike(models)
      type(process_model_type), intent(inout) :: models(:)
      logical :: is_sequential(size(models))
      integer :: i

      is_sequential = .false.
      do i = 1, size(models)
         if (models(i)%is_solved .and. models(i)%request%positive) &
            is_sequential(i) = models(i)%request%sampler == 'sequential'
      end do
      where (is_sequential) models%memory = maxval(models%memory, mask=is_sequential)
   end subroutine remember_alike

end module tradeoff_variants
