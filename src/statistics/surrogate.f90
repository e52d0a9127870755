!> A response as a function of its friction values, from a few samples: kriging, written as a ridge
!> regression on the leading eigenvectors of the kernel's matrix over the samples. Formulas (3) and
!> (4) of docs/regression.md; with K V = V diag(ev), the features phi_k(x) = V_k'(k(x) - mean of the
!> rows of K)/ev_k are orthonormal over the samples.
module statistics_surrogate
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply
   use statistics_kernel, only: kernel_diagonal, kernel_rows, kernel_type
   implicit none(type, external)
   private
   public :: fit_type, surrogate_type, average_features, find_features, find_squares, &
             fit_outputs, make_room, predict, predict_variance, rows_of, spread_out

   integer, parameter, public :: most_landmarks = 160
   !> outputs of a fit and samples whose pairs with all are looked at
   integer, parameter, public :: outputs_judged = 4, samples_paired = 64
   real(wp), parameter :: smallest_eigenvalue = 1.0e-10_wp   !! over the largest
   integer, parameter, public :: n_ratios = 13
   real(wp), parameter, public :: noise_ratios(n_ratios) = &
                          10.0_wp**[-5.0_wp, -4.5_wp, -4.0_wp, -3.5_wp, -3.0_wp, -2.5_wp, &
                                    -2.0_wp, -1.5_wp, -1.0_wp, -0.5_wp, 0.0_wp, 0.5_wp, 1.0_wp]

   !> The features, as functions of the inputs and over the samples.
   type :: surrogate_type
      type(kernel_type) :: kernel
      real(wp), allocatable :: feature(:, :)     !! (sample, feature) V
      real(wp), allocatable :: eigenvalue(:)     !! (feature)
      real(wp), allocatable :: direction(:, :)   !! (input, 2) along which the outputs vary most
      !> sqrt(n/(n - p)): leave-one-out residuals do not know that p constants of the kernel were
      !> chosen on the same n samples
      real(wp) :: enlargement = 1.0_wp
      real(wp), allocatable, private :: landmark(:, :)    !! (landmark, input) standardised
      !> (landmark, feature), (feature): phi(x) = sum of transform*k(x, landmark) - offset
      real(wp), allocatable, private :: transform(:, :), offset(:)
      real(wp), private :: mean_of_kernel = 0.0_wp   !! over pairs of landmarks
      real(wp), private :: mean_rest = 0.0_wp        !! of k(x, x) at samples that features leave
   end type surrogate_type

   !> Outputs as functions of the inputs.
   type :: fit_type
      real(wp), allocatable :: mean(:)             !! (output)
      real(wp), allocatable :: shrink(:, :)        !! (feature, output) s
      real(wp), allocatable :: coefficient(:, :)   !! (feature, output) of phi
      real(wp), allocatable :: noise_ratio(:)      !! (output) r
      real(wp), allocatable, private :: of_row(:, :), constant(:)   !! G = of_row'k(x) + constant
      real(wp), allocatable :: residual(:, :)      !! (sample, output) leave-one-out
      real(wp), allocatable :: left(:, :)          !! (sample, output) 1 - h
      real(wp), allocatable :: predicted(:, :)     !! (sample, output) y - residual
      integer, allocatable :: judged(:), some(:)   !! outputs and samples of the pairs
      !> (sample j, i of some, judged output) what leaving out j too adds to the residual e_i, and
      !> leaving out i too to e_j
      real(wp), allocatable :: change(:, :, :), other_change(:, :, :)
   end type fit_type

contains

   !> Places of at most some of n, at equal distances.
   pure function spread_out(n, most) result(places)
      integer, intent(in) :: n, most
      integer, allocatable :: places(:)
      integer :: i

      associate (some => min(n, most))
         places = [(1 + int((i - 1)*real(n, wp)/some), i=1, some)]
      end associate
   end function spread_out

   !> Finds the eigenvectors over the samples of the centred kernel, or of its projection on the
   !> functions k(., landmark); largest eigenvalue first.
   subroutine find_features(x, most_landmarks, surrogate, error)
      real(wp), intent(in), contiguous :: x(:, :)   !! (sample, input)
      integer, intent(in) :: most_landmarks
      type(surrogate_type), intent(inout) :: surrogate
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: basis(:, :), eigenvalue(:), rows(:, :)
      integer :: n

      n = size(x, 1)
      surrogate%landmark = x(spread_out(n, most_landmarks), :)
      call rows_of(surrogate, surrogate%landmark, rows)
      surrogate%mean_of_kernel = sum(rows)/size(rows)
      call centre_both(rows)
      call find_leading(rows, basis, eigenvalue, error)
      if (allocated(error)) return
      call centre_columns(basis)   ! to all digits: small eigenvalues divide them
      surrogate%feature = scaled_columns(basis, sqrt(eigenvalue))
      basis = scaled_columns(basis, 1.0_wp/sqrt(eigenvalue))
      call rows_of(surrogate, x, rows)
      surrogate%offset = matmul(sum(rows, 2)/n, basis)
      if (size(rows, 1) < n) call rotate(surrogate, rows, basis, eigenvalue, error)
      if (allocated(error)) return
      surrogate%eigenvalue = eigenvalue
      associate (scale => 1.0_wp/sqrt(eigenvalue))
         surrogate%feature = scaled_columns(surrogate%feature, scale)
         surrogate%transform = scaled_columns(basis, scale)
         surrogate%offset = surrogate%offset*scale
      end associate
      surrogate%mean_rest = sum(centred_diagonal(surrogate, x, rows) &
                                - matmul(surrogate%feature**2, eigenvalue))/n
   end subroutine find_features

   !> Computes k(landmark, x) at points or samples.
   subroutine rows_of(surrogate, x, rows)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: x(:, :)         !! (point, input) standardised
      real(wp), allocatable, intent(inout) :: rows(:, :)  !! (landmark, point)

      call make_room(rows, size(surrogate%landmark, 1), size(x, 1))
      call kernel_rows(surrogate%kernel, surrogate%landmark, x, rows)
   end subroutine rows_of

   !> Allocates an array unless it has its size: fresh memory costs as much as what goes into it.
   pure subroutine make_room(values, n_rows, n_columns)
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in) :: n_rows, n_columns

      if (allocated(values)) then
         if (all(shape(values) == [n_rows, n_columns])) return
         deallocate (values)
      end if
      allocate (values(n_rows, n_columns))
   end subroutine make_room

   !> Frees rows and columns of a symmetric matrix of their means.
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
      integer :: k

      do k = 1, size(matrix, 2)
         matrix(:, k) = matrix(:, k) - sum(matrix(:, k))/size(matrix, 1)
      end do
   end subroutine centre_columns

   !> Finds the leading eigenvectors, largest eigenvalue first; a centred matrix has one fewer than
   !> rows.
   subroutine find_leading(matrix, vector, eigenvalue, error)
      real(wp), intent(inout), contiguous :: matrix(:, :)   !! symmetric; on return of no use
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
   end subroutine find_leading

   pure function scaled_columns(matrix, scale) result(scaled)
      real(wp), intent(in) :: matrix(:, :), scale(:)
      real(wp) :: scaled(size(matrix, 1), size(matrix, 2))
      integer :: k

      do k = 1, size(scale)
         scaled(:, k) = matrix(:, k)*scale(k)
      end do
   end function scaled_columns

   !> Computes the features of all samples from functions of the landmarks, turned such that they
   !> are orthogonal over the samples.
   subroutine rotate(surrogate, rows, basis, eigenvalue, error)
      type(surrogate_type), intent(inout) :: surrogate
      real(wp), intent(in), contiguous :: rows(:, :)          !! (landmark, sample)
      real(wp), allocatable, intent(inout) :: basis(:, :)     !! (landmark, feature)
      real(wp), allocatable, intent(out) :: eigenvalue(:)     !! squares of the features
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: feature(:, :), square(:, :), vector(:, :), turned(:, :)

      allocate (feature(size(rows, 2), size(basis, 2)), square(size(basis, 2), size(basis, 2)))
      call multiply(rows, basis, feature, transposes_a=.true.)
      call centre_columns(feature)
      call multiply(feature, feature, square, transposes_a=.true.)
      call find_leading(square, vector, eigenvalue, error)
      if (allocated(error)) return
      allocate (turned(size(basis, 1), size(vector, 2)))
      call multiply(basis, vector, turned)
      call move_alloc(turned, basis)
      allocate (turned(size(feature, 1), size(vector, 2)))
      call multiply(feature, vector, turned)
      call move_alloc(turned, surrogate%feature)
      surrogate%offset = matmul(surrogate%offset, vector)
   end subroutine rotate

   !> Fits outputs, each with its own noise ratio.
   subroutine fit_outputs(surrogate, outputs, fit)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: outputs(:, :)   !! (sample, output)
      type(fit_type), intent(out) :: fit
      real(wp), allocatable :: square(:, :), leverage(:, :), y(:, :), projection(:, :)
      integer :: n, n_out, o, r

      n = size(outputs, 1)
      n_out = size(outputs, 2)
      fit%mean = sum(outputs, 1)/n
      allocate (y(n, n_out), fit%residual(n, n_out), leverage(n, n_out))
      allocate (projection(size(surrogate%eigenvalue), n_out))
      allocate (fit%shrink, mold=projection)
      allocate (fit%noise_ratio(n_out))
      do o = 1, n_out
         y(:, o) = outputs(:, o) - fit%mean(o)
      end do
      call multiply(surrogate%feature, y, projection, transposes_a=.true.)
      do o = 1, n_out
         r = best_ratio(surrogate%eigenvalue, projection(:, o), sum(y(:, o)**2), n)
         fit%shrink(:, o) = surrogate%eigenvalue/(surrogate%eigenvalue + noise_ratios(r))
         fit%noise_ratio(o) = noise_ratios(r)
      end do
      allocate (fit%coefficient, source=fit%shrink*projection)   ! not by =, which would read bounds
      allocate (fit%of_row(size(surrogate%transform, 1), n_out))
      call multiply(surrogate%transform, fit%coefficient, fit%of_row)
      fit%constant = fit%mean - matmul(surrogate%offset, fit%coefficient)
      square = surrogate%feature**2
      call multiply(surrogate%feature, fit%coefficient, fit%residual)
      call multiply(square, fit%shrink, leverage)
      leverage = leverage + 1.0_wp/n
      fit%left = 1.0_wp - leverage
      fit%residual = (y - fit%residual)/fit%left
      fit%predicted = outputs - fit%residual
      call find_pairs(surrogate, fit)
   end subroutine fit_outputs

   !> Computes the changes of residuals when two samples are left out: e_i becomes
   !> (e_i + h_ij e_j/(1 - h_i))/(1 - h_ij^2/((1 - h_i)(1 - h_j))), with the leverages
   !> h_ij = 1/n + sum_k s_k V_ik V_jk.
   subroutine find_pairs(surrogate, fit)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(inout) :: fit
      real(wp), allocatable :: pair_leverage(:, :), shrunk(:, :)
      real(wp) :: both
      integer :: i, j, k, m, n

      n = size(fit%left, 1)
      fit%some = spread_out(n, samples_paired)
      fit%judged = spread_out(size(fit%left, 2), outputs_judged)
      allocate (fit%change(n, size(fit%some), size(fit%judged)))
      allocate (fit%other_change, mold=fit%change)
      allocate (pair_leverage(n, size(fit%some)))
      allocate (shrunk(size(surrogate%eigenvalue), size(fit%some)))
      do k = 1, size(fit%judged)
         shrunk = transpose(surrogate%feature(fit%some, :)) &
                  *spread(fit%shrink(:, fit%judged(k)), 2, size(fit%some))
         call multiply(surrogate%feature, shrunk, pair_leverage)
         do m = 1, size(fit%some)
            i = fit%some(m)
            associate (e => fit%residual(:, fit%judged(k)), left => fit%left(:, fit%judged(k)), &
                       h => pair_leverage(:, m))
               !$omp simd
               do j = 1, n
                  h(j) = h(j) + 1.0_wp/n
                  both = 1.0_wp/(1.0_wp - h(j)**2/(left(i)*left(j)))
                  fit%change(j, m, k) = both*(e(i) + h(j)*e(j)/left(i)) - e(i)
                  fit%other_change(j, m, k) = both*(e(j) + h(j)*e(i)/left(j)) - e(j)
               end do
            end associate
            fit%change(i, m, k) = 0.0_wp   ! no pair
            fit%other_change(i, m, k) = 0.0_wp
         end do
      end do
   end subroutine find_pairs

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

   !> Averages of the features, from the same averages of kernel rows.
   subroutine average_features(surrogate, average_row, constant, average)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in), contiguous :: average_row(:, :)   !! (landmark, average)
      real(wp), intent(in) :: constant                        !! the same average of 1
      real(wp), intent(out), contiguous :: average(:, :)      !! (feature, average)
      integer :: o

      call multiply(surrogate%transform, average_row, average, transposes_a=.true.)
      do o = 1, size(average, 2)
         average(:, o) = average(:, o) - constant*surrogate%offset
      end do
   end subroutine average_features

   !> Computes the squares of the features at points, and what they leave of k(x, x).
   subroutine find_squares(surrogate, x, rows, square, rest)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in) :: x(:, :)                      !! (point, input)
      real(wp), intent(in), contiguous :: rows(:, :)       !! (landmark, point), see rows_of
      real(wp), allocatable, intent(out) :: square(:, :)   !! (feature, point)
      real(wp), allocatable, intent(out) :: rest(:)        !! (point)

      allocate (square(size(surrogate%eigenvalue), size(rows, 2)))
      call average_features(surrogate, rows, 1.0_wp, square)
      square = square**2
      rest = max(centred_diagonal(surrogate, x, rows) - matmul(surrogate%eigenvalue, square), &
                 0.0_wp)
   end subroutine find_squares

   !> k(x, x) of the kernel whose mean over the landmarks is taken away on both sides.
   pure function centred_diagonal(surrogate, x, rows) result(diagonal)
      type(surrogate_type), intent(in) :: surrogate
      real(wp), intent(in) :: x(:, :), rows(:, :)   !! (point, input), (landmark, point)
      real(wp) :: diagonal(size(x, 1))

      diagonal = kernel_diagonal(surrogate%kernel, x) - 2.0_wp*sum(rows, 1)/size(rows, 1) &
                 + surrogate%mean_of_kernel
   end function centred_diagonal

   !> Computes G at points of the law.
   subroutine predict(fit, rows, values)
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: rows(:, :)      !! (landmark, point), see rows_of
      real(wp), intent(out), contiguous :: values(:, :)   !! (point, output)
      integer :: o

      call multiply(rows, fit%of_row, values, transposes_a=.true.)
      do o = 1, size(values, 2)
         values(:, o) = values(:, o) + fit%constant(o)
      end do
   end subroutine predict

   !> Computes the variance of G at points, over that of the noise: sum_k s_k phi_k^2, and what the
   !> features leave of k(x, x) as if it had no data. Samples have such a rest as well where they
   !> are not landmarks: their noise is not less than its mean.
   subroutine predict_variance(surrogate, fit, square, rest, variance)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp), intent(in), contiguous :: square(:, :)      !! (feature, point), see find_squares
      real(wp), intent(in), contiguous :: rest(:)           !! (point)
      real(wp), intent(out), contiguous :: variance(:, :)   !! (point, output)
      integer :: o

      call multiply(square, fit%shrink, variance, transposes_a=.true.)
      do o = 1, size(variance, 2)
         variance(:, o) = variance(:, o) + rest/max(fit%noise_ratio(o), surrogate%mean_rest)
      end do
   end subroutine predict_variance

end module statistics_surrogate
