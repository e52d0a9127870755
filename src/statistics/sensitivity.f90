!> Sensitivity: share of a response's variance that is due to each friction value, formula (13) of
!> docs/regression.md.
module statistics_sensitivity
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply, solve_positive_definite
   use statistics_estimates, only: estimates_type, stated_error, statistic_type
   use statistics_fit, only: fit_type
   use statistics_influences, only: case_law_type
   use statistics_surrogate, only: average_features, surrogate_type
   implicit none(type, external)
   private
   public :: find_sensitivity

   integer, parameter :: degree = 3   !! degree of the cubic fit in each input

contains

   !> Computes the sensitivities. A (point, term) holds the centred powers of the inputs, W the
   !> weights of the points. With u = A'W G and b = (A'W A)^-1 u, Cov(f_j, G) is the sum of u b over
   !> the powers of input j. Influences follow from u and b of each feature of G.
   subroutine find_sensitivity(surrogate, fit, law, values, deviation, share, error)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit                !! its first output is used
      type(case_law_type), intent(in) :: law
      real(wp), intent(in) :: values(:)                !! (point) G
      type(estimates_type), intent(in) :: deviation    !! result of law_deviation
      type(statistic_type), intent(out) :: share(:)    !! (input) S_j
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: a(:, :), weighted(:, :), square(:, :), row_covariance(:, :)
      real(wp), allocatable :: feature_covariance(:, :), u_all(:, :), b_all(:, :)
      real(wp), allocatable :: influence(:), slope(:)
      real(wp) :: root_kappa, variance
      integer :: d, i, j, k, n_terms

      d = size(law%x, 2)
      n_terms = degree*d
      allocate (a(size(values), n_terms), square(n_terms, n_terms))
      do j = 1, d
         do k = 1, degree
            a(:, degree*(j - 1) + k) = law%x(:, j)**k
         end do
      end do
      allocate (weighted, mold=a)
      do k = 1, n_terms
         a(:, k) = a(:, k) - dot_product(law%weight, a(:, k))
         weighted(:, k) = law%weight*a(:, k)
      end do
      call multiply(a, weighted, square, transposes_a=.true.)
      do k = 1, n_terms
         square(k, k) = square(k, k)*(1.0_wp + 1.0e-10_wp)   ! inputs may be dependent
      end do
      allocate (row_covariance(size(law%rows, 1), n_terms))
      allocate (feature_covariance(size(surrogate%eigenvalue), n_terms))
      allocate (u_all(n_terms, 1 + size(surrogate%eigenvalue)))   ! u of G, then of each feature
      call multiply(law%rows, weighted, row_covariance)
      call average_features(surrogate, row_covariance, 0.0_wp, feature_covariance)
      u_all(:, 1) = matmul(values - dot_product(law%weight, values), weighted)
      u_all(:, 2:) = transpose(feature_covariance)
      allocate (b_all, source=u_all)   ! the same for b
      call solve_positive_definite(square, b_all, error)
      if (allocated(error)) return
      variance = deviation%value(1)**2
      root_kappa = sqrt(sqrt(deviation%kappa(1)))   ! removes 1/kappa^(1/4) from influences
      allocate (influence(size(fit%residual, 1)))
      do j = 1, d
         i = degree*(j - 1)
         associate (u => u_all(i + 1:i + degree, :), b => b_all(i + 1:i + degree, :))
            share(j)%value = dot_product(u(:, 1), b(:, 1))/variance
            slope = fit%shrink(:, 1)*(matmul(b(:, 1), u(:, 2:)) + matmul(u(:, 1), b(:, 2:)))
         end associate
         do i = 1, size(influence)
            influence(i) = surrogate%enlargement*fit%residual(i, 1) &
                           *dot_product(surrogate%feature(i, :), slope)/variance &
                           - 2.0_wp*share(j)%value*root_kappa*deviation%influence(i, 1) &
                           /deviation%value(1)
         end do
         share(j)%error = stated_error(influence, 0.0_wp, size(influence))
      end do
   end subroutine find_sensitivity

end module statistics_sensitivity
