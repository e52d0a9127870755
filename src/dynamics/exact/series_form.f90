!> Base system of a structure with diagonal mass, by power series in its dofs.
!>
!> The answer to a transition is local: with the force s k (w.x(t) - w.x(tau)) on one dof, which the
!> old regime did not have, that dof answers by a series of its own, and the dofs around it by two
!> sums over that series. Joints for which this is not exact enough, links among them, are left to
!> `redo`, which begins the series of the whole sample anew.
module dynamics_exact_series_form
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_exact_base_system, only: base_system, raise_too_many, switch_joint
   use dynamics_exact_free_steps, only: expand_block, finish_part, follow_links
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_joint_paths, only: layer_reach, layer_side, layer_slider, local_answers, width
   use dynamics_exact_local_answers, only: find_answers
   use dynamics_exact_ledger, only: ledger_type, new_ledger
   use dynamics_exact_series, only: new_series, series_type
   use dynamics_exact_transitions, only: n_near, transition_group
   use dynamics_response, only: block_state, march_work
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: series_form, new_series_form

   !> Diagonal mass, in the dofs.
   type, extends(base_system) :: series_form
      type(series_type) :: series
      type(ledger_type) :: ledger
      logical :: has_works = .false.                !! of the part, added by redo
   contains
      procedure :: begin
      procedure :: take
      procedure :: give
      procedure :: run_part
      procedure :: correct
      procedure :: redo
      procedure :: go_on
      procedure :: put_state
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
      form%n_kept = structure%n_dof
      call new_series(structure, dt, parts, tolerance, form%series)
      form%ledger = new_ledger(form%series, structure, tolerance)
      call find_answers(structure, form%series, tolerance, form%paths%answers)
   end subroutine new_series_form

   !> Work of a step of so many parts (11). A transition that is not answered locally begins all
   !> series anew.
   pure type(march_work) function work(self, parts)
      class(series_form), intent(in) :: self
      integer, intent(in) :: parts
      real(wp), parameter :: local = 2500.0_wp, anew = 6000.0_wp

      work%step = parts*self%series%work()
      work%lanes = width
      work%n_parts = parts
      associate (is_local => self%paths%answers%is_local)
         work%share_anew = real(count(.not. is_local), wp)/max(1, size(is_local))
      end associate
      work%transition = (1.0_wp - work%share_anew)*local + work%share_anew*anew
   end function work

   !> See base_system.
   subroutine begin(self)
      class(series_form), intent(inout) :: self

      call self%paths%start(self%series%degree, self%n_forces, self%series%diagonal, &
                            self%series%row, self%series%spring)
   end subroutine begin

   !> See base_system. Velocities are in m per part here, in m/s in the block.
   subroutine take(self, state)
      class(series_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: l, w

      associate (x => self%paths%x, layer => self%paths%layer, n => self%series%n_dof)
         x = 0.0_wp
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            x(l, :n, layer(0)) = state%displacement(:, w)
            x(l, :n, layer(1)) = state%velocity(:, w)*self%h
            if (self%is_kept) x(l, :n, layer(1)) = state%kept(:, w)
         end do
      end associate
      call follow_starts(self)
   end subroutine take

   !> See base_system.
   subroutine give(self, state)
      class(series_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: l, w

      associate (x => self%paths%x, layer => self%paths%layer, n => self%series%n_dof)
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            state%displacement(:, w) = x(l, :n, layer(0))
            state%velocity(:, w) = x(l, :n, layer(1))/self%h
            state%kept(:, w) = x(l, :n, layer(1))
         end do
      end associate
   end subroutine give

   !> See base_system.
   subroutine run_part(self)
      class(series_form), intent(inout) :: self

      call expand_block(self%series, self%paths)
      call finish_part(self%paths)
   end subroutine run_part

   !> See base_system.
   subroutine correct(self, group, entry)
      class(series_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry

      associate (x => self%paths%x, finish => self%paths%finish)
         call add_answer(size(x, 2), self%paths%answers, group, entry, x(1, 1, finish(0)), &
                         x(1, 1, finish(1)))
      end associate
      if (self%keeps_ledger) call self%ledger%note_answer(self%series%loaded, self%paths%answers, &
                                                          group, entry)
   end subroutine correct

   !> Adds (7): sums of the joint's own answer, weighted for each of the dofs around it.
   pure subroutine add_answer(top, answers, group, entry, place, velocity)
      integer, intent(in) :: top, entry
      type(local_answers), intent(in) :: answers
      type(transition_group), intent(in) :: group
      real(wp), intent(inout), dimension(width, top) :: place, velocity   !! at the end of the part
      real(wp) :: ends(2 + 2*n_near)
      integer :: e, i, l, row

      l = group%lane(entry)
      row = group%row(entry)
      ends = group%ends(entry, :)
      place(l, row) = place(l, row) + ends(1)
      velocity(l, row) = velocity(l, row) + ends(2)
      do e = answers%first(row), answers%first(row + 1) - 1
         i = answers%dof(e)
         associate (weight => answers%value(:, e))
            place(l, i) = place(l, i) + ((weight(1)*ends(3) + weight(2)*ends(5)) &
                                         + (weight(3)*ends(7) + weight(4)*ends(9)))
            velocity(l, i) = velocity(l, i) + ((weight(1)*ends(4) + weight(2)*ends(6)) &
                                               + (weight(3)*ends(8) + weight(4)*ends(10)))
         end associate
      end do
   end subroutine add_answer

   !> See base_system. In each round the series of all samples begin anew where the marked ones have
   !> come to, and those of them that have a transition on their way go on to it. After a stick the
   !> joint stands at its limit and at rest, so that its guard is not found at zero again.
   subroutine redo(self, begin, state, error)
      class(series_form), intent(inout) :: self
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: same_instant = 4.0_wp*epsilon(1.0_wp)
      logical :: has_stuck(width, size(self%series%row)), is_on_way(width)
      real(wp), dimension(width) :: first, now, span   ! [parts]
      real(wp) :: crossing(width, size(self%series%row))
      integer :: finish(0:1), l, round

      is_on_way = self%paths%is_involved
      if (self%keeps_ledger) &   ! of the others, by the regimes at the start
         call count_works(self, spread(1.0_wp, 1, width), (.not. is_on_way))
      self%has_works = self%keeps_ledger
      finish = self%paths%finish
      self%paths%finish = self%paths%spare
      has_stuck = .false.
      now = 0.0_wp
      do round = 0, self%max_transitions
         call self%run_part()
         call find_crossings()
         first = minval(crossing, 2)
         span = min(first, 1.0_wp - now)
         associate (x => self%paths%x, from => self%paths%layer(0), to => self%paths%finish(0))
            call move_on(self%series%degree, size(x, 2), span, x(1, 1, from), x(1, 1, 2), &
                         x(1, 1, to))
         end associate
         if (self%keeps_ledger) call count_works(self, span, is_on_way)
         do l = 1, width
            if (is_on_way(l)) call go_to_transition()
         end do
         if (.not. any(is_on_way)) exit
         call follow_starts(self)
      end do
      self%paths%finish = finish
      if (.not. any(is_on_way)) return
      l = findloc(is_on_way, .true., 1)
      call raise_too_many(self, minloc(crossing(l, :), 1), l, begin, error)

   contains

      !> Finds the first zeros of the guards of the suspects within what is left of the part.
      subroutine find_crossings()
         real(wp) :: path(0:self%series%degree)
         integer :: j, k, s

         crossing = no_crossing
         do s = 1, self%paths%n_suspects
            l = iand(self%paths%suspect(s) - 1, width - 1) + 1
            if (.not. is_on_way(l)) cycle
            j = (self%paths%suspect(s) - 1)/width + 1
            associate (regime => self%paths%regime(l, j, :), layer => self%paths%layer)
               path = [(self%paths%x(l, self%series%row(j), layer(k)), k=0, self%series%degree)]
               if (has_stuck(l, j)) path(0:1) = [regime(layer_slider) + sign( &
                                                 regime(layer_reach), &
                                                 path(0) - regime(layer_slider)), 0.0_wp]
               crossing(l, j) = first_transition(path, regime(layer_side), regime(layer_slider), &
                                                 regime(layer_reach), 1.0_wp - now(l))
            end associate
         end do
      end subroutine find_crossings

      !> Begins anew at the transition of a sample; without one it is at the end of the part.
      subroutine go_to_transition()
         integer :: to(0:1)

         is_on_way(l) = first(l) < no_crossing
         to = merge(self%paths%layer(0:1), finish, is_on_way(l))
         self%paths%x(l, :, to(0)) = self%paths%x(l, :, self%paths%finish(0))
         self%paths%x(l, :, to(1)) = self%paths%x(l, :, self%paths%finish(1))
         if (.not. is_on_way(l)) return
         now(l) = now(l) + span(l)
         associate (force => self%paths%force(l, :, :))   ! from 1: value and rise
            force(:, 1) = force(:, 1) + span(l)*force(:, 2)
         end associate
         call switch_joints()
      end subroutine go_to_transition

      !> Switches all joints of a sample that cross now, in their order.
      subroutine switch_joints()
         integer :: j

         do j = 1, size(crossing, 2)
            has_stuck(l, j) = crossing(l, j) <= span(l) + same_instant .and. &
                              abs(self%paths%regime(l, j, layer_side)) > 0.0_wp
            if (crossing(l, j) > span(l) + same_instant) cycle
            associate (row => self%series%row(j), layer => self%paths%layer, x => self%paths%x)
               call switch_joint(self, l, j, begin + now(l), x(l, row, layer(0)), &
                                 x(l, row, layer(1)), state)
               if (has_stuck(l, j) .and. row <= self%series%n_dof) x(l, row, layer(1)) = 0.0_wp
            end associate
         end do
      end subroutine switch_joints

   end subroutine redo

   !> Finds the ends of all paths after a span of their own.
   pure subroutine move_on(degree, top, span, start, x, finish)
      integer, intent(in) :: degree, top
      real(wp), intent(in) :: span(width)            !! [parts]
      real(wp), intent(in) :: start(width, top, 0:1)   !! powers 0 and 1
      real(wp), intent(in) :: x(width, top, 2:degree)
      real(wp), intent(inout) :: finish(width, top, 0:1)
      real(wp), dimension(width) :: slope, value
      integer :: i, k

      do i = 1, top
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
   subroutine go_on(self)
      class(series_form), intent(inout) :: self

      if (self%keeps_ledger .and. .not. self%has_works) &
         call count_works(self, spread(1.0_wp, 1, width), spread(.true., 1, width))
      self%has_works = .false.
      call self%paths%exchange_ends()
      call follow_starts(self)
   end subroutine go_on

   !> Forms the starts of the links' paths.
   subroutine follow_starts(self)
      class(series_form), intent(inout) :: self

      if (self%series%n_links == 0) return
      associate (x => self%paths%x, layer => self%paths%layer)
         call follow_links(size(x, 2), self%series, x(:, :, layer(0)))
         call follow_links(size(x, 2), self%series, x(:, :, layer(1)))
      end associate
   end subroutine follow_starts

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

   !> Adds the works of the counted lanes over spans from the start of the paths.
   subroutine count_works(self, span, is_counted)
      class(series_form), intent(inout) :: self
      real(wp), intent(in) :: span(width)   !! [parts]
      logical, intent(in) :: is_counted(width)
      real(wp) :: work(width, 2)

      work = 0.0_wp
      call self%ledger%add_part(self%series, self%paths, span, work)
      where (spread(is_counted, 2, 2)) self%works = self%works + work
   end subroutine count_works

end module dynamics_exact_series_form
