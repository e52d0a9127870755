!> Influences of the samples on averages of a fit G over the law of a case, and the factors on them
!> for pairs of samples and for tails of the law: formulas (4), (7) and (8) of docs/regression.md.
module statistics_influences
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply
   use statistics_estimates, only: estimates_type
   use statistics_fit, only: fit_type, hidden_variance, variance_at_samples
   use statistics_law, only: choose_points, law_type, n_points
   use statistics_pool, only: pool_type
   use statistics_surrogate, only: find_kernel_rows, find_rest_between, predict_variance, &
                                   surrogate_type
   implicit none(type, external)
   private
   public :: add_hidden_errors, case_law_type, density_tail_ratio, extrapolation_of, &
             find_influences, find_weights, kappa_of, prepare_law, prepare_thin_points, &
             scale_by_pairs, tail_factors, tail_ratio

   !> for means of exponentials the variance of G is computed at every 4th point
   integer, parameter, public :: thinning = 4
   !> pairs of every 16th point stand for those of a law without samples
   integer, parameter, public :: pair_thinning = 16
   real(wp), parameter :: largest_ratio = 4.0_wp           !! upper limit of E
   real(wp), parameter :: largest_density_ratio = 3.0_wp   !! the same for mean densities

   !> Law of a case: its points, the kernel at them, and the samples that were drawn from it.
   type, extends(law_type) :: case_law_type
      real(wp), allocatable :: rows(:, :)       !! (landmark, point) kernel
      integer :: first = 0, last = 0            !! samples of the case in the pool
      integer :: n_samples = 0                  !! samples of the case, in the pool and beyond
      logical :: has_samples = .true.           !! false: the samples are those of other laws
      !> (sample) share of the law that a sample of the pool stands for; their sum is 1
      real(wp), allocatable :: share(:)
      real(wp), allocatable :: thin_rows(:, :)       !! (landmark, every 4th point) kernel
      real(wp), allocatable :: thin_variance(:, :)   !! (every 4th point, noise ratio) v/tau^2
      !> (every 16th point), (every 16th point, every 16th point) of a law without samples: weight,
      !> their sum is 1; rest(x, x') of formula (14)
      real(wp), allocatable :: pair_weight(:), rest(:, :)
   end type case_law_type

contains

   !> Chooses the points of a case's law and computes the kernel between the landmarks and them.
   subroutine prepare_law(pool, case_number, surrogate, law, error)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: case_number
      type(surrogate_type), intent(in) :: surrogate
      type(case_law_type), intent(inout) :: law   !! memory of earlier rows is used again
      type(error_type), allocatable, intent(out) :: error

      law%first = pool%first(case_number)
      law%last = pool%last(case_number)
      law%n_samples = pool%n_samples(case_number)
      law%has_samples = pool%has_samples(case_number)
      call choose_points(pool%draws(case_number), surrogate%direction, n_points, law%law_type, &
                         error)
      if (allocated(error)) return
      call find_kernel_rows(surrogate, law%x, law%rows)
      law%share = spread(0.0_wp, 1, size(pool%x, 1))
      if (law%has_samples) then
         law%share(law%first:law%last) = 1.0_wp/(law%last - law%first + 1)
      else
         call add_shares(law, pool%x, surrogate%kernel%weight)
      end if
   end subroutine prepare_law

   !> Adds the weight of each point of a law to the share of the sample nearest to it, in the
   !> distance |w (x - x')| of the kernel.
   pure subroutine add_shares(law, x, weight)
      type(case_law_type), intent(inout) :: law
      real(wp), intent(in) :: x(:, :)     !! (sample, input) standardised
      real(wp), intent(in) :: weight(:)   !! (input) w
      real(wp) :: square(size(x, 1))      ! (sample) squared distance
      integer :: j, m

      do m = 1, size(law%weight)
         square = 0.0_wp
         do j = 1, size(weight)
            square = square + (weight(j)*(x(:, j) - law%x(m, j)))**2
         end do
         associate (share => law%share(minloc(square, 1)))
            share = share + law%weight(m)
         end associate
      end do
   end subroutine add_shares

   !> Adds the kernel and the variance of G at every 4th point, and what hidden errors need.
   subroutine prepare_thin_points(surrogate, law)
      type(surrogate_type), intent(in) :: surrogate
      type(case_law_type), intent(inout) :: law

      law%thin_rows = law%rows(:, ::thinning)
      call predict_variance(surrogate, law%x(::thinning, :), law%thin_rows, law%thin_variance)
      if (law%has_samples) return
      associate (weight => law%weight(::pair_thinning))
         law%pair_weight = weight/sum(weight)
      end associate
      call find_rest_between(surrogate, law%x(::pair_thinning, :), law%rows(:, ::pair_thinning), &
                             law%rest)
   end subroutine prepare_thin_points

   !> Mean variance of G over a law relative to that at the samples, for each output of a fit.
   pure function extrapolation_of(law, surrogate, fit) result(ratio)
      type(case_law_type), intent(in) :: law   !! with every 4th point
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp) :: ratio(size(fit%mean))
      integer :: o

      associate (weight => law%weight(::thinning)/sum(law%weight(::thinning)))
         ratio = [(dot_product(weight, law%thin_variance(:, fit%noise_ratio(o))), &
                   o=1, size(ratio))]/variance_at_samples(surrogate, fit)
      end associate
   end function extrapolation_of

   !> E of formula (8): variance of a function of G over the law relative to that over the samples,
   !> within 1..4. The samples are those of the case for plain sampling; for the fit those of the
   !> case or the pool, whichever have more variance.
   pure function tail_ratio(law, values, predicted) result(ratio)
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:)      !! (point) function of G
      real(wp), intent(in), contiguous :: predicted(:)   !! (sample) the same, leave-one-out
      real(wp) :: ratio(2)                               !! ratios for the fit and plain sampling
      real(wp) :: mean, own_variance, pool_variance, law_variance
      integer :: m

      mean = 0.0_wp
      law_variance = 0.0_wp
      !$omp simd reduction(+:mean, law_variance)
      do m = 1, size(values)
         mean = mean + law%weight(m)*values(m)
         law_variance = law_variance + law%weight(m)*values(m)**2
      end do
      law_variance = law_variance - mean**2
      own_variance = variance(predicted(law%first:law%last))
      pool_variance = max(own_variance, variance(predicted))
      ratio = 1.0_wp
      if (own_variance > 0.0_wp) &
         ratio = max(1.0_wp, min(law_variance/[pool_variance, own_variance], largest_ratio))
   end function tail_ratio

   !> E of a mean density, formula (8): relative variance of exp(G) over the law, with the variance
   !> v of G, over that of the case's samples; within 1..3.
   pure real(wp) function density_tail_ratio(weight, share, growth, y) result(ratio)
      real(wp), intent(in), contiguous :: weight(:)   !! (point), their sum is 1
      real(wp), intent(in), contiguous :: share(:)    !! (point) weight*exp(G) over its sum
      real(wp), intent(in), contiguous :: growth(:)   !! (point) exp(v/2)
      real(wp), intent(in), contiguous :: y(:)        !! (sample of the case)
      real(wp) :: sample_variance, law_variance

      sample_variance = variance(y)/(sum(y)/size(y))**2
      law_variance = sum(share**2/weight*growth**4)/dot_product(share, growth)**2 - 1.0_wp
      ratio = 1.0_wp
      if (sample_variance > 0.0_wp) &
         ratio = max(1.0_wp, min(law_variance/sample_variance, largest_density_ratio))
   end function density_tail_ratio

   pure real(wp) function variance(values)
      real(wp), intent(in) :: values(:)

      variance = sum((values - sum(values)/size(values))**2)/(size(values) - 1)
   end function variance

   !> Factors on standard errors that turn the variance J/sqrt(kappa) of a fit into
   !> J (1/sqrt(kappa) + F - 1), and J of plain sampling into F J.
   pure function tail_factors(factor, kappa) result(tail_factor)
      real(wp), intent(in) :: factor(2)   !! F for the fit, for plain sampling
      real(wp), intent(in) :: kappa
      real(wp) :: tail_factor(2)          !! factors for the fit and for plain sampling

      tail_factor = sqrt([1.0_wp + sqrt(kappa)*(factor(1) - 1.0_wp), factor(2)])
   end function tail_factors

   !> Computes the weights of the residuals in averages of G: [c_i] = constant/n
   !> + sum_k V_ik s_k average_k of formulas (4) and (5).
   subroutine find_weights(surrogate, fit, average, constant, weight)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: average(:, :)    !! (feature, output) average of phi
      real(wp), intent(in) :: constant                     !! the same average of 1
      real(wp), allocatable, intent(out) :: weight(:, :)   !! (sample, output)
      real(wp) :: shrunk(size(average, 1), size(average, 2))

      allocate (weight(size(fit%residual, 1), size(average, 2)))
      shrunk = fit%shrink*average
      call multiply(surrogate%feature, shrunk, weight)
      weight = weight + constant/size(weight, 1)
   end subroutine find_weights

   !> Adds to the bias what the residuals do not show of a law without samples, formula (14): the
   !> variance of the response about G by its kernel, and residuals alike around each sample.
   subroutine add_hidden_errors(surrogate, fit, law, weight, scale, estimate, share)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: weight(:, :)   !! (every 16th point, output) in an average
      real(wp), intent(in) :: scale(:)                   !! (output) estimate over the average
      type(estimates_type), intent(inout) :: estimate
      real(wp), intent(in), optional :: share(:, :)      !! (sample, output) in the same
      real(wp) :: variance(size(scale))

      variance = hidden_variance(surrogate, fit, weight, law%rest)
      if (present(share)) variance = variance + sum((share*fit%residual)**2, 1)
      estimate%bias = sign(hypot(estimate%bias, scale*sqrt(variance)), estimate%bias)
   end subroutine add_hidden_errors

   !> Turns weights of the residuals into influences, and computes kappa, or sets it to 1.
   subroutine find_influences(surrogate, fit, estimate, is_bound)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(estimates_type), intent(inout) :: estimate   !! weights in its influences
      logical, intent(in) :: is_bound                   !! true: J is the variance

      estimate%kappa = kappa_of(fit, estimate%influence)
      if (is_bound) estimate%kappa = 1.0_wp
      estimate%influence = fit%residual*estimate%influence
      call scale_by_pairs(surrogate, estimate)
   end subroutine find_influences

   !> kappa of each output, from the weights of the residuals. Computed for the pair outputs of the
   !> fit; others take that of the last pair output before them.
   pure function kappa_of(fit, weight) result(kappa)
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: weight(:, :)   !! (sample, output)
      real(wp) :: kappa(size(weight, 2))
      integer :: k, o

      do k = 1, size(fit%pair_outputs)
         o = fit%pair_outputs(k)
         kappa(o:) = 1.0_wp + share_of_pairs(fit, k, weight(:, o))
      end do
   end function kappa_of

   !> Scales influences such that the sum of their squares is J/sqrt(kappa) n/(n - p).
   pure subroutine scale_by_pairs(surrogate, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(estimates_type), intent(inout) :: estimate
      integer :: o

      do o = 1, size(estimate%kappa)
         estimate%influence(:, o) = estimate%influence(:, o) &
                                    *(surrogate%enlargement/sqrt(sqrt(estimate%kappa(o))))
      end do
   end subroutine scale_by_pairs

   !> 2 P/J of formula (7), from the pairs of the pair samples with all: Q_ij is the change of
   !> w_i e_i + w_j e_j by leaving out both samples.
   pure real(wp) function share_of_pairs(fit, k, weight)
      type(fit_type), intent(in) :: fit
      integer, intent(in) :: k                        !! number among the pair outputs
      real(wp), intent(in), contiguous :: weight(:)   !! (sample) w
      real(wp) :: part(size(weight)), pair_sum
      integer :: j, m

      part = weight*fit%residual(:, fit%pair_outputs(k))
      pair_sum = 0.0_wp
      do m = 1, size(fit%pair_samples)
         associate (weight_i => weight(fit%pair_samples(m)), change_i => fit%change_i(:, m, k), &
                    change_j => fit%change_j(:, m, k))
            !$omp simd reduction(+:pair_sum)
            do j = 1, size(weight)
               pair_sum = pair_sum + (weight_i*change_i(j) + weight(j)*change_j(j))**2
            end do
         end associate
      end do
      share_of_pairs = 0.0_wp
      if (any(abs(part) > 0.0_wp)) &
         share_of_pairs = pair_sum*size(weight)/(size(fit%pair_samples)*sum(part**2))
   end function share_of_pairs

end module statistics_influences
