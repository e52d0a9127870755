!> Rows in which Newmark's scheme marches a structure, and what changes in them where a joint
!> changes its regime.
module dynamics_newmark_frame
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_alignment, only: register_width, whole_registers
   use numerics_lapack, only: invert_matrix, unit_matrix
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_frame, new_newmark_frame

   !> One structure by rows: the dofs, then the paths w_j.x of all joints but those that are the
   !> first to hold a dof to the ground, whose paths are those of their dofs.
   type :: newmark_frame
      type(structure_type) :: structure
      integer :: n_dof = 0
      integer :: n_rows = 0                        !! that are used
      integer :: n_padded = 0                      !! whole registers
      logical :: is_short = .false.                !! rows fill one register at most
      integer, allocatable :: row(:)               !! (joint) of its path
      type(sparse_matrix) :: rows                  !! Z (row, dof), the rows from the dofs
      real(wp), allocatable :: inverse_mass(:, :)  !! M^-1 (dof, dof)
      real(wp), allocatable :: kick(:, :)          !! Z M^-1 W: acceleration by a unit of force
      !> Z M^-1 W/(w'M^-1 w) (row, joint): velocity lost for a unit of w.v where the joint sticks
      real(wp), allocatable :: lost(:, :)
      real(wp), allocatable :: relief(:, :)        !! Z M^-1 C M^-1 W/(w'M^-1 w): acceleration then
   contains
      procedure :: rows_of
   end type newmark_frame

contains

   !> Prepares what Newmark's scheme needs of a structure; fails where M cannot be inverted.
   subroutine new_newmark_frame(structure, frame, error)
      type(structure_type), intent(in) :: structure
      type(newmark_frame), intent(out) :: frame
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: lost(structure%n_dof, structure%n_joints)
      real(wp) :: rows(structure%n_dof + structure%n_joints, structure%n_dof)
      integer :: j, n

      n = structure%n_dof
      frame%structure = structure
      frame%n_dof = n
      frame%n_rows = n
      allocate (frame%row(structure%n_joints), source=0)
      rows = 0.0_wp
      rows(:n, :) = unit_matrix(n)
      do j = 1, structure%n_joints
         associate (w => structure%direction(:, j), row => frame%row(j))
            row = maxloc(abs(w), 1)
            if (all(abs(rows(row, :) - w) <= 0.0_wp) .and. all(frame%row(:j - 1) /= row)) cycle
            frame%n_rows = frame%n_rows + 1
            row = frame%n_rows
            rows(row, :) = w
         end associate
      end do
      frame%rows = sparse_of(rows(:frame%n_rows, :))
      frame%n_padded = whole_registers(frame%n_rows)
      frame%is_short = frame%n_padded == register_width

      call invert_matrix(structure%mass, frame%inverse_mass, error)
      if (allocated(error)) return
      lost = matmul(frame%inverse_mass, structure%direction)
      frame%kick = frame%rows_of(lost)
      do j = 1, structure%n_joints
         lost(:, j) = lost(:, j)/frame%kick(frame%row(j), j)
      end do
      frame%lost = frame%rows_of(lost)
      frame%relief = frame%rows_of(matmul(frame%inverse_mass, matmul(structure%damping, lost)))
   end subroutine new_newmark_frame

   !> Z x of every column.
   pure function rows_of(self, x) result(y)
      class(newmark_frame), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:, :)   !! (dof, column)
      real(wp) :: y(self%n_rows, size(x, 2))
      integer :: j

      do j = 1, size(x, 2)
         call self%rows%multiply(x(:, j), y(:, j))
      end do
   end function rows_of

end module dynamics_newmark_frame
