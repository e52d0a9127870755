!> Base system of any structure, in the modes that it has with all joints stuck.
!>
!> Modes rotate exactly over a part, whatever their frequency. A slipping joint is a moving slider:
!> the path of every joint is the polynomial through its free path at the half and the end of the
!> part, and the answers to all sliders, power by power (M4), (M5). The modes then take the
!> integrals of the sliders' motion (M6). All transitions of a sample in a part are treated in the
!> paths of its joints alone (dynamics_exact_modal_lane).
module dynamics_exact_modal_form
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_free_steps, only: finish_part
   use dynamics_exact_guard_zeros, only: no_crossing
   use dynamics_exact_joint_paths, only: layer_reach, layer_side, layer_slider, layer_spring, width
   use dynamics_exact_modal_lane, only: lane_paths
   use dynamics_exact_modal_operators, only: modal_operators, new_modal_operators
   use dynamics_exact_modal_steps, only: follow, integrate_motion, mask, put_free_paths, rotate, &
                                         take_motion
   use dynamics_exact_modal_terms, only: path_degree
   use dynamics_exact_transitions, only: transition_group
   use dynamics_joint, only: enter_transition, slip_direction
   use dynamics_alignment, only: first_aligned
   use dynamics_response, only: block_state
   use numerics_dense_product, only: padded_rows
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
      real(wp), pointer, contiguous :: motion(:, :, :) => null()   !! (.., 1:4) sliders, by powers
      real(wp), pointer, contiguous :: moves(:, :) => null()       !! (lane, joint) 1: slider moves
      real(wp), pointer, contiguous :: moments(:, :, :) => null()  !! (.., 0:moment) of sliders
      !> (lane, force, power) where a ledger is kept
      real(wp), allocatable, private :: force(:, :, :)
      real(wp), pointer, contiguous, private :: memory(:) => null()
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
   subroutine new_modal_form(structure, dt, tolerance, form, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_form), intent(out) :: form
      type(error_type), allocatable, intent(out) :: error

      call new_modal_operators(structure, dt, tolerance, form%operators, error)
      if (allocated(error)) return
      form%h = form%operators%h
      form%n_forces = structure%n_forces
      form%has_works_of_all = .true.
      form%can_keep_ledger = form%operators%decouples
      form%n_padded = padded_rows(structure%n_dof)
      form%m_padded = padded_rows(structure%n_joints)
   end subroutine new_modal_form

   !> See base_system.
   subroutine begin(self)
      class(modal_form), intent(inout) :: self
      integer :: at, j, last

      call self%paths%start(path_degree, [(0.0_wp, j=1, self%m_padded)], &
                            [(j, j=1, self%operators%n_joints)], &
                            [(1.0_wp, j=1, self%operators%n_joints)])
      if (associated(self%memory)) deallocate (self%memory)
      last = self%operators%n_moments
      allocate (self%memory(width*((9 + last)*self%n_padded + (10 + last)*self%m_padded) + 8), &
                source=0.0_wp)
      at = first_aligned(self%memory)
      call c_f_pointer(c_loc(self%memory(at)), self%now, [width, self%n_padded, 3])
      at = at + size(self%now)
      call c_f_pointer(c_loc(self%memory(at)), self%ahead, [width, self%n_padded, 4])
      at = at + size(self%ahead)
      call c_f_pointer(c_loc(self%memory(at)), self%pushed, [width, self%n_padded])
      at = at + size(self%pushed)
      call c_f_pointer(c_loc(self%memory(at)), self%taken, [width, self%n_padded, last + 1])
      self%taken(1:, 1:, 0:) => self%taken
      at = at + size(self%taken)
      if (self%m_padded == 0) then
         allocate (self%moves(width, 0), self%value(width, 0, 4), self%motion(width, 0, 4), &
                   self%moments(width, 0, 0:last))
         return
      end if
      call c_f_pointer(c_loc(self%memory(at)), self%value, [width, self%m_padded, 4])
      at = at + size(self%value)
      call c_f_pointer(c_loc(self%memory(at)), self%moves, [width, self%m_padded])
      at = at + size(self%moves)
      call c_f_pointer(c_loc(self%memory(at)), self%motion, [width, self%m_padded, 4])
      at = at + size(self%motion)
      call c_f_pointer(c_loc(self%memory(at)), self%moments, [width, self%m_padded, last + 1])
      self%moments(1:, 1:, 0:) => self%moments
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
      if (self%keeps_ledger) self%force = force
      if (self%operators%decouples) then
         call rotate(n, self%operators%rotation, self%operators%load, force, self%now, &
                     self%pushed, self%ahead)
      else
         call propagate(self, force)
      end if
      do i = 1, self%operators%n_reads
         call self%operators%read%multiply(self%ahead(:, :, i), self%value(:, :, i))
      end do
      associate (x => self%paths%x, v => self%paths%layer(1), u => self%paths%layer(0), &
                 regime => self%paths%regime, motion => self%motion)
         call put_free_paths(m, size(x, 2), self%operators%n_reads, self%value, x(:, :, u), &
                             x(:, :, v), x(:, :, 2:6))
         call follow(self%operators%n_joints, regime(:, :, layer_side), &
                     regime(:, :, layer_spring), self%moves)
         call mask(m, self%moves, x(:, :, v), motion(:, :, 1))
         call mask(m, self%moves, x(:, :, 2), motion(:, :, 2))
         do k = 3, path_degree
            associate (first => self%operators%first_power(k))
               if (first <= k - 2) &
                  call self%operators%answer(k)%multiply_add(motion(:, :, first:), x(:, :, k))
            end associate
            if (k <= 4) call mask(m, self%moves, x(:, :, k), motion(:, :, k))
         end do
         call integrate_motion(m, size(x, 2), self%operators%n_moments, self%moves, x(:, :, v), &
                               x(:, :, 2:6), self%moments)
      end associate
      call finish_part(self%paths, list, found)
   end subroutine run_part

   !> All modes together (M3).
   subroutine propagate(self, force)
      class(modal_form), intent(inout) :: self
      real(wp), intent(in) :: force(:, :, 0:)
      integer :: f, r, row

      do r = 1, self%operators%n_modes
         self%now(:, r, 3) = self%pushed(:, r)
         do f = 1, self%n_forces
            self%now(:, r, 3) = self%now(:, r, 3) + self%operators%load(r, f)*force(:, f, 0)
         end do
      end do
      call self%operators%propagator%multiply(self%now, self%ahead)
      do f = 1, self%n_forces
         do r = 1, 4
            do row = 1, self%n_padded
               self%ahead(:, row, r) = self%ahead(:, row, r) + force(:, f, 1)* &
                                       self%operators%rise((r - 1)*self%n_padded + row, f)
            end do
         end do
      end do
   end subroutine propagate

   !> Never called: joints act on each other, so no joint is local.
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
      real(wp) :: first, power, slope, value
      integer :: j, k, m, round

      m = self%operators%n_joints
      associate (paths => self%lane, x => self%paths%x, regime => self%paths%regime)
         if (.not. allocated(paths%side)) call paths%start(m, self%operators%n_moments)
         do j = 1, m
            paths%side(j) = regime(lane, j, layer_side)
            paths%slider(j) = regime(lane, j, layer_slider)
            paths%reach(j) = regime(lane, j, layer_reach)
            paths%follows(j) = self%moves(lane, j)
            do k = 0, path_degree
               paths%path(j, k) = x(lane, j, self%paths%layer(k))
            end do
            paths%moments(j, :) = self%moments(lane, j, :)
         end do
         paths%left = 1.0_wp
         do round = 0, self%max_transitions
            call paths%find_crossings()
            first = minval(paths%crossing)
            if (.not. first < no_crossing) exit
            call paths%move_on(first)
            call switch_joints(paths)
         end do
         if (round > self%max_transitions) then
            call raise_too_many(self, minloc(paths%crossing, 1), lane, begin, error)
            return
         end if
         do j = 1, m
            self%moments(lane, j, :) = paths%moments(j, :)
            value = 0.0_wp
            slope = 0.0_wp
            power = paths%left
            do k = path_degree, 0, -1
               slope = slope*power + value
               value = value*power + paths%path(j, k)
            end do
            x(lane, j, self%paths%finish(0)) = value
            x(lane, j, self%paths%finish(1)) = slope
         end do
      end associate

   contains

      !> All joints that cross now, in their order.
      subroutine switch_joints(paths)
         type(lane_paths), intent(inout) :: paths
         real(wp), parameter :: same_instant = 1.0e-12_wp   ! rounding of sliders over velocity
         real(wp) :: time
         integer :: direction, i, sample

         sample = self%paths%first_sample + lane - 1
         time = (begin + 1.0_wp - paths%left)*self%h
         do i = 1, m
            if (paths%crossing(i) > first + same_instant) cycle
            associate (place => paths%path(i, 0))
               if (abs(paths%side(i)) > 0.0_wp) then
                  direction = nint(paths%side(i))
                  call enter_transition(state, i, sample, time, place, 0)
               else
                  direction = slip_direction(paths%path(i, 1))
                  call enter_transition(state, i, sample, time, place, direction)
               end if
               call self%paths%switch(lane, i, direction, place)
            end associate
            call paths%switch_slider(self%operators, i, real(direction, wp))
         end do
      end subroutine switch_joints

   end subroutine redo

   !> The modes take the motion of the sliders (M6), and the ends become the starts.
   subroutine go_on(self)
      class(modal_form), intent(inout) :: self

      if (self%operators%decouples) then
         if (.not. self%keeps_ledger) call form_taken(self)
         call take_motion(self%n_padded, self%operators%n_moments, self%operators%weight, &
                          self%ahead, self%taken, self%now)
         self%pushed = self%pushed + self%taken(:, :, 0)
      else
         call self%operators%push%multiply_add(self%moments(:, :, 0), self%pushed)
         self%now(:, :, 1:2) = self%ahead(:, :, 1:2)
         call self%operators%kick%multiply_add(self%moments, self%now)
      end if
      call self%paths%exchange_ends()
   end subroutine go_on

   !> See base_system.
   subroutine put_state(self, displacement, velocity)
      class(modal_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)
      real(wp) :: x(width, self%n_padded)

      call self%operators%shape_rows%multiply(self%now(:, :, 1), x)
      displacement = x(:, :self%operators%n_modes)
      if (size(velocity) == 0) return
      call self%operators%shape_rows%multiply(self%now(:, :, 2), x)
      velocity = x(:, :self%operators%n_modes)/self%h
   end subroutine put_state

   !> See base_system. Never called where damping couples the modes.
   subroutine add_works(self, work)
      class(modal_form), intent(inout) :: self
      real(wp), intent(inout) :: work(:, :)

      call form_taken(self)
      call self%operators%ledger%add_part(self%operators%load, self%operators%weight, self%force, &
                                          self%now, self%ahead, self%pushed, self%taken, work)
   end subroutine add_works

   !> Push of the integrals of the sliders' motion (M6).
   subroutine form_taken(self)
      class(modal_form), intent(inout) :: self
      integer :: k

      do k = 0, self%operators%n_moments
         call self%operators%push%multiply(self%moments(:, :, k), self%taken(:, :, k))
      end do
   end subroutine form_taken

end module dynamics_exact_modal_form
