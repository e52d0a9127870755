!> Entropy and the correlation length that is not imposed, by the order of a process.
!>
!> Measured on the process without sign constraint, as the order is a matter of its autocovariance.
module tradeoff_process_settings
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_direct_fit, only: fit_unconstrained
   use process_model, only: process_model_type, process_request
   use process_reference, only: is_reference
   implicit none(type, external)
   private
   public :: order_row, compare_orders, same_kind

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

end module tradeoff_process_settings
