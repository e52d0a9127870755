!> A response as a function of its friction values, from a few samples: kriging, written as a ridge
!> regression on the leading eigenvectors of the kernel's matrix over the samples.
!>
!> With K the kernel over n samples, rows and columns freed of their means, K V = V diag(ev):
!> phi_k(x) = V_k'(k(x) - mean of the rows of K)/ev_k are orthonormal over the samples, and
!> G(x) = mean y + sum_k s_k (V_k'y) phi_k(x), s_k = ev_k/(ev_k + ratio), is the kriging prediction
!> for the noise ratio. With all eigenvectors it is that of the kernel with a constant trend.
!> Leave-one-out residuals are e_i = (y_i - fit_i)/(1 - h_i), h_i = 1/n + sum_k s_k V_ik^2: leaving
!> sample i out is replacing y_i by y_i - e_i. The noise ratio of each output has the least
!> generalised cross-validation; kernel and weights of the inputs, shared by all outputs, the least
!> leave-one-out residuals over at most 128 samples.
module statistics_surrogate
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply, solve_positive_definite
   use statistics_kernel, only: kernel_rows, kernel_type, new_kernel
   implicit none(type, external)
   private
   public :: fit_type, surrogate_type, features_of, fit_outputs, learn_kernel, predict

   integer, parameter :: samples_of_choice = 128   !! that choose the kernel
   integer, parameter :: most_features = 160
   real(wp), parameter :: smallest_eigenvalue = 1.0e-10_wp   !! over the largest
   real(wp), parameter :: lengths(*) = [1.0_wp, 2.0_wp, 4.0_wp, 8.0_wp, 16.0_wp]
   real(wp), parameter :: powers(*) = [0.5_wp, 1.0_wp]   !! of the weights
   real(wp), parameter :: least_weight = 0.03_wp         !! over the largest
   integer, parameter :: n_ratios = 13
   real(wp), parameter :: noise_ratios(n_ratios) = &
                          10.0_wp**[-5.0_wp, -4.5_wp, -4.0_wp, -3.5_wp, -3.0_wp, -2.5_wp, &
                                    -2.0_wp, -1.5_wp, -1.0_wp, -0.5_wp, 0.0_wp, 0.5_wp, 1.0_wp]

   !> The samples' inputs and the features over them.
   type :: surrogate_type
      type(kernel_type) :: kernel
      real(wp), allocatable :: x(:, :)           !! (sample, input) standardised
      real(wp), allocatable :: feature(:, :)     !! (sample, feature) V
      real(wp), allocatable :: eigenvalue(:)     !! (feature)
      real(wp), allocatable :: direction(:)      !! (input) along which the outputs vary most
      real(wp), allocatable, private :: row_mean(:)   !! (sample) of K
   end type surrogate_type

   !> Outputs as functions of the inputs.
   type :: fit_type
      real(wp), allocatable :: mean(:)             !! (output)
      real(wp), allocatable :: shrink(:, :)        !! (feature, output) s
      real(wp), allocatable :: coefficient(:, :)   !! (feature, output) of phi
      real(wp), allocatable :: residual(:, :)      !! (sample, output) leave-one-out
      real(wp), allocatable :: predicted(:, :)     !! (sample, output) y - residual
   end type fit_type

contains

   !> Chooses the kernel for some outputs and finds the features of all samples.
   subroutine learn_kernel(x, outputs, surrogate, error)
      real(wp), intent(in), contiguous :: x(:, :)         !! (sample, input) standardised
      real(wp), intent(in), contiguous :: outputs(:, :)   !! (sample, output)
      type(surrogate_type), intent(out) :: surrogate
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: proportion(size(x, 2)), score, best
      real(wp) :: slope(size(x, 2), size(outputs, 2))
      real(wp), allocatable :: y(:, :), some_x(:, :), some_y(:, :)
      type(kernel_type) :: kernel
      integer, allocatable :: chosen(:)
      integer :: i, k

      call standardise(outputs, y)
      call find_slopes(x, y, slope, error)
      if (.not. allocated(error)) call find_direction(slope, surrogate%direction, error)
      if (allocated(error)) return
      proportion = sqrt(sum(slope**2, 2)/size(y, 2))
      proportion = max(proportion/max(maxval(proportion), tiny(1.0_wp)), least_weight)
      associate (n => size(x, 1))
         chosen = [(1 + int((i - 1)*real(n, wp)/min(n, samples_of_choice)), &
                    i=1, min(n, samples_of_choice))]
      end associate
      some_x = x(chosen, :)
      some_y = y(chosen, :)
      best = huge(best)
      do k = 1, size(powers)
         do i = 1, size(lengths)
            kernel = new_kernel(proportion**powers(k), lengths(i))
            call judge(kernel, some_x, some_y, score, error)
            if (allocated(error)) return
            if (score < best) surrogate%kernel = kernel
            best = min(best, score)
         end do
      end do
      call find_features(x, most_features, surrogate, error)
   end subroutine learn_kernel

   !> Outputs with mean 0 and mean square 1, or 0 throughout.
   pure subroutine standardise(outputs, y)
      real(wp), intent(in) :: outputs(:, :)          !! (sample, output)
      real(wp), allocatable, intent(out) :: y(:, :)
      integer :: o

      allocate (y, source=outputs)
      do o = 1, size(y, 2)
         y(:, o) = y(:, o) - sum(y(:, o))/size(y, 1)
         if (any(abs(y(:, o)) > 0.0_wp)) y(:, o) = y(:, o)/sqrt(sum(y(:, o)**2)/size(y, 1))
      end do
   end subroutine standardise

   !> Coefficients of a linear ridge regression.
   subroutine find_slopes(x, y, slope, error)
      real(wp), intent(in), contiguous :: x(:, :), y(:, :)   !! (sample, input or output)
      real(wp), intent(out), contiguous :: slope(:, :)       !! (input, output)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: square(size(x, 2), size(x, 2))
      integer :: j

      call multiply(x, x, square, transposes_a=.true.)
      call multiply(x, y, slope, transposes_a=.true.)
      do j = 1, size(x, 2)
         square(j, j) = square(j, j) + size(x, 2)/5.0_wp   ! ridge: 1 for five inputs
      end do
      call solve_positive_definite(square, slope, error)
   end subroutine find_slopes

   !> First left singular vector of the slopes.
   subroutine find_direction(slope, direction, error)
      real(wp), intent(in), contiguous :: slope(:, :)   !! (input, output)
      real(wp), allocatable, intent(out) :: direction(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: square(size(slope, 1), size(slope, 1)), eigenvalue(size(slope, 1))

      call multiply(slope, transpose(slope), square)
      call find_symmetric_eigenvectors(square, eigenvalue, error)
      direction = square(:, size(eigenvalue))
   end subroutine find_direction

   !> Mean over the outputs of the logarithm of the least mean square of leave-one-out residuals.
   subroutine judge(kernel, x, outputs, score, error)
      type(kernel_type), intent(in) :: kernel
      real(wp), intent(in), contiguous :: x(:, :), outputs(:, :)   !! (sample, input or output)
      real(wp), intent(out) :: score
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: least = 1.0e-12_wp   ! relative mean square that is told apart
      type(surrogate_type) :: trial
      type(fit_type) :: fit
      real(wp) :: square(n_ratios, size(outputs, 2)), variance
      integer :: o, r

      trial%kernel = kernel
      call find_features(x, size(x, 1), trial, error)
      if (allocated(error)) return
      do r = 1, n_ratios
         call fit_outputs(trial, outputs, fit, only_ratio=r)
         square(r, :) = sum(fit%residual**2, 1)
      end do
      score = 0.0_wp
      do o = 1, size(outputs, 2)
         variance = sum((outputs(:, o) - sum(outputs(:, o))/size(x, 1))**2)
         score = score + log(minval(square(:, o))/max(variance, tiny(1.0_wp)) + least)
      end do
      score = score/size(outputs, 2)
   end subroutine judge

   !> Eigenvectors of the centred kernel over the samples, the largest first.
   subroutine find_features(x, most, surrogate, error)
      real(wp), intent(in), contiguous :: x(:, :)   !! (sample, input)
      integer, intent(in) :: most
      type(surrogate_type), intent(inout) :: surrogate
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: matrix(:, :)
      real(wp) :: eigenvalue(size(x, 1)), mean
      integer :: i, n, rank

      n = size(x, 1)
      allocate (matrix(n, n), surrogate%row_mean(n))
      call kernel_rows(surrogate%kernel, x, x, matrix)
      surrogate%x = x
      surrogate%row_mean(:) = sum(matrix, 1)/n
      mean = sum(surrogate%row_mean)/n
      do i = 1, n
         matrix(:, i) = matrix(:, i) - surrogate%row_mean - (surrogate%row_mean(i) - mean)
      end do
      call find_symmetric_eigenvectors(matrix, eigenvalue, error)
      if (allocated(error)) return
      rank = min(most, n - 1, count(eigenvalue > smallest_eigenvalue*eigenvalue(n)))
      surrogate%eigenvalue = eigenvalue(n:n - rank + 1:-1)
      surrogate%feature = matrix(:, n:n - rank + 1:-1)
   end subroutine find_features

   !> Fits outputs, each with its own noise ratio, or all with one.
   subroutine fit_outputs(surrogate, outputs, fit, only_ratio)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: outputs(:, :)   !! (sample, output)
      type(fit_type), intent(out) :: fit
      integer, intent(in), optional :: only_ratio         !! of noise_ratios
      real(wp), allocatable :: square(:, :), leverage(:, :), y(:, :), projection(:, :)
      integer :: n, o, n_out

      n = size(outputs, 1)
      n_out = size(outputs, 2)
      fit%mean = sum(outputs, 1)/n
      allocate (y(n, n_out), fit%residual(n, n_out), leverage(n, n_out))
      allocate (projection(size(surrogate%eigenvalue), n_out))
      allocate (fit%shrink, mold=projection)
      do o = 1, n_out
         y(:, o) = outputs(:, o) - fit%mean(o)
      end do
      call multiply(surrogate%feature, y, projection, transposes_a=.true.)
      do o = 1, n_out
         associate (ratio => noise_ratios(ratio_of(o)))
            fit%shrink(:, o) = surrogate%eigenvalue/(surrogate%eigenvalue + ratio)
         end associate
      end do
      fit%coefficient = fit%shrink*projection
      square = surrogate%feature**2
      call multiply(surrogate%feature, fit%coefficient, fit%residual)
      call multiply(square, fit%shrink, leverage)
      fit%residual = (y - fit%residual)/(1.0_wp - 1.0_wp/n - leverage)
      fit%predicted = outputs - fit%residual

   contains

      integer function ratio_of(o)
         integer, intent(in) :: o

         if (present(only_ratio)) then
            ratio_of = only_ratio
         else
            ratio_of = best_ratio(surrogate%eigenvalue, projection(:, o), sum(y(:, o)**2), n)
         end if
      end function ratio_of

   end subroutine fit_outputs

   !> The noise ratio with the least generalised cross-validation.
   pure integer function best_ratio(eigenvalue, projection, total, n)
      real(wp), intent(in) :: eigenvalue(:), projection(:)   !! (feature)
      real(wp), intent(in) :: total                          !! square of the centred output
      integer, intent(in) :: n                               !! samples
      real(wp) :: shrink(size(eigenvalue)), score(n_ratios)
      integer :: r

      do r = 1, n_ratios
         shrink = eigenvalue/(eigenvalue + noise_ratios(r))
         score(r) = max(total - sum(shrink*(2.0_wp - shrink)*projection**2), 0.0_wp) &
                    /(n - 1 - sum(shrink))**2
      end do
      best_ratio = minloc(score, 1)
   end function best_ratio

   !> phi_k at points of the law.
   subroutine features_of(surrogate, x, feature)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: x(:, :)          !! (point, input) standardised
      real(wp), allocatable, intent(out) :: feature(:, :)  !! (point, feature)
      real(wp), allocatable :: rows(:, :), over_eigenvalue(:, :)
      integer :: i, k

      allocate (rows(size(x, 1), size(surrogate%x, 1)))
      allocate (feature(size(x, 1), size(surrogate%eigenvalue)))
      allocate (over_eigenvalue, mold=surrogate%feature)
      call kernel_rows(surrogate%kernel, x, surrogate%x, rows)
      do i = 1, size(rows, 2)
         rows(:, i) = rows(:, i) - surrogate%row_mean(i)
      end do
      do k = 1, size(feature, 2)
         over_eigenvalue(:, k) = surrogate%feature(:, k)/surrogate%eigenvalue(k)
      end do
      call multiply(rows, over_eigenvalue, feature)
   end subroutine features_of

   !> G at points of the law.
   subroutine predict(fit, feature, values)
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: feature(:, :)   !! (point, feature)
      real(wp), intent(out), contiguous :: values(:, :)   !! (point, output)
      integer :: o

      call multiply(feature, fit%coefficient, values)
      do o = 1, size(values, 2)
         values(:, o) = values(:, o) + fit%mean(o)
      end do
   end subroutine predict

end module statistics_surrogate
