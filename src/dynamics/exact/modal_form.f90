!> Base system of any structure, in the modes that it has with all joints stuck.
!>
!> Modes rotate exactly over a part, whatever their frequency. A slipping joint is a moving slider:
!> the path of every joint is the polynomial through its free path at the half and the end of the
!> part, and the answers to all sliders, power by power (M4), (M5). The modes then take the
!> integrals of the sliders' motion (M6). All transitions of a sample in a part are treated in the
!> paths of its joints alone (dynamics_exact_modal_lane).
module dynamics_exact_modal_form
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_free_steps, only: finish_part
   use dynamics_exact_guard_zeros, only: no_crossing
   use dynamics_exact_joint_paths, only: layer_reach, layer_side, layer_slider, layer_spring, width
   use dynamics_exact_modal_lane, only: lane_paths
   use dynamics_exact_modal_operators, only: modal_operators, new_modal_operators
   use dynamics_exact_modal_sliders, only: moving_sliders
   use dynamics_exact_modal_steps, only: put_free_paths, put_rest, rotate, take_motion
   use dynamics_exact_modal_terms, only: path_degree
   use dynamics_exact_transitions, only: transition_group
   use dynamics_joint, only: enter_transition, slip_direction
   use dynamics_alignment, only: aligned_memory
   use dynamics_response, only: block_state
   use numerics_dense_product, only: groups, padded_rows
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: modal_form, new_modal_form

   !> Modes and joints of 32 samples side by side.
   type, extends(base_system) :: modal_form
      type(modal_operators) :: operators
      integer :: n_padded = 0, m_padded = 0
      real(wp), pointer, contiguous :: now(:, :, :) => null()      !! (lane, mode, 1:3) q, q', f(0)
      real(wp), pointer, contiguous :: ahead(:, :, :) => null()    !! (.., 1:4) q, q' at 1, at 1/2
      real(wp), pointer, contiguous :: pushed(:, :) => null()      !! (lane, mode) by sliders: S z
      real(wp), pointer, contiguous :: taken(:, :, :) => null()    !! (lane, mode, 0:moment) S I
      real(wp), pointer, contiguous :: value(:, :, :) => null()    !! (lane, joint, 1:4) G ahead
      type(moving_sliders) :: sliders
      !> Where a ledger is kept: (lane, mode, 1:4), see its start_part; (.., q q'), see its add_part
      real(wp), pointer, contiguous, private :: works(:, :, :) => null(), rest(:, :, :) => null()
      type(aligned_memory), private :: memory
      type(lane_paths), private :: lane   !! room for redo
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
   end type modal_form

contains

   !> Prepares as many parts a step as the tolerance needs, relative to the rms displacement.
   subroutine new_modal_form(structure, dt, tolerance, form)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_form), intent(out) :: form

      call new_modal_operators(structure, dt, tolerance, form%operators)
      form%h = form%operators%h
      form%n_forces = structure%n_forces
      form%has_works_of_all = .true.
      form%n_padded = padded_rows(structure%n_dof)
      form%m_padded = padded_rows(structure%n_joints)
   end subroutine new_modal_form

   !> See base_system.
   subroutine begin(self)
      class(modal_form), intent(inout) :: self
      real(wp), pointer, contiguous :: plane(:, :, :)
      integer :: extra, j

      call self%sliders%start(self%operators%n_joints, self%m_padded, self%operators%n_moments)
      call self%paths%start(path_degree, [(0.0_wp, j=1, self%m_padded)], &
                            [(j, j=1, self%operators%n_joints)], &
                            [(1.0_wp, j=1, self%operators%n_joints)])
      self%paths%keeps_slack = .true.
      extra = merge(6, 0, self%keeps_ledger)
      if (self%keeps_ledger) then
         associate (for => self%operators)
            if (.not. for%ledger%is_ready) &
               call for%ledger%prepare(self%h, for%rate, for%damping, for%load, for%decouples)
         end associate
      end if
      call self%memory%start(width*((9 + self%operators%n_moments + extra)*self%n_padded &
                                    + 4*self%m_padded))
      call self%memory%take([width, self%n_padded, 3], self%now)
      call self%memory%take([width, self%n_padded, 4], self%ahead)
      call self%memory%take([width, self%n_padded, self%operators%n_moments + 1], self%taken)
      self%taken(1:, 1:, 0:) => self%taken
      call self%memory%take([width, self%n_padded, 1], plane)
      self%pushed => plane(:, :, 1)
      call self%memory%take([width, self%m_padded, 4], self%value)
      if (.not. self%keeps_ledger) return
      call self%memory%take([width, self%n_padded, 4], self%works)
      call self%memory%take([width, self%n_padded, 2], self%rest)
   end subroutine begin

   !> Takes what `give` has kept where displacements, velocities and step are as it left them.
   subroutine take(self, state)
      class(modal_form), intent(inout) :: self
      type(block_state), intent(in) :: state
      real(wp) :: slider(self%operators%n_joints)
      integer :: l, m, n, w

      n = self%operators%n_modes
      m = self%operators%n_joints
      self%now = 0.0_wp
      self%pushed = 0.0_wp
      self%sliders%has_switched = .true.   ! regimes are given
      associate (x => self%paths%x, layer => self%paths%layer)
         x = 0.0_wp
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            associate (place => state%displacement(:, w), speed => state%velocity(:, w))
               if (is_kept(w)) then
                  associate (kept => state%modal(:, w))
                     self%now(l, :n, 1) = kept(:n)
                     self%now(l, :n, 2) = kept(n + 1:2*n)
                     self%pushed(l, :n) = kept(2*n + 1:3*n)
                     x(l, :m, layer(0)) = kept(3*n + 1:3*n + m)
                     x(l, :m, layer(1)) = kept(3*n + m + 1:3*n + 2*m)
                  end associate
                  cycle
               end if
               slider = state%slider(:, w)
               self%now(l, :n, 1) = matmul(place, self%operators%momentum)
               self%now(l, :n, 2) = matmul(speed, self%operators%momentum)*self%h
               self%pushed(l, :n) = matmul(self%operators%slider_push, slider)
               x(l, :m, layer(0)) = matmul(place, self%operators%direction)
               x(l, :m, layer(1)) = matmul(speed, self%operators%direction)*self%h
            end associate
         end do
      end associate

   contains

      logical function is_kept(sample)
         integer, intent(in) :: sample

         is_kept = .false.
         if (.not. allocated(state%modal)) return
         associate (last => ubound(state%modal, 1))
            if (last /= 5*n + 2*m) return
            is_kept = all(abs(state%modal(last - 2*n + 1:last - n, sample) &
                              - state%displacement(:, sample)) <= 0.0_wp) .and. &
                      all(abs(state%modal(last - n + 1:, sample) &
                              - state%velocity(:, sample)) <= 0.0_wp)
         end associate
      end function is_kept

   end subroutine take

   !> See base_system.
   subroutine give(self, state)
      class(modal_form), intent(in) :: self
      type(block_state), intent(inout) :: state
      real(wp), dimension(width, self%operators%n_modes) :: displacement, velocity
      integer :: l, m, n, w

      n = self%operators%n_modes
      m = self%operators%n_joints
      call self%put_state(displacement, velocity)
      if (allocated(state%modal)) then
         if (size(state%modal, 1) /= 5*n + 2*m) deallocate (state%modal)
      end if
      if (.not. allocated(state%modal)) allocate (state%modal(5*n + 2*m, state%n_samples), &
                                                  source=0.0_wp)
      associate (x => self%paths%x, layer => self%paths%layer)
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            state%displacement(:, w) = displacement(l, :)
            state%velocity(:, w) = velocity(l, :)
            state%modal(:, w) = [self%now(l, :n, 1), self%now(l, :n, 2), self%pushed(l, :n), &
                                 x(l, :m, layer(0)), x(l, :m, layer(1)), displacement(l, :), &
                                 velocity(l, :)]
         end do
      end associate
   end subroutine give

   !> See base_system.
   subroutine run_part(self, force, list, found)
      class(modal_form), intent(inout) :: self
      real(wp), intent(in) :: force(:, :, 0:)
      integer, intent(inout) :: list(:)
      integer, intent(out) :: found
      integer :: i, k, m, n

      n = self%n_padded
      m = self%m_padded
      if (self%keeps_ledger) call self%operators%ledger%start_part(force, self%now, self%pushed, &
                                                                   self%works)
      if (self%operators%decouples) then
         call rotate(n, merge(4, self%operators%n_reads, self%keeps_ledger), &
                     self%operators%rotation, self%operators%load, force, self%now, &
                     self%pushed, self%ahead)
      else
         call self%operators%propagate(force, self%pushed, self%now, self%ahead)
      end if
      do i = 1, self%operators%n_reads
         call self%operators%read%multiply(self%ahead(:, :, i), self%value(:, :, i))
      end do
      associate (x => self%paths%x, v => self%paths%layer(1), u => self%paths%layer(0), &
                 regime => self%paths%regime, sliders => self%sliders)
         call put_free_paths(m, size(x, 2), self%operators%n_reads, self%value, x(:, :, u), &
                             x(:, :, v), x(:, :, 2:6))
         call sliders%follow(regime(:, :, layer_side), regime(:, :, layer_spring))
         call sliders%mask(1, x(:, :, v))
         call sliders%mask(2, x(:, :, 2))
         do k = 3, path_degree
            associate (first => self%operators%first_power(k))
               if (first <= k - 2) &
                  call self%operators%answer(k)%multiply_add(sliders%motion(:, :, first:), &
                                                             x(:, :, k), sliders%moved, &
                                                             (k - 1 - first)*sliders%n_moved)
            end associate
            if (k <= 4) call sliders%mask(k, x(:, :, k))
         end do
         call sliders%integrate_motion(size(x, 2), x(:, :, v), x(:, :, 2:6))
      end associate
      call finish_part(self%paths, list, found)
   end subroutine run_part

   !> Stops, as it is never called: joints act on each other, so no joint is local.
   subroutine correct(self, group, entry)
      class(modal_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry

      if (self%n_padded < 0 .or. group%n < entry) return
      error stop 'dynamics_exact_modal_form: correct'
   end subroutine correct

   !> See base_system.
   subroutine redo(self, lane, begin, state, error)
      class(modal_form), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: first
      integer :: round

      associate (paths => self%lane)
         if (.not. allocated(paths%slack)) call paths%start(self%operators%n_joints, &
                                                            self%operators%n_moments)
         call paths%begin(self%paths%slack(lane, :self%operators%n_joints), &
                          self%sliders%moves(lane, :self%operators%n_joints))
         do round = 0, self%max_transitions
            call adopt_suspects(paths)
            call paths%find_crossings()
            first = minval(paths%crossing(:paths%n_suspects))
            if (.not. first < no_crossing) exit
            call paths%move_on(first)
            call switch_suspects(paths)
         end do
         if (round > self%max_transitions) then
            call raise_too_many(self, paths%suspect(minloc(paths%crossing(:paths%n_suspects), 1)), &
                                lane, begin, error)
            return
         end if
         if (round > 0) call put_changes(paths)
      end associate

   contains

      !> Adopts the joints whose guards may have a zero.
      subroutine adopt_suspects(paths)
         type(lane_paths), intent(inout) :: paths
         integer :: j

         do j = 1, self%operators%n_joints
            if (paths%slack(j) > 0.0_wp) cycle
            associate (regime => self%paths%regime(lane, j, :))
               call paths%adopt(j, self%paths%x(lane, j, self%paths%layer), regime(layer_side), &
                                regime(layer_slider), regime(layer_reach))
            end associate
         end do
      end subroutine adopt_suspects

      !> Switches all suspects that cross now, in their order.
      subroutine switch_suspects(paths)
         type(lane_paths), intent(inout) :: paths
         real(wp), parameter :: same_instant = 1.0e-12_wp   ! rounding of sliders over velocity
         real(wp) :: time
         integer :: direction, e, i, sample

         sample = self%paths%first_sample + lane - 1
         time = (begin + 1.0_wp - paths%left)*self%h
         do e = 1, paths%n_suspects
            if (paths%crossing(e) > first + same_instant) cycle
            i = paths%suspect(e)
            associate (place => paths%path(0, e))
               if (abs(paths%side(e)) > 0.0_wp) then
                  direction = nint(paths%side(e))
                  call enter_transition(state, i, sample, time, place, 0)
               else
                  direction = slip_direction(paths%path(1, e))
                  call enter_transition(state, i, sample, time, place, direction)
               end if
               call self%paths%switch(lane, i, direction, place)
            end associate
            call self%sliders%switch(i, lane)
            call paths%switch_slider(self%operators, e, real(direction, wp))
         end do
      end subroutine switch_suspects

      !> Adds to the ends of paths and to the sliders' integrals.
      subroutine put_changes(paths)
         type(lane_paths), intent(in) :: paths
         real(wp) :: place, velocity
         integer :: j

         associate (x => self%paths%x, finish => self%paths%finish)
            do j = 1, self%operators%n_joints
               call paths%end_changes(j, place, velocity)
               x(lane, j, finish(0)) = x(lane, j, finish(0)) + place
               x(lane, j, finish(1)) = x(lane, j, finish(1)) + velocity
               if (.not. self%sliders%has_moved(1 + (lane - 1)*groups/width, j)) cycle
               associate (moments => self%sliders%moments(lane, j, :))
                  moments = moments + paths%moments(j, :)
               end associate
            end do
         end associate
      end subroutine put_changes

   end subroutine redo

   !> Makes the ends the starts.
   subroutine go_on(self)
      class(modal_form), intent(inout) :: self

      if (.not. self%keeps_ledger) call take_sliders(self)
      call self%paths%exchange_ends()
   end subroutine go_on

   !> Takes the modes to the end of the part, with the motion of the sliders (M6).
   subroutine take_sliders(self)
      class(modal_form), intent(inout) :: self
      integer :: k

      if (any(self%sliders%has_switched)) call self%sliders%list_moved()
      associate (sliders => self%sliders, last => self%operators%n_moments)
         do k = 0, merge(last, 0, self%operators%decouples)
            call self%operators%push%multiply(sliders%moments(:, :, k), self%taken(:, :, k), &
                                              sliders%moved, sliders%n_moved)
         end do
         if (self%operators%decouples) then
            call take_motion(self%n_padded, self%operators%weight, self%ahead, self%taken, &
                             self%now, self%pushed)
         else
            self%now(:, :, 1:2) = self%ahead(:, :, 1:2)
            call self%operators%kick%multiply_add(sliders%moments, self%now, sliders%moved, &
                                                  (last + 1)*sliders%n_moved)
            self%pushed = self%pushed + self%taken(:, :, 0)
         end if
      end associate
   end subroutine take_sliders

   !> See base_system.
   subroutine put_state(self, displacement, velocity)
      class(modal_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)
      real(wp) :: x(width, self%n_padded)

      call self%operators%shape%multiply(self%now(:, :, 1), x)
      displacement = x(:, :self%operators%n_modes)
      if (size(velocity) == 0) return
      call self%operators%shape%multiply(self%now(:, :, 2), x)
      velocity = x(:, :self%operators%n_modes)/self%h
   end subroutine put_state

   !> See base_system. The modes go on here.
   subroutine add_works(self, work)
      class(modal_form), intent(inout) :: self
      real(wp), intent(inout) :: work(:, :)   !! (lane, input viscous) [J]

      call take_sliders(self)
      associate (for => self%operators, sliders => self%sliders)
         if (for%decouples) then
            call put_rest(self%n_padded, for%weight, for%rotation, self%taken, self%rest)
         else
            call for%rest%multiply(sliders%moments, self%rest, sliders%moved, &
                                   (for%n_moments + 1)*sliders%n_moved)
         end if
         call for%ledger%add_part(self%now, self%ahead, self%taken(:, :, 0), self%rest, &
                                  self%works, work)
      end associate
   end subroutine add_works

end module dynamics_exact_modal_form
