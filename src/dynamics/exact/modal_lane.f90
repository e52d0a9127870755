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
   use dynamics_alignment, only: lanes => register_width, whole_registers
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_modal_operators, only: modal_operators
   use dynamics_exact_modal_terms, only: n_markov, path_degree
   use dynamics_exact_transitions, only: fall
   use dynamics_joint, only: slip_direction
   implicit none(type, external)
   private
   public :: lane_paths

   !> Joints of one sample, padded to whole registers; time runs from the last transition, in parts.
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
      !> (joint, power from 1) room for what moves otherwise; (joint) for answers and their bound;
      !> (entry) for columns of Y and their shares in one power of the answers
      real(wp), allocatable, private :: motion(:, :), answer(:), bound(:), share(:)
      integer, allocatable, private :: column(:)
      !> (joint) changes of the path and of the velocity at the end of the part
      real(wp), allocatable :: place(:), velocity(:)
      real(wp) :: left = 1.0_wp                 !! of the part
   contains
      procedure :: start
      procedure :: begin
      procedure :: adopt
      procedure :: find_crossings
      procedure :: move_on
      procedure :: switch_slider
      procedure :: end_changes
      procedure, private :: add_power
   end type lane_paths

contains

   !> Gets memory.
   pure subroutine start(self, n_joints, n_moments)
      class(lane_paths), intent(inout) :: self
      integer, intent(in) :: n_joints, n_moments
      integer :: m

      m = whole_registers(n_joints)
      allocate (self%path(0:path_degree, n_joints), self%change(m, 0:path_degree))
      allocate (self%moments(m, 0:n_moments), self%motion(m, path_degree))
      allocate (self%answer(m), self%bound(m), self%place(m), self%velocity(m))
      allocate (self%follows(m), source=0.0_wp)
      allocate (self%slack(m), source=huge(1.0_wp))
      allocate (self%share(2*n_joints + 2), self%column(2*n_joints + 2))
      allocate (self%suspect(n_joints), self%side(n_joints), self%slider(n_joints), &
                self%reach(n_joints), self%crossing(n_joints))
   end subroutine start

   !> Begins a part: no suspects, no changes.
   pure subroutine begin(self, slack, follows)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in) :: slack(:), follows(:)   !! (joint)

      self%n_suspects = 0
      self%left = 1.0_wp
      call clear(size(self%change), self%change)
      call clear(size(self%moments), self%moments)
      self%slack(:size(slack)) = slack
      self%follows(:size(follows)) = follows
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
         if (self%left < 1.0_wp) then
            call shift(self%path(:, e), 1.0_wp - self%left)
            self%path(:, e) = self%path(:, e) + self%change(joint, :)
         end if
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
      integer :: e

      do e = 1, self%n_suspects
         call shift(self%path(:, e), span)
      end do
      if (self%left < 1.0_wp) call shift_all(size(self%slack)/lanes, span, self%change)
      self%left = self%left - span
   end subroutine move_on

   !> Expands the changes of all joints about a later time.
   pure subroutine shift_all(blocks, span, change)
      integer, intent(in) :: blocks
      real(wp), intent(in) :: span
      real(wp), intent(inout) :: change(lanes, blocks, 0:path_degree)
      integer :: b, k, l, m

      do m = 0, path_degree - 1
         do k = path_degree - 1, m, -1
            do b = 1, blocks
               !$omp simd
               do l = 1, lanes
                  change(l, b, k) = change(l, b, k) + span*change(l, b, k + 1)
               end do
            end do
         end do
      end do
   end subroutine shift_all

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

   !> Changes a suspect's regime now: its slider begins to move with it, or stops.
   pure subroutine switch_slider(self, operators, entry)
      class(lane_paths), intent(inout) :: self
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: entry
      real(wp) :: power
      integer :: e, i, j, k, many, n, s

      n = size(self%suspect)
      associate (motion => self%motion, answer => self%answer, bound => self%bound)
         call clear(size(motion), motion)
         call clear(size(bound), bound)
         i = self%suspect(entry)
         if (abs(self%side(entry)) > 0.0_wp) then
            self%path(1, entry) = 0.0_wp
            self%slider(entry) = self%path(0, entry) - self%side(entry)*self%reach(entry)
            motion(i, :) = -self%path(1:, entry)
            self%side(entry) = 0.0_wp
            self%follows(i) = 0.0_wp
         else
            motion(i, :) = self%path(1:, entry)
            self%side(entry) = slip_direction(self%path(1, entry))
            self%follows(i) = 1.0_wp
         end if
         power = self%left
         do k = 3, path_degree
            power = power*self%left
            if (operators%first_power(k) > k - 2) cycle
            many = 0
            do e = max(operators%first_power(k), k - 1 - n_markov), k - 2
               do j = merge(i, 1, e < 3), merge(i, n, e < 3)   ! the others answer from power 3 on
                  self%column(many + 1) = n*(k - 2 - e) + j
                  self%share(many + 1) = motion(j, e)*fall(e, k - e)
                  many = many + merge(1, 0, abs(motion(j, e)) > 0.0_wp)
               end do
            end do
            call self%add_power(operators%markov, k, many, k*power)
            do s = 1, self%n_suspects
               self%path(k, s) = self%path(k, s) + answer(self%suspect(s))
            end do
         end do
         self%slack = self%slack - bound
         call add_moments(size(answer)/lanes, self%left, motion, ubound(self%moments, 2), &
                          self%moments)
      end associate
   end subroutine switch_slider

   pure subroutine clear(n, values)
      integer, intent(in) :: n
      real(wp), intent(inout) :: values(n)

      values = 0.0_wp
   end subroutine clear

   !> Finds power k of the answers, and adds it to the sliders that follow, the paths, and the bound
   !> of changes of velocities, and so of paths.
   pure subroutine add_power(self, markov, k, many, weight)
      class(lane_paths), intent(inout) :: self
      real(wp), intent(in), contiguous :: markov(:, :)   !! see modal_operators
      integer, intent(in) :: k, many                     !! columns that count
      real(wp), intent(in) :: weight
      real(wp) :: total(lanes)
      integer :: e, first, l

      do first = 0, size(self%answer) - lanes, lanes
         total = 0.0_wp
         do e = 1, many
            !$omp simd
            do l = 1, lanes
               total(l) = total(l) + self%share(e)*markov(first + l, self%column(e))
            end do
         end do
         !$omp simd
         do l = 1, lanes
            self%answer(first + l) = total(l)
            self%motion(first + l, k) = self%motion(first + l, k) + self%follows(first + l)*total(l)
            self%change(first + l, k) = self%change(first + l, k) + total(l)
            self%bound(first + l) = self%bound(first + l) + weight*abs(total(l))
         end do
      end do
   end subroutine add_power

   !> Finds the changes of all paths and velocities at the end of the part.
   pure subroutine end_changes(self)
      class(lane_paths), intent(inout) :: self

      call find_ends(size(self%slack), self%left, self%change, self%place, self%velocity)
   end subroutine end_changes

   pure subroutine find_ends(n, t, c, place, velocity)
      integer, intent(in) :: n
      real(wp), intent(in) :: t, c(n, 0:path_degree)
      real(wp), intent(inout), dimension(n) :: place, velocity
      integer :: l

      !$omp simd
      do l = 1, n
         place(l) = c(l, 0) + t*(c(l, 1) + t*(c(l, 2) + t*(c(l, 3) + t*(c(l, 4) + t*(c(l, 5) &
                                                                            + t*c(l, 6))))))
         velocity(l) = c(l, 1) + t*(2.0_wp*c(l, 2) + t*(3.0_wp*c(l, 3) + t*(4.0_wp*c(l, 4) &
                                                        + t*(5.0_wp*c(l, 5) + t*6.0_wp*c(l, 6)))))
      end do
   end subroutine find_ends

   !> Adds a motion of the sliders from now on to their integrals at the end of the part: I_s of t^k
   !> is k!/(k + s)! t^(k + s).
   pure subroutine add_moments(blocks, left, motion, last, moments)
      integer, intent(in) :: blocks, last
      real(wp), intent(in) :: left, motion(lanes, blocks, path_degree)
      real(wp), intent(inout) :: moments(lanes, blocks, 0:last)
      real(wp) :: power, share(path_degree)   ! power: of what is left
      integer :: b, k, l, s

      power = 1.0_wp
      do s = 0, last
         share(1) = left*power
         do k = 2, path_degree
            share(k) = left*share(k - 1)
         end do
         power = left*power
         share = share*fall(:path_degree, s)
         do b = 1, blocks
            !$omp simd
            do l = 1, lanes
               moments(l, b, s) = moments(l, b, s) &
                                  + (((motion(l, b, 1)*share(1) + motion(l, b, 2)*share(2)) &
                                      + (motion(l, b, 3)*share(3) + motion(l, b, 4)*share(4))) &
                                     + (motion(l, b, 5)*share(5) + motion(l, b, 6)*share(6)))
            end do
         end do
      end do
   end subroutine add_moments

end module dynamics_exact_modal_lane
