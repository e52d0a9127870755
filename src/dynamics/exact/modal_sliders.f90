!> Motion of the sliders of 32 samples over one part of a step, in the modal form, in groups of
!> eight samples: which sliders move, what that adds to the paths of joints, and its integrals.
!> Products leave out the sliders that stand in all eight samples: those add nothing, so no bit
!> depends on it.
module dynamics_exact_modal_sliders
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory
   use dynamics_exact_transitions, only: fall
   use dynamics_exact_modal_operators, only: four, modal_operators
   use dynamics_exact_modal_terms, only: factorial, groups, lanes, path_degree
   implicit none(type, external)
   private
   public :: moving_sliders

   integer, parameter :: most_power = 4   !! of the motion that others answer to

   !> Sliders of one part.
   type :: moving_sliders
      real(wp), pointer, contiguous :: moves(:, :, :) => null()       !! (lane, joint, group) 1 or 0
      real(wp), pointer, contiguous :: motion(:, :, :) => null()   !! e! x_e (lane, entry, e)
      real(wp), pointer, contiguous :: moments(:, :, :, :) => null()  !! (lane, joint, 0:, group) I
      !> moved(:n_moved(group), group): joints, ascending, whose sliders move in some lane; where
      !> some has switched, or regimes are given, those that may
      integer, allocatable :: n_moved(:), moved(:, :)
      logical, allocatable :: has_switched(:)   !! (group) some joint has since `follow`
      type(aligned_memory), private :: memory
   contains
      procedure :: start
      procedure :: follow
      procedure :: switch
   end type moving_sliders

contains

   !> Gets memory, of zeros.
   subroutine start(self, n_joints, n_moments)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: n_joints, n_moments
      real(wp), pointer, contiguous :: planes(:, :, :)

      call self%memory%start(int(lanes, long)*n_joints*(groups*(2 + n_moments) + most_power))
      call self%memory%take([lanes, n_joints, groups], self%moves)
      call self%memory%take([lanes, n_joints, most_power], self%motion)
      call self%memory%take([lanes, n_joints, (n_moments + 1)*groups], planes)
      self%moments(1:lanes, 1:n_joints, 0:n_moments, 1:groups) => planes
      if (allocated(self%moved)) deallocate (self%n_moved, self%moved, self%has_switched)
      allocate (self%n_moved(groups), self%moved(n_joints + 1, groups), source=0)
      allocate (self%has_switched(groups), source=.true.)
   end subroutine start

   !> Lists a joint that switches within the part.
   pure subroutine switch(self, g, joint)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, joint
      integer :: i

      self%has_switched(g) = .true.
      associate (moved => self%moved(:, g), n => self%n_moved(g))
         if (any(moved(:n) == joint)) return
         n = n + 1
         do i = n, 2, -1
            if (moved(i - 1) < joint) exit
            moved(i) = moved(i - 1)
         end do
         moved(i) = joint
      end associate
      self%moments(:, joint, :, g) = 0.0_wp
   end subroutine switch

   !> Follows the sliders of a group through a part, whose joints' free paths are given, and adds
   !> what they do to the paths (M5).
   pure subroutine follow(self, g, operators, rows, side, spring, x1, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, rows   !! group, whose lanes come first below
      type(modal_operators), intent(in) :: operators
      real(wp), intent(in), dimension(lanes, groups, *) :: side, spring
      real(wp), intent(in) :: x1(lanes, groups, rows)
      real(wp), intent(inout) :: x(lanes, groups, rows, 2:path_degree)   !! (.., joint, power)
      integer :: k, n

      if (self%has_switched(g)) then
         self%has_switched(g) = .false.
         call find_moving(side, spring, self%moves(:, :, g), self%n_moved(g), self%moved(:, g))
      end if
      n = self%n_moved(g)
      associate (moved => self%moved(:n, g), moves => self%moves(:, :, g), motion => self%motion)
         call mask(n, moved, moves, x1, 1.0_wp, motion(:, :, 1))
         call mask(n, moved, moves, x(:, :, :, 2), 2.0_wp, motion(:, :, 2))
         do k = 3, path_degree
            if (operators%first_power(k) <= k - 2) &
               call add_answer(size(operators%reads, 3), k, operators%first_power(k), &
                               operators%markov, n, moved, motion, x(:, :, :, k))
            if (k <= most_power) call mask(n, moved, moves, x(:, :, :, k), factorial(k), &
                                           motion(:, :, k))
         end do
         call integrate(n, moved, rows, moves, x1, x, self%moments(:, :, :, g))
      end associate
   end subroutine follow

   !> Finds which of the listed sliders move with their joints from the start of the part: those of
   !> slipping joints, and of joints without friction, which have no spring and slip for ever.
   pure subroutine find_moving(side, spring, moves, n_moved, moved)
      real(wp), intent(in), dimension(lanes, groups, *) :: side, spring
      real(wp), intent(inout) :: moves(lanes, *)
      integer, intent(inout) :: n_moved, moved(:)
      real(wp) :: most
      integer :: i, j, l, n

      n = 0
      do i = 1, n_moved
         j = moved(i)
         most = 0.0_wp
         !$omp simd reduction(max:most)
         do l = 1, lanes
            moves(l, j) = merge(0.0_wp, 1.0_wp, abs(side(l, 1, j)) <= 0.0_wp .and. &
                                spring(l, 1, j) > 0.0_wp)
            most = max(most, moves(l, j))
         end do
         moved(n + 1) = j
         n = n + nint(most)
      end do
      n_moved = n
   end subroutine find_moving

   !> Finds one power of the motion, times a factor, from that power of the paths.
   pure subroutine mask(n, moved, moves, x, factor, motion)
      integer, intent(in) :: n, moved(n)
      real(wp), intent(in) :: moves(lanes, *), x(lanes, groups, *), factor
      real(wp), intent(inout) :: motion(lanes, *)
      integer :: i, l

      do i = 1, n
         !$omp simd
         do l = 1, lanes
            motion(l, i) = factor*moves(l, moved(i))*x(l, 1, moved(i))
         end do
      end do
   end subroutine mask

   !> Adds the sliders' answers to one power of the paths: power e of a slider adds Y_d e!/k! to
   !> power k = e + d + 2 (M5). The sums of four joints stay in registers.
   pure subroutine add_answer(fours, k, first, markov, n, moved, motion, x)
      integer, intent(in) :: fours, k, first, n, moved(n)   !! first: e
      real(wp), intent(in), contiguous :: markov(:, :, 0:)
      real(wp), intent(in), contiguous :: motion(:, :, :)   !! e! x_e (lane, entry, e)
      real(wp), intent(inout) :: x(lanes, groups, four, fours)
      real(wp) :: before, share, total(lanes, four)
      integer :: d, e, i, l, q, r

      before = merge(factorial(k), 0.0_wp, k < path_degree)   ! of the free path
      share = 1.0_wp/factorial(k)
      do q = 1, fours
         total = before*x(:, 1, :, q)
         do e = first, k - 2
            d = k - 2 - e
            do i = 1, n
               do r = 1, four
                  do l = 1, lanes
                     total(l, r) = total(l, r) &
                                   + markov(four*(q - 1) + r, moved(i), d)*motion(l, i, e)
                  end do
               end do
            end do
         end do
         x(:, 1, :, q) = share*total
      end do
   end subroutine add_answer

   !> Integrates the motion: I_s of t^k is k!/(k + s)! (M6).
   pure subroutine integrate(n, moved, rows, moves, x1, x, moments)
      integer, intent(in) :: n, moved(n), rows
      real(wp), intent(in) :: moves(lanes, *), x1(lanes, groups, rows)
      real(wp), intent(in) :: x(lanes, groups, rows, 2:6)
      real(wp), intent(inout), contiguous :: moments(:, :, 0:)   !! (lane, joint, s)
      integer :: i, j, l, s

      do i = 1, n
         j = moved(i)
         do s = 0, ubound(moments, 3)
            !$omp simd
            do l = 1, lanes
               moments(l, j, s) = moves(l, j) &
                                  *((fall(6, s)*x(l, 1, j, 6) + fall(5, s)*x(l, 1, j, 5)) &
                                    + (fall(4, s)*x(l, 1, j, 4) + fall(3, s)*x(l, 1, j, 3)) &
                                    + (fall(2, s)*x(l, 1, j, 2) + fall(1, s)*x1(l, 1, j)))
            end do
         end do
      end do
   end subroutine integrate

end module dynamics_exact_modal_sliders
