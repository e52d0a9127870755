!> Which friction value the scatter of a response is due to: formula (13) of docs/regression.md.
module statistics_sensitivity
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply, solve_positive_definite
   use statistics_estimates, only: estimates_type, stated_error, statistic_type
   use statistics_influences, only: view_type
   use statistics_surrogate, only: average_features, fit_type, surrogate_type
   implicit none(type, external)
   private
   public :: find_sensitivity

   integer, parameter :: degree = 3

contains

   !> Computes the sensitivities. With u = A'W G, b = (A'W A)^-1 u: Cov(f_j, G) is the sum of u b
   !> over the polynomials of input j. Leaving out a sample changes u as it changes the
   !> coefficients of the features.
   subroutine find_sensitivity(surrogate, fit, view, values, deviation, share, error)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit                !! of one output
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:)                !! (point) G
      type(estimates_type), intent(in) :: deviation    !! of the output, by law_deviation
      type(statistic_type), intent(out) :: share(:)    !! (input) of the variance
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: a(:, :), weighted(:, :), square(:, :), of_rows(:, :)
      real(wp), allocatable :: of_features(:, :), to_u(:, :), to_b(:, :), step(:), functional(:)
      real(wp) :: of_pairs, variance
      integer :: d, i, j, k, n_terms

      d = size(view%x, 2)
      n_terms = degree*d
      allocate (a(size(values), n_terms), square(n_terms, n_terms))
      do j = 1, d
         do k = 1, degree
            a(:, degree*(j - 1) + k) = view%x(:, j)**k
         end do
      end do
      allocate (weighted, mold=a)
      do k = 1, n_terms
         a(:, k) = a(:, k) - dot_product(view%weight, a(:, k))
         weighted(:, k) = view%weight*a(:, k)
      end do
      call multiply(a, weighted, square, transposes_a=.true.)
      do k = 1, n_terms
         square(k, k) = square(k, k)*(1.0_wp + 1.0e-10_wp)   ! inputs may depend on each other
      end do
      allocate (of_rows(size(view%rows, 1), n_terms))
      allocate (of_features(size(surrogate%eigenvalue), n_terms))
      allocate (to_u(n_terms, 1 + size(surrogate%eigenvalue)))   ! u, its changes with features
      call multiply(view%rows, weighted, of_rows)
      call average_features(surrogate, of_rows, 0.0_wp, of_features)
      to_u(:, 1) = matmul(values - dot_product(view%weight, values), weighted)
      to_u(:, 2:) = transpose(of_features)
      allocate (to_b, source=to_u)   ! b and its changes
      call solve_positive_definite(square, to_b, error)
      if (allocated(error)) return
      variance = deviation%value(1)**2
      of_pairs = sqrt(sqrt(deviation%kappa(1)))   ! shares take pairs as they are
      allocate (step(size(fit%residual, 1)))
      do j = 1, d
         i = degree*(j - 1)
         associate (u => to_u(i + 1:i + degree, :), b => to_b(i + 1:i + degree, :))
            share(j)%value = dot_product(u(:, 1), b(:, 1))/variance
            functional = fit%shrink(:, 1)*(matmul(b(:, 1), u(:, 2:)) + matmul(u(:, 1), b(:, 2:)))
         end associate
         do i = 1, size(step)
            step(i) = surrogate%enlargement*fit%residual(i, 1) &
                      *dot_product(surrogate%feature(i, :), functional)/variance &
                      - 2.0_wp*share(j)%value*of_pairs*deviation%influence(i, 1) &
                        /deviation%value(1)
         end do
         share(j)%error = stated_error(step, 0.0_wp, size(step))
      end do
   end subroutine find_sensitivity

end module statistics_sensitivity
