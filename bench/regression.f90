!> Errors and coverage of the regression estimates, for regression.py: many draws of N samples from
!> a campaign with thousands of them, whose statistics are the truth.
!>
!>    bench_regression RESULTS N FIRST LAST EVERY CASE...
!>
!> The cases are one pool, of the first 600 samples drawn; FIRST, LAST: numbers of the draws, each
!> the same in whatever portion it is made; EVERY: frequencies taken. A line of
!> output per case, joint, quantity and frequency: root mean square errors of plain sampling, of the
!> estimate and as stated, coverage of the intervals of plain sampling and of the estimate.
program regression
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use io_hdf5, only: hdf5_file, open_hdf5, read_dataset, read_extent
   use numerics_sorting, only: sort_order
   use statistics_estimates, only: estimates_type, plain_percentile
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars, scalar_plain, scalar_type
   use statistics_spectra, only: estimate_spectrum, spectrum_plain, spectrum_type
   implicit none(type, external)
   real(wp), parameter :: share_below(2) = [0.05_wp, 0.95_wp]
   !> Sums over replicates: squares of plain and regression errors, coverages, stated squares.
   type :: score_type
      real(wp) :: plain = 0.0_wp, ours = 0.0_wp, stated = 0.0_wp
      integer :: plain_covers = 0, covers = 0, n = 0
   end type score_type
   type :: case_data
      real(wp), allocatable :: friction(:, :)     !! (point, sample)
      real(wp), allocatable :: slip(:, :)         !! (joint, sample)
      real(wp), allocatable :: density(:, :, :)   !! (dof, frequency, sample)
   end type case_data
   type(case_data), allocatable :: cases(:)
   type(score_type), allocatable :: slip_score(:, :, :)      ! (quantity, joint, case)
   type(score_type), allocatable :: spectrum_score(:, :, :, :)   ! (quantity, frequency, dof, case)
   type(score_type), allocatable :: integral_score(:, :, :)  ! (quantity, dof, case)
   type(scalar_plain), allocatable :: slip_truth(:, :)       ! (joint, case)
   type(spectrum_plain), allocatable :: spectrum_truth(:, :) ! (dof, case)
   real(wp), allocatable :: frequency(:)
   character(64), allocatable :: words(:)
   integer, parameter :: most_samples = 600   ! of a pool, as campaign_pooling has it
   integer(long), parameter :: seed = 1_long
   integer :: every, first, i, last, n, n_cases, n_fitted, n_joints, replicate
   real(wp) :: began, ended, seconds

   allocate (words(command_argument_count()))
   do i = 1, size(words)
      call get_command_argument(i, words(i))
   end do
   read (words(2:5), *) n, first, last, every
   n_cases = size(words) - 5
   n_fitted = min(n, most_samples/n_cases)
   allocate (cases(n_cases))
   do i = 1, n_cases
      call read_case(trim(words(1)), trim(words(5 + i)), cases(i))
   end do
   n_joints = size(cases(1)%slip, 1)
   allocate (slip_score(4, n_joints, n_cases), integral_score(4, n_joints, n_cases))
   allocate (spectrum_score(3, size(frequency), n_joints, n_cases))
   call find_truth()
   seconds = 0.0_wp
   do replicate = first, last
      call cpu_time(began)
      call estimate_all()
      call cpu_time(ended)
      seconds = seconds + ended - began
   end do
   call print_all()

contains

   subroutine read_case(path, name, data)
      character(*), intent(in) :: path, name
      type(case_data), intent(out) :: data
      type(hdf5_file) :: file
      type(error_type), allocatable :: error
      integer(long), allocatable :: extent(:)
      real(wp), allocatable :: all_of(:, :, :), all_frequencies(:)

      call open_hdf5(path, file, error)
      call check(error)
      call read_extent(file, '/campaign/'//name//'/psd', 3, extent, error)
      call check(error)
      allocate (data%friction(extent(1), extent(3)), data%slip(extent(1), extent(3)))
      allocate (all_of(extent(1), extent(2), extent(3)), all_frequencies(extent(2)))
      call read_dataset(file, '/campaign/'//name//'/friction', data%friction, error)
      call check(error)
      call read_dataset(file, '/campaign/'//name//'/slip_fraction', data%slip, error)
      call check(error)
      call read_dataset(file, '/campaign/'//name//'/psd', all_of, error)
      call check(error)
      call read_dataset(file, '/campaign/'//name//'/frequency', all_frequencies, error)
      call check(error)
      call file%abandon()
      data%density = all_of(:, 2::every, :)
      frequency = all_frequencies(2::every)
   end subroutine read_case

   subroutine check(error)
      type(error_type), allocatable, intent(in) :: error

      if (allocated(error)) error stop error%message
   end subroutine check

   pure real(wp) function percentile(values, p)
      real(wp), intent(in) :: values(:), p
      type(estimates_type) :: estimate

      estimate = plain_percentile(reshape(values, [size(values), 1]), p)
      percentile = estimate%value(1)
   end function percentile

   subroutine find_truth()
      integer :: c, f, j, p

      allocate (slip_truth(n_joints, n_cases), spectrum_truth(n_joints, n_cases))
      do c = 1, n_cases
         do j = 1, n_joints
            slip_truth(j, c) = plain_of(cases(c)%slip(j, :))
            associate (truth => spectrum_truth(j, c))
               allocate (truth%mean(size(frequency)), truth%percentile(size(frequency), 2))
               do f = 1, size(frequency)
                  associate (all_of => cases(c)%density(j, f, :))
                     truth%mean(f) = sum(all_of)/size(all_of)
                     truth%percentile(f, :) = [(percentile(all_of, share_below(p)), p=1, 2)]
                  end associate
               end do
            end associate
         end do
      end do
   end subroutine find_truth

   pure function plain_of(y) result(plain)
      real(wp), intent(in) :: y(:)
      type(scalar_plain) :: plain
      integer :: p

      plain%mean = sum(y)/size(y)
      plain%deviation = sqrt(sum((y - plain%mean)**2)/(size(y) - 1))
      plain%percentile = [(percentile(y, share_below(p)), p=1, 2)]
   end function plain_of

   !> Positions of n samples of n_all, none twice.
   function choose(n_all, number) result(chosen)
      integer, intent(in) :: n_all, number
      integer :: chosen(n)
      type(stream_type) :: stream
      real(wp), allocatable :: u(:)
      integer, allocatable :: order(:)

      allocate (u(n_all))
      stream = new_stream(seed + number, label_of('bench_regression'), replicate)
      call stream%uniforms(u)
      order = sort_order(u)
      chosen = order(:n)
   end function choose

   subroutine estimate_all()
      type(pool_type) :: pool
      real(wp), allocatable :: friction(:, :)
      integer :: c, chosen(n, n_cases), j

      allocate (friction(n_fitted*n_cases, size(cases(1)%friction, 1)))
      do c = 1, n_cases
         chosen(:, c) = choose(size(cases(c)%friction, 2), c)
         friction((c - 1)*n_fitted + 1:c*n_fitted, :) = &
            transpose(cases(c)%friction(:, chosen(:n_fitted, c)))
      end do
      call new_pool(friction, [(1 + c*n_fitted, c=0, n_cases)], [(n, c=1, n_cases)], pool)
      do c = 1, n_cases   ! all there are: exact
         call pool%add_law(c, transpose(cases(c)%friction), 1.0e9_wp)
      end do
      do j = 1, n_joints
         call estimate_joint(pool, j, chosen)
         call estimate_dof(pool, j, chosen)
      end do
   end subroutine estimate_all

   subroutine estimate_joint(pool, j, chosen)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: j, chosen(:, :)
      type(scalar_plain) :: plain(1, n_cases)
      type(scalar_type) :: estimates(1, n_cases)
      type(error_type), allocatable :: error
      real(wp) :: y(n_fitted*n_cases, 1)
      integer :: c, p

      do c = 1, n_cases
         y((c - 1)*n_fitted + 1:c*n_fitted, 1) = cases(c)%slip(j, chosen(:n_fitted, c))
         plain(1, c) = plain_of(cases(c)%slip(j, chosen(:, c)))
      end do
      call estimate_scalars(pool, y, [.true.], share_below, plain, estimates, error)
      call check(error)
      do c = 1, n_cases
         associate (truth => slip_truth(j, c), ours => estimates(1, c), &
                    score => slip_score(:, j, c))
            call take(score(1), truth%mean, plain(1, c)%mean, ours%mean, ours%mean_error, &
                      ours%mean_ratio)
            call take(score(2), truth%deviation, plain(1, c)%deviation, ours%deviation, &
                      ours%deviation_error, ours%deviation_ratio)
            do p = 1, 2
               call take(score(2 + p), angle(truth%percentile(p)), &
                         angle(plain(1, c)%percentile(p)), angle(ours%percentile(p)), &
                         (angle(ours%high(p)) - angle(ours%low(p)))/(2*1.96_wp), &
                         ours%percentile_ratio(p))
            end do
         end associate
      end do
   end subroutine estimate_joint

   pure real(wp) function angle(fraction)
      real(wp), intent(in) :: fraction

      angle = asin(sqrt(fraction))
   end function angle

   subroutine estimate_dof(pool, j, chosen)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: j, chosen(:, :)
      type(spectrum_plain) :: plain(n_cases)
      type(spectrum_type) :: estimates(n_cases)
      type(error_type), allocatable :: error
      real(wp) :: y(n_fitted*n_cases, size(frequency))
      real(wp) :: own(n, size(frequency))
      integer :: c, f, p

      do c = 1, n_cases
         allocate (plain(c)%mean(size(frequency)), plain(c)%percentile(size(frequency), 2))
         own = transpose(cases(c)%density(j, :, chosen(:, c)))
         y((c - 1)*n_fitted + 1:c*n_fitted, :) = own(:n_fitted, :)
         plain(c)%mean = sum(own, 1)/n
         do f = 1, size(frequency)
            plain(c)%percentile(f, :) = [(percentile(own(:, f), share_below(p)), p=1, 2)]
         end do
      end do
      call estimate_spectrum(pool, y, frequency(2) - frequency(1), share_below, plain, &
                             estimates, error)
      call check(error)
      do c = 1, n_cases
         do f = 1, size(frequency)
            associate (truth => spectrum_truth(j, c), ours => estimates(c), &
                       score => spectrum_score(:, f, j, c))
               call take(score(1), truth%mean(f), plain(c)%mean(f), ours%mean(f), &
                         ours%mean_error(f), ours%mean_ratio(f))
               do p = 1, 2
                  call take(score(1 + p), log(truth%percentile(f, p)), &
                            log(plain(c)%percentile(f, p)), log(ours%percentile(f, p)), &
                            log(ours%high(f, p)/ours%low(f, p))/(2*1.96_wp), &
                            ours%percentile_ratio(f, p))
               end do
            end associate
         end do
         associate (truth => spectrum_truth(j, c), ours => estimates(c), &
                    score => integral_score(:, j, c))
            associate (step => frequency(2) - frequency(1))
               call take(score(1), step*sum(truth%mean), step*sum(plain(c)%mean), &
                         ours%variance_mean, ours%variance_mean_error, &
                         ours%variance_mean_ratio)
               do p = 1, 2
                  call take(score(1 + p), step*sum(truth%percentile(:, p)), &
                            step*sum(plain(c)%percentile(:, p)), ours%variance(p), &
                            ours%variance_error(p), ours%variance_ratio(p))
               end do
            end associate
            call take(score(4), log(sum(truth%percentile(:, 2))/sum(truth%percentile(:, 1))), &
                      log(sum(plain(c)%percentile(:, 2))/sum(plain(c)%percentile(:, 1))), &
                      log(ours%ratio), log(ours%ratio_high/ours%ratio_low)/(2*1.96_wp), &
                      ours%ratio_ratio)
         end associate
      end do
   end subroutine estimate_dof

   subroutine take(score, truth, plain, ours, stated, ratio)
      type(score_type), intent(inout) :: score
      real(wp), intent(in) :: truth, plain, ours, stated, ratio

      score%n = score%n + 1
      score%plain = score%plain + (plain - truth)**2
      score%ours = score%ours + (ours - truth)**2
      score%stated = score%stated + stated**2
      if (abs(ours - truth) <= 1.96_wp*stated + 1.0e-14_wp*abs(truth)) &
         score%covers = score%covers + 1
      if (abs(plain - truth) <= 1.96_wp*stated*ratio + 1.0e-14_wp*abs(truth)) &
         score%plain_covers = score%plain_covers + 1
   end subroutine take

   subroutine print_all()
      character(8), parameter :: slips(4) = [character(8) :: 'mean', 'std', 'slip5', 'slip95']
      character(8), parameter :: spectra(3) = [character(8) :: 'psd_mean', 'psd5', 'psd95']
      character(8), parameter :: integrals(4) = [character(8) :: 'var_mean', 'var5', 'var95', &
                                                 'ratio']
      integer :: c, f, j, q

      print '(a, f8.3)', '# seconds per replicate ', seconds/(last - first + 1)
      do c = 1, n_cases
         do j = 1, n_joints
            do q = 1, 4
               call print_score(c, j, slips(q), 0.0_wp, slip_score(q, j, c))
               call print_score(c, j, integrals(q), 0.0_wp, integral_score(q, j, c))
            end do
            do f = 1, size(frequency)
               do q = 1, 3
                  call print_score(c, j, spectra(q), frequency(f), spectrum_score(q, f, j, c))
               end do
            end do
         end do
      end do
   end subroutine print_all

   subroutine print_score(c, j, name, at, score)
      integer, intent(in) :: c, j
      character(*), intent(in) :: name
      real(wp), intent(in) :: at
      type(score_type), intent(in) :: score

      associate (n => real(score%n, wp))
         print '(a, 1x, i0, 1x, a, f10.4, 3es13.5, 2f8.4)', trim(words(5 + c)), j, trim(name), at, &
            sqrt(score%plain/n), sqrt(score%ours/n), sqrt(score%stated/n), score%plain_covers/n, &
            score%covers/n
      end associate
   end subroutine print_score

end program regression
