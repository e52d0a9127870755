!> What is marched to measure how accuracy depends on the settings, as tasks that any rank may take:
!> each gives a few numbers, and none needs another's.
!>
!> The error of a setting is measured against the event method at tolerance 1e-12, on the same
!> samples. The scatter of consecutive batches of a long march gives the error of time averages,
!> that of a case's samples the Monte Carlo error.
module ensemble_tradeoff_tasks
   use core_error, only: error_type
   use core_kinds, only: wp
   use ensemble_bands, only: band_collector, start_bands
   use ensemble_comparison, only: band_ratio_error, band_ratios, compare_slip, compare_spectra, &
                                  numerical_error, slip_error
   use ensemble_plan, only: plan_type
   use ensemble_results, only: block_result, case_statistics
   use ensemble_runner, only: block_width, prepare_runner, runner_type
   use ensemble_sample, only: stop_query
   use ensemble_tradeoff_sample, only: choose_levels, draw_level, fit_segments, level_type, &
                                       march_level, shortened
   use ensemble_tradeoff_settings, only: all_settings, expected_cost, own_setting, same_setting, &
                                         reference_setting, setting_type, settings_at_dt
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: error_of_deviation, standard_deviation
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: tradeoff_type, task_type, new_tradeoff, of_setting, of_spectrum, of_batch, of_samples
   public :: n_batches

   integer, parameter :: of_setting = 1, of_spectrum = 2, of_batch = 3, of_samples = 4
   integer, parameter :: n_batches = 8
   integer, parameter :: most_cases = 16          !! whose Monte Carlo error is estimated
   real(wp), parameter :: usual_transitions = 0.3_wp   !! in a step, where nothing is known yet
   type(setting_type), parameter :: usual = setting_type('event', tolerance=1.0e-6_wp)

   !> One piece of work, to be done by any rank.
   type :: task_type
      integer :: kind = of_setting
      integer :: row = 0       !! setting, way to form spectra, batch, or case
      integer :: level = 0     !! of force; none for a case
   end type task_type

   !> All that the tasks share, the same on every rank.
   type :: tradeoff_type
      type(plan_type) :: plan                         !! short: the marches that compare settings
      type(plan_type) :: long                         !! those that estimate what is statistical
      type(setting_type), allocatable :: settings(:)
      integer :: own = 0                              !! among them: the scene's
      type(level_type), allocatable :: levels(:)
      real(wp), allocatable :: transitions(:)         !! (level) of a sample in a step
      integer, allocatable :: every(:)                !! (way) every k-th step enters the spectra
      integer, allocatable :: segment_length(:)       !! (way) steps
      integer, allocatable :: cases(:)                !! whose Monte Carlo error is estimated
      type(task_type), allocatable :: tasks(:)        !! the longest first
      integer :: n_values = 0                         !! that a task gives
      type(block_result), allocatable, private :: references(:)   !! (level)
      type(runner_type), private :: runner            !! of the whole campaign
      type(process_model_type), allocatable, private :: models(:)
   contains
      procedure :: run_task
      procedure, private :: measure_setting
      procedure, private :: measure_spectrum
      procedure, private :: measure_batch
      procedure, private :: measure_samples
   end type tradeoff_type

contains

   !> Decides what is marched, within a budget of expected cost, and marches the references. Without
   !> models: only what tells the settings at the scene's own steps apart.
   subroutine new_tradeoff(plan, file_force, every, budget, should_stop, tradeoff, error, models)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0
      integer, intent(in) :: every                !! every k-th step enters the scene's spectra
      real(wp), intent(in) :: budget              !! [s] of a processor
      procedure(stop_query) :: should_stop
      type(tradeoff_type), intent(out) :: tradeoff
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type), intent(in), optional :: models(:)   !! (process)
      integer :: i, unit, width

      unit = 2*max(every, 1)
      call choose_levels(plan, tradeoff%levels)
      width = sum([(size(tradeoff%levels(i)%sample), i=1, size(tradeoff%levels))])
      if (present(models)) then
         tradeoff%models = models
         tradeoff%settings = all_settings(plan, plan%integration%n_steps >= 8*unit .and. &
                                          modulo(every, 2) == 0)
      else
         tradeoff%settings = settings_at_dt(plan)
      end if
      tradeoff%own = findloc(same_setting(tradeoff%settings, own_setting(plan)), .true., 1)
      associate (settings => tradeoff%settings)
         tradeoff%plan = shortened(plan, every, unit, int(min(1.0e9_wp*budget/(width*sum( &
            [(expected_cost(settings(i), plan, usual_transitions), i=1, size(settings))])), &
            1.0e9_wp)))
         tradeoff%long = shortened(plan, every, unit*n_batches, int(min( &
            0.1e9_wp*budget/(width*expected_cost(usual, plan, usual_transitions)), 1.0e9_wp)))
      end associate
      call prepare_runner(plan, file_force, tradeoff%runner, error)
      if (allocated(error)) return
      call draw_and_refer(tradeoff, should_stop, error)
      if (allocated(error)) return
      call list_tasks(tradeoff)
   end subroutine new_tradeoff

   !> Friction, force and reference of every level.
   subroutine draw_and_refer(tradeoff, should_stop, error)
      type(tradeoff_type), intent(inout) :: tradeoff
      procedure(stop_query) :: should_stop
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: unused
      logical :: is_abandoned
      integer :: k, n

      n = max(tradeoff%plan%integration%n_steps, tradeoff%long%integration%n_steps)
      allocate (tradeoff%references(size(tradeoff%levels)))
      allocate (tradeoff%transitions(size(tradeoff%levels)), source=0.0_wp)
      do k = 1, size(tradeoff%levels)
         associate (level => tradeoff%levels(k), reference => tradeoff%references(k), &
                    plan => tradeoff%plan)
            if (allocated(tradeoff%models)) then
               call draw_level(tradeoff%runner%plan, tradeoff%runner, n, level, error, &
                               tradeoff%models)
            else
               call draw_level(tradeoff%runner%plan, tradeoff%runner, n, level, error)
            end if
            if (allocated(error)) return
            call march_level(plan, level, reference_setting(), should_stop, reference, unused, &
                             is_abandoned, error)
            if (allocated(error) .or. is_abandoned) return
            tradeoff%transitions(k) = &
               real(sum(reference%slip_starts + reference%stick_starts), wp) &
               /(real(plan%integration%n_steps, wp)*size(level%sample))
         end associate
      end do
   end subroutine draw_and_refer

   !> Every setting with every level, the dearest first; then what is statistical, if models are
   !> there: every way to form spectra and every batch with every level, and the cases.
   subroutine list_tasks(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      type(task_type), allocatable :: tasks(:)
      real(wp) :: cost(size(tradeoff%settings)*size(tradeoff%levels))
      integer :: i, k, n_levels

      n_levels = size(tradeoff%levels)
      tradeoff%n_values = 9 + 3*tradeoff%plan%chain%n_dof
      associate (settings => tradeoff%settings)
         tasks = [((task_type(of_setting, i, k), k=1, n_levels), i=1, size(settings))]
         cost = [((expected_cost(settings(i), tradeoff%plan, tradeoff%transitions(k)), &
                   k=1, n_levels), i=1, size(settings))]
      end associate
      tradeoff%tasks = tasks(sort_order(-cost))
      allocate (tradeoff%every(0), tradeoff%segment_length(0), tradeoff%cases(0))
      if (.not. allocated(tradeoff%models)) return
      call choose_ways(tradeoff)
      call choose_cases(tradeoff)
      tasks = [((task_type(of_batch, i, k), i=1, n_batches), k=1, n_levels), &
               ((task_type(of_spectrum, i, k), i=1, size(tradeoff%every)), k=1, n_levels), &
               (task_type(of_samples, i, 0), i=1, size(tradeoff%cases))]
      tradeoff%tasks = [tradeoff%tasks, tasks]
   end subroutine list_tasks

   !> Ways to form spectra: every step first, which the others are compared with; sparser ones; and
   !> shorter and longer segments at the scene's own rate.
   pure subroutine choose_ways(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, parameter :: values = 16   ! least of a segment
      integer :: k, length

      if (.not. tradeoff%long%output%spectrum .or. all_single(tradeoff%levels)) return
      associate (own => tradeoff%long%output%segment_length, &
                 every => tradeoff%long%output%spectrum_every)
         do k = 0, 4
            if (modulo(own, 2**(k + 1)) /= 0 .or. own/2**k < values) exit
            tradeoff%every = [tradeoff%every, 2**k]
            tradeoff%segment_length = [tradeoff%segment_length, own]
         end do
         do k = -3, 1
            length = int(own*2.0_wp**k)
            if (k == 0 .or. modulo(length, 2*every) /= 0 .or. length < values*every) cycle
            if (2*length > tradeoff%long%integration%n_steps) cycle
            tradeoff%every = [tradeoff%every, every]
            tradeoff%segment_length = [tradeoff%segment_length, length]
         end do
      end associate
   end subroutine choose_ways

   pure logical function all_single(levels)
      type(level_type), intent(in) :: levels(:)
      integer :: k

      all_single = all([(size(levels(k)%sample) == 1, k=1, size(levels))])
   end function all_single

   !> Cases with drawn friction, evenly among all where they are many.
   pure subroutine choose_cases(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, allocatable :: random(:)
      integer :: i, n

      associate (cases => tradeoff%plan%cases)
         random = pack([(i, i=1, size(cases))], cases%process > 0)
      end associate
      n = min(most_cases, size(random))
      tradeoff%cases = [(random(1 + ((i - 1)*size(random))/n), i=1, n)]
   end subroutine choose_cases

   !> Numbers of a task, the first the cost of a sample-step [ns of a processor]:
   !> of a setting, slip fractions [points] rms over samples and its standard error, their mean,
   !> their standard deviation; mean spectrum, percentiles, band ratio and its standard error
   !> [relative];
   !> of a way, band ratios (dof);
   !> of a batch, mean slip fractions [points] (dof), band ratios (dof);
   !> of a case, standard deviation over samples of slip fractions and its standard error [points]
   !> (dof each), standard error of the logarithm of the band ratio (dof), for as many samples as
   !> were marched, which is the last number.
   subroutine run_task(self, number, should_stop, values, is_abandoned, error)
      class(tradeoff_type), intent(in) :: self
      integer, intent(in) :: number
      procedure(stop_query) :: should_stop
      real(wp), intent(out) :: values(:)   !! (n_values)
      logical, intent(out) :: is_abandoned
      type(error_type), allocatable, intent(out) :: error

      values = 0.0_wp
      associate (task => self%tasks(number))
         select case (task%kind)
         case (of_setting)
            call self%measure_setting(task, should_stop, values, is_abandoned, error)
         case (of_spectrum)
            call self%measure_spectrum(task, should_stop, values, is_abandoned, error)
         case (of_batch)
            call self%measure_batch(task, should_stop, values, is_abandoned, error)
         case default
            call self%measure_samples(task, should_stop, values, is_abandoned, error)
         end select
      end associate
   end subroutine run_task

   subroutine measure_setting(self, task, should_stop, values, is_abandoned, error)
      class(tradeoff_type), intent(in) :: self
      type(task_type), intent(in) :: task
      procedure(stop_query) :: should_stop
      real(wp), intent(inout) :: values(:)
      logical, intent(out) :: is_abandoned
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: result
      type(numerical_error) :: errors

      associate (level => self%levels(task%level), reference => self%references(task%level))
         call march_level(self%plan, level, self%settings(task%row), should_stop, result, &
                          values(1), is_abandoned, error)
         if (allocated(error) .or. is_abandoned) return
         call compare_cases(level, self%plan%cases%n_samples, result%slip_fraction, &
                            reference%slip_fraction, values(2:5))
         if (.not. self%plan%output%spectrum) return
         call compare_spectra(result%psd, reference%psd, self%plan%output%percentiles, &
                              level%n_all, errors)
         values(6) = maxval(errors%psd_mean)
         if (size(level%sample) == 1) return
         values(7) = maxval(errors%psd_percentiles)
         values(8) = band_ratio_error(errors)
         values(9) = maxval(errors%band_ratio_error)
      end associate
   end subroutine measure_setting

   !> The largest errors of slip fractions over the cases of a level; the standard error such that
   !> twice of it covers that of every case. One sample of many says as much as its error is large.
   pure subroutine compare_cases(level, n_samples, tested, reference, values)
      type(level_type), intent(in) :: level
      integer, intent(in) :: n_samples(:)       !! (case)
      real(wp), intent(in) :: tested(:, :)      !! (dof, sample)
      real(wp), intent(in) :: reference(:, :)   !! (dof, sample)
      real(wp), intent(out) :: values(4)        !! rms, its standard error, mean, standard deviation
      type(numerical_error) :: errors
      real(wp) :: scatter, surely
      integer, allocatable :: samples(:)
      integer :: c, i

      values = 0.0_wp
      surely = 0.0_wp
      do c = 1, size(n_samples)
         samples = pack([(i, i=1, size(level%sample))], level%case_number == c)
         if (size(samples) == 0) cycle
         errors = numerical_error()
         call compare_slip(tested(:, samples), reference(:, samples), n_samples(c), errors)
         scatter = 0.0_wp
         if (size(samples) > 1) then
            scatter = maxval(errors%slip_rms_error)
            values(4) = max(values(4), maxval(abs(errors%slip_std)))
         else if (n_samples(c) > 1) then
            scatter = slip_error(errors)
         end if
         surely = max(surely, slip_error(errors) + 2*scatter)
         values(1) = max(values(1), slip_error(errors))
         values(3) = max(values(3), maxval(abs(errors%slip_mean)))
      end do
      values(2) = 0.5_wp*(surely - values(1))
   end subroutine compare_cases

   subroutine measure_spectrum(self, task, should_stop, values, is_abandoned, error)
      class(tradeoff_type), intent(in) :: self
      type(task_type), intent(in) :: task
      procedure(stop_query) :: should_stop
      real(wp), intent(inout) :: values(:)
      logical, intent(out) :: is_abandoned
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: plan
      type(block_result) :: result

      plan = self%long
      plan%output%spectrum_every = self%every(task%row)
      plan%output%segment_length = self%segment_length(task%row)
      call march_level(plan, self%levels(task%level), usual, should_stop, result, values(1), &
                       is_abandoned, error)
      if (allocated(error) .or. is_abandoned) return
      if (result%n_samples > 1) &
         values(2:1 + plan%chain%n_dof) = band_ratios(result%psd, plan%output%percentiles)
   end subroutine measure_spectrum

   subroutine measure_batch(self, task, should_stop, values, is_abandoned, error)
      class(tradeoff_type), intent(in) :: self
      type(task_type), intent(in) :: task
      procedure(stop_query) :: should_stop
      real(wp), intent(inout) :: values(:)
      logical, intent(out) :: is_abandoned
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: plan
      type(block_result) :: result
      integer :: n, n_dof

      plan = self%long
      n_dof = plan%chain%n_dof
      n = plan%integration%n_steps/n_batches
      plan%integration%n_steps = task%row*n
      plan%integration%n_discard = (task%row - 1)*n
      call fit_segments(n, plan)
      call march_level(plan, self%levels(task%level), usual, should_stop, result, values(1), &
                       is_abandoned, error)
      if (allocated(error) .or. is_abandoned) return
      values(2:1 + n_dof) = 100.0_wp*sum(result%slip_fraction, 2)/result%n_samples
      if (plan%output%spectrum .and. result%n_samples > 1) &
         values(2 + n_dof:1 + 2*n_dof) = band_ratios(result%psd, plan%output%percentiles)
   end subroutine measure_batch

   subroutine measure_samples(self, task, should_stop, values, is_abandoned, error)
      class(tradeoff_type), intent(in) :: self
      type(task_type), intent(in) :: task
      procedure(stop_query) :: should_stop
      real(wp), intent(inout) :: values(:)
      logical, intent(out) :: is_abandoned
      type(error_type), allocatable, intent(out) :: error
      type(level_type) :: level
      type(block_result) :: result
      type(case_statistics) :: statistics
      type(band_collector) :: bands
      integer :: dof, i, n_dof, w

      is_abandoned = .false.
      associate (plan => self%plan, c => self%cases(task%row))
         n_dof = plan%chain%n_dof
         w = block_width(self%runner%plan)
         if (plan%excitation%kind == 'file' .and. plan%excitation%per_sample) &
            w = min(w, plan%cases(c)%n_samples)
         values(size(values)) = w
         if (w < 2) return
         level%case_number = [(c, i=1, w)]
         level%sample = [(i, i=1, w)]
         call draw_level(self%runner%plan, self%runner, plan%integration%n_steps, level, error, &
                         self%models)
         if (allocated(error)) return
         call march_level(plan, level, usual, should_stop, result, values(1), is_abandoned, error)
         if (allocated(error) .or. is_abandoned) return
         do dof = 1, n_dof
            associate (slip => 100.0_wp*result%slip_fraction(dof, :))
               values(1 + dof) = standard_deviation(slip)
               values(1 + n_dof + dof) = error_of_deviation(slip)
            end associate
         end do
         if (.not. plan%output%spectrum) return
         associate (step => 1.0_wp/(plan%output%segment_length*plan%integration%dt))
            call start_bands(w, n_dof, [(i*step, i=0, size(result%psd, 2) - 1)], &
                             plan%output%percentiles, plan%seed, 1, bands)
         end associate
         call bands%add(1, 1, 1, result%psd)
         call bands%finish(statistics)
         do dof = 1, n_dof
            if (minval(statistics%pseudo_variance_percentiles(dof, :)) > 0.0_wp) &
               values(1 + 2*n_dof + dof) = log(statistics%band_ratio_high(dof) &
                                               /statistics%band_ratio(dof))/1.96_wp
         end do
      end associate
   end subroutine measure_samples

end module ensemble_tradeoff_tasks
