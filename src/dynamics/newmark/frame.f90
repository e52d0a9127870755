!> Matrices that Newmark's scheme needs where a joint changes its regime.
module dynamics_newmark_frame
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: invert_matrix
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_frame, new_newmark_frame

   !> One structure; arrays by (dof, joint).
   type :: newmark_frame
      type(structure_type) :: structure
      !> joint i holds dof i to the ground, one force acts, M is diagonal and K couples neighbours
      logical :: is_row = .false.
      type(sparse_matrix) :: directions            !! W'
      real(wp), allocatable :: inverse_mass(:, :)  !! M^-1 (dof, dof)
      real(wp), allocatable :: kick(:, :)          !! M^-1 W: acceleration by a unit of force
      !> M^-1 W/(w'M^-1 w): velocity that a joint loses when it sticks, for a unit of w.v
      real(wp), allocatable :: lost(:, :)
      real(wp), allocatable :: relief(:, :)        !! M^-1 C lost: acceleration that goes with it
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
      frame%directions = sparse_of(transpose(structure%direction))
      if (structure%has_lumped_mass()) then
         allocate (frame%inverse_mass(n, n), source=0.0_wp)
         do i = 1, n
            frame%inverse_mass(i, i) = 1.0_wp/structure%mass(i, i)
         end do
      else
         call invert_matrix(structure%mass, frame%inverse_mass, error)
         if (allocated(error)) return
      end if
      frame%kick = matmul(frame%inverse_mass, structure%direction)
      frame%lost = frame%kick
      do j = 1, structure%n_joints
        frame%lost(:, j) = frame%kick(:, j)/dot_product(structure%direction(:, j), frame%kick(:, j))
      end do
      frame%relief = matmul(frame%inverse_mass, matmul(structure%damping, frame%lost))
      frame%is_row = is_row_of_masses(structure)
   end subroutine new_newmark_frame

   pure logical function is_row_of_masses(structure)
      type(structure_type), intent(in) :: structure
      integer :: i, j

      is_row_of_masses = structure%n_joints == structure%n_dof .and. structure%n_forces == 1 .and. &
                         structure%has_lumped_mass()
      if (.not. is_row_of_masses) return
      do j = 1, structure%n_dof
         do i = 1, structure%n_dof
            if (abs(structure%direction(i, j) - merge(1.0_wp, 0.0_wp, i == j)) > 0.0_wp .or. &
                abs(i - j) > 1 .and. abs(structure%stiffness(i, j)) > 0.0_wp) &
               is_row_of_masses = .false.
         end do
      end do
   end function is_row_of_masses

end module dynamics_newmark_frame
