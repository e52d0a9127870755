!> Influences of samples on averages of a fit G over a law, and the variance that they make:
!> formulas (4), (7) and (8) of docs/regression.md.
module statistics_influences
   use core_kinds, only: wp
   use numerics_lapack, only: multiply
   use statistics_estimates, only: estimates_type
   use statistics_law, only: law_type
   use statistics_surrogate, only: find_squares, fit_type, rows_of, surrogate_type
   implicit none(type, external)
   private
   public :: view_type, excess_of, find_weights, kappa_of, scale_influences, thin_view, view_law, &
             weigh_residuals, width_of, width_of_densities

   integer, parameter, public :: thinning = 4   !! of the points for means of exponentials
   real(wp), parameter :: widest = 3.0_wp   !! E that is allowed for

   !> A law as a surrogate sees it, and which of the samples were drawn from it.
   type, extends(law_type) :: view_type
      real(wp), allocatable :: rows(:, :)       !! (landmark, point) of the kernel
      integer :: first = 0, last = 0            !! samples of the law
      !> Rows of some points (thin_view), squares of their features (feature, point), and what these
      !> leave of k(x, x) (point).
      real(wp), allocatable :: some_rows(:, :), some_square(:, :), rest(:)
   end type view_type

contains

   !> Computes the kernel of a surrogate at the points of the law.
   subroutine view_law(surrogate, first, last, view)
      type(surrogate_type), intent(in) :: surrogate
      integer, intent(in) :: first, last
      type(view_type), intent(inout) :: view   !! the memory of another law's rows serves again

      call rows_of(surrogate, view%x, view%rows)
      view%first = first
      view%last = last
   end subroutine view_law

   !> Adds what means of exponentials need of some points.
   subroutine thin_view(surrogate, view)
      type(surrogate_type), intent(in) :: surrogate
      type(view_type), intent(inout) :: view

      view%some_rows = view%rows(:, ::thinning)
      call find_squares(surrogate, view%x(::thinning, :), view%some_rows, view%some_square, &
                        view%rest)
   end subroutine thin_view

   !> E: variance of a function of G over the law relative to that over the samples, by predictions
   !> of both; at least 1, at most 3. A fit lacks a tail that neither the case's samples nor the
   !> pool's have, plain sampling one that the case's do not.
   pure function width_of(view, values, predicted) result(width)
      type(view_type), intent(in) :: view
      real(wp), intent(in), contiguous :: values(:)      !! (point)
      real(wp), intent(in), contiguous :: predicted(:)   !! (sample)
      real(wp) :: width(2)                               !! of the fit, of plain sampling
      real(wp) :: mean, of_own, of_pool, over_law
      integer :: m

      mean = 0.0_wp
      over_law = 0.0_wp
      !$omp simd reduction(+:mean, over_law)
      do m = 1, size(values)
         mean = mean + view%weight(m)*values(m)
         over_law = over_law + view%weight(m)*values(m)**2
      end do
      over_law = over_law - mean**2
      of_own = variance(predicted(view%first:view%last))
      of_pool = max(of_own, variance(predicted))
      width = 1.0_wp
      if (of_own > 0.0_wp) &
         width = max(1.0_wp, min(over_law/[of_pool, of_own], widest))
   end function width_of

   !> E of a mean density: its variance over the law, by G and the variance v of G, relative to that
   !> over the case's samples, each over the square of its mean.
   pure real(wp) function width_of_densities(weight, share, growth, y) result(width)
      real(wp), intent(in), contiguous :: weight(:)   !! (some of the points) their sum is 1
      real(wp), intent(in), contiguous :: share(:)    !! (point) in the mean of exp(G), sum 1
      real(wp), intent(in), contiguous :: growth(:)   !! (point) exp(v/2)
      real(wp), intent(in), contiguous :: y(:)        !! (own sample)
      real(wp) :: of_samples, over_law

      of_samples = variance(y)/(sum(y)/size(y))**2
      over_law = sum(share**2/weight*growth**4)/dot_product(share, growth)**2 - 1.0_wp
      width = 1.0_wp
      if (of_samples > 0.0_wp) width = max(1.0_wp, min(over_law/of_samples, widest))
   end function width_of_densities

   pure real(wp) function variance(values)
      real(wp), intent(in) :: values(:)

      variance = sum((values - sum(values)/size(values))**2)/(size(values) - 1)
   end function variance

   !> Roots of what a law wider than its samples makes of the variances J/sqrt(kappa) and of plain
   !> sampling.
   pure function excess_of(factor, kappa) result(excess)
      real(wp), intent(in) :: factor(2)   !! F of the fit, of plain sampling
      real(wp), intent(in) :: kappa
      real(wp) :: excess(2)               !! of the fit, of plain sampling

      excess = sqrt([1.0_wp + sqrt(kappa)*(factor(1) - 1.0_wp), factor(2)])
   end function excess_of

   !> Computes the weights of the samples' residuals in averages of G, constant/n + sum_k V_ik s_k
   !> average_k.
   subroutine find_weights(surrogate, fit, average, constant, weight)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: average(:, :)    !! (feature, output) of phi
      real(wp), intent(in) :: constant                     !! the same average of 1
      real(wp), allocatable, intent(out) :: weight(:, :)   !! (sample, output)
      real(wp) :: shrunk(size(average, 1), size(average, 2))

      allocate (weight(size(fit%residual, 1), size(average, 2)))
      shrunk = fit%shrink*average
      call multiply(surrogate%feature, shrunk, weight)
      weight = weight + constant/size(weight, 1)
   end subroutine find_weights

   !> Turns weights of the samples' residuals into influences, as their variance by pairs is stated.
   subroutine weigh_residuals(surrogate, fit, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(estimates_type), intent(inout) :: estimate

      estimate%kappa = kappa_of(fit, estimate%influence)
      estimate%influence = fit%residual*estimate%influence
      call scale_influences(surrogate, estimate)
   end subroutine weigh_residuals

   !> kappa of each output, from the weights of the samples' residuals: that of the last judged
   !> output up to it.
   pure function kappa_of(fit, weight) result(kappa)
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: weight(:, :)   !! (sample, output)
      real(wp) :: kappa(size(weight, 2))
      integer :: k

      do k = 1, size(fit%judged)
         kappa(fit%judged(k):) = 1.0_wp + share_of_pairs(fit, k, weight(:, fit%judged(k)))
      end do
   end function kappa_of

   !> Scales influences such that their squares are J/sqrt(kappa) n/(n - p).
   pure subroutine scale_influences(surrogate, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(estimates_type), intent(inout) :: estimate
      integer :: o

      do o = 1, size(estimate%kappa)
         estimate%influence(:, o) = estimate%influence(:, o) &
                                    *(surrogate%enlargement/sqrt(sqrt(estimate%kappa(o))))
      end do
   end subroutine scale_influences

   !> 2P/J from the pairs of some samples with all: Q_ij is what leaving out both changes in
   !> w_i e_i + w_j e_j.
   pure real(wp) function share_of_pairs(fit, k, weight)
      type(fit_type), intent(in) :: fit
      integer, intent(in) :: k                        !! of the judged outputs
      real(wp), intent(in), contiguous :: weight(:)   !! (sample) w
      real(wp) :: of_one(size(weight)), pairs
      integer :: j, m

      of_one = weight*fit%residual(:, fit%judged(k))
      pairs = 0.0_wp
      do m = 1, size(fit%some)
         associate (of_i => weight(fit%some(m)), change => fit%change(:, m, k), &
                    other => fit%other_change(:, m, k))
            !$omp simd reduction(+:pairs)
            do j = 1, size(weight)
               pairs = pairs + (of_i*change(j) + weight(j)*other(j))**2
            end do
         end associate
      end do
      share_of_pairs = 0.0_wp
      if (any(abs(of_one) > 0.0_wp)) &
         share_of_pairs = pairs*size(weight)/(size(fit%some)*sum(of_one**2))
   end function share_of_pairs

end module statistics_influences
