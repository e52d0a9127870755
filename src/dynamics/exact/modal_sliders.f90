!> Motion of the sliders of 32 samples over one part of a step, in the modal form: its powers and
!> its integrals, in groups of eight samples. Products leave out the sliders that stand in all eight
!> samples: those add nothing, so no bit depends on it.
module dynamics_exact_modal_sliders
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_transitions, only: fall
   use numerics_dense_product, only: lanes => product_width
   implicit none(type, external)
   private
   public :: moving_sliders, groups, lanes

   integer, parameter :: groups = width/lanes
   integer, parameter :: most_power = 4   !! of the motion that others answer to

   !> Sliders of one part.
   type :: moving_sliders
      real(wp), pointer, contiguous :: moves(:, :, :) => null()       !! (lane, joint, group) 1 or 0
      real(wp), pointer, contiguous :: motion(:, :, :, :) => null()   !! (.., 1:4, group) by powers
      real(wp), pointer, contiguous :: moments(:, :, :, :) => null()  !! (.., 0:moment, group)
      !> moved(:n_moved(group), group): joints, ascending, whose sliders move in some lane
      integer, allocatable :: n_moved(:), moved(:, :)
      logical, allocatable :: has_switched(:)   !! (group) some joint has since `follow`
      type(aligned_memory), private :: memory
   contains
      procedure :: start
      procedure :: follow
      procedure :: switch
      procedure :: mask
      procedure :: integrate_motion
   end type moving_sliders

contains

   !> Gets memory, of zeros.
   subroutine start(self, n_joints, n_padded, n_moments)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: n_joints, n_padded, n_moments
      real(wp), pointer, contiguous :: planes(:, :, :)

      call self%memory%start(int(width, long)*n_padded*(2 + most_power + n_moments))
      call self%memory%take([lanes, n_padded, groups], self%moves)
      call self%memory%take([lanes, n_padded, most_power*groups], planes)
      self%motion(1:lanes, 1:n_padded, 1:most_power, 1:groups) => planes
      call self%memory%take([lanes, n_padded, (n_moments + 1)*groups], planes)
      self%moments(1:lanes, 1:n_padded, 0:n_moments, 1:groups) => planes
      if (allocated(self%moved)) deallocate (self%n_moved, self%moved, self%has_switched)
      allocate (self%n_moved(groups), self%moved(n_joints + 1, groups), source=0)
      allocate (self%has_switched(groups), source=.true.)
   end subroutine start

   !> Finds which sliders move with their joints from the start of the part: those of slipping
   !> joints, and of joints without friction, which have no spring and slip for ever.
   pure subroutine follow(self, g, side, spring)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g   !! group, whose lanes come first in:
      real(wp), intent(in), dimension(lanes, groups, *) :: side, spring
      integer :: is_any, j

      if (.not. self%has_switched(g)) return
      self%has_switched(g) = .false.
      self%n_moved(g) = 0
      do j = 1, size(self%moved, 1) - 1
         call find_moving(side(:, 1, j), spring(:, 1, j), self%moves(:, j, g), is_any)
         self%moved(self%n_moved(g) + 1, g) = j
         self%n_moved(g) = self%n_moved(g) + is_any
      end do
   end subroutine follow

   pure subroutine find_moving(side, spring, moves, is_any)
      real(wp), intent(in), dimension(lanes) :: side, spring
      real(wp), intent(inout) :: moves(lanes)
      integer, intent(out) :: is_any   !! 1 if some slider moves, or 0
      real(wp) :: most
      integer :: l

      most = 0.0_wp
      !$omp simd reduction(max:most)
      do l = 1, lanes
         moves(l) = merge(1.0_wp, 0.0_wp, abs(side(l)) + (1.0_wp - spring(l)) > 0.0_wp)
         most = max(most, moves(l))
      end do
      is_any = nint(most)
   end subroutine find_moving

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

   !> Finds one power of the motion, from that power of the paths.
   pure subroutine mask(self, g, power, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, power
      real(wp), intent(in) :: x(lanes, groups, *)   !! (.., joint), the group's lanes first
      integer :: i

      do i = 1, self%n_moved(g)
         associate (j => self%moved(i, g))
            call multiply(self%moves(:, j, g), x(1, 1, j), self%motion(:, j, power, g))
         end associate
      end do
   end subroutine mask

   pure subroutine multiply(moves, x, motion)
      real(wp), intent(in), dimension(lanes) :: moves, x
      real(wp), intent(inout) :: motion(lanes)
      integer :: l

      !$omp simd
      do l = 1, lanes
         motion(l) = moves(l)*x(l)
      end do
   end subroutine multiply

   !> Integrates the motion: I_s of t^k is k!/(k + s)! (M6).
   pure subroutine integrate_motion(self, g, rows, x1, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: g, rows
      real(wp), intent(in) :: x1(lanes, groups, rows), x(lanes, groups, rows, 2:6)   !! see mask
      integer :: i

      do i = 1, self%n_moved(g)
         associate (j => self%moved(i, g))
            call integrate(ubound(self%moments, 3), rows, self%moves(:, j, g), x1(1, 1, j), &
                           x(1, 1, j, 2), size(self%moves, 2), j, self%moments(:, :, :, g))
         end associate
      end do
   end subroutine integrate_motion

   pure subroutine integrate(last, rows, moves, x1, x, joints, j, moments)
      integer, intent(in) :: last, rows, joints, j
      real(wp), intent(in), dimension(lanes) :: moves, x1
      real(wp), intent(in) :: x(lanes, groups, rows, 2:*)      !! its first row counts
      real(wp), intent(inout) :: moments(lanes, joints, 0:last)
      integer :: l, s

      do s = 0, last
         !$omp simd
         do l = 1, lanes
            moments(l, j, s) = moves(l)*((fall(6, s)*x(l, 1, 1, 6) + fall(5, s)*x(l, 1, 1, 5)) &
                                         + (fall(4, s)*x(l, 1, 1, 4) + fall(3, s)*x(l, 1, 1, 3)) &
                                         + (fall(2, s)*x(l, 1, 1, 2) + fall(1, s)*x1(l)))
         end do
      end do
   end subroutine integrate

end module dynamics_exact_modal_sliders
