!> Draws of the regression estimates, for regression.py: each takes N samples, with replacement,
!> from a campaign with thousands of them, whose statistics are the truth.
!>
!>    bench_regression TRUTH N TIMES RAW CASE...
!>
!> TRUTH is a thinned campaign (`thinned` of regression.py). The cases are one pool, which takes the
!> first samples drawn; of a case named as law:c003 it takes none, and estimates such laws alone.
!> RAW is a file of the draws, which is filled up to TIMES of them: of each case, joint and output
!> five numbers (real32): the errors of plain sampling and of the estimate, the estimate's distances
!> to both ends of its interval, and the standard error that plain sampling states (of a law without
!> samples the estimate's, times the extrapolation). Outputs: mean, standard deviation, 5 and 95 %
!> of slip, pseudo-variances of the mean, of 5 and of 95 %, band ratio; then mean spectrum, its 5
!> and 95 % at each frequency below 3 Hz.
program regression
   use, intrinsic :: iso_fortran_env, only: real32
   use campaign_pooling, only: most_samples
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use io_hdf5, only: hdf5_group, open_hdf5
   use numerics_sorting, only: sort_order
   use statistics_estimates, only: estimates_type, limit_beyond_samples, normal_95, &
                                   plain_percentile, stated_error, statistic_type, upward_error
   use statistics_fit, only: fit_outputs, fit_type
   use statistics_kernel_choice, only: choose_kernel
   use statistics_percentiles, only: at_rank, interval_rank
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars
   use statistics_spectra, only: estimate_spectrum, last_powerful
   use statistics_surrogate, only: surrogate_type
   implicit none(type, external)
   real(wp), parameter :: share_below(2) = [0.05_wp, 0.95_wp]
   integer, parameter :: n_scalars = 4   ! mean, percentiles, standard deviation
   real(wp), parameter :: highest = 3.0_wp   ! highest frequency of the outputs [Hz]
   integer(long), parameter :: seed = 1_long
   real(wp), parameter :: share_left_out = 0.05_wp   ! share of the law's draws
   type :: case_data
      integer :: n_fitted = 0                     !! samples in the pool
      real(wp), allocatable :: friction(:, :)     !! (point, sample)
      real(wp), allocatable :: slip(:, :)         !! (joint, sample)
      real(wp), allocatable :: density(:, :, :)   !! (dof, frequency, sample)
   end type case_data
   type(case_data), allocatable :: cases(:)
   ! mean, percentiles, standard deviation; spectra without that
   type(statistic_type), allocatable :: slip_truth(:, :, :)          ! (statistic, joint, case)
   !> (frequency, statistic, dof, case)
   type(statistic_type), allocatable :: spectrum_truth(:, :, :, :)
   real(wp), allocatable :: frequency(:)
   real(real32), allocatable :: numbers(:, :, :, :)            ! (5, output, joint, case)
   character(256), allocatable :: words(:)
   integer, allocatable :: first(:)   ! (case + 1) its first sample in the pool
   integer :: i, draw, n, n_bytes, n_cases, n_done, n_joints, raw, times
   real(wp) :: began, ended

   allocate (words(command_argument_count()))
   do i = 1, size(words)
      call get_command_argument(i, words(i))
   end do
   read (words(2:3), *) n, times
   n_cases = size(words) - 4
   allocate (cases(n_cases))
   do i = 1, n_cases
      associate (name => words(4 + i))
         call read_case(trim(words(1)), trim(name(index(name, ':') + 1:)), cases(i))
         if (index(name, ':') == 0) cases(i)%n_fitted = min(n, most_samples/n_cases)
      end associate
   end do
   first = [1, (1 + sum(cases(:i)%n_fitted), i=1, n_cases)]
   n_joints = size(cases(1)%slip, 1)
   allocate (numbers(5, 8 + 3*count(frequency < highest), n_joints, n_cases))
   call find_truth()
   open (newunit=raw, file=trim(words(4)), access='stream', form='unformatted')
   inquire (unit=raw, size=n_bytes)
   n_done = n_bytes/(storage_size(numbers)/8*size(numbers))
   call cpu_time(began)
   do draw = n_done + 1, times
      call estimate_all()
      write (raw, pos=1 + (draw - 1)*(storage_size(numbers)/8*size(numbers))) numbers
   end do
   call cpu_time(ended)
   close (raw)
   if (times > n_done) print '(a, f8.3)', 'seconds a draw ', (ended - began)/(times - n_done)

contains

   subroutine read_case(path, name, data)
      character(*), intent(in) :: path, name
      type(case_data), intent(out) :: data
      type(hdf5_group) :: group
      type(error_type), allocatable :: error

      group%path = '/campaign/'//name
      call open_hdf5(path, group%file, error)
      call check(error)
      if (allocated(frequency)) deallocate (frequency)   ! the same of every case
      call group%get('frequency', frequency)
      call group%get('friction', data%friction)
      call group%get('slip_fraction', data%slip)
      call group%allocate_for('psd', data%density)
      call group%move_rows('psd', 0, data%density, 0, size(data%density, 3), .false.)
      call group%take_error(error)
      call check(error)
      call group%file%abandon()
   end subroutine read_case

   subroutine check(error)
      type(error_type), allocatable, intent(in) :: error

      if (allocated(error)) error stop error%message
   end subroutine check

   subroutine find_truth()
      real(wp) :: quiet(1, size(share_below)), quiet_spectrum(size(frequency), size(share_below))
      integer :: c, j

      allocate (slip_truth(n_scalars, n_joints, n_cases))
      allocate (spectrum_truth(size(frequency), n_scalars - 1, n_joints, n_cases))
      do c = 1, n_cases
         do j = 1, n_joints
            associate (slip => cases(c)%slip(j, :), density => transpose(cases(c)%density(j, :, :)))
               slip_truth(:, j, c) = plain_of(slip)
               spectrum_truth(:, :, j, c) = plain_spectrum(density)
               quiet = quiet_percentiles(c, reshape(angle(slip), [size(slip), 1]))
               quiet_spectrum = quiet_percentiles(c, log(density))
            end associate
            where (slip_truth(2:3, j, c)%value > 0.0_wp)   ! no residuals are at zero
               slip_truth(2:3, j, c)%value = sin(max(quiet(1, :), 0.0_wp))**2
            end where
            spectrum_truth(:, 2:3, j, c)%value = exp(quiet_spectrum)
         end do
      end do
   end subroutine find_truth

   !> Percentiles of outputs over all samples of a case without the noise of their residuals, which
   !> draws of few samples do not share: those of a fit to all samples, with the residuals of nine
   !> samples predicted near each.
   function quiet_percentiles(c, y) result(values)
      integer, intent(in) :: c
      real(wp), intent(in) :: y(:, :)   !! (sample, output)
      real(wp) :: values(size(y, 2), size(share_below))
      integer, parameter :: step = 5   ! in rank: within 0.4 % of 5000 samples
      real(wp), allocatable :: outputs(:, :), sums(:, :), sorted(:)
      integer, allocatable :: ranking(:)
      type(pool_type) :: inputs
      type(surrogate_type) :: surrogate
      type(fit_type) :: fit
      type(error_type), allocatable :: error
      integer :: i, k, o

      associate (n => size(y, 1))
         call new_pool(transpose(cases(c)%friction), [1, n + 1], [n], inputs)
         outputs = y
         call choose_kernel(inputs%x, outputs, surrogate, error)
         call check(error)
         call fit_outputs(surrogate, outputs, fit)
         allocate (sums(n, -4:4))
         do o = 1, size(y, 2)
            ranking = sort_order(fit%predicted(:, o))
            do k = -4, 4
               sums(:, k) = fit%predicted(ranking, o) &
                            + fit%residual(ranking([(min(max(i + step*k, 1), n), i=1, n)]), o)
            end do
            sorted = reshape(sums, [size(sums)])
            sorted = sorted(sort_order(sorted))
            values(o, :) = [(at_rank(sorted, 1 + share_below(i)*(size(sorted) - 1)), &
                             i=1, size(share_below))]
         end do
      end associate
   end function quiet_percentiles

   pure function plain_of(y) result(plain)
      real(wp), intent(in) :: y(:)
      type(statistic_type) :: plain(n_scalars)
      integer :: p

      plain(1)%value = sum(y)/size(y)
      do p = 1, size(share_below)
         plain(1 + p:1 + p)%value = percentile(reshape(y, [size(y), 1]), share_below(p))
      end do
      plain(n_scalars)%value = sqrt(sum((y - plain(1)%value)**2)/(size(y) - 1))
   end function plain_of

   !> As the program has them, for the frequencies without a regression too.
   pure function plain_spectrum(y) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, frequency)
      type(statistic_type) :: plain(size(y, 2), n_scalars - 1)
      real(wp) :: sorted(size(y, 1))
      integer :: f, p

      plain(:, 1)%value = sum(y, 1)/size(y, 1)
      do f = 1, size(y, 2)
         plain(f, 1)%error = upward_error(plain(f, 1)%value, &
                                          stated_error((y(:, f) - plain(f, 1)%value)/n, 0.0_wp, n))
      end do
      do p = 1, size(share_below)
         plain(:, 1 + p)%value = percentile(y, share_below(p))
         do f = 1, size(y, 2)
            sorted = y(sort_order(y(:, f)), f)
            plain(f, 1 + p)%low = interval_end(sorted, share_below(p), .false.)
            plain(f, 1 + p)%high = interval_end(sorted, share_below(p), .true.)
         end do
      end do
   end function plain_spectrum

   pure real(wp) function interval_end(sorted, p, is_upper)
      real(wp), intent(in) :: sorted(:), p
      logical, intent(in) :: is_upper
      integer :: rank

      rank = interval_rank(size(sorted), p, is_upper)
      if (rank >= 1 .and. rank <= size(sorted)) then
         interval_end = sorted(rank)
      else
         interval_end = limit_beyond_samples(sorted, p, is_upper)
      end if
   end function interval_end

   pure function percentile(y, p) result(values)
      real(wp), intent(in) :: y(:, :)   !! (sample, output)
      real(wp), intent(in) :: p
      real(wp) :: values(size(y, 2))
      type(estimates_type) :: estimate

      estimate = plain_percentile(y, p)
      values = estimate%value
   end function percentile

   !> Positions of n samples, each any of n_all.
   function choose(n_all, number) result(chosen)
      integer, intent(in) :: n_all, number
      integer :: chosen(n)
      type(stream_type) :: stream
      real(wp) :: u(n)

      stream = new_stream(seed + number, label_of('bench_regression'), draw)
      call stream%uniforms(u)
      chosen = min(1 + int(n_all*u), n_all)
   end function choose

   subroutine estimate_all()
      type(pool_type) :: pool
      real(wp), allocatable :: friction(:, :)
      integer :: c, chosen(n, n_cases), j

      allocate (friction(sum(cases%n_fitted), size(cases(1)%friction, 1)))
      do c = 1, n_cases
         chosen(:, c) = choose(size(cases(c)%friction, 2), c)
         friction(first(c):first(c + 1) - 1, :) = &
            transpose(cases(c)%friction(:, chosen(:cases(c)%n_fitted, c)))
      end do
      call new_pool(friction, first, [(n, c=1, n_cases)], pool)
      do c = 1, n_cases
         if (cases(c)%n_fitted == 0 .or. all(cases%n_fitted > 0)) call add_law(c, pool)
      end do
      do j = 1, n_joints
         call estimate_joint(pool, j, chosen)
         call estimate_dof(pool, j, chosen)
      end do
   end subroutine estimate_all

   !> Adds most samples of a case, others in each draw, as draws of its law: so do the points of the
   !> law differ.
   subroutine add_law(number, pool)
      integer, intent(in) :: number
      type(pool_type), intent(inout) :: pool
      type(stream_type) :: stream
      real(wp) :: u(size(cases(number)%friction, 2))
      integer :: i, n_all
      integer, allocatable :: some(:)

      n_all = size(u)
      stream = new_stream(seed + number, label_of('law'), draw)
      call stream%uniforms(u)
      some = pack([(i, i=1, n_all)], u > share_left_out)
      call pool%add_law(number, transpose(cases(number)%friction(:, some)), &
                        real(n_all, wp)*size(some)/(n_all - size(some)))
   end subroutine add_law

   subroutine estimate_joint(pool, j, chosen)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: j, chosen(:, :)
      type(statistic_type), dimension(1, n_scalars, n_cases) :: plain, estimates
      type(statistic_type) :: sensitivity(size(pool%x, 2), n_cases)
      type(error_type), allocatable :: error
      real(wp) :: y(sum(cases%n_fitted), 1)
      integer :: c, p

      do c = 1, n_cases
         y(first(c):first(c + 1) - 1, 1) = cases(c)%slip(j, chosen(:cases(c)%n_fitted, c))
         plain(1, :, c) = plain_of(cases(c)%slip(j, chosen(:, c)))
      end do
      call estimate_scalars(pool, y, [.true.], share_below, plain, estimates, sensitivity, error)
      call check(error)
      do c = 1, n_cases
         associate (truth => slip_truth(:, j, c), sampled => plain(1, :, c), &
                    ours => estimates(1, :, c), taken => numbers(:, :, j, c))
            taken(:, 1) = about(truth(1)%value, sampled(1)%value, ours(1))
            taken(:, 2) = about(truth(n_scalars)%value, sampled(n_scalars)%value, ours(n_scalars))
            do p = 1, 2
               taken(:, 2 + p) = &
                  between(angle(truth(1 + p)%value), angle(sampled(1 + p)%value), &
                          angle([ours(1 + p)%low, ours(1 + p)%value, ours(1 + p)%high]), &
                          ours(1 + p)%ratio)
            end do
         end associate
      end do
   end subroutine estimate_joint

   elemental real(wp) function angle(fraction)
      real(wp), intent(in) :: fraction

      angle = asin(sqrt(fraction))
   end function angle

   subroutine estimate_dof(pool, j, chosen)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: j, chosen(:, :)
      type(statistic_type) :: plain(size(frequency), n_scalars - 1, n_cases)
      type(statistic_type) :: integrals(n_scalars, n_cases)   ! last the band ratio
      type(statistic_type), allocatable :: spectra(:, :, :)
      type(statistic_type) :: best(n_scalars - 1)   ! estimates at a frequency
      type(error_type), allocatable :: error
      real(wp) :: y(sum(cases%n_fitted), size(frequency))
      real(wp) :: own(n, size(frequency)), step
      integer :: at, c, f, n_powerful, p

      do c = 1, n_cases
         own = transpose(cases(c)%density(j, :, chosen(:, c)))
         y(first(c):first(c + 1) - 1, :) = own(:cases(c)%n_fitted, :)
         plain(:, :, c) = plain_spectrum(own)
      end do
      step = frequency(2) - frequency(1)
      n_powerful = maxval([(last_powerful(plain(:, 1, c)%value), c=1, n_cases)])
      allocate (spectra(n_powerful, n_scalars - 1, n_cases))
      call estimate_spectrum(pool, y(:, :n_powerful), step, share_below, plain, spectra, &
                             integrals, error)
      call check(error)
      do c = 1, n_cases
         associate (truth => spectrum_truth(:, :, j, c), sampled => plain(:, :, c), &
                    taken => numbers(:, :, j, c))
            do p = 1, 3   ! mean, percentiles
               taken(:, 4 + p) = about(step*sum(truth(:, p)%value), step*sum(sampled(:, p)%value), &
                                       integrals(p, c))
            end do
            taken(:, 8) = log_between(ratio_of(truth), ratio_of(sampled), integrals(4, c))
            do f = 1, count(frequency < highest)
               at = 8 + 3*(f - 1)
               best = plain(f, :, c)
               if (f <= n_powerful) best = spectra(f, :, c)
               taken(:, at + 1) = about(truth(f, 1)%value, sampled(f, 1)%value, best(1))
               do p = 2, 3
                  taken(:, at + p) = log_between(truth(f, p)%value, sampled(f, p)%value, best(p))
               end do
            end do
         end associate
      end do
   end subroutine estimate_dof

   pure real(wp) function ratio_of(plain)
      type(statistic_type), intent(in) :: plain(:, :)   !! (frequency, statistic)

      ratio_of = sum(plain(:, 3)%value)/sum(plain(:, 2)%value)
   end function ratio_of

   !> The numbers of an output whose logarithm is compared.
   pure function log_between(truth, plain, ours) result(five)
      real(wp), intent(in) :: truth, plain
      type(statistic_type), intent(in) :: ours
      real(real32) :: five(5)

      five = between(log(truth), log(plain), log([ours%low, ours%value, ours%high]), ours%ratio)
   end function log_between

   !> The numbers of an output whose estimate has a standard error.
   pure function about(truth, plain, ours) result(five)
      real(wp), intent(in) :: truth, plain
      type(statistic_type), intent(in) :: ours
      real(real32) :: five(5)

      five = between(truth, plain, ours%value + normal_95*ours%error*[-1.0_wp, 0.0_wp, 1.0_wp], &
                     ours%ratio)
   end function about

   !> The numbers of an output whose estimate has an interval.
   pure function between(truth, plain, ours, ratio) result(five)
      real(wp), intent(in) :: truth, plain
      real(wp), intent(in) :: ours(3)   !! low end, value, high end
      real(wp), intent(in) :: ratio     !! error of plain sampling over that of the estimate
      real(real32) :: five(5)

      five = real([plain - truth, ours(2) - truth, ours(2) - ours(1), ours(3) - ours(2), &
                   ratio*(ours(3) - ours(1))/(2*normal_95)], real32)
   end function between

end program regression
