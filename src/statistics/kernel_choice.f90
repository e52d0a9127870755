!> Choice of the weights and the length of a kernel by the least leave-one-out residuals of at most
!> 128 samples: formula (2) of docs/regression.md. The weights are in proportion to the slopes of a
!> linear ridge regression, or to their roots: both are tried at the middle length, then shorter and
!> longer lengths with the better one, as long as the residuals fall.
module statistics_kernel_choice
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply, solve_positive_definite
   use statistics_kernel, only: kernel_type, new_kernel
   use statistics_surrogate, only: find_features, most_landmarks, n_ratios, noise_ratios, &
                                   evenly_spaced, surrogate_type
   implicit none(type, external)
   private
   public :: choose_kernel

   integer, parameter, public :: most_chosen = 128   !! samples whose residuals are compared
   real(wp), parameter :: lengths(*) = [1.0_wp, 2.0_wp, 4.0_wp, 8.0_wp, 16.0_wp]
   integer, parameter :: middle = 3          !! number of the length that is tried first
   real(wp), parameter :: powers(*) = [0.5_wp, 1.0_wp]   !! power of the slopes in the weights
   real(wp), parameter :: least_weight = 0.03_wp         !! least slope, over the largest one
   real(wp), parameter :: n_other_constants = 2.0_wp     !! length and noise ratio: part of p
   real(wp), parameter :: least_free_share = 0.1_wp      !! lower limit of (n - p)/n
   real(wp), parameter :: least_variance = 1.0e-6_wp     !! along direction 2, over direction 1

contains

   !> Chooses the kernel for some outputs, and finds the features of all samples and the directions
   !> in which the outputs vary most.
   subroutine choose_kernel(x, outputs, surrogate, error)
      real(wp), intent(in), contiguous :: x(:, :)         !! (sample, input) standardised
      real(wp), intent(in), contiguous :: outputs(:, :)   !! (sample, output)
      type(surrogate_type), intent(out) :: surrogate
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: proportion(size(x, 2)), best, best_power, n_slopes, power
      real(wp) :: slope(size(x, 2), size(outputs, 2))
      real(wp), allocatable :: y(:, :), chosen_x(:, :), chosen_y(:, :)
      integer, allocatable :: chosen(:)
      integer :: best_length, i, k

      call standardise(outputs, y)
      call find_slopes(x, y, slope, n_slopes, error)
      if (.not. allocated(error)) call find_directions(slope, surrogate%direction, error)
      if (allocated(error)) return
      surrogate%enlargement = &
         1.0_wp/sqrt(max(1.0_wp - (n_slopes + n_other_constants)/size(x, 1), least_free_share))
      proportion = sqrt(sum(slope**2, 2)/size(y, 2))
      proportion = max(proportion/max(maxval(proportion), tiny(1.0_wp)), least_weight)
      chosen = evenly_spaced(size(x, 1), most_chosen)
      chosen_x = x(chosen, :)
      chosen_y = y(chosen, :)
      best = huge(best)
      do k = 1, size(powers)
         call try_kernel(powers(k), middle)
         if (allocated(error)) return
      end do
      power = best_power
      do k = -1, 1, 2   ! shorter lengths, then longer ones
         i = middle + k
         do while (best_length == i - k .and. i >= 1 .and. i <= size(lengths))
            call try_kernel(power, i)
            if (allocated(error)) return
            i = i + k
         end do
      end do
      call find_features(x, most_landmarks, surrogate, error)

   contains

      subroutine try_kernel(power, length)
         real(wp), intent(in) :: power
         integer, intent(in) :: length   !! number of the length
         type(kernel_type) :: kernel
         real(wp) :: score

         kernel = new_kernel(proportion**power, lengths(length))
         call find_score(kernel, chosen_x, chosen_y, score, error)
         if (allocated(error)) return
         if (score >= best) return
         best = score
         best_power = power
         best_length = length
         surrogate%kernel = kernel
      end subroutine try_kernel

   end subroutine choose_kernel

   !> Standardises the outputs to mean 0 and mean square 1; a constant output becomes 0.
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

   !> Finds the slopes of a linear ridge regression, and their degrees of freedom: the trace of
   !> (X'X + ridge)^-1 X'X.
   subroutine find_slopes(x, y, slope, n_slopes, error)
      real(wp), intent(in), contiguous :: x(:, :), y(:, :)   !! (sample, input or output)
      real(wp), intent(out), contiguous :: slope(:, :)       !! (input, output)
      real(wp), intent(out) :: n_slopes
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(x, 2), size(x, 2)) :: square, shrunk, with_ridge
      integer :: j

      call multiply(x, x, square, transposes_a=.true.)
      call multiply(x, y, slope, transposes_a=.true.)
      shrunk = square
      do j = 1, size(x, 2)
         square(j, j) = square(j, j) + size(x, 2)/5.0_wp   ! ridge: 1 for five inputs
      end do
      with_ridge = square
      call solve_positive_definite(square, slope, error)
      if (.not. allocated(error)) call solve_positive_definite(with_ridge, shrunk, error)
      n_slopes = sum([(shrunk(j, j), j=1, size(x, 2))])
   end subroutine find_slopes

   !> Finds the first two left singular vectors of the slopes; the first one twice if there is no
   !> second.
   subroutine find_directions(slope, direction, error)
      real(wp), intent(in), contiguous :: slope(:, :)   !! (input, output)
      real(wp), allocatable, intent(out) :: direction(:, :)   !! (input, 2)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: square(size(slope, 1), size(slope, 1)), eigenvalue(size(slope, 1))
      real(wp) :: transposed_slope(size(slope, 2), size(slope, 1))
      integer :: last, second

      transposed_slope = transpose(slope)
      call multiply(transposed_slope, transposed_slope, square, transposes_a=.true.)
      call find_symmetric_eigenvectors(square, eigenvalue, error)
      last = size(eigenvalue)
      second = max(1, last - 1)
      if (eigenvalue(second) <= least_variance*eigenvalue(last)) second = last
      direction = square(:, [last, second])
   end subroutine find_directions

   !> Computes the score of a kernel: mean over outputs of ln(mean square of the leave-one-out
   !> residuals over that of the output), each with its best noise ratio.
   subroutine find_score(kernel, x, outputs, score, error)
      type(kernel_type), intent(in) :: kernel
      real(wp), intent(in), contiguous :: x(:, :), outputs(:, :)   !! (sample, input or output)
      real(wp), intent(out) :: score
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: least_square = 1.0e-12_wp   ! keeps the logarithm finite
      type(surrogate_type) :: trial
      real(wp), allocatable :: projection(:, :), fitted(:, :), leverage(:), shrink(:)
      real(wp) :: square(n_ratios, size(outputs, 2)), y(size(outputs, 1), size(outputs, 2))
      integer :: n, o, r

      n = size(x, 1)
      trial%kernel = kernel
      call find_features(x, n, trial, error)
      if (allocated(error)) return
      y = outputs - spread(sum(outputs, 1)/n, 1, n)
      allocate (projection(size(trial%eigenvalue), size(y, 2)))
      allocate (fitted, mold=y)
      call multiply(trial%feature, y, projection, transposes_a=.true.)
      do r = 1, n_ratios
         shrink = trial%eigenvalue/(trial%eigenvalue + noise_ratios(r))
         leverage = matmul(trial%feature**2, shrink)
         call multiply(trial%feature, projection*spread(shrink, 2, size(y, 2)), fitted)
         do o = 1, size(y, 2)
            square(r, o) = sum(((y(:, o) - fitted(:, o))/(1.0_wp - 1.0_wp/n - leverage))**2)
         end do
      end do
      score = 0.0_wp
      do o = 1, size(y, 2)
         score = score + log(minval(square(:, o))/max(sum(y(:, o)**2), tiny(1.0_wp)) + least_square)
      end do
      score = score/size(y, 2)
   end subroutine find_score

end module statistics_kernel_choice
