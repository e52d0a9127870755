!> CPU time of positive processes: points sampled per second, and the six fits of the paper's
!> friction.
program bench_process_positive
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use process_autoregressive_model, only: coefficients_of
   use process_fit, only: fit_process
   use process_model, only: process_model_type, process_request
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_positive_exact, only: sample_exact, sweeps_to_forget
   use process_positive_moments, only: batch_averages, new_batches
   use process_positive_sequential, only: sample_sequential
   use process_positive_truncated_normal, only: lanes
   implicit none(type, external)
   integer, parameter :: orders(4) = [1, 5, 10, 30], lags(2) = [10, 100]
   real(wp), parameter :: lengths(3) = [0.3_wp, 1.0_wp, 3.0_wp], stds(2) = [0.067_wp, 0.10_wp]
   integer, parameter :: order_of(3) = [2, 5, 10]
   character(10), parameter :: samplers(2) = ['sequential', 'exact     ']
   integer :: i, j, k

   print '(a)', &
      '# law order lags million_points_per_second_and_core (values, all their moments and controls)'
   do i = 1, size(samplers)
      do j = 1, size(orders)
         do k = 1, size(lags)
            call report_speed(trim(samplers(i)), orders(j), max(lags(k), orders(j)))
         end do
      end do
   end do
   print '(a)', &
      '# law L0 order std seconds relative_standard_errors_of_mean_std_L0 entropy its_error'
   do i = 1, size(samplers)
      do j = 1, size(lengths)
         do k = 1, size(stds)
            call report_fit(trim(samplers(i)), lengths(j), order_of(j), stds(k))
         end do
      end do
   end do

contains

   !> Prints the best of several runs of about a million values.
   subroutine report_speed(sampler, order, n_lags)
      character(*), intent(in) :: sampler
      integer, intent(in) :: order, n_lags
      integer, parameter :: repetitions = 5, n_stretches = 8, ring_length = 512
      type(batch_averages) :: batches
      type(stream_type) :: stream
      real(wp) :: a(order), best, finish, n_values, start
      integer :: i, n_burn_in

      a = coefficients_of(spread(-0.5_wp/order, 1, order))
      best = huge(best)
      do i = 1, repetitions
         batches = new_batches(n_lags, n_lags, n_stretches*lanes)
         stream = new_stream(2016_long, label_of('bench'), i)
         if (sampler == 'sequential') then
            n_burn_in = 128
            n_values = lanes*(128.0_wp + n_stretches*4096)
            call cpu_time(start)
            call sample_sequential(a, 1.0_wp, a, 2.0_wp, n_burn_in, 4096, stream, batches)
         else
            n_burn_in = sweeps_to_forget(2.0_wp*(1.0_wp + sum(a**2)), 1.0_wp, 1.0e-5_wp)
            n_values = lanes*real(ring_length, wp)*(n_burn_in + n_stretches*8)
            call cpu_time(start)
            call sample_exact(symbol_of_process(a, 1.0_wp), 1.0_wp, a, 2.0_wp, ring_length, &
                              n_burn_in, 8, stream, batches)
         end if
         call cpu_time(finish)
         best = min(best, finish - start)
      end do
      print '(a, 2i6, f10.1)', sampler, order, n_lags, 1.0e-6_wp*n_values/best
   end subroutine report_speed

   subroutine report_fit(sampler, length, order, std)
      character(*), intent(in) :: sampler
      real(wp), intent(in) :: length, std
      integer, intent(in) :: order
      type(process_request) :: request
      type(process_model_type) :: model
      real(wp) :: finish, start

      request%method = 'autoregressive'
      request%correlation = 'L0'
      request%correlation_length = length
      request%order = order
      request%mean = 0.2_wp
      request%std = std
      request%positive = .true.
      request%sampler = sampler
      call cpu_time(start)
      call fit_process(request, 2016_long, model)
      call cpu_time(finish)
      if (model%is_solved) then
         print '(a, f6.1, i4, f7.3, f8.2, 3es9.1, f11.6, es9.1)', sampler, length, order, std, &
            finish - start, &
            model%mean_error/model%mean, model%std_error/model%std, model%l0_error/model%l0, &
               model%entropy, &
            model%entropy_error
      else
         print '(a, f6.1, i4, f7.3, f8.2, 2a)', sampler, length, order, std, finish - start, '  ', &
            model%reason
      end if
   end subroutine report_fit

end program bench_process_positive
