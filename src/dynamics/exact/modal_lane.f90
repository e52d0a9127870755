!> Transitions of one sample within a part of a step, in the modal form.
!>
!> A joint that changes its regime moves its slider otherwise than before: by what it slips from
!> then on, or back by what it would have slipped. That motion changes the paths of all joints (M5)
!> and, with them, the motion of the sliders of all that slip. The modes get its integrals (M6).
!> Several transitions are made one after another, in the paths of all joints. Where one is alone,
!> all that it changes at the end follows from integrals of that motion, as H is a polynomial (M10).
module dynamics_exact_modal_lane
   use core_kinds, only: wp
   use dynamics_alignment, only: lanes => register_width, whole_registers
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_joint_paths, only: joint_paths, layer_reach, layer_side, layer_slider
   use dynamics_exact_modal_operators, only: modal_operators
   use dynamics_exact_modal_terms, only: n_markov, path_degree
   use dynamics_exact_transitions, only: fall, last_integral
   use dynamics_joint, only: slip_direction, slider_at
   implicit none(type, external)
   private
   public :: find_answers, lane_paths

   !> k!/(k + s)!, s first
   real(wp), parameter :: share_of(0:last_integral, path_degree) = transpose(fall(:path_degree, :))

   !> Joints of one sample, padded to whole registers; time runs from the last transition, in parts.
   type :: lane_paths
      real(wp) :: left = 1.0_wp                  !! of the part
      real(wp), allocatable :: path(:, :)        !! (joint, power from 0)
      real(wp), allocatable :: side(:)           !! (joint) direction of slip, 0 stuck
      real(wp), allocatable :: slider(:)         !! (joint) z of a stuck joint [m]
      real(wp), allocatable :: reach(:)          !! (joint) mu N/k [m]
      real(wp), allocatable :: follows(:)        !! (joint) 1 where the slider moves with the joint
      real(wp), allocatable :: crossing(:)       !! (joint) time of its next transition
      real(wp), allocatable :: moments(:, :)     !! (joint, 0:moment) added to sliders' integrals
      real(wp), allocatable :: ends(:, :)        !! (joint, 0:1) path and velocity at the end
      !> (joint, power from 1) room for what moves otherwise; (joint) a bound; one power of answers
      real(wp), allocatable, private :: motion(:, :), guard(:), answer(:)
   contains
      procedure :: take
      procedure :: find_next
      procedure :: move_on
      procedure :: switch_slider
   end type lane_paths

contains

   !> Takes the joints of a lane at the start of a part.
   pure subroutine take(self, paths, lane, follows, n_moments)
      class(lane_paths), intent(inout) :: self
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: lane, n_moments
      real(wp), intent(in) :: follows(:)   !! (joint)
      integer :: k, m

      m = whole_registers(paths%n_joints)
      if (.not. allocated(self%path)) then
         allocate (self%path(m, 0:path_degree), self%motion(m, path_degree), &
                   self%moments(m, 0:n_moments), self%ends(m, 0:1), self%side(m), self%slider(m), &
                   self%reach(m), self%follows(m), self%guard(m), self%answer(m), source=0.0_wp)
         allocate (self%crossing(paths%n_joints))
      end if
      m = paths%n_joints
      self%left = 1.0_wp
      do k = 0, path_degree
         self%path(:m, k) = paths%x(lane, :m, paths%layer(k))
      end do
      self%slider(:m) = paths%regime(lane, :m, layer_slider)
      self%reach(:m) = paths%regime(lane, :m, layer_reach)
      self%side(:m) = paths%regime(lane, :m, layer_side)
      self%follows(:m) = follows(:m)
      self%moments = 0.0_wp
   end subroutine take

   !> Finds the next transitions in what is left of the part, of joints whose guards may have a zero
   !> there by (3), and the time of the first; else the ends of all paths.
   pure subroutine find_next(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(out) :: span   !! [parts]; no_crossing: there is none
      integer :: j

      call bound_guards(size(self%guard), self%left, self%path, self%side, self%slider, &
                        self%reach, self%ends, self%guard)
      self%crossing = no_crossing
      do j = 1, size(self%crossing)
         if (self%guard(j) <= 0.0_wp) &
            self%crossing(j) = first_transition(self%path(j, :), self%side(j), self%slider(j), &
                                                self%reach(j), self%left)
      end do
      span = minval(self%crossing)
   end subroutine find_next

   !> Finds the ends of paths and lower bounds of the guards over what is left of the part (3).
   pure subroutine bound_guards(n, t, c, side, slider, reach, ends, guard)
      integer, intent(in) :: n
      real(wp), intent(in) :: t, c(n, 0:path_degree)
      real(wp), intent(in), dimension(n) :: side, slider, reach
      real(wp), intent(inout) :: ends(n, 0:1), guard(n)
      real(wp) :: bend, turn
      integer :: j

      !$omp simd private(bend, turn)
      do j = 1, n
         ends(j, 0) = c(j, 0) + t*(c(j, 1) + t*(c(j, 2) + t*(c(j, 3) + t*(c(j, 4) + t*(c(j, 5) &
                                                                            + t*c(j, 6))))))
         ends(j, 1) = c(j, 1) + t*(2.0_wp*c(j, 2) + t*(3.0_wp*c(j, 3) + t*(4.0_wp*c(j, 4) &
                                                         + t*(5.0_wp*c(j, 5) + t*6.0_wp*c(j, 6)))))
         turn = t**2*(0.75_wp*abs(c(j, 3)) + t*(3.0_wp*abs(c(j, 4)) + t*(7.5_wp*abs(c(j, 5)) &
                                                                     + t*15.0_wp*abs(c(j, 6)))))
         bend = t*(turn + 0.25_wp*t*abs(c(j, 2)))
         guard(j) = merge(min(side(j)*c(j, 1), side(j)*ends(j, 1)) - turn, &
                          reach(j) - max(abs(c(j, 0) - slider(j)), abs(ends(j, 0) - slider(j))) &
                          - bend, abs(side(j)) > 0.0_wp)
      end do
   end subroutine bound_guards

   !> Moves the origin of time on.
   pure subroutine move_on(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: span
      integer :: k, m

      do m = 0, path_degree - 1
         do k = path_degree - 1, m, -1
            self%path(:, k) = self%path(:, k) + span*self%path(:, k + 1)
         end do
      end do
      self%left = self%left - span
   end subroutine move_on

   !> Changes a joint's regime now: its slider begins to move with it, or stops.
   pure subroutine switch_slider(self, operators, joint)
      class(lane_paths), intent(inout) :: self
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: joint
      real(wp) :: power
      integer :: e, j, k, s

      self%motion = 0.0_wp
      if (abs(self%side(joint)) > 0.0_wp) then
         self%path(joint, 1) = 0.0_wp
         self%slider(joint) = slider_at(self%path(joint, 0), nint(self%side(joint)), &
                                        self%reach(joint))
         self%motion(joint, :) = -self%path(joint, 1:)
         self%side(joint) = 0.0_wp
      else
         self%motion(joint, :) = self%path(joint, 1:)
         self%side(joint) = slip_direction(self%path(joint, 1))
      end if
      self%follows(joint) = abs(self%side(joint))
      do k = 3, path_degree
         self%answer = 0.0_wp
         do e = max(operators%first_power(k), k - 1 - n_markov), k - 2
            do j = 1, size(self%crossing)
               if (.not. abs(self%motion(j, e)) > 0.0_wp) cycle
               self%answer = self%answer + (self%motion(j, e)*fall(e, k - e)) &
                                           *operators%markov(:, j, k - 2 - e)
            end do
         end do
         self%motion(:, k) = self%motion(:, k) + self%follows*self%answer
         self%path(:, k) = self%path(:, k) + self%answer
      end do
      do s = 0, ubound(self%moments, 2)   ! I_s of t^k is k!/(k + s)! t^(k + s)
         power = self%left**s
         do k = 1, path_degree
            power = power*self%left
            self%moments(:, s) = self%moments(:, s) + (fall(k, s)*power)*self%motion(:, k)
         end do
      end do
   end subroutine switch_slider

   !> Finds the answers to a transition of the first joint. The sliders of the others follow them.
   pure subroutine find_answers(markov, joints, path, starts, left, moments, ends)
      real(wp), intent(in), contiguous :: markov(:, :, 0:)   !! see modal_operators
      integer, intent(in) :: joints(:)
      real(wp), intent(in) :: path(path_degree)   !! of the first joint, from the transition on
      logical, intent(in) :: starts            !! its slip; else it ends
      real(wp), intent(in) :: left             !! of the part
      real(wp), intent(out) :: moments(0:last_integral, size(joints))   !! added to I_s (s, joint)
      real(wp), intent(out) :: ends(size(markov, 1), 0:1)   !! added to paths, velocities at the end
      real(wp) :: part(0:last_integral + n_markov + 1, size(joints), 0:2)   ! moments by order
      real(wp), dimension(0:last_integral) :: power, total
      real(wp) :: place(lanes), share, velocity(lanes)
      integer :: c, d, f, first, k, l, many, order, s

      many = size(joints)
      part = 0.0_wp
      power(0) = 1.0_wp
      do s = 1, last_integral
         power(s) = power(s - 1)*left
      end do
      share = merge(1.0_wp, -1.0_wp, starts)
      total = 0.0_wp
      do k = 1, path_degree
         share = share*left
         do s = 0, last_integral
            total(s) = total(s) + share*path(k)*share_of(s, k)
         end do
      end do
      part(:last_integral, 1, 0) = power*total
      do order = 1, 2   ! sliders that follow answer to it, and by Y_0 to each other
         do f = merge(1, 2, starts), many
            total = 0.0_wp
            do c = 1, merge(1, many, order == 1)
               do d = 0, merge(n_markov - 1, 0, order == 1)
                  do s = 0, last_integral
                     total(s) = total(s) &
                                + markov(joints(f), joints(c), d)*part(s + d + 2, c, order - 1)
                  end do
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
               do l = 1, lanes
                  place(l) = place(l) + moments(d + 2, c)*markov(first + l, joints(c), d)
                  velocity(l) = velocity(l) + moments(d + 1, c)*markov(first + l, joints(c), d)
               end do
            end do
         end do
         ends(first + 1:first + lanes, 0) = place
         ends(first + 1:first + lanes, 1) = velocity
      end do
   end subroutine find_answers

end module dynamics_exact_modal_lane
