!> Transitions of one sample within a part of a step, in the modal form: one after another, what
!> they change in the paths of its joints, and the integrals of its sliders' motion that the modes
!> need.
!>
!> A joint that changes its regime moves its slider otherwise than before: by what it slips from
!> then on, or back by what it would have slipped. That motion changes the paths of all joints (M5)
!> and, with them, the motion of the sliders of all that slip. Only suspects are followed; another
!> joint becomes one when the changes may exceed the slack of its guard (M10).
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
      integer :: n_suspects = 0
      integer, allocatable :: suspect(:)        !! (entry) joint
      real(wp), allocatable :: path(:, :)       !! (power from 0, entry)
      real(wp), allocatable :: side(:)          !! (entry) direction of slip, 0 stuck
      real(wp), allocatable :: slider(:)        !! (entry) z of a stuck joint [m]
      real(wp), allocatable :: reach(:)         !! (entry) mu N/k [m]
      real(wp), allocatable :: crossing(:)      !! (entry) time of its next transition
      real(wp), allocatable :: change(:, :)     !! (joint, power from 0) of paths by transitions
      real(wp), allocatable :: slack(:)         !! (joint) lower bound of its guard
      real(wp), allocatable :: follows(:)       !! (joint) 1 where the slider moves with the joint
      real(wp), allocatable :: moments(:, :)    !! (joint, 0:moments) added to sliders' integrals
      !> (joint, power from 1) room for what moves otherwise; (joint) for answers and their bound
      real(wp), allocatable, private :: motion(:, :), answer(:), bound(:)
      real(wp) :: left = 1.0_wp                 !! of the part
   contains
      procedure :: start
      procedure :: begin
      procedure :: adopt
      procedure :: find_crossings
      procedure :: move_on
      procedure :: switch_slider
      procedure :: end_changes
      procedure, private :: add_moments
   end type lane_paths

contains

   !> Gets memory.
   pure subroutine start(self, n_joints, n_moments)
      class(lane_paths), intent(inout) :: self
      integer, intent(in) :: n_joints, n_moments

      allocate (self%path(0:path_degree, n_joints), self%change(n_joints, 0:path_degree))
      allocate (self%moments(n_joints, 0:n_moments), self%motion(n_joints, path_degree))
      allocate (self%answer(n_joints), self%bound(n_joints))
      allocate (self%suspect(n_joints), self%side(n_joints), self%slider(n_joints), &
                self%reach(n_joints), self%crossing(n_joints), self%slack(n_joints), &
                self%follows(n_joints))
   end subroutine start

   !> Begins a part: no suspects, no changes.
   pure subroutine begin(self, slack, follows)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: slack(:), follows(:)   !! (joint)

      self%n_suspects = 0
      self%left = 1.0_wp
      self%change = 0.0_wp
      self%moments = 0.0_wp
      self%slack = slack
      self%follows = follows
   end subroutine begin

   !> Follows a joint from now on, whose path was given at the start of the part.
   pure subroutine adopt(self, joint, path, side, slider, reach)
      class(lane_paths), intent(inout) :: self
      integer, intent(in) :: joint
      real(wp), intent(in) :: path(0:path_degree)
      real(wp), intent(in) :: side, slider, reach

      self%n_suspects = self%n_suspects + 1
      associate (e => self%n_suspects)
         self%suspect(e) = joint
         self%side(e) = side
         self%slider(e) = slider
         self%reach(e) = reach
         self%path(:, e) = path
         call shift(self%path(:, e), 1.0_wp - self%left)
         self%path(:, e) = self%path(:, e) + self%change(joint, :)
      end associate
      self%slack(joint) = huge(1.0_wp)
   end subroutine adopt

   !> Finds the next transition of each suspect in what is left of the part.
   pure subroutine find_crossings(self)
      class(lane_paths), intent(inout) :: self
      integer :: e

      do e = 1, self%n_suspects
         self%crossing(e) = first_transition(self%path(:, e), self%side(e), self%slider(e), &
                                             self%reach(e), self%left)
      end do
   end subroutine find_crossings

   !> Moves the origin of time on.
   pure subroutine move_on(self, span)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: span
      integer :: e, k, m

      do e = 1, self%n_suspects
         call shift(self%path(:, e), span)
      end do
      if (self%left < 1.0_wp) then
         do m = 0, path_degree - 1
            do k = path_degree - 1, m, -1
               self%change(:, k) = self%change(:, k) + span*self%change(:, k + 1)
            end do
         end do
      end if
      self%left = self%left - span
   end subroutine move_on

   !> Expands a polynomial about a later time.
   pure subroutine shift(path, span)
      real(wp), intent(inout) :: path(0:path_degree)
      real(wp), intent(in) :: span
      integer :: k, m

      do m = 0, path_degree - 1
         do k = path_degree - 1, m, -1
            path(k) = path(k) + span*path(k + 1)
         end do
      end do
   end subroutine shift

   !> Changes a suspect's regime now: its slider begins to move with it (towards `way`), or stops.
   pure subroutine switch_slider(self, operators, entry, way)
      class(lane_paths), intent(inout) :: self
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: entry
      real(wp), intent(in) :: way   !! +1 or -1
      real(wp) :: power
      integer :: d, e, i, j, k, m, s

      m = size(self%slack)
      associate (motion => self%motion, answer => self%answer, bound => self%bound)
         motion = 0.0_wp
         i = self%suspect(entry)
         if (abs(self%side(entry)) > 0.0_wp) then
            self%path(1, entry) = 0.0_wp
            self%slider(entry) = self%path(0, entry) - way*self%reach(entry)
            motion(i, :) = -self%path(1:, entry)
            self%side(entry) = 0.0_wp
            self%follows(i) = 0.0_wp
         else
            motion(i, :) = self%path(1:, entry)
            self%side(entry) = way
            self%follows(i) = 1.0_wp
         end if
         bound = 0.0_wp
         power = self%left
         do k = 3, path_degree
            power = power*self%left
            if (operators%first_power(k) > k - 2) cycle
            answer = 0.0_wp
            do e = max(operators%first_power(k), k - 1 - n_markov), k - 2
               d = k - 2 - e
               do j = merge(i, 1, e < 3), merge(i, m, e < 3)   ! the others answer from power 3 on
                  if (abs(motion(j, e)) > 0.0_wp) &
                     call add_answer(m, operators%markov(1, j, d), &
                                     motion(j, e)*(factorial(e)/factorial(k)), answer)
               end do
            end do
            call take_answer(m, k*power, answer, self%follows, motion(1, k), self%change(1, k), &
                             bound)
            do s = 1, self%n_suspects
               self%path(k, s) = self%path(k, s) + answer(self%suspect(s))
            end do
         end do
         self%slack = self%slack - bound
         call self%add_moments(motion)
      end associate
   end subroutine switch_slider

   pure subroutine add_answer(m, markov, share, answer)
      integer, intent(in) :: m
      real(wp), intent(in) :: markov(m), share
      real(wp), intent(inout) :: answer(m)

      answer = answer + markov*share
   end subroutine add_answer

   !> Adds one power of the answers to the sliders that follow, the paths, and the bound of changes
   !> of velocities, and so of paths.
   pure subroutine take_answer(m, weight, answer, follows, motion, change, bound)
      integer, intent(in) :: m
      real(wp), intent(in) :: weight, answer(m), follows(m)
      real(wp), intent(inout), dimension(m) :: motion, change, bound

      motion = motion + follows*answer
      change = change + answer
      bound = bound + weight*abs(answer)
   end subroutine take_answer

   !> Changes of the path and of the velocity of a joint at the end of the part.
   pure subroutine end_changes(self, joint, place, velocity)
      class(lane_paths), intent(in) :: self
      integer, intent(in) :: joint
      real(wp), intent(out) :: place, velocity
      integer :: k

      place = self%change(joint, path_degree)
      velocity = 0.0_wp
      do k = path_degree - 1, 0, -1
         velocity = velocity*self%left + place
         place = place*self%left + self%change(joint, k)
      end do
   end subroutine end_changes

   !> Adds a motion of the sliders from now on to their integrals at the end of the part: I_s of t^k
   !> is k!/(k + s)! t^(k + s).
   pure subroutine add_moments(self, motion)
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
