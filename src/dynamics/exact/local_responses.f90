!> Coefficients by which the dofs around a joint respond to its transitions (7), and the joints for
!> which (7) is accurate enough (8); see docs/exact_march.md.
module dynamics_exact_local_responses
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: local_responses
   use dynamics_exact_series, only: form_matrices, series_type, without_diagonal
   use dynamics_exact_transitions, only: integral, n_response_sums
   use numerics_lapack, only: multiply
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: find_responses

contains

   !> Finds the coefficients and the local joints, for a tolerance relative to the rms displacement.
   subroutine find_responses(structure, series, tolerance, responses)
      type(structure_type), intent(in) :: structure
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_responses), intent(out) :: responses
      real(wp), allocatable :: damping(:, :), stiffness(:, :)   ! C^, K^
      integer :: i, j, half

      call form_matrices(structure, series%h, damping, stiffness)
      do half = 1, 2   ! half the springs of the joints for (7), all of them for (8)
         do j = 1, structure%n_joints
            i = series%row(j)
            if (i <= structure%n_dof) stiffness(i, i) = stiffness(i, i) + 0.5_wp*series%spring(j)
         end do
         if (half == 1) call find_near(damping, stiffness, series, tolerance, responses)
      end do
      call find_local(damping, stiffness, series, tolerance, responses)
   end subroutine find_responses

   !> Finds the columns of N_1 .. N_4 (7): -C^, C^ C~ - K^, C^ K~ + K^ C~, K^ K~ with C~ and K~
   !> without diagonals. Entries of other dofs are kept if they are not negligible.
   subroutine find_near(damping, stiffness, series, tolerance, responses)
      !> C^, K^ with half the springs of the joints
      real(wp), intent(in), dimension(:, :), contiguous :: damping, stiffness
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_responses), intent(inout) :: responses
      real(wp), parameter :: share = 1.0e-4_wp   !! share of the tolerance for one entry
      !> d_3 = kappa/6 adds kappa |N_s,ji|/divisor(s) to a velocity at the end of a part
      real(wp), parameter :: divisor(*) = [24.0_wp, 120.0_wp, 720.0_wp, 5040.0_wp]/4.0_wp
      real(wp) :: column(size(damping, 1), n_response_sums)
      real(wp), allocatable, dimension(:, :) :: off_damping, squared   ! C~, C^ C~
      type(sparse_matrix) :: springs                                   ! K^
      logical :: matters(size(damping, 1))
      integer :: i, j

      allocate (off_damping, source=without_diagonal(damping))
      allocate (squared, mold=damping)
      call multiply(damping, off_damping, squared)
      springs = sparse_of(stiffness)
      allocate (responses%dof(0), responses%value(n_response_sums, 0))
      allocate (responses%own(n_response_sums, series%n_rows), source=0.0_wp)
      responses%first = [1]
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
         responses%own(:, j) = column(j, :)
         ! K^_jj, which depends on the regime, is subtracted at the transition
         responses%own(2, j) = responses%own(2, j) + stiffness(j, j)
         column(j, :) = 0.0_wp
         matters = sum(series%spring, series%row == j) &
                   *maxval(abs(column)/spread(divisor, 1, size(column, 1)), 2) > share*tolerance
         responses%dof = [responses%dof, pack([(i, i=1, size(matters))], matters)]
         responses%value = reshape([responses%value, &
                                    pack(transpose(column), spread(matters, 1, n_response_sums))], &
                                   [n_response_sums, size(responses%dof)])
         responses%first = [responses%first, size(responses%dof) + 1]
      end do
   end subroutine find_near

   !> Finds the local joints (8): those alone on a dof without links, if the response to a
   !> transition at the start of a part has a small error and hardly moves the other dofs.
   subroutine find_local(damping, stiffness, series, tolerance, responses)
      real(wp), intent(in), dimension(:, :) :: damping, stiffness   !! C^, K^ with stuck joints
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: tolerance
      type(local_responses), intent(inout) :: responses
      real(wp), parameter :: share = 5.0e-2_wp        !! share of the tolerance for one transition
      real(wp), parameter :: most_place = 10.0_wp     !! bound of u over the tolerance (9)
      integer, parameter :: first_power = 4           !! first power of the response of other dofs
      real(wp), parameter :: most_shift = 1.0e-7_wp   !! a tenth of the margin of guards (5)
      real(wp) :: error, shift(size(damping, 1))
      integer :: i, j

      allocate (responses%undisturbed_span(size(series%row), size(series%row)), source=1.0_wp)
      allocate (responses%is_local(size(series%row)), source=.false.)
      do j = 1, size(series%row)
         i = series%row(j)
         if (i > series%n_dof .or. count(series%row == i) > 1) cycle
         if (any(series%links%column == i)) cycle
         call compare_responses(responses, series%degree, damping, stiffness, i, series%spring(j), &
                                error, shift)
         associate (least => most_place*tolerance)   ! links have any value: they are not local
            responses%undisturbed_span(:, j) = &
               (least/max(least, shift(min(series%row, series%n_dof))))**(1.0_wp/first_power)
         end associate
         responses%is_local(j) = &
            error <= share*tolerance .and. maxval(shift) <= most_shift .and. &
            maxval(shift)*maxval(series%spring)/6.0_wp <= 2.0_wp*share*tolerance
      end do
   end subroutine find_local

   !> Compares the response (6), (7) to the path t + t^2 of a joint with the series of all dofs:
   !> finds its largest error at the end of the part, and the displacements of the other dofs.
   pure subroutine compare_responses(responses, degree, damping, stiffness, dof, spring, error, &
                                     shift)
      type(local_responses), intent(in) :: responses
      integer, intent(in) :: degree
      real(wp), intent(in), dimension(:, :) :: damping, stiffness   !! C^, K^ with stuck joints
      integer, intent(in) :: dof
      real(wp), intent(in) :: spring
      real(wp), intent(out) :: error, shift(:)   !! shift (dof)
      real(wp), parameter :: negligible = 1.0e-18_wp
      real(wp), dimension(size(damping, 1), 1:degree) :: d, local
      real(wp) :: driven
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
         do s = 1, min(n_response_sums, degree - 4, k - 3)
            driven = local(dof, k - s)*integral(k - s, s)
            local(dof, k) = local(dof, k) + responses%own(s, dof)*driven
            do e = responses%first(dof), responses%first(dof + 1) - 1
               local(responses%dof(e), k) = local(responses%dof(e), k) &
                                            + responses%value(s, e)*driven
            end do
         end do
      end do
      error = max(maxval(abs(sum(d - local, 2))), &
                  maxval(abs(matmul(d - local, [(real(k, wp), k=1, degree)]))))
      d(dof, :) = 0.0_wp
      shift = abs(sum(d, 2))
   end subroutine compare_responses

end module dynamics_exact_local_responses
