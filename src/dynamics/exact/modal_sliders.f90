!> Motion of the sliders of 32 samples over one part of a step, in the modal form: its powers and
!> its integrals. Products leave out the sliders that stand in all eight samples that they go over
!> together: those add nothing, so no bit depends on it.
module dynamics_exact_modal_sliders
   use core_kinds, only: wp
   use dynamics_alignment, only: aligned_memory
   use dynamics_exact_joint_paths, only: width
   use numerics_dense_product, only: groups
   implicit none(type, external)
   private
   public :: moving_sliders

   integer, parameter :: layers = 5   !! of all joints in a row that a product goes over, at most
   integer, parameter :: most_power = 4   !! of the motion that others answer to

   !> Sliders of one part.
   type :: moving_sliders
      integer :: n_joints = 0, n_padded = 0
      real(wp), pointer, contiguous :: moves(:, :) => null()       !! (lane, joint) 1: slider moves
      real(wp), pointer, contiguous :: motion(:, :, :) => null()   !! (.., 1:4) by powers
      real(wp), pointer, contiguous :: moments(:, :, :) => null()  !! (.., 0:moment) integrals
      integer :: n_moving = 0                   !! sliders that move from the start, in some lane
      integer, allocatable :: moving(:)         !! their joints
      logical, allocatable :: has_switched(:)   !! (joint) in some lane since `follow`
      logical, allocatable :: has_moved(:, :)   !! (group, joint) in some lane of eight
      integer :: n_moved(groups) = 0            !! joints that have
      integer, allocatable :: moved(:, :)       !! (entry, group) their columns, layer by layer
      type(aligned_memory), private :: memory
   contains
      procedure :: start
      procedure :: follow
      procedure :: switch
      procedure :: mask
      procedure :: integrate_motion
      procedure :: list_moved
   end type moving_sliders

contains

   !> Gets memory, of zeros.
   subroutine start(self, n_joints, n_padded, n_moments)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: n_joints, n_padded, n_moments
      real(wp), pointer, contiguous :: plane(:, :, :)

      self%n_joints = n_joints
      self%n_padded = n_padded
      call self%memory%start(width*n_padded*(2 + most_power + n_moments))
      call self%memory%take([width, n_padded, 1], plane)
      self%moves => plane(:, :, 1)
      call self%memory%take([width, n_padded, most_power], self%motion)
      call self%memory%take([width, n_padded, n_moments + 1], self%moments)
      self%moments(1:, 1:, 0:) => self%moments
      if (allocated(self%moved)) deallocate (self%moving, self%has_switched, self%has_moved, &
                                             self%moved)
      allocate (self%has_switched(n_joints), self%has_moved(groups, n_joints), source=.false.)
      allocate (self%moving(n_joints), self%moved(layers*n_joints, groups), source=0)
   end subroutine start

   !> Finds which sliders move with their joints from the start of the part. Joints that have not
   !> switched go on as before.
   pure subroutine follow(self, side, spring)
      class(moving_sliders), intent(inout) :: self
      real(wp), intent(in), dimension(width, self%n_joints) :: side, spring
      integer :: j

      if (.not. any(self%has_switched)) return
      self%n_moving = 0
      do j = 1, self%n_joints
         if (self%has_switched(j)) then
            call find_moving(side(:, j), spring(:, j), self%moves(:, j), self%has_moved(:, j))
            self%moments(:, j, :) = 0.0_wp
            self%has_switched(j) = .false.
         end if
         if (.not. any(self%has_moved(:, j))) cycle
         self%n_moving = self%n_moving + 1
         self%moving(self%n_moving) = j
      end do
      call self%list_moved()
   end subroutine follow

   !> Sliders of slipping joints move, and of joints without friction, which have no spring and slip
   !> for ever.
   pure subroutine find_moving(side, spring, moves, has_moved)
      real(wp), intent(in), dimension(width/groups, groups) :: side, spring
      real(wp), intent(inout) :: moves(width/groups, groups)
      logical, intent(inout) :: has_moved(groups)
      integer :: g, l
      logical :: is_any

      moves = merge(1.0_wp, 0.0_wp, abs(side) + (1.0_wp - spring) > 0.0_wp)
      do g = 1, groups
         is_any = .false.
         do l = 1, width/groups
            is_any = is_any .or. moves(l, g) > 0.0_wp
         end do
         has_moved(g) = is_any
      end do
   end subroutine find_moving

   !> Notes that a joint has switched in a lane.
   pure subroutine switch(self, joint, lane)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: joint, lane

      self%has_switched(joint) = .true.
      self%has_moved(1 + (lane - 1)*groups/width, joint) = .true.
   end subroutine switch

   !> Finds one power of the motion, from that power of the paths.
   pure subroutine mask(self, power, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: power
      real(wp), intent(in) :: x(width, self%n_padded)
      integer :: i

      do i = 1, self%n_moving
         associate (j => self%moving(i))
            call multiply(self%moves(:, j), x(:, j), self%motion(:, j, power))
         end associate
      end do
   end subroutine mask

   pure subroutine multiply(moves, x, motion)
      real(wp), intent(in), dimension(width) :: moves, x
      real(wp), intent(inout) :: motion(width)

      motion = moves*x
   end subroutine multiply

   !> Integrals of the motion: I_s of t^k is k!/(k + s)! (M6).
   pure subroutine integrate_motion(self, rows, x1, x)
      class(moving_sliders), intent(inout) :: self
      integer, intent(in) :: rows
      real(wp), intent(in) :: x1(width, rows), x(width, rows, 2:6)
      real(wp) :: share(6)
      integer :: i, k, s

      share = 1.0_wp
      do s = 0, ubound(self%moments, 3)
         do i = 1, self%n_moving
            associate (j => self%moving(i))
               call integrate(rows, share, self%moves(:, j), x1(:, j), x(1, j, 2), &
                              self%moments(:, j, s))
            end associate
         end do
         do k = 1, 6
            share(k) = share(k)/(k + s + 1)
         end do
      end do
   end subroutine integrate_motion

   pure subroutine integrate(rows, share, moves, x1, x, moment)
      integer, intent(in) :: rows
      real(wp), intent(in) :: share(6)
      real(wp), intent(in), dimension(width) :: moves, x1
      real(wp), intent(in) :: x(width, rows, 2:*)   !! its first row counts
      real(wp), intent(inout) :: moment(width)
      real(wp) :: total
      integer :: l

      do l = 1, width
         total = share(6)*x(l, 1, 6) + share(5)*x(l, 1, 5)
         total = total + (share(4)*x(l, 1, 4) + share(3)*x(l, 1, 3))
         total = total + (share(2)*x(l, 1, 2) + share(1)*x1(l))
         moment(l) = moves(l)*total
      end do
   end subroutine integrate

   !> Lists the sliders that have moved in the part.
   pure subroutine list_moved(self)
      class(moving_sliders), intent(inout) :: self
      integer :: g, i, j, n

      do g = 1, groups
         n = 0
         do j = 1, self%n_joints
            if (.not. self%has_moved(g, j)) cycle
            n = n + 1
            self%moved(n, g) = j
         end do
         self%n_moved(g) = n
         do i = 1, layers - 1
            do j = 1, n
               self%moved(i*n + j, g) = i*self%n_padded + self%moved(j, g)
            end do
         end do
      end do
   end subroutine list_moved

end module dynamics_exact_modal_sliders
