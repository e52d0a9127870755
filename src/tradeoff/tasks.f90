!> Marches that measure how accuracy depends on the settings, as tasks that any rank may take: each
!> is one march, of which a few numbers are kept, and none needs another's. tradeoff_marches runs
!> them.
!>
!> The error of a setting is measured against the event method at tolerance 1e-12, on the same
!> samples. The scatter of consecutive batches of a long march gives the error of time averages,
!> that of a case's samples the Monte Carlo error.
module tradeoff_tasks
   use campaign_plan, only: plan_type
   use campaign_pooling, only: sharing_cases
   use campaign_results, only: block_result
   use campaign_runner, only: block_width, prepare_runner, runner_type
   use campaign_sample, only: stop_query
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_correlated, only: n_batches
   use numerics_sorting, only: sort_order
   use numerics_spectrum, only: count_segments
   use process_model, only: process_model_type
   use tradeoff_sample, only: choose_levels, draw_level, fit_segments, level_type, march_level, &
      shortened
   use tradeoff_settings, only: all_settings, count_work, expected_cost, own_setting, &
      reference_setting, same_setting, setting_type, settings_at_dt
   use tradeoff_task_results, only: task_result
   use tradeoff_variants, only: variant_type
   implicit none(type, external)
   private
   public :: tradeoff_type, task_type, scope_type, case_of, choose_march, new_tradeoff
   public :: of_setting, of_spectrum, of_batch, of_samples, of_variant

   integer, parameter :: of_setting = 1, of_spectrum = 2, of_batch = 3, of_samples = 4, &
                         of_variant = 5
   integer, parameter :: most_cases = 16          !! whose Monte Carlo error is estimated
   integer, parameter :: many_samples = 128       !! that variants of a process are compared on
   integer, parameter :: most_ways = 9            !! to form spectra; see choose_ways
   real(wp), parameter :: usual_transitions = 0.3_wp   !! in a step, where nothing is known yet

   !> One piece of work, to be done by any rank.
   type :: task_type
      integer :: kind = of_setting
      integer :: row = 0       !! setting, way to form spectra, batch, case, or variant
      integer :: level = 0     !! of force; none for a case
   end type task_type

   !> Scope of a tradeoff. Statistical parts and variants need models.
   type :: scope_type
      real(wp) :: budget = 0.0_wp         !! expected cost of the marches [s of a processor]
      logical :: at_other_dt = .false.    !! settings with other steps than the scene's too
      logical :: has_settings = .true.
      logical :: is_statistical = .false.
      type(process_model_type), allocatable :: models(:)     !! (process), solved
      type(variant_type), allocatable :: variants(:)
      type(process_model_type), allocatable :: variant_models(:)   !! some have no solution
   end type scope_type

   !> All that the tasks share, the same on every rank.
   type :: tradeoff_type
      type(plan_type) :: plan                         !! short: the marches that compare settings
      type(plan_type) :: long                         !! those that estimate what is statistical
      type(plan_type) :: wide                         !! of many samples: those of variants
      type(scope_type) :: scope
      type(setting_type), allocatable :: settings(:)
      integer :: own = 0                              !! among them: the scene's; 0: none measured
      type(setting_type) :: usual                     !! of what is statistical, counted
      real(wp) :: slowness = 1.0_wp                   !! of this processor, beside expected_cost's
      real(wp) :: seconds = 0.0_wp                    !! of this processor for all tasks, expected
      type(level_type), allocatable :: levels(:)
      real(wp), allocatable :: transitions(:)         !! (level) of a sample in a step
      integer, allocatable :: every(:)                !! (way) every k-th step enters the spectra
      integer, allocatable :: segment_length(:)       !! (way) steps
      integer, allocatable :: cases(:)                !! whose Monte Carlo error is estimated
      integer, allocatable :: n_cases(:)              !! (case) that may share its samples
      type(task_type), allocatable :: tasks(:)        !! the longest first
      integer :: n_segments = 0                       !! of the scene's spectra; 0: none
      integer :: n_wide = 0                           !! samples of a variant's march
      type(task_result), allocatable :: found(:)      !! (task)
      type(block_result), allocatable :: references(:)   !! (level)
      type(runner_type) :: runner                     !! of the whole campaign
   end type tradeoff_type

contains

   !> Decides what is marched, within a budget of expected cost, and marches the references.
   subroutine new_tradeoff(plan, file_force, scope, should_stop, tradeoff, error)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0
      type(scope_type), intent(in) :: scope
      procedure(stop_query) :: should_stop
      type(tradeoff_type), intent(out) :: tradeoff
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: of_plan, of_long   ! expected costs of a step [ns]
      integer :: every, i, unit, width

      every = max(plan%output%spectrum_every, 1)
      unit = 2*every
      tradeoff%scope = scope
      if (.not. allocated(scope%variants)) allocate (tradeoff%scope%variants(0))
      call choose_levels(plan, tradeoff%levels)
      width = sum([(size(tradeoff%levels(i)%sample), i=1, size(tradeoff%levels))])
      if (scope%at_other_dt) then
         tradeoff%settings = all_settings(plan, plan%integration%n_steps >= 8*unit .and. &
                                          modulo(every, 2) == 0)
      else
         tradeoff%settings = settings_at_dt(plan)
      end if
      if (.not. scope%has_settings) tradeoff%settings = tradeoff%settings(:0)
      tradeoff%own = findloc(same_setting(tradeoff%settings, own_setting(plan)), .true., 1)
      tradeoff%n_wide = wide_block(plan, file_force)
      tradeoff%usual = setting_type('event', tolerance=1.0e-6_wp)
      call count_work(plan, tradeoff%usual, error)
      do i = 1, size(tradeoff%settings)
         if (.not. allocated(error)) call count_work(plan, tradeoff%settings(i), error)
      end do
      if (allocated(error)) return
      associate (usual_cost => expected_cost(tradeoff%usual, plan%structure%n_dof, &
                                             block_width(plan), usual_transitions), &
                 n_levels => size(tradeoff%levels))
         if (scope%has_settings) then
            of_plan = width*sum(expected_cost(tradeoff%settings, plan%structure%n_dof, &
                                              max(1, width/n_levels), usual_transitions))
            of_long = (most_ways + 0.5_wp*(n_batches + 1))*width*usual_cost
         else   ! a block of each case, and half of a long march for every batch
            of_plan = 2*min(most_cases, size(plan%cases))*block_width(plan)*usual_cost
            of_long = n_batches*width*usual_cost
         end if
         tradeoff%plan = shortened(plan, unit, affordable(scope%budget, of_plan))
         tradeoff%long = shortened(plan, unit*n_batches, affordable(scope%budget, of_long))
         tradeoff%wide = shortened(plan, unit, affordable( &
                             0.3_wp*scope%budget, tradeoff%n_wide*usual_cost*size(tradeoff%levels) &
                                   *max(1, size(tradeoff%scope%variants))))
      end associate
      call prepare_runner(with_short_record(plan, tradeoff), file_force, tradeoff%runner, error)
      if (allocated(error)) return
      associate (layout => tradeoff%runner%layout, how => plan%integration)
         if (plan%output%spectrum) tradeoff%n_segments = &
            count_segments((how%n_steps - how%n_discard)/layout%every, layout%segment_length, &
                           layout%overlap)
      end associate
      call draw_and_refer(tradeoff, should_stop, error)
      if (allocated(error)) return
      call list_tasks(tradeoff)
      allocate (tradeoff%found(size(tradeoff%tasks)))
   end subroutine new_tradeoff

   !> The plan with a record of its force that is drawn in a second: no march needs a longer one.
   pure function with_short_record(plan, tradeoff) result(short)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(plan_type) :: short
      integer, parameter :: enough = 2**22   ! steps

      short = plan
      if (plan%excitation%kind == 'file') return
      short%integration%n_steps = min(plan%integration%n_steps, &
                                      max(enough, tradeoff%plan%integration%n_steps, &
                                          tradeoff%long%integration%n_steps, &
                                          tradeoff%wide%integration%n_steps))
      if (short%integration%n_steps < plan%integration%n_steps) short%integration%n_discard = 0
   end function with_short_record

   !> Steps that a budget [s] allows when each costs so much [ns].
   pure integer function affordable(budget, cost)
      real(wp), intent(in) :: budget, cost

      affordable = int(min(1.0e9_wp*budget/cost, 1.0e9_wp))
   end function affordable

   !> Samples of a variant's march: fewer where each carries a record of its own.
   pure integer function wide_block(plan, file_force)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)

      wide_block = many_samples
      if (.not. plan%excitation%per_sample) return
      wide_block = block_width(plan)
      if (plan%excitation%kind == 'file') &
         wide_block = min(wide_block, size(file_force, 2)/plan%structure%n_forces)
   end function wide_block

   !> Draws friction, force and, where settings are compared, reference of every level.
   subroutine draw_and_refer(tradeoff, should_stop, error)
      type(tradeoff_type), intent(inout) :: tradeoff
      procedure(stop_query) :: should_stop
      type(error_type), allocatable, intent(out) :: error
      type(setting_type) :: counted
      real(wp) :: expected, measured, nanoseconds   ! summed over levels
      integer :: k, n

      counted = reference_setting
      call count_work(tradeoff%plan, counted, error)
      if (allocated(error)) return
      expected = 0.0_wp
      measured = 0.0_wp
      n = max(tradeoff%plan%integration%n_steps, tradeoff%long%integration%n_steps)
      allocate (tradeoff%references(size(tradeoff%levels)))
      allocate (tradeoff%transitions(size(tradeoff%levels)), source=usual_transitions)
      do k = 1, size(tradeoff%levels)
         associate (level => tradeoff%levels(k), reference => tradeoff%references(k), &
                    plan => tradeoff%plan, campaign => tradeoff%runner%plan)
            call draw_level(campaign, tradeoff%runner, n, level, error, tradeoff%scope%models)
            if (allocated(error)) return
            if (size(tradeoff%settings) == 0) cycle
            call march_level(plan, level, counted, should_stop, reference, nanoseconds, error)
            if (allocated(error) .or. reference%n_samples == 0) return
            tradeoff%transitions(k) = &
               sum(reference%slip_starts + reference%stick_starts) &
               /(real(plan%integration%n_steps, wp)*size(level%sample))
            measured = measured + nanoseconds
            expected = expected + expected_cost(counted, plan%structure%n_dof, &
                                                size(level%sample), tradeoff%transitions(k))
         end associate
      end do
      if (expected > 0.0_wp) tradeoff%slowness = measured/expected
   end subroutine draw_and_refer

   !> Lists the tasks, the dearest first: every variant, every setting, every way to form spectra
   !> and every batch with every level, and cases.
   subroutine list_tasks(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      type(task_type), allocatable :: tasks(:)
      real(wp), allocatable :: cost(:)
      integer :: i, k, n_levels

      n_levels = size(tradeoff%levels)
      allocate (tradeoff%every(0), tradeoff%segment_length(0), tradeoff%cases(0))
      tradeoff%n_cases = sharing_cases(tradeoff%plan)
      tasks = [((task_type(of_variant, i, k), i=1, size(tradeoff%scope%variants)), k=1, n_levels)]
      tasks = pack(tasks, [(can_be_marched(tradeoff, tasks(i)), i=1, size(tasks))])
      tasks = [tasks, ((task_type(of_setting, i, k), k=1, n_levels), i=1, size(tradeoff%settings))]
      if (tradeoff%scope%is_statistical) then
         if (tradeoff%scope%has_settings) call choose_ways(tradeoff)
         call choose_cases(tradeoff)
         tasks = [tasks, ((task_type(of_batch, i, k), i=1, n_batches), k=1, n_levels), &
                  ((task_type(of_spectrum, i, k), i=1, size(tradeoff%every)), k=1, n_levels), &
                  (task_type(of_samples, i, 0), i=1, size(tradeoff%cases))]
      end if
      cost = [(cost_of(tradeoff, tasks(i)), i=1, size(tasks))]
      tradeoff%tasks = tasks(sort_order(-cost))
      tradeoff%seconds = 1.0e-9_wp*tradeoff%slowness*sum(cost)
   end subroutine list_tasks

   !> Expected cost of a task [ns of the processor of expected_cost].
   pure real(wp) function cost_of(tradeoff, task) result(cost)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task
      type(plan_type) :: plan
      type(setting_type) :: setting
      real(wp) :: transitions
      integer :: n_samples

      call choose_march(tradeoff, task, plan, setting, n_samples)
      transitions = maxval(tradeoff%transitions)
      if (task%level > 0) transitions = tradeoff%transitions(task%level)
      cost = real(plan%integration%n_steps, wp)*n_samples &
             *expected_cost(setting, plan%structure%n_dof, n_samples, transitions)
   end function cost_of

   !> Chooses what a task marches: steps and what is kept of them, its setting, its samples.
   pure subroutine choose_march(tradeoff, task, plan, setting, n_samples)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task
      type(plan_type), intent(out) :: plan
      type(setting_type), intent(out) :: setting
      integer, intent(out) :: n_samples
      integer :: n

      setting = tradeoff%usual
      if (task%level > 0) n_samples = size(tradeoff%levels(task%level)%sample)
      select case (task%kind)
      case (of_setting)
         plan = tradeoff%plan
         setting = tradeoff%settings(task%row)
      case (of_spectrum)
         plan = tradeoff%long
         plan%output%spectrum_every = tradeoff%every(task%row)
         plan%output%segment_length = tradeoff%segment_length(task%row)
      case (of_batch)
         plan = tradeoff%long
         n = plan%integration%n_steps/n_batches
         plan%integration%n_steps = task%row*n
         plan%integration%n_discard = (task%row - 1)*n
         call fit_segments(n, plan)
      case (of_samples)
         plan = tradeoff%plan
         n_samples = case_width(tradeoff, tradeoff%cases(task%row))
      case default
         plan = tradeoff%wide
         n_samples = tradeoff%n_wide
      end select
   end subroutine choose_march

   !> True if a variant has a solution, and a case at this level.
   pure logical function can_be_marched(tradeoff, task)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task

      can_be_marched = tradeoff%scope%variant_models(task%row)%is_solved .and. &
                       tradeoff%n_wide > 1 .and. case_of(tradeoff, task) > 0
   end function can_be_marched

   !> The case of a variant's process at a level; 0: none.
   pure integer function case_of(tradeoff, task)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task

      associate (cases => tradeoff%plan%cases, level => tradeoff%levels(task%level))
         case_of = findloc(cases%process == tradeoff%scope%variants(task%row)%process .and. &
                           abs(cases%strength - level%strength) <= 0.0_wp, .true., 1)
      end associate
   end function case_of

   !> Chooses ways to form spectra: every step first, which the others are compared with; sparser
   !> ones; and shorter and longer segments at the scene's own rate.
   pure subroutine choose_ways(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, parameter :: values = 16   ! least of a segment
      integer :: k, length

      if (.not. tradeoff%long%output%spectrum) return
      if (all([(size(tradeoff%levels(k)%sample) == 1, k=1, size(tradeoff%levels))])) return
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

   !> Chooses cases with drawn friction, evenly among all where they are many.
   pure subroutine choose_cases(tradeoff)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, allocatable :: random(:)
      integer :: i, n

      associate (cases => tradeoff%plan%cases)
         random = pack([(i, i=1, size(cases))], cases%process > 0 .and. &
                       [(case_width(tradeoff, i) > 1, i=1, size(cases))])
      end associate
      n = min(most_cases, size(random))
      tradeoff%cases = [(random(1 + ((i - 1)*size(random))/n), i=1, n)]
   end subroutine choose_cases

   !> Samples whose scatter is that of a case: a block of them, or as many as have a record or given
   !> values.
   pure integer function case_width(tradeoff, case_number)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: case_number
      logical :: is_bounded

      associate (plan => tradeoff%runner%plan, &
                 case => tradeoff%runner%plan%cases(case_number))
         is_bounded = plan%excitation%kind == 'file' .and. plan%excitation%per_sample
         if (case%process > 0) &
            is_bounded = is_bounded .or. plan%processes(case%process)%method == 'values'
         case_width = block_width(plan)
         if (is_bounded) case_width = min(case_width, case%n_samples)
      end associate
   end function case_width

end module tradeoff_tasks
