!> Draws and marches some samples of a campaign, under the first part of its force, to measure
!> settings on them.
!>
!> Samples of all cases with one force level share a block, as wide as the campaign's blocks: a step
!> costs the same as in the campaign.
module tradeoff_sample
   use campaign_plan, only: case_type, plan_type
   use campaign_results, only: block_result
   use campaign_runner, only: block_width, prepare_runner, runner_type
   use campaign_sample, only: run_block, stop_query
   use campaign_study, only: block_range, draw_friction, name_sample
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: label_of, new_stream, stream_type
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use tradeoff_settings, only: setting_type, with_setting
   implicit none(type, external)
   private
   public :: level_type, choose_levels, draw_level, march_level
   public :: fit_segments, shortened, resampled_force, only_slip_and_spectra

   integer, parameter :: most_levels = 4
   !> Transitions of a sample in a step, as long as none are counted.
   real(wp), parameter, public :: assumed_transitions = 0.3_wp
   real(wp), parameter, public :: history_memory = 32.0e6_wp   !! histories of a timed march [byte]

   !> Force level with the samples that are marched at it.
   type :: level_type
      real(wp) :: strength = 0.0_wp            !! as in case_type
      integer :: n_all = 0                     !! number of the campaign's samples at this level
      real(wp) :: transitions = assumed_transitions   !! transitions of a sample in a step
      type(block_range), allocatable :: samples(:)   !! each a range of one
      real(wp), allocatable :: friction(:, :)  !! (joint, sample)
      real(wp), allocatable :: force(:, :)     !! (0:n_steps, 1 or sample) [N]
   end type level_type

contains

   !> Chooses at most four force levels, the lowest and the highest among them, and a block of
   !> samples at each: the first samples of its cases, about as many of each.
   pure subroutine choose_levels(plan, levels)
      type(plan_type), intent(in) :: plan
      type(level_type), allocatable, intent(out) :: levels(:)
      real(wp), allocatable :: strengths(:)
      integer, allocatable :: cases(:)
      integer :: i, k, n, sample, width

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
         levels(k)%n_all = sum(plan%cases(cases)%n_samples)
         ! samples 1 of the cases in turn, then samples 2, ...; no more than the largest case has
         width = min(block_width(plan), maxval(plan%cases(cases)%n_samples))
         allocate (levels(k)%samples(0))
         do sample = 1, width
            levels(k)%samples = [levels(k)%samples, &
                                 pack([(block_range(cases(i), sample, sample), i=1, size(cases))], &
                                      plan%cases(cases)%n_samples >= sample)]
         end do
         levels(k)%samples = levels(k)%samples(:width)
      end do
   end subroutine choose_levels

   !> Draws the friction and the force of a level's samples. Without models, substitute_friction
   !> draws the friction: numerical errors hardly depend on more than its mean and scatter.
   subroutine draw_level(plan, runner, n_steps, level, models)
      type(plan_type), intent(in) :: plan
      type(runner_type), intent(in) :: runner   !! runner of the whole campaign
      integer, intent(in) :: n_steps            !! steps of the force that are kept
      type(level_type), intent(inout) :: level
      type(process_model_type), intent(in), optional :: models(:)   !! (process)
      real(wp), allocatable :: force(:, :)
      integer :: i, n

      n = size(level%samples)
      if (present(models)) then
         call draw_friction(plan, models, level%samples, level%friction)
      else
         allocate (level%friction(plan%structure%n_joints, n))
         do i = 1, n
            level%friction(:, i) = substitute_friction(plan, level%samples(i))
         end do
      end if
      n = merge(n, 1, plan%excitation%per_sample)*plan%structure%n_forces
      allocate (force(0:plan%integration%n_steps, n))
      call runner%force_of(level%samples(1)%case_number, 1, force)
      allocate (level%force(0:n_steps, n), source=force(:n_steps, :))
   end subroutine draw_level

   !> Independent friction values |mean + std z|, z normal, with the mean and standard deviation of
   !> the case's process.
   pure function substitute_friction(plan, sample) result(friction)
      type(plan_type), intent(in) :: plan
      type(block_range), intent(in) :: sample   !! a range of one
      real(wp) :: friction(plan%structure%n_joints), values(plan%structure%n_points)
      type(stream_type) :: stream

      friction = plan%friction
      associate (process => plan%cases(sample%case_number)%process)
         if (process == 0) return
         stream = new_stream(plan%seed, label_of(label_of('stand-in'), sample%case_number), &
                             sample%first)
         call stream%normals(values)
         values = abs(plan%processes(process)%mean + plan%processes(process)%std*values)
         friction = values(plan%structure%friction_point)
      end associate
   end function substitute_friction

   !> Plan that discards no steps and keeps only slip fractions and spectra.
   pure type(plan_type) function only_slip_and_spectra(plan) result(short)
      type(plan_type), intent(in) :: plan

      short = plan
      short%integration%n_discard = 0
      short%output%energy = .false.
      short%output%history = .false.
      short%output%harmonic = .false.
      short%output%transitions = .false.
      short%output%dofs = [integer ::]
   end function only_slip_and_spectra

   !> Plan of about n_steps, at least 4096 and a multiple of `unit` if the scene has as many. Keeps
   !> only slip fractions and spectra.
   pure type(plan_type) function shortened(plan, unit, n_steps) result(short)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: unit, n_steps
      integer, parameter :: least = 4096

      short = only_slip_and_spectra(plan)
      short%integration%n_steps = min(plan%integration%n_steps, max(least, n_steps))
      if (short%integration%n_steps >= unit) &
         short%integration%n_steps = unit*(short%integration%n_steps/unit)
      short%output%spectrum_every = max(plan%output%spectrum_every, 1)
      call fit_segments(short%integration%n_steps, short)
   end function shortened

   !> Limits the Welch segments to half of n_steps. Turns spectra off if a segment then has too few
   !> values.
   pure subroutine fit_segments(n_steps, plan)
      integer, intent(in) :: n_steps
      type(plan_type), intent(inout) :: plan
      integer, parameter :: fewest_values = 16

      associate (output => plan%output, unit => 2*plan%output%spectrum_every)
         output%segment_length = unit*(min(output%segment_length, n_steps/2)/unit)
         output%spectrum = output%spectrum .and. output%segment_length >= fewest_values*unit/2
      end associate
   end subroutine fit_segments

   !> Marches the samples of a level under its force with one setting. `plan` gives the number of
   !> steps (at most those of level%force) and the results that are kept.
   subroutine march_level(plan, level, setting, should_stop, result, nanoseconds, error, prepared)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      type(setting_type), intent(in) :: setting
      procedure(stop_query) :: should_stop
      type(block_result), intent(out) :: result
      real(wp), intent(out) :: nanoseconds   !! processor time of a sample-step of the scene
      type(error_type), allocatable, intent(out) :: error
      type(runner_type), intent(inout), optional :: prepared   !! runner whose marchers are used
      type(plan_type) :: short
      type(runner_type) :: runner
      real(wp) :: after, before

      nanoseconds = 0.0_wp
      short = with_setting(plan, setting)
      short%excitation%kind = 'file'
      short%excitation%per_sample = size(level%force, 2) > plan%structure%n_forces
      short%cases = [case_type(n_samples=size(level%samples))]
      associate (n_steps => plan%integration%n_steps)
         call prepare_runner(short, resampled_force(level%force(:n_steps, :), setting), runner, &
                             error, prepared)
         if (allocated(error)) return
         call cpu_time(before)
         call run_block(runner, 1, level%friction, 1, should_stop, result, error)
         call cpu_time(after)
         if (present(prepared)) then
            call move_alloc(runner%marcher, prepared%marcher)
            call move_alloc(runner%reference, prepared%reference)
         end if
         if (allocated(error)) call name_sample(plan, level%samples, error)
         nanoseconds = 1.0e9_wp*(after - before)/(real(n_steps, wp)*size(level%samples))
      end associate
   end subroutine march_level

   !> Force at the steps of a setting [N]: linear between the steps of the scene, or every stride-th
   !> value.
   pure function resampled_force(force, setting) result(resampled)
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N]
      type(setting_type), intent(in) :: setting
      real(wp), allocatable :: resampled(:, :)   !! (0:step, force)
      integer :: i, k, n

      n = ubound(force, 1)
      associate (parts => setting%parts, stride => setting%stride)
         allocate (resampled(0:n*parts/stride, size(force, 2)))
         do i = 0, ubound(resampled, 1)
            k = i*stride/parts
            resampled(i, :) = force(k, :) + (force(min(k + 1, n), :) - force(k, :)) &
                              *(real(modulo(i*stride, parts), wp)/parts)
         end do
      end associate
   end function resampled_force

end module tradeoff_sample
