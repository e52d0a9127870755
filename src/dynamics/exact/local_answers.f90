!> Answers of the dofs around a joint to its transitions, by sums over the series of its own dof
!> (7), and which joints they are exact enough for (8); see docs/exact_march.md.
module dynamics_exact_local_answers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: local_answers
   use dynamics_exact_series, only: form_matrices, series_type, without_diagonal
   use dynamics_exact_transitions, only: fall, n_near
   use numerics_lapack, only: multiply
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: find_answers

contains

   !> Finds the answers to a tolerance relative to the rms displacement.
   subroutine find_answers(structure, series, tolerance, answers)
      type(structure_type), intent(in) :: structure
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_answers), intent(out) :: answers
      real(wp), allocatable :: damping(:, :), stiffness(:, :)   ! C^, K^
      integer :: i, j, half

      call form_matrices(structure, series%h, damping, stiffness)
      do half = 1, 2
         do j = 1, structure%n_joints
            i = series%row(j)
            if (i <= structure%n_dof) stiffness(i, i) = stiffness(i, i) + 0.5_wp*series%spring(j)
         end do
         if (half == 1) call find_near(damping, stiffness, series, tolerance, answers)
      end do
      call find_local(damping, stiffness, series, tolerance, answers)
   end subroutine find_answers

   !> Finds the columns of N_1 .. N_4, which say how the dofs around one follow it (7): -C^, C^ C~ -
   !> K^, C^ K~ + K^ C~, K^ K~; C~ and K~ are without diagonals.
   subroutine find_near(damping, stiffness, series, tolerance, answers)
      !> C^, K^ with half the joints
      real(wp), intent(in), dimension(:, :), contiguous :: damping, stiffness
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_answers), intent(inout) :: answers
      real(wp), parameter :: share = 1.0e-4_wp   !! of the tolerance, for one entry
      !> of the answer's first power, in the velocity at the end of a part
      real(wp), parameter :: part(n_near) = [24.0_wp, 120.0_wp, 720.0_wp, 5040.0_wp]/4.0_wp
      real(wp) :: column(size(damping, 1), n_near)
      real(wp), allocatable, dimension(:, :) :: off_damping, squared   ! C~, C^ C~
      type(sparse_matrix) :: springs                                   ! K^
      logical :: matters(size(damping, 1))
      integer :: i, j

      allocate (off_damping, source=without_diagonal(damping))
      allocate (squared, mold=damping)
      call multiply(damping, off_damping, squared)
      springs = sparse_of(stiffness)
      allocate (answers%dof(0), answers%value(n_near, 0))
      allocate (answers%own(n_near, series%n_rows), source=0.0_wp)
      answers%first = [1]
      do j = 1, size(damping, 1)
         column(:, 1) = -damping(:, j)
         column(:, 2) = squared(:, j) - stiffness(:, j)
         call springs%multiply(off_damping(:, j), column(:, 3))
         column(:, 4) = 0.0_wp
         do i = 1, size(damping, 1)
            if (i == j .or. .not. abs(stiffness(i, j)) > 0.0_wp) cycle
            column(:, 3) = column(:, 3) + damping(:, i)*stiffness(i, j)
            column(:, 4) = column(:, 4) + stiffness(:, i)*stiffness(i, j)
         end do
         answers%own(:, j) = column(j, :)
         answers%own(2, j) = answers%own(2, j) + stiffness(j, j)   ! which depends on the regime
         column(j, :) = 0.0_wp
         matters = sum(series%spring, series%row == j) &
                   *maxval(abs(column)/spread(part, 1, size(column, 1)), 2) > share*tolerance
         answers%dof = [answers%dof, pack([(i, i=1, size(matters))], matters)]
         answers%value = reshape([answers%value, &
                                  pack(transpose(column), spread(matters, 1, n_near))], &
                                 [n_near, size(answers%dof)])
         answers%first = [answers%first, size(answers%dof) + 1]
      end do
   end subroutine find_near

   !> Finds which joints may be answered locally: only those of one dof that no other joint holds,
   !> where the answer to a transition at the start of a part differs from the true one by little,
   !> and does not move the paths of other joints by more than they may be wrong within the part
   !> (8).
   subroutine find_local(damping, stiffness, series, tolerance, answers)
      real(wp), intent(in), dimension(:, :) :: damping, stiffness   !! C^, K^ with stuck joints
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_answers), intent(inout) :: answers
      real(wp), parameter :: share = 5.0e-2_wp        !! of the tolerance, for one transition
      real(wp), parameter :: most_place = 10.0_wp     !! of the tolerance: the path is a tenth part
      integer, parameter :: first_power = 4           !! of the answers of others
      real(wp), parameter :: most_shift = 1.0e-7_wp   !! a tenth of the margin of guards (5)
      real(wp) :: error, shift(size(damping, 1))
      integer :: i, j

      allocate (answers%free_span(size(series%row), size(series%row)), source=1.0_wp)
      allocate (answers%is_local(size(series%row)), source=.false.)
      do j = 1, size(series%row)
         i = series%row(j)
         if (i > series%n_dof .or. count(series%row == i) > 1) cycle
         if (any(series%links%column == i)) cycle
         call compare_answers(answers, series%degree, damping, stiffness, i, series%spring(j), &
                              error, shift)
         associate (least => most_place*tolerance)   ! of links no matter what: they are not local
            answers%free_span(:, j) = (least/max(least, shift(min(series%row, series%n_dof)))) &
                                      **(1.0_wp/first_power)
         end associate
         answers%is_local(j) = error <= share*tolerance .and. maxval(shift) <= most_shift .and. &
                               maxval(shift)*maxval(series%spring)/6.0_wp <= 2.0_wp*share*tolerance
      end do
   end subroutine find_local

   !> Compares the local answer of a dof to the path t + t^2 of its joint with the series of all
   !> dofs: its largest error at the end of the part, and the displacements of the others.
   pure subroutine compare_answers(answers, degree, damping, stiffness, dof, spring, error, &
                                   shift)
      type(local_answers), intent(in) :: answers
      integer, intent(in) :: degree
      real(wp), intent(in), dimension(:, :) :: damping, stiffness   !! C^, K^ with stuck joints
      integer, intent(in) :: dof
      real(wp), intent(in) :: spring
      real(wp), intent(out) :: error, shift(:)   !! shift (dof)
      real(wp), parameter :: negligible = 1.0e-18_wp
      real(wp), dimension(size(damping, 1), 1:degree) :: d, local
      real(wp) :: follow
      integer :: e, i, k, s

      d = 0.0_wp
      local = 0.0_wp
      do k = 3, degree
         if (k <= 4) d(dof, k) = spring/(k*(k - 1))
         do i = 1, size(damping, 1)
            if (max(abs(d(i, k - 1)), abs(d(i, k - 2))) < negligible) cycle
            d(:, k) = d(:, k) - damping(:, i)*(d(i, k - 1)/k) &
                      - stiffness(:, i)*(d(i, k - 2)/(k*(k - 1)))
         end do
         if (k <= 4) local(dof, k) = spring/(k*(k - 1))
         local(dof, k) = local(dof, k) - stiffness(dof, dof)*local(dof, k - 2)/(k*(k - 1))
         do s = 1, min(n_near, degree - 4, k - 3)
            follow = local(dof, k - s)*fall(k - s, s)
            local(dof, k) = local(dof, k) + answers%own(s, dof)*follow
            do e = answers%first(dof), answers%first(dof + 1) - 1
               local(answers%dof(e), k) = local(answers%dof(e), k) + answers%value(s, e)*follow
            end do
         end do
      end do
      error = max(maxval(abs(sum(d - local, 2))), &
                  maxval(abs(matmul(d - local, [(real(k, wp), k=1, degree)]))))
      d(dof, :) = 0.0_wp
      shift = abs(sum(d, 2))
   end subroutine compare_answers

end module dynamics_exact_local_answers
