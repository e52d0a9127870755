!> Weighted points that represent a law of which many draws are known: formula (6) of
!> docs/regression.md.
!>
!> Some of the draws are kept, with the means over all draws of polynomials of the inputs: to the
!> third degree and, for up to 12 inputs, products of two. The kept draws are sorted along one
!> direction and, in blocks, along a second one; of them M evenly spaced ones are the points. With B
!> (point, polynomial), the weights
!>    w = (1 + B (B'B/M)^-1 (mean of B over all draws - mean of B over the points))/M
!> give the polynomials their means over all draws.
module statistics_law
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply, solve_positive_definite
   implicit none(type, external)
   private
   public :: draws_type, law_type, choose_points, error_of_points, keep_draws

   integer, parameter :: most_with_products = 12     !! inputs, for products of two
   integer, parameter, public :: most_kept_draws = 2**15   !! draws that are kept
   integer, parameter, public :: n_points = 4096     !! points of a law
   integer, parameter :: points_per_block = 16
   integer, parameter :: n_direction_steps = 8   !! steps of a component, 0 to the largest one

   !> Draws of a law.
   type :: draws_type
      real(wp), allocatable :: x(:, :)      !! (kept draw, input) standardised
      real(wp), allocatable :: mean(:)      !! (polynomial) mean over all draws
      integer :: n_all = 0                  !! number of all draws
      real(wp) :: n_independent = 0.0_wp    !! independent draws with the same error of a mean
   end type draws_type

   !> Weighted points that represent a law.
   type :: law_type
      real(wp), allocatable :: x(:, :)      !! (point, input) standardised
      real(wp), allocatable :: weight(:)    !! (point), their sum is 1
      integer :: n_all = 0                  !! number of all draws
      real(wp) :: n_independent = 0.0_wp    !! independent draws with the same error of a mean
      !> (pair, polynomial) of B: sums of pairs of neighbours, and their differences D B
      real(wp), allocatable, private :: pair_sum(:, :), difference(:, :)
      real(wp), allocatable, private :: square(:, :)      !! (polynomial, polynomial) B'B
      real(wp), allocatable, private :: db_square(:, :)   !! (polynomial, polynomial) B'D'D B
   end type law_type

contains

   !> Selects the draws to keep, and computes the means of the polynomials over all draws.
   pure subroutine keep_draws(x, n_independent, draws)
      real(wp), intent(in) :: x(:, :)          !! (draw, input) standardised
      real(wp), intent(in) :: n_independent    !! as in draws_type
      type(draws_type), intent(out) :: draws
      integer, parameter :: chunk = 2048
      real(wp), allocatable :: b(:, :)
      integer :: first, last, n

      n = size(x, 1)
      draws%n_all = n
      draws%n_independent = n_independent
      draws%x = x(1::(n - 1)/most_kept_draws + 1, :)
      allocate (draws%mean(count_polynomials(size(x, 2))), source=0.0_wp)
      do first = 1, n, chunk
         last = min(first + chunk - 1, n)
         call find_polynomials(x(first:last, :), b)
         draws%mean = draws%mean + sum(b, 1)
      end do
      draws%mean = draws%mean/n
   end subroutine keep_draws

   !> Chooses at most n_points of the draws: evenly along a direction and, within blocks, evenly
   !> along a second one. The directions are rounded, so that the points do not depend on their last
   !> digits.
   subroutine choose_points(draws, direction, n_points, law, error)
      type(draws_type), intent(in) :: draws
      real(wp), intent(in) :: direction(:, :)   !! (input, first or second)
      integer, intent(in) :: n_points
      type(law_type), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      integer, allocatable :: ranking(:)
      integer :: first, k, last, m, n, n_blocks

      n = min(n_points, size(draws%x, 1))
      ranking = rough_order(positions_along(draws%x, direction(:, 1)))
      n_blocks = max(1, n/points_per_block)
      last = 0
      do k = 1, n_blocks
         first = last + 1
         last = nint(k*real(size(ranking), wp)/n_blocks)
         associate (block => ranking(first:last))   ! up and down in turn: all neighbours are near
            block = block(rough_order((-1)**k*positions_along(draws%x(block, :), direction(:, 2))))
         end associate
      end do
      associate (stride => real(size(draws%x, 1), wp)/n)
         ranking = ranking([(1 + int((m - 0.5_wp)*stride), m=1, n)])
      end associate
      law%x = draws%x(ranking, :)
      law%n_all = draws%n_all
      law%n_independent = draws%n_independent
      call find_point_weights(draws%mean, law, error)
   end subroutine choose_points

   !> Positions of draws along a direction, whose components are rounded to eighths of the largest.
   pure function positions_along(x, direction) result(place)
      real(wp), intent(in) :: x(:, :)        !! (draw, input)
      real(wp), intent(in) :: direction(:)   !! (input)
      real(wp) :: place(size(x, 1))          !! (draw)
      real(wp) :: largest
      integer :: j

      largest = direction(maxloc(abs(direction), 1))
      place = 0.0_wp
      do j = 1, size(direction)
         place = place + nint(n_direction_steps*direction(j)/largest)*x(:, j)
      end do
   end function positions_along

   !> Indices in ascending order of the values, by a bucket sort: values in the same bucket, one of
   !> n/2 in their range, stay in their order.
   pure function rough_order(values) result(ranking)
      real(wp), intent(in) :: values(:)
      integer :: ranking(size(values))
      integer :: bucket(size(values)), i, n_buckets
      integer, allocatable :: last(:)
      real(wp) :: least, scale

      n_buckets = max(1, size(values)/2)
      least = minval(values)
      scale = n_buckets/max(maxval(values) - least, n_buckets*tiny(least))
      allocate (last(0:n_buckets), source=0)
      do i = 1, size(values)
         bucket(i) = min(int((values(i) - least)*scale), n_buckets - 1)
         last(bucket(i) + 1) = last(bucket(i) + 1) + 1
      end do
      do i = 1, n_buckets
         last(i) = last(i) + last(i - 1)
      end do
      do i = 1, size(values)
         last(bucket(i)) = last(bucket(i)) + 1
         ranking(last(bucket(i))) = i
      end do
   end function rough_order

   !> Computes the standard errors of means of functions f over the points: of the points among the
   !> draws, and of the draws. D being the differences in pairs of neighbours and c the coefficients
   !> of the polynomials fitted to f, |D (f - B c)|^2 = |D f|^2 - c'(2 B'D'D f - B'D'D B c).
   subroutine error_of_points(law, values, mean_error, error)
      class(law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, function) f
      real(wp), intent(out) :: mean_error(:)             !! (function)
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(law%difference, 1), size(mean_error)) :: pair_sum, difference
      real(wp), dimension(size(law%square, 1), size(mean_error)) :: coefficient, db_f   ! c, B'D'D f
      real(wp) :: square(size(law%square, 1), size(law%square, 1))
      real(wp) :: half_square, variance
      integer :: n, o

      n = size(values, 1)
      do o = 1, size(mean_error)
         call pair_up(values(:, o), pair_sum(:, o), difference(:, o))
      end do
      call multiply(law%difference, difference, db_f, transposes_a=.true.)
      call multiply(law%pair_sum, pair_sum, coefficient, transposes_a=.true.)
      coefficient = 0.5_wp*(coefficient + db_f)   ! B'f, from sums and differences of pairs
      square = law%square
      call solve_positive_definite(square, coefficient, error)
      if (allocated(error)) return
      do o = 1, size(mean_error)
         call find_pair_variances(pair_sum(:, o), difference(:, o), half_square, variance)
         half_square = half_square - dot_product(coefficient(:, o), 2.0_wp*db_f(:, o) &
                                                 - matmul(law%db_square, coefficient(:, o))) &
                       /(2*size(difference, 1))
         mean_error(o) = sqrt(max(half_square, 0.0_wp)*(1.0_wp/n - 1.0_wp/law%n_all) &
                              + max(variance, 0.0_wp)/law%n_independent)
      end do
   end subroutine error_of_points

   !> Computes sums and differences in pairs of neighbours; an odd last value is left out.
   pure subroutine pair_up(values, pair_sum, difference)
      real(wp), intent(in), contiguous :: values(:)   !! (point)
      real(wp), intent(out), contiguous :: pair_sum(:), difference(:)   !! (pair)
      integer :: m

      do m = 1, size(pair_sum)
         pair_sum(m) = values(2*m - 1) + values(2*m)
         difference(m) = values(2*m - 1) - values(2*m)
      end do
   end subroutine pair_up

   !> Computes variances from sums and differences in pairs.
   pure subroutine find_pair_variances(pair_sum, difference, half_square, variance)
      real(wp), intent(in), contiguous :: pair_sum(:), difference(:)   !! (pair)
      real(wp), intent(out) :: half_square   !! half the mean square of the differences
      real(wp), intent(out) :: variance      !! variance of all values
      real(wp) :: mean, total_square
      integer :: m

      half_square = 0.0_wp
      mean = 0.0_wp
      total_square = 0.0_wp
      !$omp simd reduction(+:half_square, mean, total_square)
      do m = 1, size(pair_sum)
         half_square = half_square + difference(m)**2
         mean = mean + pair_sum(m)
         total_square = total_square + pair_sum(m)**2
      end do
      variance = ((total_square + half_square)/4 - (mean/2)**2/size(pair_sum))/size(pair_sum)
      half_square = half_square/(2*size(pair_sum))
   end subroutine find_pair_variances

   !> Computes the weights that give the polynomials their means over all draws; equal weights if
   !> any of them would not be positive.
   subroutine find_point_weights(mean, law, error)
      real(wp), intent(in) :: mean(:)   !! (polynomial) over all draws
      type(law_type), intent(inout) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: b(:, :), square(:, :), missing(:, :)
      integer :: i, k, n

      n = size(law%x, 1)
      call find_polynomials(law%x, b)
      k = size(b, 2)
      allocate (law%square(k, k), law%db_square(k, k), law%weight(n), missing(k, 1))
      call multiply(b, b, law%square, transposes_a=.true.)
      do i = 1, k   ! keeps B'B positive definite if inputs depend on each other
         law%square(i, i) = law%square(i, i)*(1.0_wp + 1.0e-10_wp)
      end do
      missing(:, 1) = n*mean - sum(b, 1)
      square = law%square
      call solve_positive_definite(square, missing, error)
      if (allocated(error)) return
      law%weight(:) = 1.0_wp + matmul(b, missing(:, 1))
      if (any(law%weight <= 0.0_wp)) law%weight = 1.0_wp
      law%weight = law%weight/sum(law%weight)
      allocate (law%pair_sum(n/2, k), law%difference(n/2, k))
      do i = 1, k
         call pair_up(b(:, i), law%pair_sum(:, i), law%difference(:, i))
      end do
      call multiply(law%difference, law%difference, law%db_square, transposes_a=.true.)
   end subroutine find_point_weights

   pure integer function count_polynomials(n_inputs)
      integer, intent(in) :: n_inputs

      count_polynomials = 1 + 3*n_inputs
      if (n_inputs <= most_with_products) &
         count_polynomials = count_polynomials + n_inputs*(n_inputs - 1)/2
   end function count_polynomials

   !> Computes the polynomials 1, x_j, x_j^2, x_j^3, x_i x_j at each point.
   pure subroutine find_polynomials(x, b)
      real(wp), intent(in) :: x(:, :)                !! (point, input)
      real(wp), allocatable, intent(out) :: b(:, :)  !! (point, polynomial)
      integer :: d, i, j, k

      d = size(x, 2)
      allocate (b(size(x, 1), count_polynomials(d)))
      b(:, 1) = 1.0_wp
      do j = 1, d
         b(:, 3*j - 1) = x(:, j)
         b(:, 3*j) = x(:, j)**2
         b(:, 3*j + 1) = x(:, j)**3
      end do
      k = 3*d + 1
      if (d > most_with_products) return
      do j = 2, d
         do i = 1, j - 1
            k = k + 1
            b(:, k) = x(:, i)*x(:, j)
         end do
      end do
   end subroutine find_polynomials

end module statistics_law
