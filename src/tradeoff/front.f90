!> Evaluates the trial marches: error and cost of every setting, the Pareto front of both, the
!> components of the scene's error, and the errors with other numbers of samples and steps.
module tradeoff_front
   use campaign_plan, only: plan_type
   use campaign_samples_needed, only: error_with, law_share, slip_error
   use core_kinds, only: long, wp
   use numerics_correlated, only: error_of_batches, n_batches
   use numerics_spectrum, only: error_of_density
   use tradeoff_settings, only: expected_cost, setting_type
   use tradeoff_task_results, only: band_ratio, n_published, psd_mean, psd_percentiles, slip, &
                                    slip_std, task_result
   use tradeoff_tasks, only: batch_task, samples_task, setting_task, spectrum_task, tradeoff_type
   implicit none(type, external)
   private
   public :: error_parts, setting_row, size_row, spectrum_row
   public :: components_of, has_drawn_friction, meets_targets, nearest_to_targets, &
             setting_rows_of, size_rows_of, predicted_slip_error, spectrum_rows_of

   !> Measured setting.
   type :: setting_row
      type(setting_type) :: setting
      real(wp) :: error(n_published) = 0.0_wp    !! largest error over the levels, as in task_result
      real(wp) :: error_bound(n_published) = 0.0_wp   !! error plus twice its standard error
      real(wp) :: cost = 0.0_wp               !! processor time of a sample-step of the scene [ns]
      real(wp) :: seconds = 0.0_wp            !! processor time of the scene's march
      real(wp) :: work = 0.0_wp               !! expected_cost of a sample-step of the scene [ns]
      logical :: is_on_front = .false.        !! no cheaper setting has a smaller error of slip
      logical :: is_own = .false.             !! setting of the scene
   end type setting_row

   !> Measured pair of spectrum_every and segment_length.
   type :: spectrum_row
      integer :: every = 1
      integer :: segment_length = 0         !! [step]
      real(wp) :: cost = 0.0_wp             !! processor time of a sample-step, march included [ns]
      real(wp) :: band_ratio = 0.0_wp       !! largest relative change against the first row
   end type spectrum_row

   !> Total error with other numbers of samples and steps.
   type :: size_row
      integer :: n_samples = 0
      integer(long) :: n_steps = 0
      real(wp) :: error(n_published) = 0.0_wp
      real(wp) :: seconds = 0.0_wp              !! processor time
   end type size_row

   !> Components of the error of the scene's results.
   type :: error_parts
      real(wp) :: discretisation(n_published) = 0.0_wp   !! numerical error
      real(wp) :: time(n_published) = 0.0_wp      !! time-average error
      real(wp) :: samples(n_published) = 0.0_wp   !! Monte Carlo error of the scene's estimator
      real(wp) :: times_to_halve = 4.0_wp         !! factor on n_samples that halves samples(slip)
      !> time-average error of the slip fraction of one sample [points] if each has its own record
      !> (the scatter over samples of a short march contains it); else 0
      real(wp) :: noise = 0.0_wp
   end type error_parts

contains

   !> Rows of all settings, in their order.
   pure function setting_rows_of(tradeoff) result(rows)
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
                                                  size(tradeoff%levels(k)%samples), &
                                                  tradeoff%levels(k)%transitions), &
                              k=1, size(share))])
         rows(i)%cost = tradeoff%history_time*rows(i)%setting%parts/rows(i)%setting%stride
      end do
      do i = 1, size(tradeoff%tasks)
         if (tradeoff%tasks(i)%kind /= setting_task) cycle
         associate (row => rows(tradeoff%tasks(i)%row), result => tradeoff%results(i))
            row%cost = row%cost + share(tradeoff%tasks(i)%level)*result%cost
            row%error = max(row%error, result%errors(:, 1))
            row%error_bound = max(row%error_bound, result%errors(:, 2))
         end associate
      end do
      rows%seconds = 1.0e-9_wp*rows%cost*tradeoff%sample_steps
      do i = 1, n
         rows(i)%is_on_front = .not. any(dominates(rows, rows(i)))
      end do
   end function setting_rows_of

   !> True if setting a is not worse than b in cost and error of slip, and better in one of the two.
   elemental logical function dominates(a, b)
      type(setting_row), intent(in) :: a, b

      dominates = a%cost <= b%cost .and. a%error(slip) <= b%error(slip) .and. &
              (a%cost < b%cost .or. a%error(slip) < b%error(slip))
   end function dominates

   !> True if the measured errors plus twice their standard errors meet the targets.
   elemental logical function meets_targets(row, slip_points, ratio)
      type(setting_row), intent(in) :: row
      real(wp), intent(in) :: slip_points, ratio   !! 0: not wanted

      meets_targets = (.not. slip_points > 0.0_wp .or. row%error_bound(slip) <= slip_points) .and. &
                      (.not. ratio > 0.0_wp .or. row%error_bound(band_ratio) <= ratio)
   end function meets_targets

   !> Number of the row with the smallest ratio of error to target.
   pure integer function nearest_to_targets(rows, slip_points, ratio) result(best_row)
      type(setting_row), intent(in) :: rows(:)
      real(wp), intent(in) :: slip_points, ratio   !! 0: not wanted
      real(wp) :: excess(size(rows))

      excess = 0.0_wp
      if (slip_points > 0.0_wp) excess = rows%error_bound(slip)/slip_points
      if (ratio > 0.0_wp) excess = max(excess, rows%error_bound(band_ratio)/ratio)
      best_row = minloc(excess, 1)
   end function nearest_to_targets

   !> Rows of all spectra, each compared with the first.
   pure function spectrum_rows_of(tradeoff) result(rows)
      type(tradeoff_type), intent(in) :: tradeoff
      type(spectrum_row), allocatable :: rows(:)
      real(wp) :: ratio(tradeoff%plan%structure%n_dof, size(tradeoff%every), size(tradeoff%levels))
      integer :: i

      allocate (rows(size(tradeoff%every)))
      rows%every = tradeoff%every
      rows%segment_length = tradeoff%segment_length
      do i = 1, size(tradeoff%tasks)
         associate (task => tradeoff%tasks(i), found => tradeoff%results(i))
            if (task%kind /= spectrum_task) cycle
            rows(task%row)%cost = rows(task%row)%cost + found%cost/size(ratio, 3)
            ratio(:, task%row, task%level) = found%value(:size(ratio, 1), band_ratio)
         end associate
      end do
      do i = 1, size(rows)
         rows(i)%band_ratio = maxval(abs(ratio(:, i, :) - ratio(:, 1, :)) &
                                     /merge(ratio(:, 1, :), 1.0_wp, ratio(:, 1, :) > 0.0_wp))
      end do
   end function spectrum_rows_of

   !> Components of the error of the scene's results.
   pure type(error_parts) function components_of(tradeoff, own, n_steps) result(errors)
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: own   !! row of the scene's setting
      integer, intent(in) :: n_steps         !! measured steps of the scene
      real(wp) :: error(n_published), high, low
      integer :: i

      errors%discretisation = own%error
      call add_time_average_errors(tradeoff, n_steps, errors)
      errors%samples = monte_carlo_error(tradeoff, errors, 1.0_wp)
      low = 1.0_wp    ! bisection for the factor on n_samples, on a logarithmic scale
      high = 4.0_wp   ! plain sampling's; no estimator needs more
      do i = 1, 12
         error = monte_carlo_error(tradeoff, errors, sqrt(low*high))
         if (error(slip) > 0.5_wp*errors%samples(slip)) then
            low = sqrt(low*high)
         else
            high = sqrt(low*high)
         end if
      end do
      errors%times_to_halve = high
   end function components_of

   !> Expected standard errors of the mean slip fractions of the scene's results: the joints of all
   !> measured cases in one list.
   pure type(slip_error) function predicted_slip_error(plan, tradeoff) result(error)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(error_parts) :: errors
      real(wp), allocatable :: now(:), ratio(:)
      real(wp) :: w
      integer :: i, n_steps

      n_steps = plan%integration%n_steps - plan%integration%n_discard
      call add_time_average_errors(tradeoff, n_steps, errors)
      error%n_samples = maxval(plan%cases%n_samples)
      error%has_own_records = plan%excitation%per_sample
      error%n_cases = maxval(tradeoff%n_cases)
      allocate (error%samples(0), error%ratio(0))
      associate (n => real(error%n_samples, wp))
         do i = 1, size(tradeoff%tasks)
            if (tradeoff%tasks(i)%kind /= samples_task) cycle
            associate (n_cases => tradeoff%n_cases(tradeoff%cases(tradeoff%tasks(i)%row)))
               w = tradeoff%results(i)%n_samples
               call mean_slip_errors(tradeoff%results(i), errors%noise, now, ratio)
               error%samples = [error%samples, error_with(n, w, w, now, ratio, 0.0_wp, n_cases)]
               error%ratio = [error%ratio, now*ratio*sqrt(w/n)]   ! plain sampling's error
            end associate
         end do
         error%record = spread(errors%time(slip), 1, size(error%samples))
         error%own = error%record
         if (error%has_own_records) then
            error%samples = hypot(error%samples, error%record)
            error%ratio = hypot(error%ratio, error%record)
            error%own = sqrt(n)*error%record
            error%record = 0.0_wp
         end if
         error%ratio = max(1.0_wp, error%ratio/max(error%samples, tiny(1.0_wp)))
      end associate
   end function predicted_slip_error

   !> Computes errors%time and errors%noise from the batches, for a march of n_steps. Errors fall as
   !> n_steps^(-1/2); if every sample has its own force, those of means over samples also fall as
   !> n_samples^(-1/2).
   pure subroutine add_time_average_errors(tradeoff, n_steps, errors)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: n_steps
      type(error_parts), intent(inout) :: errors
      real(wp), allocatable :: series(:, :, :)   ! (joint or dof, published number, batch)
      real(wp) :: factor
      integer :: i, k, q

      associate (plan => tradeoff%plan, error => errors%time)
         allocate (series(max(plan%structure%n_joints, plan%structure%n_dof), n_published, &
                          n_batches))
         if (tradeoff%n_segments > 0) &
            error([psd_mean, psd_percentiles]) = error_of_density(tradeoff%n_segments)
         do k = 1, size(tradeoff%levels)
            do i = 1, size(tradeoff%tasks)
               associate (task => tradeoff%tasks(i))
                  if (task%kind == batch_task .and. task%level == k) &
                     series(:, :, task%row) = tradeoff%results(i)%value
               end associate
            end do
            factor = sqrt(real(tradeoff%long_plan%integration%n_steps, wp)/n_steps)
            associate (level => tradeoff%levels(k))
               if (plan%excitation%per_sample) &
                  factor = factor*sqrt(real(size(level%samples), wp) &
                                       /maxval(plan%cases(level%samples%case_number)%n_samples))
            end associate
            do i = 1, size(series, 1)
               do q = slip, slip_std
                  error(q) = max(error(q), factor*error_of_batches(series(i, q, :)))
               end do
               if (.not. minval(series(i, band_ratio, :)) > 0.0_wp) cycle
               error(band_ratio) = max(error(band_ratio), &
                                       factor*error_of_batches(log(series(i, band_ratio, :))))
            end do
         end do
         if (plan%excitation%per_sample) errors%noise = error(slip) &
            *sqrt(maxval(plan%cases%n_samples)*real(n_steps, wp)/plan%integration%n_steps)
      end associate
   end subroutine add_time_average_errors

   !> Monte Carlo errors with `factor` times the scene's samples.
   pure function monte_carlo_error(tradeoff, errors, factor) result(error)
      type(tradeoff_type), intent(in) :: tradeoff
      type(error_parts), intent(in) :: errors   !! errors with time averages
      real(wp), intent(in) :: factor
      real(wp) :: error(n_published)
      real(wp), allocatable :: now(:), ratio(:)
      integer :: i

      error = 0.0_wp
      do i = 1, size(tradeoff%tasks)
         if (tradeoff%tasks(i)%kind /= samples_task) cycle
         associate (found => tradeoff%results(i), number => tradeoff%cases(tradeoff%tasks(i)%row))
            call mean_slip_errors(found, errors%noise, now, ratio)
            associate (n => factor*tradeoff%plan%cases(number)%n_samples, &
                       n_now => real(found%n_samples, wp), n_cases => tradeoff%n_cases(number), &
                       gain => found%gain(:, slip_std:))
               error(slip) = max(error(slip), &
                                 maxval(error_with(n, n_now, n_now, now, ratio, 0.0_wp, n_cases)))
               error(slip_std:) = max(error(slip_std:), &
                                      maxval(error_with(n, n_now, n_now, &
                                                        found%plain_error(:, slip_std:)/gain, &
                                                        gain, 0.0_wp, n_cases), 1))
            end associate
         end associate
      end do
   end function monte_carlo_error

   !> Computes standard errors of mean slip fractions [points], for the marched samples and without
   !> the part that is due to their own records; and plain sampling's over them.
   pure subroutine mean_slip_errors(found, noise, now, ratio)
      type(task_result), intent(in) :: found   !! result of a samples task
      real(wp), intent(in) :: noise            !! as in error_parts
      real(wp), allocatable, intent(out) :: now(:), ratio(:)   !! (joint) error, ratio

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

   !> Total errors with quarters and multiples of the scene's samples and steps. The numerical error
   !> stays; the Monte Carlo error falls as that of the scene's estimator; the time-average error
   !> falls as n_steps^(-1/2), and as n_samples^(-1/2) too if every sample has its own force.
   pure function size_rows_of(plan, tradeoff, own, errors) result(rows)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: own   !! row of the scene's setting
      type(error_parts), intent(in) :: errors
      type(size_row), allocatable :: rows(:)
      real(wp), parameter :: samples(*) = 0.25_wp*[1, 4, 4, 4, 16, 16, 64]
      real(wp), parameter :: steps(*) = 0.25_wp*[4, 1, 4, 16, 4, 16, 4]
      integer :: i

      rows = [(row(samples(i), steps(i)), i=1, size(samples))]
      ! without drawn friction all samples are the same
      rows = pack(rows, has_drawn_friction(plan) .and. rows%n_samples > 1 .or. &
                  abs(samples - 1.0_wp) <= 0.0_wp)

   contains

      !> Row with the scene's samples and steps multiplied by factors.
      pure type(size_row) function row(sample_factor, step_factor)
         real(wp), intent(in) :: sample_factor, step_factor
         real(wp) :: time_factor

         time_factor = step_factor*merge(sample_factor, 1.0_wp, plan%excitation%per_sample)
         row%n_samples = nint(sample_factor*maxval(plan%cases%n_samples))
         row%n_steps = nint(step_factor*plan%integration%n_steps, long)
         row%error = sqrt(errors%discretisation**2 + errors%time**2/time_factor &
                          + monte_carlo_error(tradeoff, errors, sample_factor)**2)
         row%seconds = own%seconds*sample_factor*step_factor
      end function row

   end function size_rows_of

   !> True if a case draws its friction, so that its samples differ.
   pure logical function has_drawn_friction(plan)
      type(plan_type), intent(in) :: plan

      has_drawn_friction = any(plan%cases%process > 0)
   end function has_drawn_friction

end module tradeoff_front
