!> CPU time of the autoregressive fits: one line per request, read by process_ar.py.
program bench_process_ar
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use process_autoregressive_fit, only: fit_ar
   use process_fit, only: fit_process
   use process_model, only: process_model_type, process_request
   implicit none(type, external)
   integer(long), parameter :: seed = 2016_long
   character(2), parameter :: definitions(2) = ['L0', 'L1']
   real(wp), parameter :: lengths(3) = [0.3_wp, 1.0_wp, 3.0_wp]
   integer, parameter :: orders(4) = [2, 5, 10, 30]
   type(process_request) :: request
   integer :: i, j, k

   request%method = 'autoregressive'
   request%std = 1.0_wp
   print '(a)', '# definition length order entropy residual ms_of_fit ms_with_rivals'
   do i = 1, size(definitions)
      do j = 1, size(lengths)
         do k = 1, size(orders)
            request%correlation = definitions(i)
            request%correlation_length = lengths(j)
            request%order = orders(k)
            call report(request)
         end do
      end do
   end do

contains

   !> Times the fit alone, and with the searches of other shapes of `fit_process`: the best of
   !> several.
   subroutine report(request)
      type(process_request), intent(in) :: request
      integer, parameter :: repetitions = 5
      type(process_model_type) :: model
      type(error_type), allocatable :: error
      real(wp) :: best(2), time(3)
      integer :: i

      best = huge(1.0_wp)
      do i = 1, repetitions
         call cpu_time(time(1))
         call fit_ar(request, model, error)
         call cpu_time(time(2))
         if (allocated(error)) error stop error%message
         call fit_process(request, seed, model)
         call cpu_time(time(3))
         if (.not. model%is_solved) error stop model%reason
         best = min(best, 1.0e3_wp*(time(2:) - time(:2)))
      end do
      print '(a, f6.1, i4, f15.10, es10.1, 2f9.3)', request%correlation, &
         request%correlation_length, request%order, model%entropy, model%optimality, best
   end subroutine report

end program bench_process_ar
