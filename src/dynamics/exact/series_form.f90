!> Base system of a structure with diagonal mass, by power series in its dofs.
!>
!> The answer to a transition is local: with the force s k (w.x(t) - w.x(tau)) on one dof, which the
!> old regime did not have, that dof answers by a series of its own, and the dofs around it by two
!> sums over that series. Joints for which this is not exact enough, links among them, are left to
!> `redo`, which begins the series of the whole sample anew.
module dynamics_exact_series_form
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_free_steps, only: expand_block, finish_part, follow_links
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_joint_paths, only: layer_reach, layer_side, layer_slider, width
   use dynamics_exact_local_answers, only: local_answers, new_local_answers
   use dynamics_exact_ledger, only: ledger_type, new_ledger
   use dynamics_exact_powers, only: power_operator, power_operators
   use dynamics_exact_series, only: new_series, series_type
   use dynamics_exact_transitions, only: n_near, transition_group
   use dynamics_joint, only: enter_transition, slip_direction
   use dynamics_response, only: block_state, march_work
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: series_form, new_series_form

   !> Diagonal mass, in the dofs.
   type, extends(base_system) :: series_form
      type(series_type) :: series
      type(ledger_type) :: ledger
      type(local_answers) :: answers
      type(power_operator), allocatable :: operators(:)   !! (0:degree - 2)
      real(wp), allocatable :: push(:, :, :)        !! (lane, loaded dof, value and rise)
   contains
      procedure :: begin
      procedure :: take
      procedure :: give
      procedure :: run_part
      procedure :: correct
      procedure :: redo
      procedure :: go_on
      procedure :: put_state
      procedure :: add_works
      procedure :: work
   end type series_form

contains

   !> Prepares equal parts of a step, to a tolerance relative to the rms displacement.
   subroutine new_series_form(structure, dt, parts, tolerance, form)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      integer, intent(in) :: parts        !! of a step
      real(wp), intent(in) :: tolerance
      type(series_form), intent(out) :: form

      form%h = dt/parts
      form%n_forces = structure%n_forces
      call new_series(structure, dt, parts, tolerance, form%series)
      form%ledger = new_ledger(form%series, structure, tolerance)
      call new_local_answers(structure, form%series, tolerance, form%answers)
   end subroutine new_series_form

   !> Work of a step of so many parts (11). A transition that is not answered locally begins the
   !> series of its sample anew, as does the part that it is found in; alone, without the samples
   !> beside it, a multiplication takes as long as 45.
   pure type(march_work) function work(self, parts)
      class(series_form), intent(in) :: self
      integer, intent(in) :: parts
      real(wp), parameter :: alone = 45.0_wp, local = 1500.0_wp

      work%step = parts*self%series%work()
      work%lanes = width
      work%n_parts = parts
      work%begin_anew = alone*self%series%work()
      associate (is_local => self%answers%is_local)
         work%share_anew = real(count(.not. is_local), wp)/max(1, size(is_local))
      end associate
      work%transition = (1.0_wp - work%share_anew)*local + work%share_anew*work%begin_anew
   end function work

   !> See base_system.
   subroutine begin(self)
      class(series_form), intent(inout) :: self

      call self%paths%start(self%series%degree, self%series%diagonal, self%series%row, &
                            self%series%spring)
      call power_operators(self%series, self%paths%top, self%operators)
      self%paths%is_local = self%answers%is_local
      self%paths%first_moved = self%answers%first_moved
      self%paths%moved = self%answers%moved
      self%paths%free_span = self%answers%free_span
      self%paths%own(:, :self%series%n_dof) = self%answers%own
      self%push = spread(spread(spread(0.0_wp, 1, width), 2, size(self%series%loaded)), 3, 2)
   end subroutine begin

   !> Takes samples over. Velocities are in m per part here, in m/s in the block: those that `give`
   !> has left unchanged are taken as they were.
   subroutine take(self, state)
      class(series_form), intent(inout) :: self
      type(block_state), intent(in) :: state
      integer :: i, l, w

      associate (x => self%paths%x, layer => self%paths%layer)
         x = 0.0_wp
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            do i = 1, self%series%n_dof
               x(l, i, layer(0)) = state%displacement(i, w)
               x(l, i, layer(1)) = state%velocity(i, w)*self%h
            end do
            if (.not. allocated(state%velocity_step)) cycle
            do i = 1, self%series%n_dof
               if (abs(state%velocity_step(i, w)/self%h - state%velocity(i, w)) <= 0.0_wp) &
                  x(l, i, layer(1)) = state%velocity_step(i, w)
            end do
         end do
         call follow_links(size(x, 2), self%series, x(:, :, layer(0)))
         call follow_links(size(x, 2), self%series, x(:, :, layer(1)))
      end associate
   end subroutine take

   !> See base_system.
   subroutine give(self, state)
      class(series_form), intent(in) :: self
      type(block_state), intent(inout) :: state
      integer :: i, l, w

      if (.not. allocated(state%velocity_step)) state%velocity_step = state%velocity*self%h
      associate (x => self%paths%x, layer => self%paths%layer)
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            do i = 1, self%series%n_dof
               state%displacement(i, w) = x(l, i, layer(0))
               state%velocity_step(i, w) = x(l, i, layer(1))
               state%velocity(i, w) = x(l, i, layer(1))/self%h
            end do
         end do
      end associate
   end subroutine give

   !> See base_system.
   subroutine run_part(self, force, list, found)
      class(series_form), intent(inout) :: self
      real(wp), intent(in) :: force(:, :, 0:)
      integer, intent(inout) :: list(:)
      integer, intent(out) :: found

      call form_push(self%series, self%n_forces, force, self%push)
      call expand_block(self%series, self%operators, self%push, self%paths)
      call finish_part(self%paths, list, found)
   end subroutine run_part

   !> Forms the loads of the dofs that have one, and their rise.
   pure subroutine form_push(series, n_forces, force, push)
      type(series_type), intent(in) :: series
      integer, intent(in) :: n_forces
      real(wp), intent(in) :: force(width, n_forces, 0:1)
      real(wp), intent(inout) :: push(width, size(series%loaded), 0:1)
      integer :: f, i, k, l

      do k = 0, 1
         do i = 1, size(series%loaded)
            do l = 1, width
               push(l, i, k) = series%load(i, 1)*force(l, 1, k)
            end do
            do f = 2, n_forces
               do l = 1, width
                  push(l, i, k) = push(l, i, k) + series%load(i, f)*force(l, f, k)
               end do
            end do
         end do
      end do
   end subroutine form_push

   !> See base_system.
   subroutine correct(self, group, entry)
      class(series_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry

      associate (x => self%paths%x, finish => self%paths%finish)
         call add_answer(size(x, 2), self%answers, group, entry, x(1, 1, finish(0)), &
                         x(1, 1, finish(1)))
      end associate
      if (self%keeps_ledger) call note_answer(self, group, entry)
   end subroutine correct

   !> Notes a transition for the ledger: the answer of its dof, and the integrals of the answers
   !> of loaded dofs, which are the next of the sums (7).
   pure subroutine note_answer(self, group, entry)
      class(series_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      integer :: e, i

      associate (l => group%lane(entry), row => group%row(entry), area => self%ledger%area, &
                 answers => self%answers)
         call self%ledger%note_answer(l, row, group%time(entry), group%answer(entry, :))
         do i = 1, size(self%series%loaded)
            if (self%series%loaded(i) == row) area(l, i) = area(l, i) + group%ends(entry, 3)
            do e = answers%first(row), answers%first(row + 1) - 1
               if (answers%dof(e) /= self%series%loaded(i)) cycle
               area(l, i) = area(l, i) + (answers%value(1, e)*group%ends(entry, 5) &
                                          + answers%value(2, e)*group%ends(entry, 7))
            end do
         end do
      end associate
   end subroutine note_answer

   !> Adds (7): sums of the joint's own answer, weighted for each of the dofs around it.
   pure subroutine add_answer(top, answers, group, entry, place, velocity)
      integer, intent(in) :: top, entry
      type(local_answers), intent(in) :: answers
      type(transition_group), intent(in) :: group
      real(wp), intent(inout), dimension(width, top) :: place, velocity   !! at the end of the part
      real(wp) :: ends(2 + 2*n_near), more, more_velocity
      integer :: e, i, l, row

      l = group%lane(entry)
      row = group%row(entry)
      ends = group%ends(entry, :)
      place(l, row) = place(l, row) + ends(1)
      velocity(l, row) = velocity(l, row) + ends(2)
      do e = answers%first(row), answers%first(row + 1) - 1
         i = answers%dof(e)
         associate (weight => answers%value(:, e))
            more = weight(1)*ends(3) + weight(2)*ends(5)
            more_velocity = weight(1)*ends(4) + weight(2)*ends(6)
            if (group%n_sums > 2) then
               more = more + (weight(3)*ends(7) + weight(4)*ends(9))
               more_velocity = more_velocity + (weight(3)*ends(8) + weight(4)*ends(10))
            end if
         end associate
         place(l, i) = place(l, i) + more
         velocity(l, i) = velocity(l, i) + more_velocity
      end do
   end subroutine add_answer

   !> See base_system. After a stick the joint stands at its limit and at rest, so that its guard is
   !> not found at zero again.
   subroutine redo(self, lane, begin, state, error)
      class(series_form), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: same_instant = 4.0_wp*epsilon(1.0_wp)
      real(wp) :: x(self%series%n_rows, 0:self%series%degree), push(size(self%series%loaded), 0:1)
      real(wp) :: crossing(size(self%series%row)), first, now, span
      logical :: has_stuck(size(self%series%row))
      integer :: round

      x = 0.0_wp
      x(:, 0) = self%paths%x(lane, :self%series%n_rows, self%paths%layer(0))
      x(:, 1) = self%paths%x(lane, :self%series%n_rows, self%paths%layer(1))
      has_stuck = .false.
      now = 0.0_wp
      do round = 0, self%max_transitions
         push(:, 0) = self%push(lane, :, 1) + now*self%push(lane, :, 2)
         push(:, 1) = self%push(lane, :, 2)
         call self%series%expand(self%paths%stiffness(lane, :self%series%n_rows), &
                                 self%paths%pull(lane, :self%series%n_rows), push, x)
         call find_crossings(1.0_wp - now)
         first = minval(crossing)
         span = min(first, 1.0_wp - now)
         if (state%keeps_ledger) call add_work(span)
         call advance(span)
         if (.not. first < no_crossing) exit
         now = now + span
         call switch_joints()
      end do
      if (round > self%max_transitions) then
         call raise_too_many(self, minloc(crossing, 1), lane, begin, error)
         return
      end if
      self%paths%x(lane, :self%series%n_rows, self%paths%finish(0)) = x(:, 0)
      self%paths%x(lane, :self%series%n_rows, self%paths%finish(1)) = x(:, 1)

   contains

      !> Finds the first zero of the guard of every joint within what is left of the part.
      subroutine find_crossings(left)
         real(wp), intent(in) :: left
         real(wp) :: path(0:self%series%degree)
         integer :: j

         do j = 1, size(crossing)
            associate (regime => self%paths%regime(lane, j, :))
               path = x(self%series%row(j), :)
               if (has_stuck(j)) path(1) = 0.0_wp
               if (has_stuck(j)) path(0) = regime(layer_slider) + &
                                           sign(regime(layer_reach), path(0) - regime(layer_slider))
               crossing(j) = first_transition(path, regime(layer_side), regime(layer_slider), &
                                              regime(layer_reach), left)
            end associate
         end do
      end subroutine find_crossings

      !> Adds the works of the piece to those of the sample.
      subroutine add_work(span)
         real(wp), intent(in) :: span
         real(wp) :: work(2)

         work = 0.0_wp
         call self%ledger%add_piece(self%series, push, x, span, work)
         associate (sample => self%paths%first_sample + lane - 1)
            state%work_input(sample) = state%work_input(sample) + work(1)
            state%work_viscous(sample) = state%work_viscous(sample) + work(2)
         end associate
      end subroutine add_work

      !> Moves the state on, from all powers to the first two.
      subroutine advance(span)
         real(wp), intent(in) :: span
         real(wp), dimension(size(x, 1)) :: slope, value
         integer :: k

         value = x(:, self%series%degree)
         slope = 0.0_wp
         do k = self%series%degree - 1, 0, -1
            slope = slope*span + value
            value = value*span + x(:, k)
         end do
         x(:, 0) = value
         x(:, 1) = slope
      end subroutine advance

      !> Switches all joints that cross now, in their order.
      subroutine switch_joints()
         integer :: direction, j, sample
         real(wp) :: time

         sample = self%paths%first_sample + lane - 1
         time = (begin + now)*self%h
         do j = 1, size(crossing)
            has_stuck(j) = .false.
            if (crossing(j) > span + same_instant) cycle
            associate (row => self%series%row(j), side => self%paths%regime(lane, j, layer_side))
               if (abs(side) > 0.0_wp) then
                  has_stuck(j) = .true.
                  if (row <= self%series%n_dof) x(row, 1) = 0.0_wp
                  call self%paths%switch(lane, j, nint(side), x(row, 0))
                  call enter_transition(state, j, sample, time, x(row, 0), 0)
               else
                  direction = slip_direction(x(row, 1))
                  call self%paths%switch(lane, j, direction, x(row, 0))
                  call enter_transition(state, j, sample, time, x(row, 0), direction)
               end if
            end associate
         end do
      end subroutine switch_joints

   end subroutine redo

   !> See base_system.
   subroutine go_on(self)
      class(series_form), intent(inout) :: self

      call self%paths%exchange_ends()
      if (self%series%n_links == 0) return
      associate (x => self%paths%x, layer => self%paths%layer)
         call follow_links(size(x, 2), self%series, x(:, :, layer(0)))
         call follow_links(size(x, 2), self%series, x(:, :, layer(1)))
      end associate
   end subroutine go_on

   !> See base_system.
   subroutine put_state(self, displacement, velocity)
      class(series_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)

      associate (x => self%paths%x, layer => self%paths%layer)
         displacement = x(:, :self%series%n_dof, layer(0))
         if (size(velocity) > 0) velocity = x(:, :self%series%n_dof, layer(1))/self%h
      end associate
   end subroutine put_state

   !> See base_system.
   subroutine add_works(self, work)
      class(series_form), intent(inout) :: self
      real(wp), intent(inout) :: work(:, :)

      call self%ledger%add_part(self%series, self%push, self%paths, work)
   end subroutine add_works

end module dynamics_exact_series_form
