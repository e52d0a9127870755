!> Exact march of a structure with diagonal mass by power series in its dofs.
!>
!> After a transition at tau the new regime adds the force s k (w.x(t) - w.x(tau)) on one dof. That
!> dof responds by a series of its own (6), the dofs around it by sums over that series (7). Joints
!> for which this is not accurate enough, links among them, are left to `march_again`, which starts
!> the series of the whole sample again at each transition.
module dynamics_exact_series_form
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_free_steps, only: expand_series, find_candidates, find_link_paths
   use dynamics_exact_guard_zeros, only: first_transition, no_zero
   use dynamics_exact_joint_paths, only: local_responses, regime_reach, regime_side, &
                                         regime_slider, width
   use dynamics_exact_local_responses, only: find_responses
   use dynamics_exact_ledger, only: ledger_type, new_ledger
   use dynamics_exact_series, only: new_series, series_type
   use dynamics_exact_transitions, only: n_response_sums, transition_group
   use dynamics_response, only: block_state, march_work
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: series_form, new_series_form

   !> Base system by power series.
   type, extends(base_system) :: series_form
      type(series_type) :: series
      type(ledger_type) :: ledger
      logical :: has_work = .false.   !! True if march_again has added the work of the part
   contains
      procedure :: load_state
      procedure :: store_state
      procedure :: march_freely
      procedure :: add_transition
      procedure :: march_again
      procedure :: end_part
      procedure :: copy_state
      procedure :: work
   end type series_form

contains

   !> Prepares the form for a step of equal parts.
   subroutine new_series_form(structure, dt, parts, tolerance, form)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      integer, intent(in) :: parts        !! parts of a step
      real(wp), intent(in) :: tolerance   !! relative to the rms displacement
      type(series_form), intent(out) :: form

      form%h = dt/parts
      form%n_internal = structure%n_dof
      call new_series(structure, dt, parts, tolerance, form%series)
      form%ledger = new_ledger(form%series, structure, tolerance)
      call find_responses(structure, form%series, tolerance, form%paths%responses)
   end subroutine new_series_form

   !> Work of a step (11). A transition that is not local starts all series again.
   pure type(march_work) function work(self, parts)
      class(series_form), intent(in) :: self
      integer, intent(in) :: parts   !! parts of a step
      real(wp), parameter :: per_local = 2500.0_wp, per_restart = 6000.0_wp

      work%step = parts*self%series%work()
      work%lanes = width
      work%n_parts = parts
      associate (is_local => self%paths%responses%is_local)
         work%restart_share = real(count(.not. is_local), wp)/max(1, size(is_local))
      end associate
      work%transition = (1.0_wp - work%restart_share)*per_local + work%restart_share*per_restart
   end function work

   !> See base_system. Velocities are in m per part here, in m/s in the block.
   subroutine load_state(self, state)
      class(series_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: last

      call self%paths%initialize(self%series%degree, size(self%series%load, 2), &
                                 self%series%diagonal, self%series%row, self%series%spring)
      associate (x => self%paths%x, layer => self%paths%layer, m => self%paths%n_samples, &
                 n => self%series%n_dof, first => self%paths%first_sample)
         last = first + m - 1
         x(:m, :n, layer(0)) = transpose(state%displacement(:, first:last))
         x(:m, :n, layer(1)) = transpose(state%velocity(:, first:last))*self%h
         if (self%has_internal) x(:m, :n, layer(1)) = transpose(state%internal(:, first:last))
      end associate
      call find_link_starts(self)
   end subroutine load_state

   !> See base_system.
   subroutine store_state(self, state)
      class(series_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: last

      associate (x => self%paths%x, layer => self%paths%layer, m => self%paths%n_samples, &
                 n => self%series%n_dof, first => self%paths%first_sample)
         last = first + m - 1
         state%displacement(:, first:last) = transpose(x(:m, :n, layer(0)))
         state%internal(:, first:last) = transpose(x(:m, :n, layer(1)))
         state%velocity(:, first:last) = state%internal(:, first:last)/self%h
      end associate
   end subroutine store_state

   !> See base_system.
   subroutine march_freely(self)
      class(series_form), intent(inout) :: self

      call expand_series(self%series, self%paths)
      call find_candidates(self%paths)
   end subroutine march_freely

   !> See base_system.
   subroutine add_transition(self, group, entry)
      class(series_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry

      associate (x => self%paths%x, finish => self%paths%finish)
         call add_response(size(x, 2), self%paths%responses, group, entry, x(1, 1, finish(0)), &
                           x(1, 1, finish(1)))
      end associate
      if (self%keeps_ledger) &
         call self%ledger%keep_response(self%series%loaded, self%paths%responses, group, entry)
   end subroutine add_transition

   !> Adds the responses of the joint's own dof and of the dofs around it (7).
   pure subroutine add_response(n_padded, responses, group, entry, place, velocity)
      integer, intent(in) :: n_padded, entry
      type(local_responses), intent(in) :: responses
      type(transition_group), intent(in) :: group
      !> (lane, row) at the end of the part
      real(wp), intent(inout), dimension(width, n_padded) :: place, velocity
      real(wp) :: ends(2 + 2*n_response_sums)
      integer :: e, i, l, row

      l = group%lane(entry)
      row = group%row(entry)
      ends = group%ends(entry, :)
      place(l, row) = place(l, row) + ends(1)
      velocity(l, row) = velocity(l, row) + ends(2)
      do e = responses%first(row), responses%first(row + 1) - 1
         i = responses%dof(e)
         associate (weight => responses%value(:, e))
            place(l, i) = place(l, i) + ((weight(1)*ends(3) + weight(2)*ends(5)) &
                                         + (weight(3)*ends(7) + weight(4)*ends(9)))
            velocity(l, i) = velocity(l, i) + ((weight(1)*ends(4) + weight(2)*ends(6)) &
                                               + (weight(3)*ends(8) + weight(4)*ends(10)))
         end associate
      end do
   end subroutine add_response

   !> See base_system. Each round finds the series of all samples from the present times of those
   !> that are marched again, and takes each of them to its next transition, or to the end of the
   !> part. A joint that has stuck has its reach as extension and no velocity, so that its guard's
   !> zero is not found again.
   subroutine march_again(self, begin, state, error)
      class(series_form), intent(inout) :: self
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: same_instant = 4.0_wp*epsilon(1.0_wp)
      logical :: has_stuck(width, size(self%series%row)), is_unfinished(width)
      real(wp), dimension(width) :: first, now, span   ! [parts]
      real(wp) :: next_zero(width, size(self%series%row))
      integer :: finish(0:1), l, round

      is_unfinished = self%paths%is_remarched
      if (self%keeps_ledger) &   ! work of the other samples, by the regimes at the start
         call add_work(self, spread(1.0_wp, 1, width), (.not. is_unfinished))
      self%has_work = self%keeps_ledger
      finish = self%paths%finish
      self%paths%finish = self%paths%spare
      has_stuck = .false.
      now = 0.0_wp
      do round = 0, self%max_transitions
         call self%march_freely()
         call find_zeros()
         first = minval(next_zero, 2)
         span = min(first, 1.0_wp - now)
         associate (x => self%paths%x, from => self%paths%layer(0), to => self%paths%finish(0))
            call move_on(self%series%degree, size(x, 2), span, x(1, 1, from), x(1, 1, 2), &
                         x(1, 1, to))
         end associate
         if (self%keeps_ledger) call add_work(self, span, is_unfinished)
         do l = 1, width
            if (is_unfinished(l)) call go_to_transition()
         end do
         if (.not. any(is_unfinished)) exit
         call find_link_starts(self)
      end do
      self%paths%finish = finish
      if (.not. any(is_unfinished)) return
      l = findloc(is_unfinished, .true., 1)
      call raise_too_many(self, minloc(next_zero(l, :), 1), l, begin, error)

   contains

      !> Finds the first zeros of the candidates' guards within the rest of the part.
      subroutine find_zeros()
         real(wp) :: path(0:self%series%degree)
         integer :: j, k, s

         next_zero = no_zero
         do s = 1, self%paths%n_candidates
            l = iand(self%paths%candidate(s) - 1, width - 1) + 1
            if (.not. is_unfinished(l)) cycle
            j = (self%paths%candidate(s) - 1)/width + 1
            associate (regime => self%paths%regime(l, j, :), layer => self%paths%layer)
               path = [(self%paths%x(l, self%series%row(j), layer(k)), k=0, self%series%degree)]
               if (has_stuck(l, j)) path(0:1) = [regime(regime_slider) + sign( &
                                                 regime(regime_reach), &
                                                 path(0) - regime(regime_slider)), 0.0_wp]
               next_zero(l, j) = first_transition(path, regime(regime_side), &
                                                  regime(regime_slider), regime(regime_reach), &
                                                  1.0_wp - now(l))
            end associate
         end do
      end subroutine find_zeros

      !> Takes sample l to its transition, or without one to the end of the part.
      subroutine go_to_transition()
         integer :: to(0:1)

         is_unfinished(l) = first(l) < no_zero
         to = merge(self%paths%layer(0:1), finish, is_unfinished(l))
         self%paths%x(l, :, to(0)) = self%paths%x(l, :, self%paths%finish(0))
         self%paths%x(l, :, to(1)) = self%paths%x(l, :, self%paths%finish(1))
         if (.not. is_unfinished(l)) return
         now(l) = now(l) + span(l)
         associate (force => self%paths%force(l, :, :))   ! columns 1, 2: value and rise
            force(:, 1) = force(:, 1) + span(l)*force(:, 2)
         end associate
         call switch_joints()
      end subroutine go_to_transition

      !> Switches all joints of sample l whose guards are zero now, in the order of their numbers.
      subroutine switch_joints()
         integer :: j

         do j = 1, size(next_zero, 2)
            has_stuck(l, j) = next_zero(l, j) <= span(l) + same_instant .and. &
                              abs(self%paths%regime(l, j, regime_side)) > 0.0_wp
            if (next_zero(l, j) > span(l) + same_instant) cycle
            associate (row => self%series%row(j), layer => self%paths%layer, x => self%paths%x)
               call self%paths%switch(l, j, (begin + now(l))*self%h, x(l, row, layer(0)), &
                                      x(l, row, layer(1)), state)
               if (has_stuck(l, j) .and. row <= self%series%n_dof) x(l, row, layer(1)) = 0.0_wp
            end associate
         end do
      end subroutine switch_joints

   end subroutine march_again

   !> Finds the values of all paths after a span, one for each lane.
   pure subroutine move_on(degree, n_padded, span, start, x, finish)
      integer, intent(in) :: degree, n_padded
      real(wp), intent(in) :: span(width)            !! [parts]
      real(wp), intent(in) :: start(width, n_padded, 0:1)   !! powers 0 and 1
      real(wp), intent(in) :: x(width, n_padded, 2:degree)
      real(wp), intent(inout) :: finish(width, n_padded, 0:1)
      real(wp), dimension(width) :: slope, value
      integer :: i, k

      do i = 1, n_padded
         value = x(:, i, degree)
         slope = 0.0_wp
         do k = degree - 1, 2, -1
            slope = slope*span + value
            value = value*span + x(:, i, k)
         end do
         do k = 1, 0, -1
            slope = slope*span + value
            value = value*span + start(:, i, k)
         end do
         finish(:, i, 0) = value
         finish(:, i, 1) = slope
      end do
   end subroutine move_on

   !> See base_system.
   subroutine end_part(self)
      class(series_form), intent(inout) :: self

      if (self%keeps_ledger .and. .not. self%has_work) &
         call add_work(self, spread(1.0_wp, 1, width), spread(.true., 1, width))
      self%has_work = .false.
      call self%paths%exchange_ends()
      call find_link_starts(self)
   end subroutine end_part

   !> Finds displacement and velocity of the links at the start of a part.
   subroutine find_link_starts(self)
      class(series_form), intent(inout) :: self

      if (self%series%n_links == 0) return
      associate (x => self%paths%x, layer => self%paths%layer)
         call find_link_paths(size(x, 2), self%series, x(:, :, layer(0)))
         call find_link_paths(size(x, 2), self%series, x(:, :, layer(1)))
      end associate
   end subroutine find_link_starts

   !> See base_system.
   subroutine copy_state(self, displacement, velocity)
      class(series_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)

      associate (x => self%paths%x, layer => self%paths%layer)
         displacement = x(:, :self%series%n_dof, layer(0))
         if (size(velocity) > 0) velocity = x(:, :self%series%n_dof, layer(1))/self%h
      end associate
   end subroutine copy_state

   !> Adds the work of the counted lanes over spans from the start of the paths.
   subroutine add_work(self, span, is_counted)
      class(series_form), intent(inout) :: self
      real(wp), intent(in) :: span(width)   !! [parts]
      logical, intent(in) :: is_counted(width)
      real(wp) :: work(width, 2)

      work = 0.0_wp
      call self%ledger%add_part(self%series, self%paths, span, work)
      where (spread(is_counted, 2, 2)) self%work_done = self%work_done + work
   end subroutine add_work

end module dynamics_exact_series_form
