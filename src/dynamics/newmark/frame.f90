!> Coordinates in which Newmark's scheme marches a structure, and the matrices that it needs where a
!> joint changes its regime.
module dynamics_newmark_frame
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_alignment, only: register_width
   use numerics_lapack, only: invert_matrix
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_frame, new_newmark_frame

   !> One structure in the coordinates y of its march; arrays by (coordinate, joint).
   type :: newmark_frame
      type(structure_type) :: structure
      !> w_j.x is coordinate j for every joint, of at most eight coordinates
      logical :: is_short = .false.
      real(wp), allocatable :: dofs(:, :)          !! x = dofs y; not allocated where y is x
      real(wp), allocatable :: coordinates(:, :)   !! its inverse
      type(sparse_matrix) :: directions            !! W'
      real(wp), allocatable :: inverse_mass(:, :)  !! M^-1
      real(wp), allocatable :: kick(:, :)          !! M^-1 W: acceleration by a unit of force
      !> M^-1 W/(w'M^-1 w): velocity that a joint loses when it sticks, for a unit of w.v
      real(wp), allocatable :: lost(:, :)
      real(wp), allocatable :: relief(:, :)        !! M^-1 C lost: acceleration that goes with it
   contains
      procedure :: to_dofs
      procedure :: from_dofs
   end type newmark_frame

contains

   !> Prepares what Newmark's scheme needs of a structure; fails where M cannot be inverted.
   subroutine new_newmark_frame(structure, frame, error)
      type(structure_type), intent(in) :: structure
      type(newmark_frame), intent(out) :: frame
      type(error_type), allocatable, intent(out) :: error
      integer :: i, j, n

      n = structure%n_dof
      frame%structure = structure
      call choose_coordinates(frame, error)
      if (allocated(error)) return
      associate (mass => frame%structure%mass, w => frame%structure%direction)
         frame%directions = sparse_of(transpose(w))
         if (frame%structure%has_lumped_mass()) then
            allocate (frame%inverse_mass(n, n), source=0.0_wp)
            do i = 1, n
               frame%inverse_mass(i, i) = 1.0_wp/mass(i, i)
            end do
         else
            call invert_matrix(mass, frame%inverse_mass, error)
            if (allocated(error)) return
         end if
         frame%kick = matmul(frame%inverse_mass, w)
         frame%lost = frame%kick
         do j = 1, structure%n_joints
            frame%lost(:, j) = frame%kick(:, j)/dot_product(w(:, j), frame%kick(:, j))
         end do
         frame%relief = matmul(frame%inverse_mass, matmul(frame%structure%damping, frame%lost))
      end associate
   end subroutine new_newmark_frame

   !> Chooses coordinates: where n <= 8 and the directions are independent, y = [W'; U] x with as
   !> many unit vectors U as are missing.
   subroutine choose_coordinates(frame, error)
      type(newmark_frame), intent(inout) :: frame
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: independent = 1.0e-3_wp   !! part of a direction that those before lack
      real(wp), allocatable :: rest(:, :)      ! (joint, dof) W' less what the joints before have
      logical, allocatable :: is_taken(:)      ! (dof)
      integer :: i, j, k, m, n

      n = frame%structure%n_dof
      m = frame%structure%n_joints
      if (n > register_width .or. m > n) return
      allocate (frame%coordinates(n, n), source=0.0_wp)
      frame%coordinates(:m, :) = transpose(frame%structure%direction)
      rest = frame%coordinates(:m, :)
      allocate (is_taken(n), source=.false.)
      do j = 1, m
         i = maxloc(abs(rest(j, :)), 1)
         if (abs(rest(j, i)) < independent*maxval(abs(frame%structure%direction(:, j)))) then
            deallocate (frame%coordinates)
            return
         end if
         is_taken(i) = .true.
         do k = j + 1, m
            rest(k, :) = rest(k, :) - rest(k, i)/rest(j, i)*rest(j, :)
         end do
      end do
      frame%is_short = .true.
      do i = 1, n
         if (is_taken(i)) cycle
         m = m + 1
         frame%coordinates(m, i) = 1.0_wp
      end do
      rest = frame%coordinates
      do i = 1, n
         rest(i, i) = rest(i, i) - 1.0_wp
      end do
      if (all(abs(rest) <= 0.0_wp)) then
         deallocate (frame%coordinates)
      else
         call invert_matrix(frame%coordinates, frame%dofs, error)
         if (.not. allocated(error)) call transform(frame%dofs, frame%structure)
      end if
   end subroutine choose_coordinates

   !> Writes the structure in coordinates y, x = dofs y.
   pure subroutine transform(dofs, structure)
      real(wp), intent(in) :: dofs(:, :)
      type(structure_type), intent(inout) :: structure
      integer :: j

      structure%mass = matmul(transpose(dofs), matmul(structure%mass, dofs))
      structure%stiffness = matmul(transpose(dofs), matmul(structure%stiffness, dofs))
      structure%damping = matmul(transpose(dofs), matmul(structure%damping, dofs))
      structure%load = matmul(transpose(dofs), structure%load)
      structure%direction = 0.0_wp
      do j = 1, structure%n_joints
         structure%direction(j, j) = 1.0_wp
      end do
   end subroutine transform

   !> Displacements or velocities of the dofs.
   pure function to_dofs(self, y) result(x)
      class(newmark_frame), intent(in) :: self
      real(wp), intent(in) :: y(:)
      real(wp) :: x(size(y))

      x = y
      if (allocated(self%dofs)) x = matmul(self%dofs, y)
   end function to_dofs

   pure function from_dofs(self, x) result(y)
      class(newmark_frame), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: y(size(x))

      y = x
      if (allocated(self%coordinates)) y = matmul(self%coordinates, x)
   end function from_dofs

end module dynamics_newmark_frame
