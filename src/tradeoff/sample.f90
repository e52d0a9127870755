!> A small piece of a campaign to measure settings on: some samples of its cases, under the first
!> part of its own force.
!>
!> Samples of all cases with one level of force share a block, as wide as the campaign's own blocks,
!> so that a step costs here what it costs there.
module tradeoff_sample
   use campaign_plan, only: case_type, plan_type
   use campaign_results, only: block_result
   use campaign_runner, only: block_width, prepare_runner, runner_type
   use campaign_sample, only: run_block, stop_query
   use campaign_study, only: block_range, draw_friction
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: label_of, new_stream, stream_type
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use tradeoff_settings, only: setting_type, with_setting
   implicit none(type, external)
   private
   public :: level_type, choose_levels, draw_level, march_level
   public :: fit_segments, shortened, stretch, stripped

   integer, parameter :: most_levels = 4

   !> One level of force, and the samples that are marched under it.
   type :: level_type
      real(wp) :: strength = 0.0_wp            !! as case_type has it
      integer :: n_all = 0                     !! samples that the campaign has at this level
      integer, allocatable :: case_number(:)   !! (sample)
      integer, allocatable :: sample(:)        !! (sample) its number in the case
      real(wp), allocatable :: friction(:, :)  !! (dof, sample)
      real(wp), allocatable :: force(:, :)     !! (0:n_steps, 1 or sample) [N]
   end type level_type

contains

   !> Chooses the levels of force, at most four, the lowest and the highest among them; and their
   !> samples: the first of each case, as many of each as a block has room for.
   pure subroutine choose_levels(plan, levels)
      type(plan_type), intent(in) :: plan
      type(level_type), allocatable, intent(out) :: levels(:)
      real(wp), allocatable :: strengths(:)
      integer, allocatable :: cases(:), n_samples(:)
      integer :: i, k, n, width

      n_samples = plan%cases%n_samples
      allocate (strengths(0))
      do i = 1, size(plan%cases)
         associate (strength => plan%cases(i)%strength)
            if (all(abs(strengths - strength) > 0.0_wp)) strengths = [strengths, strength]
         end associate
      end do
      strengths = strengths(sort_order(strengths))
      n = min(most_levels, size(strengths))
      allocate (levels(n))
      do k = 1, n
         levels(k)%strength = strengths(1 + nint((k - 1.0_wp)*(size(strengths) - 1)/max(1, n - 1)))
         cases = pack([(i, i=1, size(plan%cases))], &
                      abs(plan%cases%strength - levels(k)%strength) <= 0.0_wp)
         levels(k)%n_all = sum(n_samples(cases))
         width = min(block_width(plan), maxval(n_samples(cases)))
         call deal(n_samples, cases, width, levels(k))
      end do
   end subroutine choose_levels

   !> Fills a block with samples 1 of the cases in turn, then samples 2, ...
   pure subroutine deal(n_samples, cases, width, level)
      integer, intent(in) :: n_samples(:)   !! (case)
      integer, intent(in) :: cases(:), width
      type(level_type), intent(inout) :: level
      integer :: i, sample

      allocate (level%case_number(0), level%sample(0))
      do sample = 1, maxval(n_samples(cases))
         do i = 1, size(cases)
            if (size(level%sample) == width) return
            if (sample > n_samples(cases(i))) cycle
            level%case_number = [level%case_number, cases(i)]
            level%sample = [level%sample, sample]
         end do
      end do
   end subroutine deal

   !> Draws the friction and the force of a level's samples. Without models, coefficients of the
   !> right mean and scatter stand in for those of the processes: numerical errors do not feel more.
   subroutine draw_level(plan, runner, n_steps, level, error, models)
      type(plan_type), intent(in) :: plan
      type(runner_type), intent(in) :: runner   !! of the whole campaign
      integer, intent(in) :: n_steps            !! of the force that are kept
      type(level_type), intent(inout) :: level
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type), intent(in), optional :: models(:)   !! (process)
      real(wp), allocatable :: force(:, :), friction(:, :)
      integer :: w

      w = size(level%sample)
      allocate (level%friction(plan%structure%n_joints, w))
      do w = 1, size(level%sample)
         associate (c => level%case_number(w), sample => level%sample(w))
            if (present(models)) then
               call draw_friction(plan, models, [block_range(c, sample, sample)], friction)
               level%friction(:, w) = friction(:, 1)
            else
               level%friction(:, w) = stand_in(plan, c, sample)
            end if
         end associate
      end do
      w = merge(size(level%sample), 1, plan%excitation%per_sample)*plan%structure%n_forces
      allocate (force(0:plan%integration%n_steps, w))
      call runner%force_of(level%case_number(1), 1, force, error)
      if (allocated(error)) return
      allocate (level%force(0:n_steps, w))
      level%force(:, :) = force(:n_steps, :)
   end subroutine draw_level

   !> Independent positive values of the mean and scatter that the case's process was asked to have.
   pure function stand_in(plan, case_number, sample) result(friction)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: case_number, sample
      real(wp) :: friction(plan%structure%n_joints), values(plan%structure%n_points)
      type(stream_type) :: stream

      friction = plan%friction
      associate (process => plan%cases(case_number)%process)
         if (process == 0) return
         stream = new_stream(plan%seed, label_of(label_of('stand-in'), case_number), sample)
         call stream%normals(values)
         values = abs(plan%processes(process)%mean + plan%processes(process)%std*values)
         friction = values(plan%structure%friction_point)
      end associate
   end function stand_in

   !> The plan with nothing discarded, and nothing kept but slip and spectra.
   pure function stripped(plan) result(short)
      type(plan_type), intent(in) :: plan
      type(plan_type) :: short

      short = plan
      short%integration%n_discard = 0
      short%output%energy = .false.
      short%output%history = .false.
      short%output%harmonic = .false.
      short%output%transitions = .false.
      short%output%dofs = [integer ::]
   end function stripped

   !> A stripped plan of about n_steps, a multiple of `unit` unless the scene has fewer.
   pure function shortened(plan, unit, n_steps) result(short)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: unit, n_steps
      type(plan_type) :: short
      integer, parameter :: least = 4096   ! steps that show something

      short = stripped(plan)
      short%integration%n_steps = min(plan%integration%n_steps, max(least, n_steps))
      if (short%integration%n_steps >= unit) &
         short%integration%n_steps = unit*(short%integration%n_steps/unit)
      short%output%spectrum_every = max(plan%output%spectrum_every, 1)
      call fit_segments(short%integration%n_steps, short)
   end function shortened

   !> Shortens the segments to half of what is marched where the scene's are longer; leaves out
   !> spectra where that is too little.
   pure subroutine fit_segments(n_steps, plan)
      integer, intent(in) :: n_steps
      type(plan_type), intent(inout) :: plan
      integer, parameter :: least = 16   ! values

      associate (output => plan%output, unit => 2*plan%output%spectrum_every)
         output%segment_length = unit*(min(output%segment_length, n_steps/2)/unit)
         output%spectrum = output%spectrum .and. output%segment_length >= least*unit/2
      end associate
   end subroutine fit_segments

   !> Marches the samples of a level under its force with one setting. `plan` says how many steps of
   !> the scene are marched (not more than the level's force has), and what is kept of them.
   subroutine march_level(plan, level, setting, should_stop, result, nanoseconds, error, like)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      type(setting_type), intent(in) :: setting
      procedure(stop_query) :: should_stop
      type(block_result), intent(out) :: result
      real(wp), intent(out) :: nanoseconds   !! of a processor, per sample and step of the scene
      type(error_type), allocatable, intent(out) :: error
      type(runner_type), intent(in), optional :: like   !! whose marcher serves again
      type(plan_type) :: short
      type(runner_type) :: runner
      real(wp) :: before, after

      nanoseconds = 0.0_wp
      short = with_setting(plan, setting)
      short%excitation%kind = 'file'
      short%excitation%per_sample = size(level%force, 2) > plan%structure%n_forces
      short%cases = [case_type(n_samples=size(level%sample))]
      call prepare_runner(short, stretch(level%force(:plan%integration%n_steps, :), setting), &
                          runner, error, like)
      if (allocated(error)) return
      call cpu_time(before)
      call run_block(runner, 1, level%friction, 1, should_stop, result, error)
      call cpu_time(after)
      nanoseconds = 1.0e9_wp*(after - before)/(real(plan%integration%n_steps, wp) &
                                               *size(level%sample))
   end subroutine march_level

   !> The force at the steps of a setting: on the chords between its values, or every so many.
   pure function stretch(force, setting) result(stretched)
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N]
      type(setting_type), intent(in) :: setting
      real(wp), allocatable :: stretched(:, :)   !! from 0
      integer :: i, k, n

      n = ubound(force, 1)
      associate (parts => setting%parts, stride => setting%stride)
         allocate (stretched(0:n*parts/stride, size(force, 2)))
         do i = 0, ubound(stretched, 1)
            k = i*stride/parts
            stretched(i, :) = force(k, :) + (force(min(k + 1, n), :) - force(k, :)) &
                              *(real(modulo(i*stride, parts), wp)/parts)
         end do
      end associate
   end function stretch

end module tradeoff_sample
