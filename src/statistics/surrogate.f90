!> Surrogate of responses, functions of the friction values: the features in which fits G to a few
!> samples are linear. A fit is kriging, computed as a ridge regression on the leading eigenvectors
!> V of the kernel matrix K of the samples: formula (3) of docs/regression.md. With K V = V
!> diag(ev), the features phi_k(x) = V_k'(k(x) - mean of the rows of K)/ev_k are orthonormal over
!> the samples.
module statistics_surrogate
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply
   use statistics_kernel, only: kernel_diagonal, kernel_rows, kernel_type
   implicit none(type, external)
   private
   public :: surrogate_type, average_features, evenly_spaced, find_features, find_kernel_rows, &
             find_rest_between, predict_variance, reallocate

   integer, parameter, public :: most_landmarks = 160
   real(wp), parameter :: smallest_eigenvalue = 1.0e-10_wp   !! eigenvalue of K over the largest
   integer, parameter, public :: n_ratios = 13
   real(wp), parameter, public :: noise_ratios(n_ratios) = &
                                  10.0_wp**[-5.0_wp, -4.5_wp, -4.0_wp, -3.5_wp, -3.0_wp, -2.5_wp, &
                                    -2.0_wp, -1.5_wp, -1.0_wp, -0.5_wp, 0.0_wp, 0.5_wp, 1.0_wp]

   !> Features, as functions of the inputs and at the samples.
   type :: surrogate_type
      type(kernel_type) :: kernel
      real(wp), allocatable :: feature(:, :)     !! (sample, feature) V
      real(wp), allocatable :: eigenvalue(:)     !! (feature)
      real(wp), allocatable :: direction(:, :)   !! (input, 2) directions of most variation
      !> sqrt(n/(n - p)), factor on residuals: p constants of the kernel were chosen on the same n
      !> samples
      real(wp) :: enlargement = 1.0_wp
      real(wp), allocatable, private :: landmark(:, :)    !! (landmark, input) standardised
      !> (landmark, feature), (feature): phi(x) = transform'k(landmark, x) - offset
      real(wp), allocatable :: transform(:, :), offset(:)
      real(wp), private :: mean_of_kernel = 0.0_wp   !! mean of k over pairs of landmarks
      real(wp), allocatable, private :: mean_feature(:)   !! (feature) mean over the landmarks
      real(wp) :: mean_rest = 0.0_wp                 !! mean of rest(x), formula (5), over samples
   end type surrogate_type

contains

   !> At most `most` of the integers 1..n, equally spaced.
   pure function evenly_spaced(n, most) result(places)
      integer, intent(in) :: n, most
      integer, allocatable :: places(:)
      integer :: i

      associate (n_places => min(n, most))
         places = [(1 + int((i - 1)*real(n, wp)/n_places), i=1, n_places)]
      end associate
   end function evenly_spaced

   !> Finds the features: eigenvectors of the centred kernel matrix of the samples or, with fewer
   !> landmarks than samples, of its projection on the functions k(., landmark). The largest
   !> eigenvalue comes first.
   subroutine find_features(x, most_landmarks, surrogate, error)
      real(wp), intent(in), contiguous :: x(:, :)   !! (sample, input)
      integer, intent(in) :: most_landmarks
      type(surrogate_type), intent(inout) :: surrogate
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: basis(:, :), eigenvalue(:), rows(:, :)
      integer :: n

      n = size(x, 1)
      surrogate%landmark = x(evenly_spaced(n, most_landmarks), :)
      call find_kernel_rows(surrogate, surrogate%landmark, rows)
      surrogate%mean_of_kernel = sum(rows)/size(rows)
      call centre_both(rows)
      call find_leading_eigenvectors(rows, basis, eigenvalue, error)
      if (allocated(error)) return
      call centre_columns(basis)   ! once more: division by small eigenvalues enlarges rounding
      surrogate%feature = basis*spread(sqrt(eigenvalue), 1, size(basis, 1))
      basis = basis*spread(1.0_wp/sqrt(eigenvalue), 1, size(basis, 1))
      call find_kernel_rows(surrogate, x, rows)
      surrogate%offset = matmul(sum(rows, 2)/n, basis)
      if (size(rows, 1) < n) call orthogonalise(surrogate, rows, basis, eigenvalue, error)
      if (allocated(error)) return
      surrogate%eigenvalue = eigenvalue
      associate (scale => 1.0_wp/sqrt(eigenvalue))
         surrogate%feature = surrogate%feature*spread(scale, 1, n)
         surrogate%transform = basis*spread(scale, 1, size(basis, 1))
         surrogate%offset = surrogate%offset*scale
      end associate
      associate (places => evenly_spaced(n, most_landmarks))
         surrogate%mean_feature = sum(surrogate%feature(places, :), 1)/size(places)
      end associate
      surrogate%mean_rest = sum(rest_at(surrogate, x, rows, transpose(surrogate%feature)))/n
   end subroutine find_features

   !> Computes k(landmark, x) at points x.
   subroutine find_kernel_rows(surrogate, x, rows)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: x(:, :)         !! (point, input) standardised
      real(wp), allocatable, intent(inout) :: rows(:, :)  !! (landmark, point)

      call reallocate(rows, size(surrogate%landmark, 1), size(x, 1))
      call kernel_rows(surrogate%kernel, surrogate%landmark, x, rows)
   end subroutine find_kernel_rows

   !> Allocates an array unless it has its size already: new memory takes as long as filling it.
   pure subroutine reallocate(values, n_rows, n_columns)
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in) :: n_rows, n_columns

      if (allocated(values)) then
         if (all(shape(values) == [n_rows, n_columns])) return
         deallocate (values)
      end if
      allocate (values(n_rows, n_columns))
   end subroutine reallocate

   !> Subtracts the means of rows and columns from a symmetric matrix.
   pure subroutine centre_both(matrix)
      real(wp), intent(inout) :: matrix(:, :)
      real(wp) :: mean(size(matrix, 1)), mean_of_all
      integer :: i

      mean = sum(matrix, 1)/size(mean)
      mean_of_all = sum(mean)/size(mean)
      do i = 1, size(mean)
         matrix(:, i) = matrix(:, i) - mean - (mean(i) - mean_of_all)
      end do
   end subroutine centre_both

   pure subroutine centre_columns(matrix)
      real(wp), intent(inout) :: matrix(:, :)

      matrix = matrix - spread(sum(matrix, 1)/size(matrix, 1), 1, size(matrix, 1))
   end subroutine centre_columns

   !> Finds the eigenvectors of a centred matrix, largest eigenvalue first, without those whose
   !> eigenvalue is zero to rounding.
   subroutine find_leading_eigenvectors(matrix, vector, eigenvalue, error)
      real(wp), intent(inout), contiguous :: matrix(:, :)   !! symmetric; destroyed
      real(wp), allocatable, intent(out) :: vector(:, :)    !! (row, eigenvalue)
      real(wp), allocatable, intent(out) :: eigenvalue(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: ascending(size(matrix, 1))
      integer :: n, rank

      n = size(matrix, 1)
      call find_symmetric_eigenvectors(matrix, ascending, error)
      if (allocated(error)) return
      rank = min(n - 1, count(ascending > smallest_eigenvalue*ascending(n)))
      vector = matrix(:, n:n - rank + 1:-1)
      eigenvalue = ascending(n:n - rank + 1:-1)
   end subroutine find_leading_eigenvectors

   !> Computes the features of all samples from functions of the landmarks, and rotates them such
   !> that they are orthogonal over the samples.
   subroutine orthogonalise(surrogate, rows, basis, eigenvalue, error)
      type(surrogate_type), intent(inout) :: surrogate
      real(wp), intent(in), contiguous :: rows(:, :)          !! (landmark, sample)
      real(wp), allocatable, intent(inout) :: basis(:, :)     !! (landmark, feature)
      real(wp), allocatable, intent(out) :: eigenvalue(:)     !! sums of squares of the features
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: feature(:, :), square(:, :), vector(:, :), rotated(:, :)

      allocate (feature(size(rows, 2), size(basis, 2)), square(size(basis, 2), size(basis, 2)))
      call multiply(rows, basis, feature, transposes_a=.true.)
      call centre_columns(feature)
      call multiply(feature, feature, square, transposes_a=.true.)
      call find_leading_eigenvectors(square, vector, eigenvalue, error)
      if (allocated(error)) return
      allocate (rotated(size(basis, 1), size(vector, 2)))
      call multiply(basis, vector, rotated)
      call move_alloc(rotated, basis)
      allocate (rotated(size(feature, 1), size(vector, 2)))
      call multiply(feature, vector, rotated)
      call move_alloc(rotated, surrogate%feature)
      surrogate%offset = matmul(surrogate%offset, vector)
   end subroutine orthogonalise

   !> Computes averages of the features from the same averages of the kernel.
   subroutine average_features(surrogate, average_row, constant, average)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: average_row(:, :)   !! (landmark, average)
      real(wp), intent(in) :: constant                        !! the same average of 1
      real(wp), intent(out), contiguous :: average(:, :)      !! (feature, average)

      call multiply(surrogate%transform, average_row, average, transposes_a=.true.)
      average = average - spread(constant*surrogate%offset, 2, size(average, 2))
   end subroutine average_features

   !> rest(x) of formula (5), from the kernel without its means over the landmarks in either
   !> argument.
   pure function rest_at(surrogate, x, rows, feature) result(rest)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in) :: x(:, :), rows(:, :)   !! (point, input), (landmark, point)
      real(wp), intent(in) :: feature(:, :)         !! (feature, point)
      real(wp) :: rest(size(x, 1))

      rest = kernel_diagonal(surrogate%kernel, x) - 2.0_wp*sum(rows, 1)/size(rows, 1) &
             + surrogate%mean_of_kernel
      rest = max(rest - matmul(surrogate%eigenvalue, &
                               (feature - spread(surrogate%mean_feature, 2, size(rest)))**2), &
                 0.0_wp)
   end function rest_at

   !> Computes rest(x, x') of formula (14) for all pairs of different points, and 0 for the others.
   subroutine find_rest_between(surrogate, x, rows, rest)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: x(:, :)         !! (point, input)
      real(wp), intent(in), contiguous :: rows(:, :)      !! (landmark, point) kernel
      real(wp), allocatable, intent(out) :: rest(:, :)    !! (point, point)
      real(wp), allocatable :: explained(:, :)            !! (point, point)
      real(wp) :: feature(size(surrogate%eigenvalue), size(x, 1)), mean(size(x, 1))
      integer :: m, n

      n = size(x, 1)
      allocate (rest(n, n), explained(n, n))
      call kernel_rows(surrogate%kernel, x, x, rest)
      call average_features(surrogate, rows, 1.0_wp, feature)
      feature = (feature - spread(surrogate%mean_feature, 2, n)) &
                *spread(sqrt(surrogate%eigenvalue), 2, n)
      call multiply(feature, feature, explained, transposes_a=.true.)
      mean = sum(rows, 1)/size(rows, 1)
      do m = 1, n
         rest(:, m) = rest(:, m) - explained(:, m) - mean - (mean(m) - surrogate%mean_of_kernel)
         rest(m, m) = 0.0_wp
      end do
   end subroutine find_rest_between

   !> Computes the variance v of G at points over that of the noise, formula (5), for each noise
   !> ratio: sum_k s_k phi_k^2 + rest/max(ratio, mean rest), rest = k(x, x) - sum_k ev_k phi_k(x)^2.
   !> Samples that are no landmarks have a rest too, so their noise is not less than its mean.
   subroutine predict_variance(surrogate, x, rows, variance)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in) :: x(:, :)                        !! (point, input)
      real(wp), intent(in), contiguous :: rows(:, :)         !! (landmark, point) kernel
      real(wp), allocatable, intent(out) :: variance(:, :)   !! (point, noise ratio)
      real(wp) :: square(size(surrogate%eigenvalue), size(rows, 2)), rest(size(rows, 2))
      real(wp) :: shrink(size(surrogate%eigenvalue), n_ratios)
      integer :: r

      call average_features(surrogate, rows, 1.0_wp, square)
      rest = rest_at(surrogate, x, rows, square)
      square = square**2
      do r = 1, n_ratios
         shrink(:, r) = surrogate%eigenvalue/(surrogate%eigenvalue + noise_ratios(r))
      end do
      allocate (variance(size(rows, 2), n_ratios))
      call multiply(square, shrink, variance, transposes_a=.true.)
      do r = 1, n_ratios
         variance(:, r) = variance(:, r) + rest/max(noise_ratios(r), surrogate%mean_rest)
      end do
   end subroutine predict_variance

end module statistics_surrogate
