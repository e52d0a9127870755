!> Blocks of samples: marched under the force of their case, spectra formed as the march goes.
module campaign_sample
   use campaign_harmonic, only: harmonic_collector, start_harmonics
   use campaign_plan, only: kept_dofs, kept_of, output_settings
   use campaign_results, only: block_result
   use campaign_runner, only: runner_type
   use campaign_time_average, only: count_spans, end_of_span, errors_of_averages, fewest_spans
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use dynamics_joint, only: close_account
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

   !> A march on its way: the block and what listens to it.
   type :: march_type
      type(block_state) :: state
      type(output_settings) :: keeps
      integer, allocatable :: dofs(:)                 !! of spectra and histories
      logical :: is_audit = .false.                   !! marched by the reference
      real(wp), allocatable :: force(:, :)            !! (0:n_steps, force or force and sample) [N]
      type(harmonic_collector) :: harmonics           !! under a sine
      logical :: is_measuring = .false.               !! past n_discard
      integer :: span = 0                             !! of the slip series, on its way
      real(wp), allocatable :: slip_before(:, :)      !! (joint, sample) slip_time at its start [s]
      real(wp), allocatable :: energy_before(:)       !! (sample) stored at the end of n_discard [J]
   end type march_type

contains

   !> Runs samples first, first + 1, ... of a case. Abandoned, and then of no samples, when
   !> `should_stop`.
   subroutine run_block(runner, case_number, friction, first, should_stop, result, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: case_number
      real(wp), intent(in) :: friction(:, :)   !! (joint, sample)
      integer, intent(in) :: first             !! number of the first sample, from 1
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

   !> True if a march is to stop: never, where it is short.
   logical function never()
      never = .false.
   end function never

   !> Starts samples at rest, with their force and room for the results that are kept.
   subroutine start_march(runner, case_number, result, march, error)
      type(runner_type), intent(in) :: runner
      integer, intent(in) :: case_number
      type(block_result), intent(inout) :: result
      type(march_type), intent(inout) :: march
      type(error_type), allocatable, intent(out) :: error

      march%keeps = kept_of(runner%plan, case_number)
      march%dofs = kept_dofs(runner%plan)
      march%is_audit = runner%plan%cases(case_number)%audits > 0
      associate (plan => runner%plan, output => march%keeps, n => result%n_samples)
         march%state%keeps_ledger = output%energy
         march%state%keeps_transitions = output%transitions
         call start_block(plan%structure, result%friction, march%state)
         allocate (march%force(0:plan%integration%n_steps, &
                               plan%structure%n_forces*merge(n, 1, plan%excitation%per_sample)))
         call runner%force_of(case_number, plan%cases(case_number)%first_sample - 1 &
                              + result%first_sample, march%force, error)
         if (allocated(error)) return
         if (output%harmonic) &
            call start_harmonics(plan%integration, plan%cases(case_number)%frequency, &
                                 plan%structure%n_dof, n, march%harmonics, error)
         if (allocated(error)) return
         if (output%history) then
            allocate (result%displacement(size(march%dofs), 0:plan%integration%n_steps, n), &
                      result%velocity(size(march%dofs), 0:plan%integration%n_steps, n))
            result%displacement(:, 0, :) = march%state%displacement(march%dofs, :)
            result%velocity(:, 0, :) = march%state%velocity(march%dofs, :)
         end if
      end associate
   end subroutine start_march

   !> Resets all sums at the end of the transient.
   subroutine start_measuring(runner, march, result)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result

      march%is_measuring = .true.
      associate (state => march%state, layout => runner%layout)
         call close_account(runner%plan%structure, state%step*runner%plan%integration%dt, state)
         state%slip_time = 0.0_wp
         state%slip_distance = 0.0_wp
         state%slip_starts = 0
         state%stick_starts = 0
         state%work_input = 0.0_wp
         state%work_viscous = 0.0_wp
         march%energy_before = stored_energy(runner%plan%structure, state)
         march%span = 1
         march%slip_before = state%slip_time
         if (march%keeps%slip) &
            allocate (result%slip_series(state%n_joints, count_spans(runner%plan%integration), &
                                         state%n_samples))
         if (march%keeps%spectrum) then
            call start_spectra(runner, march)
            allocate (result%joint_displacement_max(state%n_joints, state%n_samples), source=0.0_wp)
         end if
      end associate
   end subroutine start_measuring

   subroutine start_spectra(runner, march)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(in) :: march
      integer, allocatable :: n_expected   ! segments, where their power is followed

      associate (layout => runner%layout)
         if (layout%follows_power .and. .not. march%is_audit) n_expected = layout%n_segments
         call runner%spectra%start(size(march%dofs)*march%state%n_samples, layout%segment_length, &
                                   layout%overlap, layout%every*runner%marcher%dt, n_expected)
      end associate
   end subroutine start_spectra

   !> Marches from one step to another and hands the displacements to the spectra and the history.
   subroutine march_piece(runner, from, to, march, result, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: from, to
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable, target :: x(:, :, :), v(:, :, :)   ! (record, dof, sample)
      integer :: every, n

      associate (state => march%state, output => march%keeps)
         every = record_every(march, runner%layout%every)
         n = to/every - from/every
         if (.not. (output%history .or. output%harmonic .or. &
                    output%spectrum .and. march%is_measuring)) n = 0
         allocate (x(n, state%n_dof, state%n_samples))
         if (output%history) allocate (v, mold=x)   ! else the marchers record no velocities
         if (march%is_audit) then
            call runner%reference%advance(state, march%force(from:to, :), every, x, v, error)
         else
            call runner%marcher%advance(state, march%force(from:to, :), every, x, v, error)
         end if
         if (allocated(error)) return
         if (output%harmonic) then
            associate (stride => march%harmonics%every/every)
               call march%harmonics%add(x(stride - modulo(from/every, stride)::stride, :, :))
            end associate
         end if
         if (output%spectrum .and. march%is_measuring) &
            call follow_joints(runner%plan%structure, x(first_record(runner, from, every):: &
                                                        runner%layout%every/every, :, :), result)
         if (size(march%dofs) < state%n_dof) then
            x = x(:, march%dofs, :)
            if (output%history) v = v(:, march%dofs, :)
         end if
         if (output%history) then
            result%displacement(:, from + 1:to, :) = &
               reshape(x, [size(x, 2), n, size(x, 3)], order=[2, 1, 3])
            result%velocity(:, from + 1:to, :) = &
               reshape(v, [size(v, 2), n, size(v, 3)], order=[2, 1, 3])
         end if
         if (output%spectrum .and. march%is_measuring) call listen(runner, from, every, x)
      end associate
   end subroutine march_piece

   !> Steps between records: one for histories, else as spectra and harmonics need them.
   pure integer function record_every(march, of_spectra) result(every)
      type(march_type), intent(in) :: march
      integer, intent(in) :: of_spectra

      every = of_spectra
      if (march%keeps%harmonic) every = march%harmonics%every
      if (march%keeps%harmonic .and. march%keeps%spectrum) then
         do while (modulo(of_spectra, every) /= 0)
            every = every/2   ! a power of two
         end do
      end if
      if (march%keeps%history) every = 1
   end function record_every

   !> Records the slip fraction of a span that ends at this step. Every march is cut into spans,
   !> even where the series is not kept, so that rounding is the same.
   subroutine keep_span(runner, step, march, result)
      type(runner_type), intent(in) :: runner
      integer, intent(in) :: step   !! the march has come to
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      integer :: first

      associate (integration => runner%plan%integration, slip_time => march%state%slip_time)
         if (step < end_of_span(integration, march%span)) return
         first = end_of_span(integration, march%span - 1)
         call close_account(runner%plan%structure, step*integration%dt, march%state)
         if (allocated(result%slip_series)) &
            result%slip_series(:, march%span, :) = (slip_time - march%slip_before) &
                                                   /((step - first)*integration%dt)
         march%slip_before = slip_time
         march%span = march%span + 1
      end associate
   end subroutine keep_span

   !> Hands displacements recorded every so many steps to the spectra, those of the layout's dofs.
   subroutine listen(runner, from, every, x)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: from, every     !! steps before the first record; steps between records
      real(wp), intent(in), contiguous, target :: x(:, :, :)   !! (record, dof, sample)
      real(wp), pointer :: series(:, :)      ! (record, dof and sample as one index)

      series(1:size(x, 1), 1:size(x, 2)*size(x, 3)) => x
      call runner%spectra%add(series(first_record(runner, from, every)::runner%layout%every/every, &
                                     :))
   end subroutine listen

   !> The first record that enters the spectra.
   pure integer function first_record(runner, from, every) result(first)
      type(runner_type), intent(in) :: runner
      integer, intent(in) :: from, every   !! steps before the first record; steps between records
      integer :: stride

      stride = runner%layout%every/every
      first = stride - modulo(from/every, stride)
   end function first_record

   !> Updates the largest displacement between the ends of each joint [m].
   pure subroutine follow_joints(structure, x, result)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: x(:, :, :)   !! (record, dof, sample) [m]
      type(block_result), intent(inout) :: result
      real(wp) :: between(size(x, 1))
      integer, allocatable :: dofs(:)   ! that the joint holds
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
               largest(w) = max(largest(w), maxval(abs(between)))
            end do
         end associate
      end do
   end subroutine follow_joints

   !> Forms the block's result from the state at the end of the march.
   subroutine collect(runner, march, result)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(inout) :: march
      type(block_result), intent(inout) :: result
      real(wp) :: duration

      associate (state => march%state, output => march%keeps, how => runner%plan%integration)
         duration = how%dt*(how%n_steps - how%n_discard)
         result%slip_fraction = state%slip_time/duration
         if (output%slip .and. count_spans(how) >= fewest_spans) &
            result%slip_fraction_error = errors_of_averages(result%slip_series)
         result%slip_starts = state%slip_starts
         result%stick_starts = state%stick_starts
         result%slip_distance = state%slip_distance
         result%dissipation = state%slip_limit*state%slip_distance
         if (output%transitions) call move_alloc(state%transitions, result%transitions)
         if (output%energy) then
            result%energy_input = state%work_input
            result%energy_viscous = state%work_viscous
            result%energy_friction = sum(result%dissipation, 1)
            result%energy_stored = stored_energy(runner%plan%structure, state) - march%energy_before
            result%energy_defect = state%work_input - state%work_viscous - result%energy_friction &
                                   - result%energy_stored
         end if
         if (output%harmonic) call march%harmonics%finish(result)
         if (output%spectrum) call collect_spectra(runner, march, result)
      end associate
   end subroutine collect

   subroutine collect_spectra(runner, march, result)
      type(runner_type), intent(inout) :: runner
      type(march_type), intent(in) :: march
      type(block_result), intent(inout) :: result
      real(wp), allocatable :: power(:, :, :)   ! (batch, range, series)
      real(wp), allocatable :: psd(:, :)        ! (frequency, series)

      associate (n_dof => size(march%dofs), n => result%n_samples)
         allocate (psd(size(runner%layout%frequency), n_dof*n))
         call runner%spectra%finish(psd)
         result%psd = reshape(psd, [n_dof, size(psd, 1), n], order=[2, 1, 3])
         if (.not. runner%layout%follows_power .or. march%is_audit) return
         power = runner%spectra%power_series()
         result%power_series = reshape(power, [n_dof, size(power)/(n_dof*n), n], order=[2, 1, 3])
      end associate
   end subroutine collect_spectra

   !> Refuses results whose squares would overflow, or that have overflown.
   pure subroutine check_range(result, error)
      type(block_result), intent(in) :: result
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: largest = 1.0e150_wp
      logical :: is_within

      is_within = all(result%slip_distance <= largest) .and. all(result%dissipation <= largest)
      if (allocated(result%psd)) is_within = is_within .and. all(result%psd <= largest)
      if (.not. is_within) call raise(error, exit_no_solution, 'case '// &
                                      to_text(result%case_number)//': spectra or slip beyond '// &
                                      '1e150: scale the units of the scene; motion grows if '// &
                                      'K has a negative eigenvalue')
   end subroutine check_range

end module campaign_sample
