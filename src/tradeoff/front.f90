!> From measured tasks to what a user decides by: the error and cost of every setting, the settings
!> that no other beats in both, the cheapest for a wanted error, and the error's components.
module tradeoff_front
   use campaign_plan, only: plan_type
   use campaign_samples_needed, only: error_with, law_share, slip_error
   use core_kinds, only: long, wp
   use numerics_correlated, only: error_of_batches, n_batches
   use numerics_spectrum, only: error_of_density
   use tradeoff_settings, only: expected_cost, setting_type
   use tradeoff_task_results, only: band_ratio, n_published, psd_mean, psd_percentiles, slip, &
                                    slip_std, task_result
   use tradeoff_tasks, only: of_batch, of_samples, of_setting, of_spectrum, tradeoff_type
   implicit none(type, external)
   private
   public :: error_components, setting_row, size_row, spectrum_row
   public :: rows_of, size_rows_of, slip_error_to_come, spectrum_rows_of, components_of, best, &
             is_random, keeps, sample_steps

   !> A setting measured.
   type :: setting_row
      type(setting_type) :: setting
      real(wp) :: error(n_published) = 0.0_wp    !! as task_result has them, of all levels
      real(wp) :: surely(n_published) = 0.0_wp   !! with twice its standard error
      real(wp) :: cost = 0.0_wp               !! [ns of a processor] of a sample-step of the scene
      real(wp) :: work = 0.0_wp               !! the same as expected from counted work
      logical :: is_on_front = .false.        !! nothing cheaper has a smaller error of slip
      logical :: is_own = .false.             !! the scene's
   end type setting_row

   !> A way to form spectra.
   type :: spectrum_row
      integer :: every = 1
      integer :: segment_length = 0         !! [steps]
      real(wp) :: cost = 0.0_wp             !! [ns] of a sample-step, march included
      real(wp) :: band_ratio = 0.0_wp       !! largest relative change, from every step's
   end type spectrum_row

   !> The whole error that other numbers of samples and steps would leave.
   type :: size_row
      integer :: n_samples = 0
      integer(long) :: n_steps = 0
      real(wp) :: error(n_published) = 0.0_wp   !! as task_result has them
      real(wp) :: seconds = 0.0_wp              !! of a processor
   end type size_row

   !> Parts of the error that the scene has now.
   type :: error_components
      real(wp) :: discretisation(n_published) = 0.0_wp
      real(wp) :: time(n_published) = 0.0_wp      !! n_steps are finite
      real(wp) :: samples(n_published) = 0.0_wp   !! n_samples are finite: of the scene's estimator
      real(wp) :: times_to_halve = 4.0_wp         !! as many samples halve that of slip
      !> time-average error of slip of one sample [points] where each has its own record, as the
      !> scatter over samples of a short march holds it too; else 0
      real(wp) :: noise = 0.0_wp
   end type error_components

contains

   !> The rows of all settings, in their order.
   pure function rows_of(tradeoff) result(rows)
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), allocatable :: rows(:)
      real(wp) :: share(size(tradeoff%levels))
      integer :: i, k, n

      n = size(tradeoff%settings)
      share = [(real(tradeoff%levels(k)%n_all, wp), k=1, size(tradeoff%levels))]
      share = share/sum(share)
      allocate (rows(n))
      do i = 1, n
         rows(i)%setting = tradeoff%settings(i)
         rows(i)%is_own = i == tradeoff%own
         rows(i)%work = sum(share*[(expected_cost(rows(i)%setting, tradeoff%plan%structure%n_dof, &
                                                 size(tradeoff%levels(k)%sample), &
                                                 tradeoff%transitions(k)), k=1, size(share))])
      end do
      do i = 1, size(tradeoff%tasks)
         associate (task => tradeoff%tasks(i))
            if (task%kind /= of_setting) cycle
            rows(task%row)%cost = rows(task%row)%cost + share(task%level)*tradeoff%found(i)%cost
            rows(task%row)%error = max(rows(task%row)%error, tradeoff%found(i)%errors(:, 1))
            rows(task%row)%surely = max(rows(task%row)%surely, tradeoff%found(i)%errors(:, 2))
         end associate
      end do
      do i = 1, n
         rows(i)%is_on_front = .not. any(beats(rows, rows(i)))
      end do
   end function rows_of

   !> Not worse in cost and error, and better in one of them.
   elemental logical function beats(a, b)
      type(setting_row), intent(in) :: a, b

      beats = a%cost <= b%cost .and. a%error(slip) <= b%error(slip) .and. &
              (a%cost < b%cost .or. a%error(slip) < b%error(slip))
   end function beats

   !> True if the measured error plus twice its standard error is within what is wanted.
   elemental logical function keeps(row, slip_points, ratio)
      type(setting_row), intent(in) :: row
      real(wp), intent(in) :: slip_points, ratio   !! 0: not wanted

      keeps = (.not. slip_points > 0.0_wp .or. row%surely(slip) <= slip_points) .and. &
              (.not. ratio > 0.0_wp .or. row%surely(band_ratio) <= ratio)
   end function keeps

   !> The row that comes nearest to what is wanted.
   pure function best(rows, slip_points, ratio) result(best_row)
      type(setting_row), intent(in) :: rows(:)
      real(wp), intent(in) :: slip_points, ratio   !! 0: not wanted
      integer :: best_row
      real(wp) :: excess(size(rows))

      excess = 0.0_wp
      if (slip_points > 0.0_wp) excess = rows%surely(slip)/slip_points
      if (ratio > 0.0_wp) excess = max(excess, rows%surely(band_ratio)/ratio)
      best_row = minloc(excess, 1)
   end function best

   !> The ways to form spectra, each compared with the first.
   pure function spectrum_rows_of(tradeoff) result(rows)
      type(tradeoff_type), intent(in) :: tradeoff
      type(spectrum_row), allocatable :: rows(:)
      real(wp) :: ratio(tradeoff%plan%structure%n_dof, size(tradeoff%every), size(tradeoff%levels))
      integer :: i

      allocate (rows(size(tradeoff%every)))
      rows%every = tradeoff%every
      rows%segment_length = tradeoff%segment_length
      do i = 1, size(tradeoff%tasks)
         associate (task => tradeoff%tasks(i), found => tradeoff%found(i))
            if (task%kind /= of_spectrum) cycle
            rows(task%row)%cost = rows(task%row)%cost + found%cost/size(ratio, 3)
            ratio(:, task%row, task%level) = found%value(:size(ratio, 1), band_ratio)
         end associate
      end do
      do i = 1, size(rows)
         rows(i)%band_ratio = maxval(abs(ratio(:, i, :) - ratio(:, 1, :)) &
                                     /merge(ratio(:, 1, :), 1.0_wp, ratio(:, 1, :) > 0.0_wp))
      end do
   end function spectrum_rows_of

   !> Parts of the error of the scene's results.
   pure function components_of(tradeoff, own, n_steps) result(errors)
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: own   !! the scene's setting
      integer, intent(in) :: n_steps         !! of the scene, after those discarded
      type(error_components) :: errors
      real(wp) :: few, fewer(n_published), many
      integer :: i

      errors%discretisation = own%error
      call add_time_averages(tradeoff, n_steps, errors)
      errors%samples = error_of_samples(tradeoff, errors, 1.0_wp)
      few = 1.0_wp
      many = 4.0_wp   ! plain sampling; no estimator falls more slowly
      do i = 1, 12
         fewer = error_of_samples(tradeoff, errors, sqrt(few*many))
         if (fewer(slip) > 0.5_wp*errors%samples(slip)) then
            few = sqrt(few*many)
         else
            many = sqrt(few*many)
         end if
      end do
      errors%times_to_halve = many
   end function components_of

   !> Standard errors of mean slip fractions that the scene's results will have, the joints of all
   !> cases that were looked at in a row.
   pure function slip_error_to_come(plan, tradeoff) result(error)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(slip_error) :: error
      type(error_components) :: errors
      real(wp), allocatable :: now(:), ratio(:)
      real(wp) :: w
      integer :: i, n_steps

      n_steps = plan%integration%n_steps - plan%integration%n_discard
      call add_time_averages(tradeoff, n_steps, errors)
      error%n_samples = maxval(plan%cases%n_samples)
      error%has_own_records = plan%excitation%per_sample
      error%n_cases = maxval(tradeoff%n_cases)
      allocate (error%samples(0), error%ratio(0))
      associate (n => real(error%n_samples, wp))
         do i = 1, size(tradeoff%tasks)
            if (tradeoff%tasks(i)%kind /= of_samples) cycle
            associate (n_cases => tradeoff%n_cases(tradeoff%cases(tradeoff%tasks(i)%row)))
               w = tradeoff%found(i)%n_samples
               call mean_slip_errors(tradeoff%found(i), errors%noise, now, ratio)
               error%samples = [error%samples, error_with(n, w, now, ratio, 0.0_wp, n_cases)]
               error%ratio = [error%ratio, now*ratio*sqrt(w/n)]   ! plain sampling's error
            end associate
         end do
         if (error%has_own_records) then   ! samples lower both
            error%samples = hypot(error%samples, errors%time(slip))
            error%ratio = hypot(error%ratio, errors%time(slip))
         end if
         error%ratio = max(1.0_wp, error%ratio/max(error%samples, tiny(1.0_wp)))
         error%record = 0.0_wp*error%samples
         if (.not. error%has_own_records) error%record = error%record + errors%time(slip)
         error%own = 0.0_wp*error%samples + errors%time(slip) &
                     *merge(sqrt(n), 1.0_wp, error%has_own_records)
      end associate
   end function slip_error_to_come

   !> Adds, from batches, their mean over a march of the scene's length. Where every sample has a
   !> force of its own, the mean over samples averages their errors too.
   pure subroutine add_time_averages(tradeoff, n_steps, errors)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: n_steps
      type(error_components), intent(inout) :: errors
      real(wp), allocatable :: series(:, :, :)   ! (joint or dof, published number, batch)
      real(wp) :: shorter
      integer :: i, k, q

      associate (structure => tradeoff%plan%structure)
         allocate (series(max(structure%n_joints, structure%n_dof), n_published, n_batches))
      end associate
      if (tradeoff%n_segments > 0) &
         errors%time([psd_mean, psd_percentiles]) = error_of_density(tradeoff%n_segments)
      do k = 1, size(tradeoff%levels)
         do i = 1, size(tradeoff%tasks)
            associate (task => tradeoff%tasks(i))
               if (task%kind == of_batch .and. task%level == k) &
                  series(:, :, task%row) = tradeoff%found(i)%value
            end associate
         end do
         associate (level => tradeoff%levels(k), plan => tradeoff%plan, error => errors%time)
            shorter = sqrt(real(tradeoff%long%integration%n_steps, wp)/n_steps)
            if (plan%excitation%per_sample) &
               shorter = shorter*sqrt(real(size(level%sample), wp) &
                                      /maxval(plan%cases(level%case_number)%n_samples))
            do i = 1, size(series, 1)
               do q = slip, slip_std
                  error(q) = max(error(q), shorter*error_of_batches(series(i, q, :)))
               end do
               if (.not. minval(series(i, band_ratio, :)) > 0.0_wp) cycle
               error(band_ratio) = max(error(band_ratio), &
                                       shorter*error_of_batches(log(series(i, band_ratio, :))))
            end do
         end associate
      end do
      associate (plan => tradeoff%plan)
         if (plan%excitation%per_sample) errors%noise = errors%time(slip) &
            *sqrt(maxval(plan%cases%n_samples)*real(n_steps, wp)/plan%integration%n_steps)
      end associate
   end subroutine add_time_averages

   !> The component of finite samples with so many times the scene's.
   pure function error_of_samples(tradeoff, errors, times) result(error)
      type(tradeoff_type), intent(in) :: tradeoff
      type(error_components), intent(in) :: errors   !! time averages
      real(wp), intent(in) :: times
      real(wp) :: error(n_published)
      real(wp), allocatable :: now(:), ratio(:)
      integer :: i

      error = 0.0_wp
      do i = 1, size(tradeoff%tasks)
         if (tradeoff%tasks(i)%kind /= of_samples) cycle
         associate (found => tradeoff%found(i), number => tradeoff%cases(tradeoff%tasks(i)%row))
            call mean_slip_errors(found, errors%noise, now, ratio)
            associate (n => times*tradeoff%plan%cases(number)%n_samples, &
                       n_now => real(found%n_samples, wp), n_cases => tradeoff%n_cases(number), &
                       gain => found%gain(:, slip_std:))
               error(slip) = max(error(slip), &
                                 maxval(error_with(n, n_now, now, ratio, 0.0_wp, n_cases)))
               error(slip_std:) = max(error(slip_std:), &
                                      maxval(error_with(n, n_now, &
                                                        found%plain_error(:, slip_std:)/gain, &
                                                        gain, 0.0_wp, n_cases), 1))
            end associate
         end associate
      end do
   end function error_of_samples

   !> Finds standard errors of mean slip fractions for as many samples as were marched [points]
   !> without what their own records add, and plain sampling's over them.
   pure subroutine mean_slip_errors(found, noise, now, ratio)
      type(task_result), intent(in) :: found   !! of the samples of a case
      real(wp), intent(in) :: noise            !! of one sample [points]
      real(wp), allocatable, intent(out) :: now(:), ratio(:)   !! (joint)

      associate (w => real(found%n_samples, wp))
         now = (found%plain_error(:, slip)/found%gain(:, slip))**2 - noise**2/w
         ratio = sqrt(max(0.0_wp, found%plain_error(:, slip)**2 - noise**2/w))
         now = min(ratio, max(law_share*sqrt(w)*ratio, sqrt(max(0.0_wp, now))))
      end associate
      where (now > 0.0_wp)
         ratio = ratio/now
      else where
         ratio = 1.0_wp
      end where
   end subroutine mean_slip_errors

   !> Quarters and multiples of the scene's samples and steps, by the laws that errors follow:
   !> the discretisation stays, Monte Carlo falls as the scene's estimator lets it, time averages
   !> with the root of the steps, and of the samples too where every sample has its own force.
   pure function size_rows_of(plan, tradeoff, own, errors) result(rows)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: own   !! the scene's setting
      type(error_components), intent(in) :: errors
      type(size_row), allocatable :: rows(:)
      real(wp), parameter :: samples(*) = 0.25_wp*[1, 4, 4, 4, 16, 16, 64]
      real(wp), parameter :: steps(*) = 0.25_wp*[4, 1, 4, 16, 4, 16, 4]
      integer :: i

      rows = [(row(samples(i), steps(i)), i=1, size(samples))]
      ! samples of one friction under one force are the same
      rows = pack(rows, is_random(plan) .and. rows%n_samples > 1 .or. &
                  abs(samples - 1.0_wp) <= 0.0_wp)

   contains

      pure type(size_row) function row(more_samples, more_steps)
         real(wp), intent(in) :: more_samples, more_steps
         real(wp) :: of_samples(n_published), of_time

         of_samples = error_of_samples(tradeoff, errors, more_samples)
         of_time = more_steps*merge(more_samples, 1.0_wp, plan%excitation%per_sample)
         row%n_samples = nint(more_samples*maxval(plan%cases%n_samples))
         row%n_steps = nint(more_steps*plan%integration%n_steps, long)
         row%error = sqrt(errors%discretisation**2 + errors%time**2/of_time + of_samples**2)
         row%seconds = 1.0e-9_wp*own%cost*sample_steps(plan)*more_samples*more_steps
      end function row

   end function size_rows_of

   !> True if samples of a case differ.
   pure logical function is_random(plan)
      type(plan_type), intent(in) :: plan

      is_random = any(plan%cases%process > 0)
   end function is_random

   !> Steps that all samples of the scene march together.
   pure function sample_steps(plan) result(n)
      type(plan_type), intent(in) :: plan
      real(wp) :: n

      n = real(plan%integration%n_steps, wp)*sum(plan%cases%n_samples)
   end function sample_steps

end module tradeoff_front
