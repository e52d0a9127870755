!> Motion of the sliders over one part of a step in the modal form, for groups of eight samples:
!> which sliders move, what they add to the paths of joints (M5), and the integrals of their motion.
!>
!> Products leave out sliders that move in none of the eight samples. These would add zero, so the
!> bits of a sample do not depend on the others.
module dynamics_exact_modal_sliders
   use core_alignment, only: aligned_memory
   use core_kinds, only: long, wp
   use dynamics_exact_transitions, only: integral
   use dynamics_exact_modal_operators, only: strip, modal_operators
   use dynamics_exact_modal_terms, only: factorial, groups, lanes, path_degree
   implicit none(type, external)
   private
   public :: moving_sliders

   integer, parameter :: most_power = 4   !! highest power of the sliders' motion in (M5)

   !> Sliders in one part.
   type :: moving_sliders
      !> (lane, joint, group) 1 if the slider moves, else 0
      real(wp), pointer, contiguous :: moves(:, :, :) => null()
      real(wp), pointer, contiguous :: motion(:, :, :) => null()   !! e! x_e (lane, entry, e)
      real(wp), pointer, contiguous :: moments(:, :, :, :) => null()   !! I (lane, joint, 0:, group)
      !> moving(:n_moving(group), group): joints, ascending, whose sliders move in a lane or more;
      !> after a switch also those that have stopped
      integer, allocatable :: n_moving(:), moving(:, :)
      type(aligned_memory), private :: memory
   contains
      procedure :: initialize
      procedure :: move_sliders
      procedure :: switch
   end type moving_sliders

contains

   !> Allocates all arrays, filled with zeros.
   subroutine initialize(self, n_joints, n_moments)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: n_joints, n_moments
      real(wp), pointer, contiguous :: planes(:, :, :)

      call self%memory%reserve(int(lanes, long)*n_joints*(groups*(2 + n_moments) + most_power))
      call self%memory%assign_planes([lanes, n_joints, groups], self%moves)
      call self%memory%assign_planes([lanes, n_joints, most_power], self%motion)
      call self%memory%assign_planes([lanes, n_joints, (n_moments + 1)*groups], planes)
      self%moments(1:lanes, 1:n_joints, 0:n_moments, 1:groups) => planes
      if (allocated(self%moving)) deallocate (self%n_moving, self%moving)
      allocate (self%n_moving(groups), self%moving(n_joints + 1, groups), source=0)
   end subroutine initialize

   !> Lists the slider of a joint that switches within the part, if it is not in the list.
   pure subroutine switch(self, g, joint)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, joint
      integer :: i

      associate (moving => self%moving(:, g), n => self%n_moving(g))
         if (any(moving(:n) == joint)) return
         n = n + 1
         do i = n, 2, -1
            if (moving(i - 1) < joint) exit
            moving(i) = moving(i - 1)
         end do
         moving(i) = joint
      end associate
      self%moments(:, joint, :, g) = 0.0_wp
   end subroutine switch

   !> Finds the motion of the sliders of a group over a part from the free paths of their joints,
   !> and adds its response to the paths (M5).
   pure subroutine move_sliders(self, g, operators, rows, side, spring, x1, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, rows   !! group; arrays below begin with its lanes
      type(modal_operators), intent(in) :: operators
      real(wp), intent(in), dimension(lanes, groups, *) :: side, spring
      real(wp), intent(in) :: x1(lanes, groups, rows)
      real(wp), intent(inout) :: x(lanes, groups, rows, 2:path_degree)   !! (.., joint, power)
      integer :: k, n

      call find_moving(side, spring, self%moves(:, :, g), self%n_moving(g), self%moving(:, g))
      n = self%n_moving(g)
      associate (moving => self%moving(:n, g), moves => self%moves(:, :, g), motion => self%motion)
         call find_motion(n, moving, moves, x1, 1.0_wp, motion(:, :, 1))
         call find_motion(n, moving, moves, x(:, :, :, 2), 2.0_wp, motion(:, :, 2))
         do k = 3, path_degree
            if (operators%first_power(k) <= k - 2) &
               call add_response(size(operators%outputs, 3), k, operators%first_power(k), &
                                 operators%markov, n, moving, motion, x(:, :, :, k))
            if (k <= most_power) call find_motion(n, moving, moves, x(:, :, :, k), factorial(k), &
                                                  motion(:, :, k))
         end do
         call integrate(n, moving, rows, moves, x1, x, self%moments(:, :, :, g))
      end associate
   end subroutine move_sliders

   !> Finds which of the listed sliders move with their joints from the start of the part: those of
   !> slipping joints, and of joints without friction, which have no spring and always slip.
   pure subroutine find_moving(side, spring, moves, n_moving, moving)
      real(wp), intent(in), dimension(lanes, groups, *) :: side, spring
      real(wp), intent(inout) :: moves(lanes, *)
      integer, intent(inout) :: n_moving, moving(:)
      real(wp) :: most
      integer :: i, j, l, n

      n = 0
      do i = 1, n_moving
         j = moving(i)
         most = 0.0_wp
         !$omp simd reduction(max:most)
         do l = 1, lanes
            moves(l, j) = merge(0.0_wp, 1.0_wp, abs(side(l, 1, j)) <= 0.0_wp .and. &
                                spring(l, 1, j) > 0.0_wp)
            most = max(most, moves(l, j))
         end do
         moving(n + 1) = j
         n = n + nint(most)
      end do
      n_moving = n
   end subroutine find_moving

   !> Finds one power of the sliders' motion, times a factor, from that power of the paths.
   pure subroutine find_motion(n, moving, moves, x, factor, motion)
      integer, intent(in) :: n, moving(n)
      real(wp), intent(in) :: moves(lanes, *), x(lanes, groups, *), factor
      real(wp), intent(inout) :: motion(lanes, *)
      integer :: i

      do i = 1, n
         motion(:, i) = factor*moves(:, moving(i))*x(:, 1, moving(i))
      end do
   end subroutine find_motion

   !> Adds the response to the sliders to one power of the paths: power e of a slider adds Y_d e!/k!
   !> to power k = e + d + 2 (M5). The sums of a strip of joints stay in registers.
   pure subroutine add_response(n_strips, k, first, markov, n, moving, motion, x)
      integer, intent(in) :: n_strips, k, first, n, moving(n)   !! first: lowest e
      real(wp), intent(in), contiguous :: markov(:, :, 0:)
      real(wp), intent(in), contiguous :: motion(:, :, :)   !! e! x_e (lane, entry, e)
      real(wp), intent(inout) :: x(lanes, groups, strip, n_strips)
      real(wp) :: before, share, total(lanes, strip)
      integer :: d, e, i, q, r

      before = merge(factorial(k), 0.0_wp, k < path_degree)   ! factor of the free path
      share = 1.0_wp/factorial(k)
      do q = 1, n_strips
         total = before*x(:, 1, :, q)
         do e = first, k - 2
            d = k - 2 - e
            do i = 1, n
               do r = 1, strip
                  total(:, r) = total(:, r) &
                                + markov(strip*(q - 1) + r, moving(i), d)*motion(:lanes, i, e)
               end do
            end do
         end do
         x(:, 1, :, q) = share*total
      end do
   end subroutine add_response

   !> Integrates the sliders' motion: I_s of t^k is k!/(k + s)! (M6).
   pure subroutine integrate(n, moving, rows, moves, x1, x, moments)
      integer, intent(in) :: n, moving(n), rows
      real(wp), intent(in) :: moves(lanes, *), x1(lanes, groups, rows)
      real(wp), intent(in) :: x(lanes, groups, rows, 2:6)
      real(wp), intent(inout), contiguous :: moments(:, :, 0:)   !! (lane, joint, s)
      integer :: i, j, s

      do i = 1, n
         j = moving(i)
         do s = 0, ubound(moments, 3)
            moments(:lanes, j, s) = &
               moves(:, j)*((integral(6, s)*x(:, 1, j, 6) + integral(5, s)*x(:, 1, j, 5)) &
                            + (integral(4, s)*x(:, 1, j, 4) + integral(3, s)*x(:, 1, j, 3)) &
                            + (integral(2, s)*x(:, 1, j, 2) + integral(1, s)*x1(:, 1, j)))
         end do
      end do
   end subroutine integrate

end module dynamics_exact_modal_sliders
