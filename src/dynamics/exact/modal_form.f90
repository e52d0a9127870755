!> Base system of any structure, in the modes that it has with all joints stuck.
!>
!> Modes rotate exactly over a part, whatever their frequency. A slipping joint is a moving slider:
!> the path of every joint is the polynomial through its free path at the half and the end of the
!> part, and the answers to all sliders, power by power (M4), (M5). The modes then take the
!> integrals of the sliders' motion (M6). All transitions of a sample in a part are treated in the
!> paths of its joints alone (dynamics_exact_modal_lane).
module dynamics_exact_modal_form
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_exact_base_system, only: base_system, raise_too_many, switch_joint
   use dynamics_exact_free_steps, only: finish_part
   use dynamics_exact_guard_zeros, only: no_crossing
   use dynamics_exact_joint_paths, only: layer_reach, layer_side, layer_slider, layer_spring, width
   use dynamics_exact_modal_lane, only: lane_paths
   use dynamics_exact_modal_operators, only: kernel_fit, modal_operators, new_modal_operators
   use dynamics_exact_modal_sliders, only: groups, lanes, moving_sliders
   use dynamics_exact_modal_steps, only: put_free_paths, rotate_modes, rotate_pairs, take_motion
   use dynamics_exact_modal_terms, only: path_degree
   use dynamics_alignment, only: aligned_memory
   use dynamics_response, only: block_state
   use numerics_dense_product, only: padded_rows
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: modal_form, new_modal_form

   !> Modes and joints of 32 samples, in groups of eight side by side.
   type, extends(base_system) :: modal_form
      type(modal_operators) :: operators
      integer :: n_padded = 0, m_padded = 0
      integer :: n_groups = 0   !! that have samples
      !> (lane, row, plane, group) numbers of blocks: q and q', or p; from run_part to go_on those
      !> that the free motion has at the end
      real(wp), pointer, contiguous :: now(:, :, :, :) => null()
      !> Room for the group under way: (lane, row, 1:2) p, p' at 1/2 less those of the cubic through
      !> both ends; (lane, row, 0:moment) S I; (lane, joint, 1:4) u, u' at 1 and of the middle
      real(wp), pointer, contiguous, dimension(:, :, :) :: middle => null(), taken => null(), &
                                                           value => null()
      real(wp), pointer, contiguous :: pushed(:, :, :) => null()     !! (lane, row, group) S z
      type(moving_sliders) :: sliders
      !> With a ledger: (lane, number, block, group) p' at the start of the part
      real(wp), pointer, contiguous, private :: rates(:, :, :, :) => null()
      type(aligned_memory), private :: memory
      type(lane_paths), private :: lane   !! room for redo
   contains
      procedure :: begin
      procedure :: take
      procedure :: give
      procedure :: run_part
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
      form%n_padded = padded_rows(form%operators%n_rows)
      form%m_padded = padded_rows(structure%n_joints)
      form%n_kept = (4 - form%operators%blocks%ports)*form%operators%n_rows + 2*structure%n_joints
   end subroutine new_modal_form

   !> See base_system.
   subroutine begin(self)
      class(modal_form), intent(inout) :: self
      integer :: j, n, m, n_planes, planes

      n = self%n_padded
      m = self%m_padded
      call self%sliders%start(self%operators%n_joints, m, self%operators%n_moments)
      call self%paths%start(path_degree, self%n_forces, [(0.0_wp, j=1, m)], &
                            [(j, j=1, self%operators%n_joints)], &
                            [(1.0_wp, j=1, self%operators%n_joints)])
      self%paths%keeps_slack = .true.
      planes = 3 - self%operators%blocks%ports
      n_planes = (planes + 1)*groups + 3 + self%operators%n_moments
      if (self%keeps_ledger) then
         n_planes = n_planes + 2*groups
         associate (for => self%operators)
            if (.not. for%ledger%is_ready) &
               call for%ledger%prepare(self%h, for%damping, for%modal_load, for%blocks, &
                                       kernel_fit(for%n_moments))
         end associate
      end if
      call self%memory%start(int(lanes, long)*(n_planes*n + 4*m))
      call take_planes(n, planes, self%now)
      call self%memory%take([lanes, n, groups], self%pushed)
      call self%memory%take([lanes, n, 2], self%middle)
      call self%memory%take([lanes, n, self%operators%n_moments + 1], self%taken)
      self%taken(1:, 1:, 0:) => self%taken
      call self%memory%take([lanes, m, 4], self%value)
      if (self%keeps_ledger) call take_planes(2, self%operators%n_modes, self%rates)

   contains

      !> Hands out planes of every group.
      subroutine take_planes(rows, many, planes)
         integer, intent(in) :: rows, many
         real(wp), pointer, contiguous, intent(out) :: planes(:, :, :, :)
         real(wp), pointer, contiguous :: all(:, :, :)

         call self%memory%take([lanes, rows, many*groups], all)
         planes(1:lanes, 1:rows, 1:many, 1:groups) => all
      end subroutine take_planes

   end subroutine begin

   !> See base_system.
   subroutine take(self, state)
      class(modal_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer :: e, g, k, l, m, n, w

      n = self%operators%n_rows
      m = self%operators%n_joints
      k = n*size(self%now, 3)
      self%n_groups = group_of(self%paths%n_samples)
      self%now = 0.0_wp
      self%pushed = 0.0_wp
      self%sliders%has_switched = .true.   ! regimes are given
      self%paths%x = 0.0_wp
      do l = 1, self%paths%n_samples
         w = self%paths%first_sample + l - 1
         g = group_of(l)
         e = l - lanes*(g - 1)
         associate (place => state%displacement(:, w), speed => state%velocity(:, w), &
                    kept => state%kept(:, w), u => self%paths%x(l, :m, self%paths%layer(0)), &
                    v => self%paths%x(l, :m, self%paths%layer(1)), for => self%operators)
            if (self%is_kept) then
               self%now(e, :n, :, g) = reshape(kept(:k), [n, k/n])
               self%pushed(e, :n, g) = kept(k + 1:k + n)
               u = kept(k + n + 1:k + n + m)
               v = kept(k + n + m + 1:)
            else
               self%now(e, :n, :, g) = for%blocks%numbers(matmul(place, for%momentum), &
                                                          matmul(speed, for%momentum)*self%h)
               self%pushed(e, :n, g) = matmul(for%slider_push, state%slider(:, w))
               u = matmul(place, for%direction)
               v = matmul(speed, for%direction)*self%h
            end if
         end associate
      end do
   end subroutine take

   !> Group of a lane.
   elemental integer function group_of(lane)
      integer, intent(in) :: lane

      group_of = 1 + (lane - 1)/lanes
   end function group_of

   !> See base_system.
   subroutine give(self, state)
      class(modal_form), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), dimension(width, self%operators%n_modes) :: displacement, velocity
      integer :: e, g, l, m, n, w

      n = self%operators%n_rows
      m = self%operators%n_joints
      call self%put_state(displacement, velocity)
      associate (x => self%paths%x, layer => self%paths%layer)
         do l = 1, self%paths%n_samples
            w = self%paths%first_sample + l - 1
            g = group_of(l)
            e = l - lanes*(g - 1)
            if (self%keeps_ledger) state%work_viscous(w) = &
               state%work_viscous(w) + (square(state%velocity(:, w)) - square(velocity(l, :)))
            state%displacement(:, w) = displacement(l, :)
            state%velocity(:, w) = velocity(l, :)
            state%kept(:, w) = [self%now(e, :n, :, g), self%pushed(e, :n, g), &
                                x(l, :m, layer(0)), x(l, :m, layer(1))]
         end do
      end associate

   contains

      !> v'v [J], whose growth the ledger leaves out of the parts (M9).
      pure real(wp) function square(velocity)
         real(wp), intent(in) :: velocity(:)

         square = sum(matmul(velocity, self%operators%momentum)**2)
      end function square

   end subroutine give

   !> See base_system.
   subroutine run_part(self)
      class(modal_form), intent(inout) :: self
      real(wp) :: push(lanes, self%n_forces, 0:1)
      integer :: g

      do g = 1, self%n_groups
         associate (first => lanes*(g - 1) + 1)
            push = self%paths%force(first:first + lanes - 1, :, :)
            call run_group(self, g, first, push)
         end associate
      end do
      call finish_part(self%paths)
   end subroutine run_part

   !> Takes the modes of a group ahead, and follows the paths of its joints.
   subroutine run_group(self, g, first, force)
      class(modal_form), intent(inout) :: self
      integer, intent(in) :: g, first   !! group; its first lane
      real(wp), intent(in) :: force(lanes, self%n_forces, 0:1)   !! value and rise [N]
      integer :: i, k, n, rows
      logical :: has_slope

      n = self%n_padded
      rows = size(self%paths%x, 2)
      associate (now => self%now(:, :, :, g), pushed => self%pushed(:, :, g), &
                 for => self%operators, sliders => self%sliders, x => self%paths%x, &
                 u => self%paths%layer(0), v => self%paths%layer(1), &
                 regime => self%paths%regime)
         if (self%keeps_ledger) call for%ledger%start_part(g, n, force, now, pushed, &
                                                           self%rates(:, :, :, g))
         if (for%blocks%ports == 1) then
            call rotate_modes(n, for%first_read(4), for%rotation, for%load, force, pushed, now, &
                              self%middle)
         else
            call rotate_pairs(n, for%first_read, for%rotation, for%load, force, pushed, now, &
                              self%middle)
         end if
         do i = 1, 4
            associate (first => for%n_rows - size(for%reads(i)%value, 2) + 1)
               if (first > for%n_rows) cycle
               if (i <= 2) call for%reads(i)%multiply(now(:, :, min(i, size(now, 3))), &
                                                      self%value(:, :, i))
               if (i > 2) call for%reads(i)%multiply(self%middle(:, first:, i - 2), &
                                                     self%value(:, :, i))
            end associate
         end do
         has_slope = for%first_read(4) <= for%n_modes
         call put_free_paths(self%m_padded, rows, has_slope, self%value, x(first, 1, u), &
                             x(first, 1, v), x(first, 1, 2))
         call sliders%follow(g, regime(first, 1, layer_side), regime(first, 1, layer_spring))
         call sliders%mask(g, 1, x(first, 1, v))
         call sliders%mask(g, 2, x(first, 1, 2))
         do k = 3, path_degree
            associate (least => for%first_power(k))
               if (least <= k - 2) &
                  call for%answer(k)%multiply_some( &
                  sliders%moved(:sliders%n_moved(g), g), k - 1 - least, k < 5 .or. &
                  (has_slope .and. k == 5), sliders%motion(:, :, least:, g), groups, &
                  x(first, 1, k))
            end associate
            if (k <= 4) call sliders%mask(g, k, x(first, 1, k))
         end do
         call sliders%integrate_motion(g, rows, x(first, 1, v), x(first, 1, 2))
      end associate
   end subroutine run_group

   !> See base_system.
   subroutine redo(self, begin, state, error)
      class(modal_form), intent(inout) :: self
      real(wp), intent(in) :: begin
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: first
      integer :: lane

      if (.not. allocated(self%lane%slack)) call self%lane%start(self%operators%n_joints, &
                                                                 self%operators%n_moments)
      do lane = 1, width
         if (.not. self%paths%is_involved(lane)) cycle
         call march_again(self%lane)
         if (allocated(error)) return
      end do

   contains

      !> Marches one sample through the part.
      subroutine march_again(paths)
         type(lane_paths), intent(inout) :: paths
         integer :: round

         call paths%begin(self%paths%slack(lane, :self%operators%n_joints), &
                          self%sliders%moves(lane - lanes*(group_of(lane) - 1), &
                                             :self%operators%n_joints, group_of(lane)))
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
      end subroutine march_again

      !> Adopts the joints whose guards may have a zero.
      subroutine adopt_suspects(paths)
         type(lane_paths), intent(inout) :: paths
         integer :: j, k

         if (minval(paths%slack) > 0.0_wp) return
         do j = 1, self%operators%n_joints
            if (paths%slack(j) > 0.0_wp) cycle
            associate (regime => self%paths%regime(lane, j, :), layer => self%paths%layer, &
                       x => self%paths%x(lane, j, :))
               call paths%adopt(j, [(x(layer(k) + 1), k=0, path_degree)], regime(layer_side), &
                                regime(layer_slider), regime(layer_reach))
            end associate
         end do
      end subroutine adopt_suspects

      !> Switches all suspects that cross now, in their order.
      subroutine switch_suspects(paths)
         type(lane_paths), intent(inout) :: paths
         real(wp), parameter :: same_instant = 1.0e-12_wp   ! rounding of sliders over velocity
         integer :: e, i

         do e = 1, paths%n_suspects
            if (paths%crossing(e) > first + same_instant) cycle
            i = paths%suspect(e)
            call switch_joint(self, lane, i, begin + 1.0_wp - paths%left, paths%path(0, e), &
                              paths%path(1, e), state)
            call self%sliders%switch(group_of(lane), i)
            call paths%switch_slider(self%operators, e)
         end do
      end subroutine switch_suspects

      !> Adds to the ends of paths and to the sliders' integrals.
      subroutine put_changes(paths)
         type(lane_paths), intent(inout) :: paths
         integer :: e, g, i, j

         call paths%end_changes()
         associate (place => self%paths%x(lane, :, self%paths%finish(0)), &
                    velocity => self%paths%x(lane, :, self%paths%finish(1)))
            do j = 1, self%operators%n_joints
               place(j) = place(j) + paths%place(j)
               velocity(j) = velocity(j) + paths%velocity(j)
            end do
         end associate
         g = group_of(lane)
         e = lane - lanes*(g - 1)
         do i = 1, self%sliders%n_moved(g)
            j = self%sliders%moved(i, g)
            associate (moments => self%sliders%moments(e, j, :, g))
               moments = moments + paths%moments(j, :)
            end associate
         end do
      end subroutine put_changes

   end subroutine redo

   !> Makes the ends the starts.
   subroutine go_on(self)
      class(modal_form), intent(inout) :: self
      integer :: g

      if (.not. self%keeps_ledger) then
         do g = 1, self%n_groups
            call take_sliders(self, g)
         end do
      end if
      call self%paths%exchange_ends()
   end subroutine go_on

   !> Takes the modes of a group to the end of the part, with the motion of the sliders (M6).
   subroutine take_sliders(self, g)
      class(modal_form), intent(inout) :: self
      integer, intent(in) :: g
      integer :: k

      associate (for => self%operators, moments => self%sliders%moments(:, :, :, g), &
                 moved => self%sliders%moved(:self%sliders%n_moved(g), g))
         do k = 0, for%n_moments
            call for%push%multiply_some(moved, 1, .false., moments(:, :, k + 1), 1, &
                                        self%taken(:, :, k))
         end do
         call take_motion(self%n_padded, for%n_modes, for%blocks%ports, for%n_moments, for%weight, &
                          self%taken, self%now(:, :, :, g), self%pushed(:, :, g))
      end associate
   end subroutine take_sliders

   !> See base_system.
   subroutine put_state(self, displacement, velocity)
      class(modal_form), intent(in) :: self
      real(wp), intent(out) :: displacement(:, :)
      real(wp), intent(out) :: velocity(:, :)
      real(wp) :: x(lanes, padded_rows(self%operators%n_modes))
      integer :: g

      do g = 1, self%n_groups
         associate (first => lanes*(g - 1) + 1, n => self%operators%n_modes)
            call self%operators%shape(1)%multiply(self%now(:, :, 1, g), x)
            displacement(first:first + lanes - 1, :) = x(:, :n)
            if (size(velocity) == 0) cycle
            call self%operators%shape(2)%multiply(self%now(:, :, size(self%now, 3), g), x)
            velocity(first:first + lanes - 1, :) = x(:, :n)/self%h
         end associate
      end do
   end subroutine put_state

   !> See base_system. The modes go on here.
   subroutine add_works(self)
      class(modal_form), intent(inout) :: self
      real(wp) :: of_group(lanes, 2)
      integer :: g

      associate (for => self%operators)
         do g = 1, self%n_groups
            call take_sliders(self, g)
            of_group = 0.0_wp
            call for%ledger%add_part(g, self%n_padded, self%now(:, :, :, g), self%taken, &
                                     self%rates(:, :, :, g), of_group)
            associate (works => self%works(lanes*(g - 1) + 1:lanes*g, :))
               works = works + of_group
            end associate
         end do
      end associate
   end subroutine add_works

end module dynamics_exact_modal_form
