!> Exact march of any structure by its modes with all joints stuck.
!>
!> The free motion of the modes over a part is exact at any frequency. A slipping joint is a stuck
!> one whose slider moves. The path of every joint is a polynomial, the interpolation of its free
!> path (M4), to which the responses to the sliders are added power by power (M5). The modes then
!> take the integrals of the sliders' motion (M6). Transitions are found and made in the paths of
!> the joints alone (dynamics_exact_modal_lane).
module dynamics_exact_modal_form
   use core_alignment, only: aligned_memory
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_free_steps, only: find_candidates
   use dynamics_exact_guard_zeros, only: no_zero
   use dynamics_exact_joint_paths, only: regime_side, regime_spring, width
   use dynamics_exact_modal_lane, only: find_end_responses, lane_paths
   use dynamics_exact_modal_operators, only: kernel_fit, modal_operators, new_modal_operators, strip
   use dynamics_exact_modal_sliders, only: moving_sliders
   use dynamics_exact_modal_steps, only: add_slider_motion, advance_blocks, find_paths, &
                                         multiply_strips
   use dynamics_exact_modal_terms, only: groups, lanes, path_degree
   use dynamics_exact_transitions, only: last_integral, transition_group
   use dynamics_response, only: block_state
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: modal_form, new_modal_form

   !> Base system by modes: 32 samples in four groups of eight lanes.
   type, extends(base_system) :: modal_form
      type(modal_operators) :: operators
      integer :: n_groups = 0   !! groups with samples
      !> (lane, row, plane, group) state of the blocks, q and q' or p, then S z. From march_freely
      !> to end_part it is the state at the end of the free motion
      real(wp), pointer, contiguous :: modes(:, :, :, :) => null()
      !> Buffers of one group: (lane, row, 1:2) what p and p' at 1/2 add to the cubic (M4);
      !> (lane, row, 0:moment) S I of (M6)
      real(wp), pointer, contiguous, dimension(:, :, :) :: midpoint => null(), &
                                                           slider_moments => null()
      type(moving_sliders) :: sliders
      !> With a ledger: (lane, 1:2, block, group) p' at the start of the part
      real(wp), pointer, contiguous, private :: rates(:, :, :, :) => null()
      type(aligned_memory), private :: memory
      type(lane_paths), private :: lane   !! buffer of march_again
   contains
      procedure :: load_state
      procedure :: store_state
      procedure :: march_freely
      procedure :: add_transition
      procedure :: march_again
      procedure :: end_part
      procedure :: copy_state
   end type modal_form

contains

   !> Prepares the form, with as many parts in a step as the tolerance needs.
   subroutine new_modal_form(structure, dt, tolerance, form, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance   !! relative to the rms displacement
      type(modal_form), intent(out) :: form
      type(error_type), allocatable, intent(out) :: error

      call new_modal_operators(structure, dt, tolerance, form%operators, error)
      if (allocated(error)) return
      form%h = form%operators%h
      form%n_internal = (4 - form%operators%blocks%ports)*form%operators%n_rows &
                        + 2*structure%n_joints
   end subroutine new_modal_form

   !> Allocates all arrays, filled with zeros.
   subroutine allocate_memory(self)
      class(modal_form), intent(inout) :: self
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: j, n, n_planes

      associate (ops => self%operators)
         n = size(ops%push, 1)
         n_planes = 4 - ops%blocks%ports
         self%paths%coupling = ops%coupling
         call self%sliders%initialize(ops%n_joints, ops%n_moments)
         call self%paths%initialize(path_degree, ops%n_forces, &
                                    [(0.0_wp, j=1, strip*size(ops%outputs, 3))], &
                                    [(j, j=1, ops%n_joints)], &
                                    [(ops%markov(j, j, 0), j=1, ops%n_joints)])
         if (self%keeps_ledger .and. .not. ops%ledger%is_ready) &
            call ops%ledger%prepare(self%h, ops%damping, ops%modal_load, ops%blocks, &
                                    kernel_fit(ops%n_moments))
         call self%memory%reserve(int(lanes, long)*n*((n_planes + 2)*groups + 3 + ops%n_moments))
         call self%memory%assign_planes([lanes, n, n_planes*groups], planes)
         self%modes(1:lanes, 1:n, 1:n_planes, 1:groups) => planes
         call self%memory%assign_planes([lanes, n, 2], self%midpoint)
         call self%memory%assign_planes([lanes, n, ops%n_moments + 1], self%slider_moments)
         call self%memory%assign_planes([lanes, 2, ops%n_modes*groups], planes)
         self%rates(1:lanes, 1:2, 1:ops%n_modes, 1:groups) => planes
      end associate
   end subroutine allocate_memory

   !> See base_system. Without an internal state, which is then zero, the block must be at rest.
   subroutine load_state(self, state)
      class(modal_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: e, g, k, l, m, n, w

      call allocate_memory(self)
      m = self%operators%n_joints
      n = self%operators%n_rows
      k = self%n_internal - 2*m
      self%n_groups = group_of(self%paths%n_samples)
      self%sliders%n_moving = m   ! of which move_sliders finds those that move
      self%sliders%moving(:m, :) = spread([(l, l=1, m)], 2, groups)
      do l = 1, self%paths%n_samples
         w = self%paths%first_sample + l - 1
         g = group_of(l)
         e = l - lanes*(g - 1)
         if (.not. self%has_internal .and. any(abs(state%velocity(:, w)) &
                                               + abs(state%displacement(:, w)) > 0.0_wp)) &
            error stop 'modal_form: load_state'
         associate (kept => state%internal(:, w), modes => self%modes(e, :n, :, g))
            modes = reshape(kept(:k), shape(modes))
            self%paths%x(l, :m, self%paths%layer(0)) = kept(k + 1:k + m)
            self%paths%x(l, :m, self%paths%layer(1)) = kept(k + m + 1:)
         end associate
      end do
   end subroutine load_state

   !> Group of a lane.
   elemental integer function group_of(lane)
      integer, intent(in) :: lane

      group_of = 1 + (lane - 1)/lanes
   end function group_of

   !> See base_system.
   subroutine store_state(self, state)
      class(modal_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), dimension(width, self%operators%n_modes) :: displacement, velocity
      integer :: g, l, m, w

      m = self%operators%n_joints
      call self%copy_state(displacement, velocity)
      do l = 1, self%paths%n_samples
         w = self%paths%first_sample + l - 1
         g = group_of(l)
         if (self%keeps_ledger) &   ! the growth of v'v, which add_part leaves out (M9)
            state%work_viscous(w) = &
            state%work_viscous(w) + (sum(matmul(state%velocity(:, w), self%operators%momentum)**2) &
                                     - sum(matmul(velocity(l, :), self%operators%momentum)**2))
         state%displacement(:, w) = displacement(l, :)
         state%velocity(:, w) = velocity(l, :)
         state%internal(:, w) = [self%modes(l - lanes*(g - 1), :self%operators%n_rows, :, g), &
                                 self%paths%x(l, :m, self%paths%layer(0)), &
                                 self%paths%x(l, :m, self%paths%layer(1))]
      end do
   end subroutine store_state

   !> See base_system. Advances the modes of each group, and finds the paths of its joints.
   subroutine march_freely(self)
      class(modal_form), intent(inout) :: self
      real(wp) :: force(lanes, self%operators%n_forces, 0:1)   ! value and rise [N]
      integer :: first, g, joints, rows

      rows = size(self%modes, 2)
      joints = size(self%paths%x, 2)
      do g = 1, self%n_groups
         first = lanes*(g - 1) + 1
         force = self%paths%force(first:first + lanes - 1, :, :)
         associate (ops => self%operators, modes => self%modes(:, :, :, g), x => self%paths%x, &
                    u => self%paths%layer(0), v => self%paths%layer(1), &
                    regime => self%paths%regime)
            call advance_blocks(ops, rows, force, self%keeps_ledger, modes, self%midpoint, &
                                self%rates(:, :, :, g))
            call find_paths(ops, joints, rows, force, modes, self%midpoint, x(first, 1, u), &
                            x(first, 1, v), x(first, 1, 2))
            call self%sliders%move_sliders(g, ops, joints, regime(first, 1, regime_side), &
                                           regime(first, 1, regime_spring), x(first, 1, v), &
                                           x(first, 1, 2))
         end associate
      end do
      call find_candidates(self%paths)
   end subroutine march_freely

   !> See base_system.
   subroutine add_transition(self, group, entry)
      class(modal_form), intent(inout) :: self
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      real(wp) :: ends(size(self%operators%markov, 1), 0:1)
      real(wp) :: moments(0:last_integral, self%operators%n_joints)
      integer :: e, g, i, joints(self%operators%n_joints), k, lane, n

      lane = group%lane(entry)
      g = group_of(lane)
      e = lane - lanes*(g - 1)
      n = 1
      joints(1) = group%joint(entry)
      do i = 1, self%sliders%n_moving(g)
         associate (j => self%sliders%moving(i, g))
            if (j == joints(1) .or. .not. self%sliders%moves(e, j, g) > 0.0_wp) cycle
            n = n + 1
            joints(n) = j
         end associate
      end do
      call find_end_responses(self%operators%markov, joints(:n), group%path(entry, 1:path_degree), &
                              .not. abs(group%side(entry)) > 0.0_wp, 1.0_wp - group%time(entry), &
                              moments, ends)
      call self%sliders%switch(g, joints(1))
      associate (integrals => self%sliders%moments(e, :, :, g), &
                 place => self%paths%x(lane, :, self%paths%finish(0)), &
                 velocity => self%paths%x(lane, :, self%paths%finish(1)))
         do i = 1, n
            do k = 0, self%operators%n_moments
               integrals(joints(i), k + 1) = integrals(joints(i), k + 1) + moments(k, i)
            end do
         end do
         do i = 1, self%operators%n_joints
            place(i) = place(i) + ends(i, 0)
            velocity(i) = velocity(i) + ends(i, 1)
         end do
      end associate
   end subroutine add_transition

   !> See base_system.
   subroutine march_again(self, begin, state, error)
      class(modal_form), intent(inout) :: self
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: same_instant = 1.0e-12_wp   ! rounding of sliders over velocity
      integer :: e, g, i, j, lane, round
      real(wp) :: span

      associate (m => self%operators%n_joints, one => self%lane)
         do lane = 1, width
            if (.not. self%paths%is_remarched(lane)) cycle
            g = group_of(lane)
            e = lane - lanes*(g - 1)
            call one%load(self%paths, lane, self%sliders%moves(e, :, g), self%operators%n_moments)
            do round = 0, self%max_transitions
               call one%find_next(span)
               if (.not. span < no_zero) exit
               call one%move_on(span)
               do j = 1, m
                  if (one%next_zero(j) > span + same_instant) cycle
                  call self%paths%switch(lane, j, (begin + 1.0_wp - one%time_left)*self%h, &
                                         one%path(j, 0), one%path(j, 1), state)
                  call self%sliders%switch(g, j)
                  call one%switch_slider(self%operators, j, self%paths%regime(lane, j, :))
               end do
            end do
            if (round > self%max_transitions) then
               call raise_too_many(self, minloc(one%next_zero, 1), lane, begin, error)
               return
            end if
            if (round == 0) cycle
            self%paths%x(lane, :m, self%paths%finish(0)) = one%ends(:m, 0)
            self%paths%x(lane, :m, self%paths%finish(1)) = one%ends(:m, 1)
            do i = 1, self%sliders%n_moving(g)
               associate (joint => self%sliders%moving(i, g))
                  self%sliders%moments(e, joint, :, g) = self%sliders%moments(e, joint, :, g) &
                                                         + one%moments(joint, :)
               end associate
            end do
         end do
      end associate
   end subroutine march_again

   !> See base_system. Adds the motion of the sliders to the modes at the end of the part (M6).
   subroutine end_part(self)
      class(modal_form), intent(inout) :: self
      real(wp) :: force(lanes, self%operators%n_forces, 0:1), work(lanes, 2)
      integer :: g

      do g = 1, self%n_groups
         associate (sliders => self%sliders, rows => size(self%modes, 2), &
                    first => lanes*(g - 1) + 1, last => lanes*g)
            call add_slider_motion(self%operators, sliders%moving(:sliders%n_moving(g), g), &
                                   sliders%moments(:, :, :, g), self%keeps_ledger, rows, &
                                   self%slider_moments, self%modes(:, :, :, g))
            if (.not. self%keeps_ledger) cycle
            force = self%paths%force(first:last, :, :)
            work = self%work_done(first:last, :)
            call self%operators%ledger%add_part(rows, self%operators%load, force, &
                                                self%slider_moments, self%rates(:, :, :, g), work)
            self%work_done(first:last, :) = work
         end associate
      end do
      call self%paths%exchange_ends()
   end subroutine end_part

   !> See base_system.
   subroutine copy_state(self, displacement, velocity)
      class(modal_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)
      real(wp) :: x(lanes, strip*size(self%operators%shape, 3))
      integer :: first, g

      do g = 1, self%n_groups
         first = lanes*(g - 1) + 1
         call read_shape(1, 1)
         displacement(first:first + lanes - 1, :) = x(:, :self%operators%n_modes)
         if (size(velocity) == 0) cycle
         call read_shape(2, size(self%modes, 3) - 1)
         velocity(first:first + lanes - 1, :) = x(:, :self%operators%n_modes)/self%h
      end do

   contains

      !> Finds displacements (1) or velocities (2) of all dofs from a plane of the modes.
      subroutine read_shape(quantity, plane)
         integer, intent(in) :: quantity, plane

         call multiply_strips(size(x, 2)/strip, self%operators%n_rows, &
                       self%operators%shape(:, :, :, quantity), self%modes(:, :, plane, g), x)
      end subroutine read_shape

   end subroutine copy_state

end module dynamics_exact_modal_form
