!> Prepares what all blocks of a plan share: marchers, force record, layout of the spectra.
module campaign_runner
   use campaign_plan, only: integration_settings, kept_dofs, plan_type, reference_for
   use campaign_results, only: spectrum_layout
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: brief, to_text
   use dynamics_exact_march, only: exact_march, new_exact_march
   use dynamics_excitation, only: noise_force, sine_force
   use dynamics_newmark_march, only: new_newmark, newmark_marcher
   use dynamics_response, only: marcher_type
   use numerics_spectrum, only: has_enough_batches, count_segments, welch_type
   implicit none(type, external)
   private
   public :: runner_type, prepare_runner, block_width, layout_of, new_marcher

   integer, parameter :: widest_block = 32            !! number of samples marched side by side
   integer, parameter :: records_per_piece = 264      !! records marched before spectra take them
   real(wp), parameter :: block_memory = 128.0e6_wp   !! forces and histories of a block [byte]

   !> Data that a rank needs to march any block of a plan.
   type :: runner_type
      type(plan_type) :: plan
      class(marcher_type), allocatable :: marcher
      class(marcher_type), allocatable :: reference   !! marcher of audits; not allocated without
      !> force record of strength 1 [N] (0:n_steps, force, or force + n_forces*(sample - 1)); not
      !> allocated for a sine or for noise per sample
      real(wp), allocatable :: force(:, :)
      type(spectrum_layout) :: layout
      !> (dof, case) share of the variance above the kept Nyquist frequency, from the pilot march
      real(wp), allocatable :: folded_share(:, :)
      type(welch_type) :: spectra            !! Welch's sums of the current block
      integer :: piece_steps = records_per_piece   !! number of steps marched at a time
   contains
      procedure :: draw_force
      procedure :: force_of
      procedure :: form_of_march
   end type runner_type

contains

   !> Prepares the march of a plan.
   subroutine prepare_runner(plan, file_force, runner, error, prepared)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N] of kind 'file'
      type(runner_type), intent(out) :: runner
      type(error_type), allocatable, intent(out) :: error
      !> runner for the same structure, methods and step, which loses its marchers to this one
      type(runner_type), intent(inout), optional :: prepared

      runner%plan = plan
      if (present(prepared)) then
         call move_alloc(prepared%marcher, runner%marcher)
         call move_alloc(prepared%reference, runner%reference)
      else
         call new_marcher(plan, plan%integration, runner%marcher, error)
         if (allocated(error)) return
         if (any(plan%cases%audits > 0)) &
            call new_marcher(plan, reference_for(plan%integration), runner%reference, error)
         if (allocated(error)) return
      end if
      if (plan%excitation%kind == 'file') then
         runner%force = file_force
      else if (plan%excitation%kind /= 'sine' .and. .not. plan%excitation%per_sample) then
         allocate (runner%force(0:plan%integration%n_steps, plan%structure%n_forces))
         call runner%draw_force(0, runner%force)
      end if
      runner%layout = layout_of(plan)
      runner%piece_steps = records_per_piece*runner%layout%every
   end subroutine prepare_runner

   !> Text on the form of the exact march and the multiplications of a sample-step by each form; ''
   !> for Newmark's scheme.
   pure function form_of_march(self) result(text)
      class(runner_type), intent(in) :: self
      character(:), allocatable :: text
      real(wp), parameter :: unknown = huge(1.0_wp)
      integer, parameter :: many_parts = 16   ! modes below 1/(2 dt) need 8 at tolerance 1e-6
      integer :: n   ! modes above 1/(2 dt)

      text = ''
      select type (marcher => self%marcher)
      type is (exact_march)
         associate (series => marcher%work_series, modes => marcher%work_modes, &
                    is_modal => marcher%form == 'modes')
            text = 'by '//marcher%form//', '//to_text(nint(merge(modes, series, is_modal)))// &
                   ' multiplications a step of a sample'
            if (max(series, modes) < unknown) &
               text = text//'; by '//trim(merge('power series', 'modes       ', is_modal))// &
                      ' '//to_text(nint(merge(series, modes, is_modal)))
            if (marcher%parts > 1) text = text//'; '//to_text(marcher%parts)//' parts a step'
            if (.not. is_modal .or. marcher%parts < many_parts) return
         end associate
         ! The sampled force cannot contain modes above 1/(2 dt). A reduced model without them needs
         ! fewer parts of a step, if there are more such modes than dofs of joints.
         associate (structure => marcher%structure, limit => 0.5_wp/marcher%dt)
            n = count(structure%frequencies_stuck > limit)
            if (n > 0) text = text//', as '//to_text(n)//' of '//to_text(structure%n_dof)// &
                              ' modes are above 1/(2 dt) = '//brief(limit)//' Hz'
            if (n > count(any(abs(structure%direction) > 0.0_wp, dim=2))) &
               text = text//': the importer''s --modes leaves out all but those of the joints'
         end associate
      end select
   end function form_of_march

   !> Creates the marcher of a method for the plan's structure.
   subroutine new_marcher(plan, integration, marcher, error)
      type(plan_type), intent(in) :: plan
      type(integration_settings), intent(in) :: integration
      class(marcher_type), allocatable, intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      type(newmark_marcher), allocatable :: newmark
      type(exact_march), allocatable :: exact

      if (integration%method == 'newmark') then
         allocate (newmark)
         call new_newmark(plan%structure, integration%dt, integration%max_halvings, &
                          integration%beta, integration%gamma, newmark, error)
         call move_alloc(newmark, marcher)
      else
         allocate (exact)
         call new_exact_march(plan%structure, integration%dt, integration%tolerance, exact, error)
         call move_alloc(exact, marcher)
      end if
   end subroutine new_marcher

   !> Draws the noise of a sample (0: of all samples), an independent record for each force. The
   !> expected variance of band-limited noise is 1.
   subroutine draw_force(self, sample, force)
      class(runner_type), intent(in) :: self
      integer, intent(in) :: sample
      real(wp), intent(out) :: force(0:, :)   !! (step, force) [N]
      type(stream_type) :: stream
      integer(long) :: label
      integer :: k

      label = label_of('force')
      do k = 1, size(force, 2)
         if (k > 1) label = label_of(label_of('force'), k)
         stream = new_stream(self%plan%seed, label, sample)
         associate (excitation => self%plan%excitation, dt => self%plan%integration%dt)
            if (excitation%kind == 'psd') then
               call noise_force(excitation%density(1, :), dt, stream, force(:, k), &
                                excitation%density(2, :))
            else
               call noise_force(excitation%band, dt, stream, force(:, k))
            end if
         end associate
      end do
   end subroutine draw_force

   !> Returns the force on the samples of a case, with its strength.
   subroutine force_of(self, case_number, first_sample, force)
      class(runner_type), intent(in) :: self
      integer, intent(in) :: case_number
      integer, intent(in) :: first_sample     !! number of the first sample, if each has its own
      real(wp), intent(out) :: force(0:, :)   !! (step, force, or force and sample) [N]
      integer :: first, i

      associate (excitation => self%plan%excitation, n => self%plan%structure%n_forces)
         do i = 1, size(force, 2)/n
            first = n*(first_sample + i - 2)   ! column of self%force before those of the sample
            if (excitation%kind == 'sine') then
               call sine_force(self%plan%cases(case_number)%frequency, self%plan%integration%dt, &
                               force(:, 1))
               force(:, 2:) = spread(force(:, 1), 2, size(force, 2) - 1)
            else if (.not. excitation%per_sample) then
               force(:, :) = self%force(:, :n)
            else if (excitation%kind == 'file') then
               force(:, n*(i - 1) + 1:n*i) = self%force(:, first + 1:first + n)
            else
               call self%draw_force(first_sample + i - 1, force(:, n*(i - 1) + 1:n*i))
            end if
         end do
         associate (strength => self%plan%cases(case_number)%strength)
            force = merge(sqrt(strength), strength, excitation%kind == 'band_limited')*force
         end associate
      end associate
   end subroutine force_of

   !> Layout of the spectra, whose values are those of every k-th step.
   pure type(spectrum_layout) function layout_of(plan) result(layout)
      type(plan_type), intent(in) :: plan
      integer :: i, n

      layout%every = max(plan%output%spectrum_every, 1)
      layout%segment_length = plan%output%segment_length/layout%every
      layout%overlap = layout%segment_length/2
      n = (plan%integration%n_steps - plan%integration%n_discard)/layout%every
      layout%n_segments = count_segments(n, layout%segment_length, layout%overlap)
      layout%follows_power = has_enough_batches(layout%n_segments) .and. &
                             .not. plan%excitation%per_sample
      layout%frequency = [(i/(layout%segment_length*layout%every*plan%integration%dt), &
                           i=0, layout%segment_length/2)]
   end function layout_of

   !> Number of samples of a block: 32, or fewer if their forces and histories need much memory.
   pure integer function block_width(plan) result(width)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes   ! memory of a sample

      bytes = 0.0_wp
      if (plan%excitation%per_sample) &
         bytes = 8.0_wp*plan%structure%n_forces*plan%integration%n_steps
      if (plan%output%history) &
         bytes = bytes + 16.0_wp*size(kept_dofs(plan))*plan%integration%n_steps
      width = widest_block
      if (bytes > 0.0_wp) width = max(1, min(widest_block, int(block_memory/bytes)))
   end function block_width

end module campaign_runner
