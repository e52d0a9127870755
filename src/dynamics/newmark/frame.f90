!> Rows of Newmark's march: the dofs and paths of the joints, and what changes in them when a joint
!> switches between stick and slip.
module dynamics_newmark_frame
   use core_alignment, only: register_width, whole_registers
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: invert_matrix, unit_matrix
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_frame, new_newmark_frame

   !> Rows Z x of a structure: the dofs, then the paths w_j.x of the joints. The first joint that
   !> holds a dof to the ground has no row of its own: its path is that of the dof.
   type :: newmark_frame
      type(structure_type) :: structure
      integer :: n_dof = 0
      integer :: n_rows = 0
      integer :: n_padded = 0                        !! n_rows, padded to whole registers
      logical :: is_short = .false.                  !! True if rows fill one register at most
      integer, allocatable :: row(:)                 !! (joint) row of its path
      type(sparse_matrix) :: rows                    !! Z (row, dof)
      real(wp), allocatable :: inverse_mass(:, :)    !! M^-1 (dof, dof)
      !> (row, joint) change of acceleration by a unit of joint force: Z M^-1 W
      real(wp), allocatable :: slip_gain(:, :)
      !> (row, joint) changes when a joint of unit velocity w.v sticks: velocity lost, Z M^-1 W/
      !> (w'M^-1 w); acceleration gained from the dampers, Z M^-1 C M^-1 W/(w'M^-1 w)
      real(wp), allocatable :: velocity_loss(:, :), damping_gain(:, :)
   contains
      procedure :: rows_of
   end type newmark_frame

contains

   !> Prepares the frame of a structure; fails if M cannot be inverted.
   subroutine new_newmark_frame(structure, frame, error)
      type(structure_type), intent(in) :: structure
      type(newmark_frame), intent(out) :: frame
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: velocity_loss(structure%n_dof, structure%n_joints)
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
      velocity_loss = matmul(frame%inverse_mass, structure%direction)
      frame%slip_gain = frame%rows_of(velocity_loss)
      do j = 1, structure%n_joints
         velocity_loss(:, j) = velocity_loss(:, j)/frame%slip_gain(frame%row(j), j)
      end do
      frame%velocity_loss = frame%rows_of(velocity_loss)
      frame%damping_gain = frame%rows_of(matmul(frame%inverse_mass, &
                                                matmul(structure%damping, velocity_loss)))
   end subroutine new_newmark_frame

   !> Z x (row, column).
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
