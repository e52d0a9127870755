!> Lists the trial marches of a tradeoff as independent tasks: each is one march, from which a few
!> numbers are kept, and any rank may run it (tradeoff_marches).
!>
!> The error of a setting is measured against the event method at tolerance 1e-12, on the same
!> samples. The scatter of consecutive batches of a long march gives the time-average error; the
!> scatter of a case's samples gives the Monte Carlo error.
module tradeoff_tasks
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_pooling, only: sharing_cases
   use campaign_results, only: block_result, spectrum_layout
   use campaign_runner, only: block_width, layout_of, prepare_runner, runner_type
   use campaign_sample, only: stop_query
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_correlated, only: n_batches
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use tradeoff_sample, only: assumed_transitions, choose_levels, draw_level, fit_segments, &
                              history_memory, level_type, march_level, shortened
   use tradeoff_settings, only: all_settings, count_work, expected_cost, own_setting, &
                                reference_setting, same_setting, setting_type, settings_at_dt
   use tradeoff_task_results, only: task_result
   use tradeoff_variants, only: variant_type
   implicit none(type, external)
   private
   public :: tradeoff_type, task_type, trial_scope, case_of, choose_march, new_tradeoff, &
             samples_of_block
   public :: setting_task, spectrum_task, batch_task, samples_task, variant_task

   !> Kinds of tasks: a setting, a pair of spectrum_every and segment_length, a batch of a long
   !> march, the samples of a case, a variant of a process.
   integer, parameter :: setting_task = 1, spectrum_task = 2, batch_task = 3, samples_task = 4, &
                         variant_task = 5
   integer, parameter :: most_cases = 16          !! number of cases with a samples_task
   integer, parameter :: variant_samples = 128    !! samples of a variant's march
   integer, parameter :: most_spectra = 9         !! number of pairs that choose_spectra lists
   !> Time of a march with the energy balance over that of one without (docs/cost.md).
   real(wp), parameter :: balance_factor = 2.0_wp

   !> One march.
   type :: task_type
      integer :: kind = setting_task
      integer :: row = 0       !! number of the setting, spectrum, batch, case or variant
      integer :: level = 0     !! number of the force level; 0 in a samples_task
   end type task_type

   !> Parts of a tradeoff that are wanted. Statistical parts and variants need models.
   type :: trial_scope
      real(wp) :: budget = 0.0_wp         !! expected processor time of the marches [s]
      !> longest expected processor time [s] where the fewest useful steps exceed the budget
      real(wp) :: most_seconds = huge(1.0_wp)
      !> true: for a table of settings, with other steps than the scene's too, and timed with its
      !> energy balance and histories
      logical :: for_table = .false.
      logical :: has_settings = .true.    !! true: compares settings
      logical :: is_statistical = .false. !! true: finds time-average and Monte Carlo errors
      type(process_model_type), allocatable :: models(:)     !! (process), solved
      type(variant_type), allocatable :: variants(:)
      type(process_model_type), allocatable :: variant_models(:)   !! some have no solution
   end type trial_scope

   !> Data that all tasks share, and their results. The same on every rank.
   type :: tradeoff_type
      type(plan_type) :: plan               !! short marches, of setting and samples tasks
      type(plan_type) :: long_plan          !! long marches, of batch and spectrum tasks
      type(plan_type) :: wide               !! marches of many samples, of variant tasks
      type(trial_scope) :: scope
      type(setting_type), allocatable :: settings(:)
      integer :: own = 0                    !! number of the scene's setting in settings; 0: none
      type(setting_type) :: common_setting  !! setting of all tasks but setting tasks, counted
      real(wp) :: time_over_expected = 1.0_wp      !! measured over expected cost of the references
      real(wp) :: history_time = 0.0_wp     !! time that histories add to a step of a sample [ns]
      real(wp) :: sample_steps = 0.0_wp     !! sum of the steps of all samples of the scene
      type(level_type), allocatable :: levels(:)
      integer, allocatable :: every(:)             !! (spectrum) every k-th step enters the spectra
      integer, allocatable :: segment_length(:)    !! (spectrum) [step]
      integer, allocatable :: cases(:)             !! case numbers of the samples tasks
      integer, allocatable :: n_cases(:)           !! (case) cases that may share its samples
      type(task_type), allocatable :: tasks(:)     !! the most expensive first
      real(wp), allocatable :: seconds(:)          !! (task) expected processor time [s]
      integer :: n_segments = 0             !! Welch segments of the scene's spectra; 0: no spectra
      integer :: n_variant_samples = 0                 !! samples of a variant's march
      type(task_result), allocatable :: results(:)       !! (task)
      type(block_result), allocatable :: references(:)   !! (level)
      type(runner_type) :: runner           !! runner of the campaign, which gives the force
   end type tradeoff_type

contains

   !> Chooses the marches within the budget of expected cost, marches the references, and lists the
   !> tasks. Marches nothing and lists none if they are expected to take longer than
   !> scope%most_seconds.
   subroutine new_tradeoff(plan, file_force, scope, should_stop, tradeoff, error)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0
      type(trial_scope), intent(in) :: scope
      procedure(stop_query) :: should_stop
      type(tradeoff_type), intent(out) :: tradeoff
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: enough = 2**22   ! steps of the force record
      type(plan_type) :: short
      type(spectrum_layout) :: layout
      real(wp) :: cost, long_cost   ! expected costs of a step of all marches [ns]
      integer :: every, i, unit, width

      every = max(plan%output%spectrum_every, 1)
      unit = 2*every
      tradeoff%scope = scope
      tradeoff%sample_steps = real(plan%integration%n_steps, wp)*sum(plan%cases%n_samples)
      if (.not. allocated(scope%variants)) allocate (tradeoff%scope%variants(0))
      call choose_levels(plan, tradeoff%levels)
      width = sum([(size(tradeoff%levels(i)%samples), i=1, size(tradeoff%levels))])
      if (scope%for_table) then
         tradeoff%settings = all_settings(plan, plan%integration%n_steps >= 8*unit .and. &
                                          modulo(every, 2) == 0)
      else
         tradeoff%settings = settings_at_dt(plan)
      end if
      if (.not. scope%has_settings) tradeoff%settings = tradeoff%settings(:0)
      tradeoff%own = findloc(same_setting(tradeoff%settings, own_setting(plan)), .true., 1)
      tradeoff%n_variant_samples = variant_samples
      if (plan%excitation%per_sample) &   ! then a block at most
         tradeoff%n_variant_samples = samples_of_block(plan, file_force)
      tradeoff%common_setting = setting_type('event', tolerance=1.0e-6_wp)
      call count_work(plan, tradeoff%common_setting, error)
      do i = 1, size(tradeoff%settings)
         if (.not. allocated(error)) call count_work(plan, tradeoff%settings(i), error)
      end do
      if (allocated(error)) return
      associate (step_cost => expected_cost(tradeoff%common_setting, plan%structure%n_dof, &
                                            block_width(plan), assumed_transitions), &
                 n_levels => size(tradeoff%levels))
         if (scope%has_settings) then
            cost = width*sum(expected_cost(tradeoff%settings, plan%structure%n_dof, &
                                           max(1, width/n_levels), assumed_transitions))
            long_cost = (most_spectra + 0.5_wp*(n_batches + 1))*width*step_cost
         else   ! a block of each case, and half of a long march for every batch
            cost = 2*min(most_cases, size(plan%cases))*block_width(plan)*step_cost
            long_cost = n_batches*width*step_cost
         end if
         tradeoff%plan = shortened(plan, unit, affordable(scope%budget, cost))
         tradeoff%long_plan = shortened(plan, unit*n_batches, affordable(scope%budget, long_cost))
         if (1.0e-9_wp*max(cost*tradeoff%plan%integration%n_steps, &
                           merge(long_cost, 0.0_wp, scope%is_statistical) &
                           *tradeoff%long_plan%integration%n_steps) > scope%most_seconds) return
         cost = tradeoff%n_variant_samples*step_cost*n_levels*max(1, size(tradeoff%scope%variants))
         tradeoff%wide = shortened(plan, unit, affordable(0.3_wp*scope%budget, cost))
      end associate
      short = plan
      if (plan%excitation%kind /= 'file') &   ! long enough for all marches, and drawn in a second
         short%integration%n_steps = min(plan%integration%n_steps, &
                                         max(enough, tradeoff%plan%integration%n_steps, &
                                             tradeoff%long_plan%integration%n_steps, &
                                             tradeoff%wide%integration%n_steps))
      if (short%integration%n_steps < plan%integration%n_steps) short%integration%n_discard = 0
      call prepare_runner(short, file_force, tradeoff%runner, error)
      if (allocated(error)) return
      layout = layout_of(plan)
      if (plan%output%spectrum) tradeoff%n_segments = layout%n_segments
      call march_references(tradeoff, should_stop, error)
      if (plan%output%history .and. scope%for_table .and. .not. allocated(error)) &
         call time_histories(tradeoff, should_stop, error)
      if (allocated(error)) return
      call list_tasks(tradeoff)
      allocate (tradeoff%results(size(tradeoff%tasks)))
   end subroutine new_tradeoff

   !> Number of steps that the budget allows.
   pure integer function affordable(budget, cost)
      real(wp), intent(in) :: budget   !! [s]
      real(wp), intent(in) :: cost     !! cost of a step [ns]

      affordable = int(min(1.0e9_wp*budget/cost, 1.0e9_wp))
   end function affordable

   !> Number of samples of a full block: as many as have a record, if each has its own in a file.
   pure integer function samples_of_block(plan, file_force)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0

      samples_of_block = block_width(plan)
      if (plan%excitation%kind == 'file' .and. plan%excitation%per_sample) &
         samples_of_block = min(samples_of_block, size(file_force, 2)/plan%structure%n_forces)
   end function samples_of_block

   !> Draws the friction and the force of every level; marches its reference if settings are
   !> compared.
   subroutine march_references(tradeoff, should_stop, error)
      type(tradeoff_type), intent(inout) :: tradeoff
      procedure(stop_query) :: should_stop
      type(error_type), allocatable, intent(out) :: error
      type(setting_type) :: setting
      real(wp) :: expected, measured, nanoseconds   ! summed over levels
      integer :: k, n

      setting = reference_setting
      call count_work(tradeoff%plan, setting, error)
      if (allocated(error)) return
      expected = 0.0_wp
      measured = 0.0_wp
      n = max(tradeoff%plan%integration%n_steps, tradeoff%long_plan%integration%n_steps)
      allocate (tradeoff%references(size(tradeoff%levels)))
      do k = 1, size(tradeoff%levels)
         associate (level => tradeoff%levels(k), reference => tradeoff%references(k), &
                    plan => tradeoff%plan, campaign => tradeoff%runner%plan)
            call draw_level(campaign, tradeoff%runner, n, level, tradeoff%scope%models)
            if (size(tradeoff%settings) == 0) cycle
            call march_level(plan, level, setting, should_stop, reference, nanoseconds, error)
            if (allocated(error) .or. reference%n_samples == 0) return
            level%transitions = sum(reference%slip_starts + reference%stick_starts) &
                                /(real(plan%integration%n_steps, wp)*size(level%samples))
            measured = measured + nanoseconds
            expected = expected + expected_cost(setting, plan%structure%n_dof, &
                                                size(level%samples), level%transitions)
         end associate
      end do
      if (expected > 0.0_wp) tradeoff%time_over_expected = measured/expected
   end subroutine march_references

   !> Times a short march at the first level without and with the scene's histories.
   subroutine time_histories(tradeoff, should_stop, error)
      type(tradeoff_type), intent(inout) :: tradeoff
      procedure(stop_query) :: should_stop
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: plan
      type(block_result) :: result
      real(wp) :: nanoseconds(2)   ! without and with histories
      integer :: k

      associate (level => tradeoff%levels(1), dofs => kept_dofs(tradeoff%runner%plan))
         plan = shortened(tradeoff%plan, 1, &
                          int(history_memory/(16.0_wp*size(dofs)*size(level%samples))))
         plan%output%dofs = dofs
         do k = 1, 2
            plan%output%history = k == 2
            call march_level(plan, level, tradeoff%common_setting, should_stop, result, &
                             nanoseconds(k), error)
            if (allocated(error)) return
         end do
      end associate
      tradeoff%history_time = max(0.0_wp, nanoseconds(2) - nanoseconds(1))
   end subroutine time_histories

   !> Lists the tasks, the most expensive first: variants, settings, spectra and batches at every
   !> level, and cases.
   subroutine list_tasks(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      type(task_type), allocatable :: tasks(:)
      real(wp), allocatable :: cost(:)
      integer, allocatable :: order(:), random(:)   ! random: cases with drawn friction
      integer :: i, k, n, n_levels

      n_levels = size(tradeoff%levels)
      allocate (tradeoff%every(0), tradeoff%segment_length(0), tradeoff%cases(0))
      tradeoff%n_cases = sharing_cases(tradeoff%plan)
      tasks = [((task_type(variant_task, i, k), i=1, size(tradeoff%scope%variants)), k=1, n_levels)]
      tasks = pack(tasks, [(case_of(tradeoff, tasks(i)) > 0 .and. tradeoff%n_variant_samples > 1, &
                            i=1, size(tasks))])
      tasks = [tasks, ((task_type(setting_task, i, k), k=1, n_levels), &
                       i=1, size(tradeoff%settings))]
      if (tradeoff%scope%is_statistical) then
         if (tradeoff%scope%has_settings) call choose_spectra(tradeoff)
         associate (plan => tradeoff%plan)
            random = pack([(i, i=1, size(plan%cases))], plan%cases%process > 0 .and. &
                          [(case_width(tradeoff, i) > 1, i=1, size(plan%cases))])
         end associate
         n = min(most_cases, size(random))   ! evenly spaced among all with drawn friction
         tradeoff%cases = [(random(1 + ((i - 1)*size(random))/n), i=1, n)]
         tasks = [tasks, ((task_type(batch_task, i, k), i=1, n_batches), k=1, n_levels), &
                  ((task_type(spectrum_task, i, k), i=1, size(tradeoff%every)), k=1, n_levels), &
                  (task_type(samples_task, i, 0), i=1, size(tradeoff%cases))]
      end if
      cost = [(cost_of(tradeoff, tasks(i)), i=1, size(tasks))]
      order = sort_order(-cost)
      tradeoff%tasks = tasks(order)
      tradeoff%seconds = 1.0e-9_wp*tradeoff%time_over_expected*cost(order)
   end subroutine list_tasks

   !> Expected cost of a task [ns], as expected_cost has it.
   pure real(wp) function cost_of(tradeoff, task) result(cost)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task
      type(plan_type) :: plan
      type(setting_type) :: setting
      real(wp) :: transitions
      integer :: n_samples

      call choose_march(tradeoff, task, plan, setting, n_samples)
      transitions = maxval(tradeoff%levels%transitions)
      if (task%level > 0) transitions = tradeoff%levels(task%level)%transitions
      cost = real(plan%integration%n_steps, wp)*n_samples &
             *expected_cost(setting, plan%structure%n_dof, n_samples, transitions)
      if (plan%output%energy) cost = balance_factor*cost
   end function cost_of

   !> Chooses the plan (steps and kept results), the setting and the number of samples of a task.
   pure subroutine choose_march(tradeoff, task, plan, setting, n_samples)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task
      type(plan_type), intent(out) :: plan
      type(setting_type), intent(out) :: setting
      integer, intent(out) :: n_samples
      integer :: n

      setting = tradeoff%common_setting
      if (task%level > 0) n_samples = size(tradeoff%levels(task%level)%samples)
      select case (task%kind)
      case (setting_task)
         plan = tradeoff%plan
         plan%output%energy = tradeoff%runner%plan%output%energy .and. tradeoff%scope%for_table
         setting = tradeoff%settings(task%row)
      case (spectrum_task)
         plan = tradeoff%long_plan
         plan%output%spectrum_every = tradeoff%every(task%row)
         plan%output%segment_length = tradeoff%segment_length(task%row)
      case (batch_task)
         plan = tradeoff%long_plan
         n = plan%integration%n_steps/n_batches
         plan%integration%n_steps = task%row*n
         plan%integration%n_discard = (task%row - 1)*n
         call fit_segments(n, plan)
      case (samples_task)
         plan = tradeoff%plan
         n_samples = case_width(tradeoff, tradeoff%cases(task%row))
      case default
         plan = tradeoff%wide
         n_samples = tradeoff%n_variant_samples
      end select
   end subroutine choose_march

   !> Number of the case that has the process of the task's variant and its level; 0: there is none,
   !> or the variant has no solution.
   pure integer function case_of(tradeoff, task)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task

      associate (cases => tradeoff%plan%cases, level => tradeoff%levels(task%level))
         case_of = findloc(cases%process == tradeoff%scope%variants(task%row)%process .and. &
                           abs(cases%strength - level%strength) <= 0.0_wp .and. &
                           tradeoff%scope%variant_models(task%row)%is_solved, .true., 1)
      end associate
   end function case_of

   !> Chooses pairs of spectrum_every and segment_length: every step first, with which the others
   !> are compared; every 2nd to 16th step; shorter and longer segments at the scene's own rate.
   pure subroutine choose_spectra(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, parameter :: fewest_values = 16   ! values of a segment
      integer :: k, length

      if (.not. tradeoff%long_plan%output%spectrum) return
      if (all([(size(tradeoff%levels(k)%samples) == 1, k=1, size(tradeoff%levels))])) return
      associate (own => tradeoff%long_plan%output%segment_length, &
                 every => tradeoff%long_plan%output%spectrum_every)
         do k = 0, 4
            if (modulo(own, 2**(k + 1)) /= 0 .or. own/2**k < fewest_values) exit
            tradeoff%every = [tradeoff%every, 2**k]
            tradeoff%segment_length = [tradeoff%segment_length, own]
         end do
         do k = -3, 1
            length = int(own*2.0_wp**k)
            if (k == 0 .or. modulo(length, 2*every) /= 0 .or. length < fewest_values*every) cycle
            if (2*length > tradeoff%long_plan%integration%n_steps) cycle
            tradeoff%every = [tradeoff%every, every]
            tradeoff%segment_length = [tradeoff%segment_length, length]
         end do
      end associate
   end subroutine choose_spectra

   !> Number of samples of a case that are marched for its Monte Carlo error: a block, or as many as
   !> have a given record or given values.
   pure integer function case_width(tradeoff, case_number)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: case_number
      logical :: has_given_values

      associate (plan => tradeoff%runner%plan, &
                 case => tradeoff%runner%plan%cases(case_number))
         has_given_values = .false.
         if (case%process > 0) has_given_values = plan%processes(case%process)%method == 'values'
         case_width = block_width(plan)
         if (has_given_values .or. plan%excitation%kind == 'file' .and. &
             plan%excitation%per_sample) case_width = min(case_width, case%n_samples)
      end associate
   end function case_width

end module tradeoff_tasks
