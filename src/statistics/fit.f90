!> Fits of outputs by the features of a surrogate, and their leave-one-out residuals: formulas (3)
!> and (4) of docs/regression.md.
module statistics_fit
   use core_kinds, only: wp
   use numerics_lapack, only: multiply
   use statistics_surrogate, only: evenly_spaced, n_ratios, noise_ratios, surrogate_type
   implicit none(type, external)
   private
   public :: fit_type, fit_outputs, hidden_variance, predict, variance_at_samples

   !> kappa is computed for 4 outputs of a fit, from the pairs of 64 samples with all
   integer, parameter, public :: most_pair_outputs = 4, most_pair_samples = 64

   !> Outputs as functions G of the inputs, and leave-one-out residuals.
   type :: fit_type
      real(wp), allocatable :: mean(:)             !! (output)
      real(wp), allocatable :: shrink(:, :)        !! (feature, output) s_k = ev_k/(ev_k + ratio)
      real(wp), allocatable :: coefficient(:, :)   !! (feature, output) of phi
      integer, allocatable :: noise_ratio(:)       !! (output) number of its noise ratio
      !> (landmark, output), (output): G(x) = row_coefficient'k(landmark, x) + constant
      real(wp), allocatable, private :: row_coefficient(:, :), constant(:)
      real(wp), allocatable :: residual(:, :)      !! (sample, output) e_i, leave-one-out
      real(wp), allocatable :: one_minus_h(:, :)   !! (sample, output) 1 - h_ii
      real(wp), allocatable :: predicted(:, :)     !! (sample, output) y_i - e_i
      integer, allocatable :: pair_outputs(:)      !! outputs whose kappa is computed
      integer, allocatable :: pair_samples(:)      !! samples whose pairs with all are used
      !> (sample j, pair sample i, pair output): change of e_i by leaving out j also, and of e_j by
      !> leaving out i also
      real(wp), allocatable :: change_i(:, :, :), change_j(:, :, :)
   end type fit_type

contains

   !> Fits the outputs, each with the noise ratio of least generalised cross-validation.
   subroutine fit_outputs(surrogate, outputs, fit)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: outputs(:, :)   !! (sample, output)
      type(fit_type), intent(out) :: fit
      real(wp), allocatable :: square(:, :), y(:, :), projection(:, :)
      integer :: n, n_out, o, r

      n = size(outputs, 1)
      n_out = size(outputs, 2)
      fit%mean = sum(outputs, 1)/n
      allocate (fit%residual(n, n_out), fit%one_minus_h(n, n_out))
      allocate (projection(size(surrogate%eigenvalue), n_out))
      allocate (fit%shrink, mold=projection)
      allocate (fit%noise_ratio(n_out))
      allocate (y, source=outputs - spread(fit%mean, 1, n))
      call multiply(surrogate%feature, y, projection, transposes_a=.true.)
      do o = 1, n_out
         r = best_noise_ratio(surrogate%eigenvalue, projection(:, o), sum(y(:, o)**2), n)
         fit%shrink(:, o) = surrogate%eigenvalue/(surrogate%eigenvalue + noise_ratios(r))
         fit%noise_ratio(o) = r
      end do
      allocate (fit%coefficient, source=fit%shrink*projection)   ! not by =, which would read bounds
      allocate (fit%row_coefficient(size(surrogate%transform, 1), n_out))
      call multiply(surrogate%transform, fit%coefficient, fit%row_coefficient)
      fit%constant = fit%mean - matmul(surrogate%offset, fit%coefficient)
      square = surrogate%feature**2
      call multiply(surrogate%feature, fit%coefficient, fit%residual)
      call multiply(square, fit%shrink, fit%one_minus_h)   ! h_ii - 1/n
      fit%one_minus_h = 1.0_wp - (fit%one_minus_h + 1.0_wp/n)
      fit%residual = (y - fit%residual)/fit%one_minus_h
      fit%predicted = outputs - fit%residual
      call find_pairs(surrogate, fit)
   end subroutine fit_outputs

   !> Computes the changes of the residuals by leaving out a second sample: e_i becomes
   !> (e_i + h_ij e_j/(1 - h_i))/(1 - h_ij^2/((1 - h_i)(1 - h_j))), with the leverages
   !> h_ij = 1/n + sum_k s_k V_ik V_jk.
   subroutine find_pairs(surrogate, fit)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(inout) :: fit
      real(wp), allocatable :: pair_leverage(:, :), shrunk(:, :)
      real(wp) :: factor
      integer :: i, j, k, m, n, o

      n = size(fit%one_minus_h, 1)
      fit%pair_samples = evenly_spaced(n, most_pair_samples)
      fit%pair_outputs = evenly_spaced(size(fit%one_minus_h, 2), most_pair_outputs)
      allocate (fit%change_i(n, size(fit%pair_samples), size(fit%pair_outputs)))
      allocate (fit%change_j, mold=fit%change_i)
      allocate (pair_leverage(n, size(fit%pair_samples)))
      allocate (shrunk(size(surrogate%eigenvalue), size(fit%pair_samples)))
      do k = 1, size(fit%pair_outputs)
         o = fit%pair_outputs(k)
         shrunk = transpose(surrogate%feature(fit%pair_samples, :)) &
                  *spread(fit%shrink(:, o), 2, size(fit%pair_samples))
         call multiply(surrogate%feature, shrunk, pair_leverage)
         do m = 1, size(fit%pair_samples)
            i = fit%pair_samples(m)
            associate (e => fit%residual(:, o), rest => fit%one_minus_h(:, o), &
                       h => pair_leverage(:, m))
               !$omp simd
               do j = 1, n
                  h(j) = h(j) + 1.0_wp/n
                  factor = 1.0_wp/(1.0_wp - h(j)**2/(rest(i)*rest(j)))
                  fit%change_i(j, m, k) = factor*(e(i) + h(j)*e(j)/rest(i)) - e(i)
                  fit%change_j(j, m, k) = factor*(e(j) + h(j)*e(i)/rest(j)) - e(j)
               end do
            end associate
            fit%change_i(i, m, k) = 0.0_wp   ! a sample makes no pair with itself
            fit%change_j(i, m, k) = 0.0_wp
         end do
      end do
   end subroutine find_pairs

   !> Number of the noise ratio with the least generalised cross-validation.
   pure integer function best_noise_ratio(eigenvalue, projection, total, n)
      real(wp), intent(in) :: eigenvalue(:), projection(:)   !! (feature)
      real(wp), intent(in) :: total                          !! sum of squares of y - mean y
      integer, intent(in) :: n                               !! samples
      real(wp) :: shrink(size(eigenvalue)), score(n_ratios)
      integer :: r

      do r = 1, n_ratios
         shrink = eigenvalue/(eigenvalue + noise_ratios(r))
         score(r) = max(total - sum(shrink*(2.0_wp - shrink)*projection**2), 0.0_wp) &
                    /(n - 1 - sum(shrink))**2
      end do
      best_noise_ratio = minloc(score, 1)
   end function best_noise_ratio

   !> Computes G at points.
   subroutine predict(fit, rows, values)
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: rows(:, :)      !! (landmark, point) kernel
      real(wp), intent(out), contiguous :: values(:, :)   !! (point, output)
      integer :: o

      call multiply(rows, fit%row_coefficient, values, transposes_a=.true.)
      do o = 1, size(values, 2)
         values(:, o) = values(:, o) + fit%constant(o)
      end do
   end subroutine predict

   !> Variances of averages of the response about those of G over pairs of points, by the kernel, as
   !> far as the residuals do not show them: formula (14).
   function hidden_variance(surrogate, fit, weight, rest) result(variance)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: weight(:, :)   !! (point, output)
      real(wp), intent(in), contiguous :: rest(:, :)     !! (point, point) without its diagonal
      real(wp) :: variance(size(fit%mean))
      real(wp) :: product(size(weight, 1), size(weight, 2))

      call multiply(rest, weight, product)
      variance = sum(fit%residual**2*fit%one_minus_h, 1)/size(fit%residual, 1) &
                 *max(sum(weight*product, 1), 0.0_wp) &
                 /max(noise_ratios(fit%noise_ratio), surrogate%mean_rest)
   end function hidden_variance

   !> Mean over the samples of the variance of G at each of them from the others, over that of the
   !> noise, for each output: h/(1 - h), and the rest as in predict_variance.
   pure function variance_at_samples(surrogate, fit) result(variance)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp) :: variance(size(fit%mean))

      variance = sum(1.0_wp/fit%one_minus_h - 1.0_wp, 1)/size(fit%one_minus_h, 1) &
                 + surrogate%mean_rest/max(noise_ratios(fit%noise_ratio), surrogate%mean_rest)
   end function variance_at_samples

end module statistics_fit
