!> Marches a block of samples under the force of its case and computes their results; spectra are
!> formed during the march.
module campaign_sample
   use campaign_harmonic, only: harmonic_collector, start_harmonics
   use campaign_plan, only: kept_dofs, kept_of, output_settings
   use campaign_results, only: block_result
   use campaign_runner, only: runner_type
   use campaign_time_average, only: count_spans, end_of_span, errors_of_averages, fewest_spans
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use dynamics_joint, only: count_open_slips
   use dynamics_response, only: block_state, start_block, stored_energy
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: never, run_block, stop_query

   abstract interface
      !> True if the run has been asked to end.
      logical function stop_query()
      end function stop_query
   end interface

   !> Block during its march.
   type :: march_type
      type(block_state) :: state
      type(output_settings) :: kept                   !! results that are kept of this case
      integer, allocatable :: dofs(:)                 !! dofs with spectra and histories
      logical :: is_audit = .false.                   !! the reference method marches
      real(wp), allocatable :: force(:, :)            !! (0:n_steps, force or force and sample) [N]
      type(harmonic_collector) :: harmonics           !! used under a sine
      logical :: is_measuring = .false.               !! n_discard steps are over
      integer :: span = 0                             !! number of the current span; 0: transient
      real(wp), allocatable :: slip_before(:, :)      !! (joint, sample) slip_time at its start [s]
      real(wp), allocatable :: energy_before(:)       !! (sample) stored energy after n_discard [J]
   end type march_type

contains

   !> Marches samples first, first + 1, ... of a case. If `should_stop` becomes true, it returns a
   !> result of no samples.
   subroutine run_block(runner, case_number, friction, first, should_stop, result, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: case_number
      real(wp), intent(in) :: friction(:, :)   !! (joint, sample)
      integer, intent(in) :: first             !! sample number, from 1
      procedure(stop_query) :: should_stop
      type(block_result), intent(out) :: result
      type(error_type), allocatable, intent(out) :: error
      type(march_type) :: march
      integer :: next, last

      result%case_number = case_number
      result%first_sample = first
      result%n_samples = size(friction, 2)
      result%friction = friction
      call start_march(runner, case_number, result, march, error)
      if (allocated(error)) return
      associate (integration => runner%plan%integration)
         last = 0
         do while (last < integration%n_steps)
            if (should_stop()) then
               result%n_samples = 0
               return
            end if
            if (last == integration%n_discard) call start_measuring(runner, march, result)
            next = last + runner%piece_steps
            if (last < integration%n_discard) next = min(next, integration%n_discard)
            if (march%span > 0) next = min(next, end_of_span(integration, march%span))
            next = min(next, integration%n_steps)
            call march_piece(runner, last, next, march, result, error)
            if (allocated(error)) return
            last = next
            if (march%span > 0) call keep_span(runner, last, march, result)
         end do
      end associate
      call collect(runner, march, result)
      call check_range(result, error)
   end subroutine run_block

   !> False: the `should_stop` of short marches.
   logical function never()
      never = .false.
   end function never

   !> Starts the samples at rest, with their force and memory for histories.
   subroutine start_march(runner, case_number, result, march, error)
      type(runner_type), intent(in) :: runner
      integer, intent(in) :: case_number
      type(block_result), intent(inout) :: result
      type(march_type), intent(inout) :: march
      type(error_type), allocatable, intent(out) :: error

      march%kept = kept_of(runner%plan, case_number)
      march%dofs = kept_dofs(runner%plan)
      march%is_audit = runner%plan%cases(case_number)%audits > 0
      associate (plan => runner%plan, kept => march%kept, n => result%n_samples)
         march%state%keeps_ledger = kept%energy
         march%state%keeps_transitions = kept%transitions
         call start_block(plan%structure, result%friction, march%state)
         allocate (march%force(0:plan%integration%n_steps, &
                               plan%structure%n_forces*merge(n, 1, plan%excitation%per_sample)))
         call runner%force_of(case_number, plan%cases(case_number)%first_sample - 1 &
                              + result%first_sample, march%force)
         if (kept%harmonic) &
            call start_harmonics(plan%integration, plan%cases(case_number)%frequency, &
                                 plan%structure%n_dof, n, march%harmonics, error)
         if (allocated(error)) return
         if (kept%history) then
            allocate (result%displacement(size(march%dofs), 0:plan%integration%n_steps, n), &
                      result%velocity(size(march%dofs), 0:plan%integration%n_steps, n))
            result%displacement(:, 0, :) = march%state%displacement(march%dofs, :)
            result%velocity(:, 0, :) = march%state%velocity(march%dofs, :)
         end if
      end associate
   end subroutine start_march

   !> Resets all sums at the end of the transient (n_discard steps) and starts series and Welch's
   !> sums. An audit has no power series.
   subroutine start_measuring(runner, march, result)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      integer, allocatable :: n_expected   ! number of segments, if their power is followed

      march%is_measuring = .true.
      associate (state => march%state)
         call count_open_slips(runner%plan%structure, state%step*runner%plan%integration%dt, state)
         state%account%slip_time = 0.0_wp
         state%account%slip_distance = 0.0_wp
         state%account%slip_starts = 0
         state%account%stick_starts = 0
         state%work_input = 0.0_wp
         state%work_viscous = 0.0_wp
         march%energy_before = stored_energy(runner%plan%structure, state)
         march%span = 1
         march%slip_before = state%account%slip_time
         if (march%kept%slip) &
            allocate (result%slip_series(state%n_joints, count_spans(runner%plan%integration), &
                                         state%n_samples))
         if (.not. march%kept%spectrum) return
         allocate (result%joint_displacement_max(state%n_joints, state%n_samples), source=0.0_wp)
      end associate
      associate (layout => runner%layout)
         if (layout%follows_power .and. .not. march%is_audit) n_expected = layout%n_segments
         call runner%spectra%start(size(march%dofs)*march%state%n_samples, layout%segment_length, &
                                   layout%overlap, layout%every*runner%marcher%dt, n_expected)
      end associate
   end subroutine start_measuring

   !> Marches from one step to another and adds the displacements to spectra, histories, harmonics
   !> and the largest displacements of the joints.
   subroutine march_piece(runner, from, to, march, result, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: from, to
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable, target :: x(:, :, :)   ! (record, dof, sample)
      real(wp), allocatable :: v(:, :, :)
      real(wp), pointer :: series(:, :)   ! x as (record, dof and sample as one index)
      integer :: every, first, n, stride

      associate (state => march%state, kept => march%kept, &
                 has_spectra => march%kept%spectrum .and. march%is_measuring)
         every = record_every(march, runner%layout%every)
         n = to/every - from/every
         if (.not. (kept%history .or. kept%harmonic .or. has_spectra)) n = 0
         allocate (x(n, state%n_dof, state%n_samples))
         if (kept%history) allocate (v, mold=x)   ! else the marchers record no velocities
         if (march%is_audit) then
            call runner%reference%advance(state, march%force(from:to, :), every, x, v, error)
         else
            call runner%marcher%advance(state, march%force(from:to, :), every, x, v, error)
         end if
         if (allocated(error)) return
         if (kept%harmonic) then
            stride = march%harmonics%every/every
            call march%harmonics%add(x(first_record(from/every, stride)::stride, :, :))
         end if
         if (has_spectra) then
            stride = runner%layout%every/every
            first = first_record(from/every, stride)
            call follow_joints(runner%plan%structure, x(first::stride, :, :), result)
         end if
         if (size(march%dofs) < state%n_dof) then
            x = x(:, march%dofs, :)
            if (kept%history) v = v(:, march%dofs, :)
         end if
         if (kept%history) then
            result%displacement(:, from + 1:to, :) = &
               reshape(x, [size(x, 2), n, size(x, 3)], order=[2, 1, 3])
            result%velocity(:, from + 1:to, :) = &
               reshape(v, [size(v, 2), n, size(v, 3)], order=[2, 1, 3])
         end if
         if (has_spectra) then
            series(1:n, 1:size(x, 2)*size(x, 3)) => x
            call runner%spectra%add(series(first::stride, :))
         end if
      end associate
   end subroutine march_piece

   !> Number of steps between records: 1 for histories, else as spectra and harmonics need.
   pure integer function record_every(march, spectrum_every) result(every)
      type(march_type), intent(in) :: march
      integer, intent(in) :: spectrum_every

      every = spectrum_every
      if (march%kept%harmonic) every = march%harmonics%every
      if (march%kept%harmonic .and. march%kept%spectrum) then
         do while (modulo(spectrum_every, every) /= 0)
            every = every/2   ! a power of two
         end do
      end if
      if (march%kept%history) every = 1
   end function record_every

   !> Place among the next records of the first one whose number is a multiple of the stride.
   pure integer function first_record(n_before, stride)
      integer, intent(in) :: n_before   !! number of records so far
      integer, intent(in) :: stride

      first_record = stride - modulo(n_before, stride)
   end function first_record

   !> Stores the slip fraction of the current span if it ends at this step. Every march is cut into
   !> spans, even if the series is not kept, so that rounding is the same.
   subroutine keep_span(runner, step, march, result)
      type(runner_type), intent(in) :: runner
      integer, intent(in) :: step   !! last step of the march so far
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      integer :: first

      associate (integration => runner%plan%integration, slip_time => march%state%account%slip_time)
         if (step < end_of_span(integration, march%span)) return
         first = end_of_span(integration, march%span - 1)
         call count_open_slips(runner%plan%structure, step*integration%dt, march%state)
         if (allocated(result%slip_series)) &
            result%slip_series(:, march%span, :) = (slip_time - march%slip_before) &
                                                   /((step - first)*integration%dt)
         march%slip_before = slip_time
         march%span = march%span + 1
      end associate
   end subroutine keep_span

   !> Updates joint_displacement_max, the largest |w_j.x| [m].
   pure subroutine follow_joints(structure, x, result)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: x(:, :, :)   !! (record, dof, sample) [m]
      type(block_result), intent(inout) :: result
      real(wp) :: between(size(x, 1)), peak
      integer, allocatable :: dofs(:)   ! dofs at the ends of the joint
      integer :: i, joint, w

      do joint = 1, structure%n_joints
         associate (share => structure%direction(:, joint), &
                    largest => result%joint_displacement_max(joint, :))
            dofs = pack([(i, i=1, size(share))], abs(share) > 0.0_wp)
            do w = 1, size(x, 3)
               between = 0.0_wp
               do i = 1, size(dofs)
                  between = between + share(dofs(i))*x(:, dofs(i), w)
               end do
               peak = largest(w)
               do i = 1, size(between)   ! as vectors, which maxval is not
                  peak = max(peak, abs(between(i)))
               end do
               largest(w) = peak
            end do
         end associate
      end do
   end subroutine follow_joints

   !> Computes the results of the block from its state at the end of the march.
   subroutine collect(runner, march, result)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      real(wp), allocatable :: power(:, :, :)   ! (batch, range, dof and sample as one index)
      real(wp), allocatable :: psd(:, :)        ! (frequency, dof and sample as one index)
      real(wp) :: duration

      associate (state => march%state, kept => march%kept, integration => runner%plan%integration)
         duration = integration%dt*(integration%n_steps - integration%n_discard)
         result%slip_fraction = state%account%slip_time/duration
         if (kept%slip .and. count_spans(integration) >= fewest_spans) &
            result%slip_fraction_error = errors_of_averages(result%slip_series)
         result%slip_starts = state%account%slip_starts
         result%stick_starts = state%account%stick_starts
         result%slip_distance = state%account%slip_distance
         result%dissipation = state%slip_limit*state%account%slip_distance
         if (kept%transitions) call move_alloc(state%transitions, result%transitions)
         if (kept%energy) then
            result%energy_input = state%work_input
            result%energy_viscous = state%work_viscous
            result%energy_friction = sum(result%dissipation, 1)
            result%energy_stored = stored_energy(runner%plan%structure, state) - march%energy_before
            result%energy_defect = state%work_input - state%work_viscous - result%energy_friction &
                                   - result%energy_stored
         end if
         if (kept%harmonic) call march%harmonics%finish(result)
      end associate
      if (.not. march%kept%spectrum) return
      associate (n_dof => size(march%dofs), n => result%n_samples)
         allocate (psd(size(runner%layout%frequency), n_dof*n))
         call runner%spectra%finish(psd)
         result%psd = reshape(psd, [n_dof, size(psd, 1), n], order=[2, 1, 3])
         if (.not. runner%layout%follows_power .or. march%is_audit) return
         power = runner%spectra%power_series()
         result%power_series = reshape(power, [n_dof, size(power)/(n_dof*n), n], order=[2, 1, 3])
      end associate
   end subroutine collect

   !> Refuses results that are infinite or whose squares would be.
   pure subroutine check_range(result, error)
      type(block_result), intent(in) :: result
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: largest = 1.0e150_wp
      logical :: is_within
      integer :: i

      do i = 1, result%n_samples
         is_within = all(result%slip_distance(:, i) <= largest) .and. &
                     all(result%dissipation(:, i) <= largest)
         if (allocated(result%psd)) is_within = is_within .and. all(result%psd(:, :, i) <= largest)
         if (is_within) cycle
         call raise(error, exit_no_solution, 'spectra or slip beyond 1e150: scale the units of '// &
                    'the scene; motion grows if K has a negative eigenvalue')
         error%sample = i
         return
      end do
   end subroutine check_range

end module campaign_sample
