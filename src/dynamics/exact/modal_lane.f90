!> Transitions of one sample within a part of a step, in the modal form: paths of all its joints,
!> one transition after another, and the integrals of its sliders' motion that the modes need.
!>
!> A joint that changes its regime moves its slider otherwise than before: by what it slips from
!> then on, or back by what it would have slipped. That motion changes the paths of all joints (M5)
!> and, with them, the motion of the sliders of all that slip.
module dynamics_exact_modal_lane
   use core_kinds, only: wp
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_modal_operators, only: modal_operators
   use dynamics_exact_modal_terms, only: n_markov, path_degree
   implicit none(type, external)
   private
   public :: lane_paths

   !> 0! .. 10!
   real(wp), parameter :: factorial(0:10) = [1.0_wp, 1.0_wp, 2.0_wp, 6.0_wp, 24.0_wp, 120.0_wp, &
                                             720.0_wp, 5040.0_wp, 40320.0_wp, 362880.0_wp, &
                                             3628800.0_wp]

   !> Joints of one sample; time runs from the last transition, in parts.
   type :: lane_paths
      real(wp), allocatable :: path(:, :)      !! (joint, power from 0)
      real(wp), allocatable :: side(:)         !! (joint) direction of slip, 0 stuck
      real(wp), allocatable :: slider(:)       !! (joint) z of a stuck joint [m]
      real(wp), allocatable :: reach(:)        !! (joint) mu N/k [m]
      real(wp), allocatable :: follows(:)      !! (joint) 1 where the slider moves with the joint
      real(wp), allocatable :: moments(:, :)   !! (joint, 0:moments): slider's motion, its integrals
      real(wp), allocatable :: crossing(:)     !! (joint) time of its next transition
      real(wp) :: left = 1.0_wp                !! of the part
   contains
      procedure :: start
      procedure :: find_crossings
      procedure :: move_on
      procedure :: switch_slider
      procedure, private :: add_moments
   end type lane_paths

contains

   !> Gets memory.
   subroutine start(self, n_joints, n_moments)
      class(lane_paths), intent(inout) :: self
      integer, intent(in) :: n_joints, n_moments

      allocate (self%path(n_joints, 0:path_degree), self%moments(n_joints, 0:n_moments))
      allocate (self%side(n_joints), self%slider(n_joints), self%reach(n_joints), &
                self%follows(n_joints), self%crossing(n_joints))
   end subroutine start

   !> Next transition of each joint in what is left of the part. Guards that cannot reach zero, by
   !> the bounds (3), are not looked at.
   subroutine find_crossings(self)
      class(lane_paths), intent(inout) :: self
      real(wp) :: bend, finish, least(size(self%side)), rest, speed, turn, weight(path_degree, 4)
      real(wp) :: path(0:path_degree), power
      real(wp), parameter :: margin = 1.0e-6_wp   !! as (5)
      integer :: j, k

      power = 1.0_wp
      do k = 1, path_degree
         weight(k, 1) = power*self%left
         weight(k, 2) = k*power
         weight(k, 3) = 0.125_wp*k*(k - 1)*weight(k, 1)
         weight(k, 4) = 0.125_wp*k*(k - 1)*(k - 2)*power
         power = power*self%left
      end do
      do j = 1, size(self%side)
         finish = self%path(j, 0)
         speed = 0.0_wp
         bend = 0.0_wp
         turn = 0.0_wp
         do k = 1, path_degree
            finish = finish + weight(k, 1)*self%path(j, k)
            speed = speed + weight(k, 2)*self%path(j, k)
            bend = bend + weight(k, 3)*abs(self%path(j, k))
            turn = turn + weight(k, 4)*abs(self%path(j, k))
         end do
         rest = max(abs(self%path(j, 0) - self%slider(j)), abs(finish - self%slider(j)))
         bend = self%reach(j)*(1.0_wp - margin) - bend - rest
         turn = min(self%side(j)*self%path(j, 1), self%side(j)*speed) - turn - margin*self%reach(j)
         least(j) = merge(turn, bend, abs(self%side(j)) > 0.0_wp)
      end do
      do j = 1, size(self%side)
         self%crossing(j) = no_crossing
         if (least(j) > 0.0_wp) cycle
         path = self%path(j, :)
         self%crossing(j) = first_transition(path, self%side(j), self%slider(j), self%reach(j), &
                                             self%left)
      end do
   end subroutine find_crossings

   !> Moves the origin of time on.
   subroutine move_on(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: span
      integer :: k, m

      if (span > 0.0_wp) then
         do m = 0, path_degree - 1
            do k = path_degree - 1, m, -1
               self%path(:, k) = self%path(:, k) + span*self%path(:, k + 1)
            end do
         end do
      end if
      self%left = self%left - span
   end subroutine move_on

   !> Joint i changes its regime now: its slider begins to move with it (towards `way`), or stops.
   subroutine switch_slider(self, operators, i, way)
      class(lane_paths), intent(inout) :: self
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: i
      real(wp), intent(in) :: way   !! +1 or -1
      real(wp) :: motion(size(self%side), path_degree)   ! what moves otherwise than before
      real(wp) :: share
      integer :: d, e, j, k, u

      motion = 0.0_wp
      if (abs(self%side(i)) > 0.0_wp) then
         self%path(i, 1) = 0.0_wp
         self%slider(i) = self%path(i, 0) - way*self%reach(i)
         motion(i, :) = -self%path(i, 1:)
         self%side(i) = 0.0_wp
         self%follows(i) = 0.0_wp
      else
         motion(i, :) = self%path(i, 1:)
         self%side(i) = way
         self%follows(i) = 1.0_wp
      end if
      do k = 3, path_degree
         do e = max(operators%first_power(k), k - 1 - n_markov), k - 2
            d = k - 2 - e
            do j = 1, size(self%side)
               if (e < 3 .and. j /= i) cycle   ! the others answer from power 3 on
               if (.not. abs(motion(j, e)) > 0.0_wp) cycle
               share = motion(j, e)*(factorial(e)/factorial(k))
               do u = 1, size(self%side)
                  self%path(u, k) = self%path(u, k) + operators%markov(u, j, d)*share
                  motion(u, k) = motion(u, k) + self%follows(u)*(operators%markov(u, j, d)*share)
               end do
            end do
         end do
      end do
      call self%add_moments(motion)
   end subroutine switch_slider

   !> Adds a motion of the sliders from now on to their integrals at the end of the part: I_s of t^k
   !> is k!/(k + s)! t^(k + s).
   subroutine add_moments(self, motion)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in), contiguous :: motion(:, :)   !! (joint, power from 1)
      real(wp) :: power(path_degree), share(path_degree)
      integer :: j, k, s

      power(1) = self%left
      do k = 2, path_degree
         power(k) = power(k - 1)*self%left
      end do
      do s = 0, ubound(self%moments, 2)
         do k = 1, path_degree
            share(k) = power(k)*(factorial(k)/factorial(k + s))
         end do
         power = power*self%left
         do j = 1, size(motion, 1)
            self%moments(j, s) = self%moments(j, s) &
                                 + (((motion(j, 1)*share(1) + motion(j, 2)*share(2)) &
                                     + (motion(j, 3)*share(3) + motion(j, 4)*share(4))) &
                                    + (motion(j, 5)*share(5) + motion(j, 6)*share(6)))
         end do
      end do
   end subroutine add_moments

end module dynamics_exact_modal_lane
