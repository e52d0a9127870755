!> Weighted points that represent a law of which many draws are known: formula (6) of
!> docs/regression.md.
!>
!> Some of the draws are kept, with the means over all draws of polynomials of the inputs: to the
!> third degree and, for up to 12 inputs, products of two. The kept draws are sorted along one
!> direction and, in blocks, along a second one; of them M evenly spaced ones are the points, from a
!> start that differs between blocks. With Q (point, polynomial), which combines the polynomials
!> such that Q'Q = 1, the weights
!>    w = 1/M + Q (mean of Q over all draws - mean of Q over the points)
!> give the polynomials their means over all draws.
module statistics_law
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply
   implicit none(type, external)
   private
   public :: draws_type, law_type, choose_points, count_polynomials, error_of_points, keep_draws

   integer, parameter :: most_with_products = 12     !! inputs, for products of two
   integer, parameter, public :: most_kept_draws = 2**15   !! draws that are kept
   integer, parameter, public :: n_points = 4096     !! points of a law
   integer, parameter :: points_per_block = 16
   !> part of a stride by which the points of a block begin later than those of the block before:
   !> the middles of 16 parts of a block would lack its ends
   real(wp), parameter :: golden_section = 0.5_wp*(sqrt(5.0_wp) - 1.0_wp)
   integer, parameter :: n_direction_steps = 8   !! steps of a component, 0 to the largest one
   !> least eigenvalue of the polynomials' products that counts, over the largest: inputs may depend
   !> on each other
   real(wp), parameter :: smallest_eigenvalue = 1.0e-10_wp

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
      real(wp), allocatable, private :: q(:, :)    !! (point, polynomial) Q
      !> (pair, polynomial) D Q, the differences in pairs of neighbours; (polynomial, polynomial)
      !> Q'D'D Q
      real(wp), allocatable, private :: dq(:, :), dq_square(:, :)
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
      real(wp) :: place(min(n_points, size(draws%x, 1)))   ! (point) in steps between points
      integer :: first, k, last, m, n, n_blocks

      n = size(place)
      ranking = rough_order(positions_along(draws%x, direction(:, 1)))
      n_blocks = max(1, n/points_per_block)
      last = 0
      do k = 1, n_blocks
         first = last + 1
         last = nint(k*real(size(ranking), wp)/n_blocks)
         associate (block => ranking(first:last))   ! up and down in turn: blocks end near the next
            block = block(rough_order((-1)**k*positions_along(draws%x(block, :), direction(:, 2))))
         end associate
      end do
      do m = 1, n   ! blocks run up and down, and so do their starts
         k = (m - 1)/points_per_block
         place(m) = m - 1 + modulo((-1)**k*k*golden_section, 1.0_wp)
      end do
      ranking = ranking(1 + int(place*size(ranking)/n))
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
   !> draws, and of the draws. With c = Q'f, |D (f - Q c)|^2 = |D f|^2 - c'(2 Q'D'D f - Q'D'D Q c).
   subroutine error_of_points(law, values, mean_error)
      class(law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, function) f
      real(wp), intent(out) :: mean_error(:)             !! (function)
      real(wp) :: difference(size(law%dq, 1), size(mean_error)), rest, square, total
      real(wp), dimension(size(law%q, 2), size(mean_error)) :: coefficient, product
      integer :: m, n, o

      n = size(values, 1)
      difference(:, :) = values(:n - 1:2, :) - values(2::2, :)
      call multiply(law%q, values, coefficient, transposes_a=.true.)
      call multiply(law%dq, difference, product, transposes_a=.true.)   ! Q'D'D f
      do o = 1, size(mean_error)
         rest = sum(difference(:, o)**2) &
                - dot_product(coefficient(:, o), 2.0_wp*product(:, o) &
                                                 - matmul(law%dq_square, coefficient(:, o)))
         square = 0.0_wp
         total = 0.0_wp
         !$omp simd reduction(+:square, total)
         do m = 1, n
            square = square + values(m, o)**2
            total = total + values(m, o)
         end do
         mean_error(o) = sqrt(max(rest, 0.0_wp)/(2*size(difference, 1)) &
                              *(1.0_wp/n - 1.0_wp/law%n_all) &
                              + max(square - total**2/n, 0.0_wp)/(n*law%n_independent))
      end do
   end subroutine error_of_points

   !> Computes the weights that give the polynomials their means over all draws; equal weights if
   !> any of them would not be positive.
   subroutine find_point_weights(mean, law, error)
      real(wp), intent(in) :: mean(:)   !! (polynomial) over all draws
      type(law_type), intent(inout) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: b(:, :), basis(:, :), square(:, :)
      real(wp) :: eigenvalue(size(mean))
      integer :: k, n

      n = size(law%x, 1)
      call find_polynomials(law%x, b)
      allocate (square(size(mean), size(mean)))
      call multiply(b, b, square, transposes_a=.true.)
      call find_symmetric_eigenvectors(square, eigenvalue, error)
      if (allocated(error)) return
      k = count(eigenvalue > smallest_eigenvalue*maxval(eigenvalue))
      basis = square(:, size(mean) - k + 1:) &
              /spread(sqrt(eigenvalue(size(mean) - k + 1:)), 1, size(mean))
      allocate (law%q(n, k), law%dq_square(k, k))
      call multiply(b, basis, law%q)
      law%weight = 1.0_wp + matmul(law%q, matmul(n*mean - sum(b, 1), basis))
      if (any(law%weight <= 0.0_wp)) law%weight = 1.0_wp
      law%weight = law%weight/sum(law%weight)
      law%dq = law%q(:n - 1:2, :) - law%q(2::2, :)
      call multiply(law%dq, law%dq, law%dq_square, transposes_a=.true.)
   end subroutine find_point_weights

   !> Number of polynomials whose means over all draws the points of a law keep.
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
