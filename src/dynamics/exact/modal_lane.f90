!> Transitions of one sample within a part of a step, in the modal form.
!>
!> A transition changes the motion of the joint's slider: its slip is added if it starts, and
!> subtracted if it ends. The paths of all joints respond to that change (M5), and with them the
!> sliders of those that slip. Its integrals are added to the modes (M6). Several transitions are
!> made one after another in the paths of all joints (lane_paths). If a sample has one plain
!> transition, all that it changes at the end follows from integrals of the slider's motion (M10:
!> find_end_responses).
module dynamics_exact_modal_lane
   use core_alignment, only: lanes => register_width, whole_registers
   use core_kinds, only: wp
   use dynamics_exact_guard_zeros, only: first_transition, no_zero
   use dynamics_exact_joint_paths, only: joint_paths, regime_reach, regime_side, regime_slider
   use dynamics_exact_modal_operators, only: modal_operators
   use dynamics_exact_modal_terms, only: n_markov, path_degree
   use dynamics_exact_transitions, only: integral, last_integral
   implicit none(type, external)
   private
   public :: find_end_responses, lane_paths

   !> integral(k, s) with s as its first index
   real(wp), parameter :: integral_of(0:last_integral, path_degree) = &
                          transpose(integral(:path_degree, :))

   !> Joints of one sample, padded to whole registers. Powers are in the time since the last
   !> transition [parts].
   type :: lane_paths
      real(wp) :: time_left = 1.0_wp             !! time from the last transition to the end [parts]
      real(wp), allocatable :: path(:, :)        !! (joint, power from 0)
      real(wp), allocatable :: side(:)           !! (joint) direction of slip, 0 stuck
      real(wp), allocatable :: slider(:)         !! (joint) z of a stuck joint [m]
      real(wp), allocatable :: reach(:)          !! (joint) mu N/k [m]
      real(wp), allocatable :: follows(:)        !! (joint) 1 if the slider moves with the joint
      real(wp), allocatable :: next_zero(:)      !! (joint) time of its next transition, or no_zero
      real(wp), allocatable :: moments(:, :)     !! (joint, 0:moment) added to I_s of the sliders
      real(wp), allocatable :: ends(:, :)        !! (joint, 0:1) path and velocity at the end
      !> Buffers: (joint, power from 1) change of sliders' motion; (joint) bound of the guard; one
      !> power of the responses
      real(wp), allocatable, private :: motion(:, :), guard(:), response(:)
   contains
      procedure :: load
      procedure :: find_next
      procedure :: move_on
      procedure :: switch_slider
   end type lane_paths

contains

   !> Copies the joints of a lane at the start of a part.
   pure subroutine load(self, paths, lane, follows, n_moments)
      class(lane_paths), intent(inout) :: self
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: lane, n_moments
      real(wp), intent(in) :: follows(:)   !! (joint)
      integer :: k, m

      m = whole_registers(paths%n_joints)
      if (.not. allocated(self%path)) then
         allocate (self%path(m, 0:path_degree), self%motion(m, path_degree), &
                   self%moments(m, 0:n_moments), self%ends(m, 0:1), self%side(m), self%slider(m), &
                   self%reach(m), self%follows(m), self%guard(m), self%response(m), source=0.0_wp)
         allocate (self%next_zero(paths%n_joints))
      end if
      m = paths%n_joints
      self%time_left = 1.0_wp
      do k = 0, path_degree
         self%path(:m, k) = paths%x(lane, :m, paths%layer(k))
      end do
      self%slider(:m) = paths%regime(lane, :m, regime_slider)
      self%reach(:m) = paths%regime(lane, :m, regime_reach)
      self%side(:m) = paths%regime(lane, :m, regime_side)
      self%follows(:m) = follows(:m)
      self%moments = 0.0_wp
   end subroutine load

   !> Finds the next transition of each joint whose guard may have a zero in the rest of the part
   !> (3), and the time of the first. If there is none, `ends` has the ends of all paths.
   pure subroutine find_next(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(out) :: span   !! [parts]; no_zero if there is none
      integer :: j

      call bound_guards(size(self%guard), self%time_left, self%path, self%side, self%slider, &
                        self%reach, self%ends, self%guard)
      self%next_zero = no_zero
      do j = 1, size(self%next_zero)
         if (self%guard(j) <= 0.0_wp) &
            self%next_zero(j) = first_transition(self%path(j, :), self%side(j), self%slider(j), &
                                                 self%reach(j), self%time_left)
      end do
      span = minval(self%next_zero)
   end subroutine find_next

   !> Finds the ends of all paths, and lower bounds of the guards over the rest of the part (3).
   pure subroutine bound_guards(n, t, c, side, slider, reach, ends, guard)
      integer, intent(in) :: n
      real(wp), intent(in) :: t, c(n, 0:path_degree)
      real(wp), intent(in), dimension(n) :: side, slider, reach
      real(wp), intent(inout) :: ends(n, 0:1), guard(n)
      real(wp) :: bend, rest, turn
      integer :: j

      !$omp simd private(bend, rest, turn)
      do j = 1, n
         rest = c(j, 3) + t*(c(j, 4) + t*(c(j, 5) + t*c(j, 6)))
         ends(j, 0) = c(j, 0) + t*(c(j, 1) + t*(c(j, 2) + t*rest))
         rest = 3.0_wp*c(j, 3) + t*(4.0_wp*c(j, 4) + t*(5.0_wp*c(j, 5) + t*6.0_wp*c(j, 6)))
         ends(j, 1) = c(j, 1) + t*(2.0_wp*c(j, 2) + t*rest)
         turn = t**2*(0.75_wp*abs(c(j, 3)) &
                      + t*(3.0_wp*abs(c(j, 4)) + t*(7.5_wp*abs(c(j, 5)) + t*15.0_wp*abs(c(j, 6)))))
         bend = t*(turn + 0.25_wp*t*abs(c(j, 2)))
         guard(j) = merge(min(side(j)*c(j, 1), side(j)*ends(j, 1)) - turn, &
                          reach(j) - max(abs(c(j, 0) - slider(j)), abs(ends(j, 0) - slider(j))) &
                          - bend, abs(side(j)) > 0.0_wp)
      end do
   end subroutine bound_guards

   !> Expands all paths about a later time.
   pure subroutine move_on(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: span
      integer :: k, m

      do m = 0, path_degree - 1
         do k = path_degree - 1, m, -1
            self%path(:, k) = self%path(:, k) + span*self%path(:, k + 1)
         end do
      end do
      self%time_left = self%time_left - span
   end subroutine move_on

   !> Adds the response to the switch of a joint, whose slider begins to move with it, or stops.
   pure subroutine switch_slider(self, operators, joint, regime)
      class(lane_paths), intent(inout) :: self
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: joint
      real(wp), intent(in) :: regime(:)   !! regime after the switch, see joint_paths
      real(wp) :: power
      integer :: e, j, k, s

      if (abs(self%side(joint)) > 0.0_wp) self%path(joint, 1) = 0.0_wp
      self%side(joint) = regime(regime_side)
      self%slider(joint) = regime(regime_slider)
      self%follows(joint) = abs(self%side(joint))
      self%motion = 0.0_wp
      self%motion(joint, :) = merge(1.0_wp, -1.0_wp, self%follows(joint) > 0.0_wp) &
                              *self%path(joint, 1:)
      do k = 3, path_degree
         self%response = 0.0_wp
         do e = max(operators%first_power(k), k - 1 - n_markov), k - 2
            do j = 1, size(self%next_zero)
               if (.not. abs(self%motion(j, e)) > 0.0_wp) cycle
               self%response = self%response + (self%motion(j, e)*integral(e, k - e)) &
                               *operators%markov(:, j, k - 2 - e)
            end do
         end do
         self%motion(:, k) = self%motion(:, k) + self%follows*self%response
         self%path(:, k) = self%path(:, k) + self%response
      end do
      do s = 0, ubound(self%moments, 2)   ! I_s of t^k
         power = self%time_left**s
         do k = 1, path_degree
            power = power*self%time_left
            self%moments(:, s) = self%moments(:, s) + (integral(k, s)*power)*self%motion(:, k)
         end do
      end do
   end subroutine switch_slider

   !> Finds what a transition of the first joint adds at the end of the part (M10). The sliders of
   !> the other listed joints follow their joints.
   pure subroutine find_end_responses(markov, joints, path, starts, time_left, moments, ends)
      real(wp), intent(in), contiguous :: markov(:, :, 0:)   !! see modal_operators
      integer, intent(in) :: joints(:)
      real(wp), intent(in) :: path(path_degree)   !! path of the first joint from the transition on
      logical, intent(in) :: starts               !! True if its slip starts, False if it ends
      real(wp), intent(in) :: time_left           !! time from the transition to the end [parts]
      real(wp), intent(out) :: moments(0:last_integral, size(joints))   !! added to I_s (s, joint)
      real(wp), intent(out) :: ends(size(markov, 1), 0:1)   !! added to paths and velocities
      real(wp) :: part(0:last_integral + n_markov + 1, size(joints), 0:2)   ! moments, by order
      real(wp), dimension(0:last_integral) :: power, total
      real(wp) :: place(lanes), share, velocity(lanes)
      integer :: c, d, f, first, k, many, order, s

      many = size(joints)
      part = 0.0_wp
      power(0) = 1.0_wp
      do s = 1, last_integral
         power(s) = power(s - 1)*time_left
      end do
      share = merge(1.0_wp, -1.0_wp, starts)
      total = 0.0_wp
      do k = 1, path_degree
         share = share*time_left
         total = total + share*path(k)*integral_of(:, k)
      end do
      part(:last_integral, 1, 0) = power*total
      do order = 1, 2   ! responses of the sliders that follow: to the first; by Y_0 to each other
         do f = merge(1, 2, starts), many
            total = 0.0_wp
            do c = 1, merge(1, many, order == 1)
               do d = 0, merge(n_markov - 1, 0, order == 1)
                  total = total + markov(joints(f), joints(c), d) &
                          *part(d + 2:d + 2 + last_integral, c, order - 1)
               end do
            end do
            part(:last_integral, f, order) = total
         end do
      end do
      moments = part(:last_integral, :, 0) + (part(:last_integral, :, 1) &
                                              + part(:last_integral, :, 2))
      ! the integral of H(1 - s) zeta(s) is Y_0 I_2 + Y_1 I_3 + Y_2 I_4, that of H' likewise
      do first = 0, size(ends, 1) - lanes, lanes
         place = 0.0_wp
         velocity = 0.0_wp
         do c = 1, many
            do d = 0, n_markov - 1
               associate (response => markov(first + 1:first + lanes, joints(c), d))
                  place = place + moments(d + 2, c)*response
                  velocity = velocity + moments(d + 1, c)*response
               end associate
            end do
         end do
         ends(first + 1:first + lanes, 0) = place
         ends(first + 1:first + lanes, 1) = velocity
      end do
   end subroutine find_end_responses

end module dynamics_exact_modal_lane
