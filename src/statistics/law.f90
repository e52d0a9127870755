!> Points that stand for a law of which many draws are known: formula (6) of docs/regression.md.
!>
!> Some draws are kept, and the means of polynomials of the inputs (to the third degree, with
!> products of two for few inputs) over all of them. The kept ones are sorted along a direction, in
!> blocks of it along another one, and every k-th is taken; weights give the polynomials the means
!> that they have over all draws:
!> w = (1 + B (B'B/M)^-1 (mean over all of B - mean of B))/M.
module statistics_law
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply, solve_positive_definite
   implicit none(type, external)
   private
   public :: draws_type, law_type, choose_points, error_of_points, keep_draws

   integer, parameter :: most_with_products = 12   !! inputs
   integer, parameter, public :: most_kept = 2**15   !! draws
   integer, parameter, public :: n_points = 4096     !! that stand for a law
   integer, parameter :: points_of_block = 16
   integer, parameter :: parts = 8   !! of a direction's largest component that others are whole

   !> Draws of a law.
   type :: draws_type
      real(wp), allocatable :: x(:, :)      !! (draw, input) standardised; some of all
      real(wp), allocatable :: mean(:)      !! (polynomial) over all
      integer :: n_all = 0
      real(wp) :: n_independent = 0.0_wp    !! draws that all are worth
   end type draws_type

   !> Weighted points that stand for a law.
   type :: law_type
      real(wp), allocatable :: x(:, :)      !! (point, input) standardised
      real(wp), allocatable :: weight(:)    !! (point), their sum is 1
      integer :: n_all = 0                  !! draws that they stand for
      real(wp) :: n_independent = 0.0_wp    !! what these are worth
      !> (pair, polynomial) sums and differences D B of B in pairs of neighbours
      real(wp), allocatable, private :: total(:, :), change(:, :)
      real(wp), allocatable, private :: square(:, :)       !! (polynomial, polynomial) B'B
      real(wp), allocatable, private :: of_changes(:, :)   !! (polynomial, polynomial) B'D'D B
   end type law_type

contains

   !> Selects the draws to keep; they take the place of those before.
   pure subroutine keep_draws(x, n_independent, draws)
      real(wp), intent(in) :: x(:, :)          !! (draw, input) standardised
      real(wp), intent(in) :: n_independent    !! draws that they are worth
      type(draws_type), intent(out) :: draws
      integer, parameter :: together = 2048
      real(wp), allocatable :: b(:, :)
      integer :: first, last, n

      n = size(x, 1)
      draws%n_all = n
      draws%n_independent = n_independent
      draws%x = x(1::(n - 1)/most_kept + 1, :)
      allocate (draws%mean(count_polynomials(size(x, 2))), source=0.0_wp)
      do first = 1, n, together
         last = min(first + together - 1, n)
         call find_polynomials(x(first:last, :), b)
         draws%mean = draws%mean + sum(b, 1)
      end do
      draws%mean = draws%mean/n
   end subroutine keep_draws

   !> Chooses at most n_points of the draws: evenly along a direction, and evenly along a second one
   !> within every block of them. Points that followed the last digits of a direction would change
   !> estimates by their error.
   subroutine choose_points(draws, direction, n_points, law, error)
      type(draws_type), intent(in) :: draws
      real(wp), intent(in) :: direction(:, :)   !! (input, first or second)
      integer, intent(in) :: n_points
      type(law_type), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      integer, allocatable :: ranking(:)
      integer :: first, k, last, m, n, n_blocks

      n = min(n_points, size(draws%x, 1))
      ranking = rough_order(along(draws%x, direction(:, 1)))
      n_blocks = max(1, n/points_of_block)
      last = 0
      do k = 1, n_blocks
         first = last + 1
         last = nint(k*real(size(ranking), wp)/n_blocks)
         associate (block => ranking(first:last))   ! to and fro: neighbours in all blocks
            block = block(rough_order((-1)**k*along(draws%x(block, :), direction(:, 2))))
         end associate
      end do
      associate (stride => real(size(draws%x, 1), wp)/n)
         ranking = ranking([(1 + int((m - 0.5_wp)*stride), m=1, n)])
      end associate
      law%x = draws%x(ranking, :)
      law%n_all = draws%n_all
      law%n_independent = draws%n_independent
      call weigh(draws%mean, law, error)
   end subroutine choose_points

   !> Places along a direction, in eighths of its largest component.
   pure function along(x, direction) result(place)
      real(wp), intent(in) :: x(:, :)        !! (draw, input)
      real(wp), intent(in) :: direction(:)   !! (input)
      real(wp) :: place(size(x, 1))
      real(wp) :: largest
      integer :: j

      largest = direction(maxloc(abs(direction), 1))
      place = 0.0_wp
      do j = 1, size(direction)
         place = place + nint(parts*direction(j)/largest)*x(:, j)
      end do
   end function along

   !> Positions in ascending order of values, to a fraction of their range: a bucket each, in which
   !> they stay as they came.
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

   !> Computes the standard errors that the points leave in the means of functions f, and the draws
   !> that they stand for. With the slopes c of their polynomials,
   !> |D (f - B c)|^2 = |D f|^2 - c'(2 B'D'D f - B'D'D B c).
   subroutine error_of_points(law, values, stated, error)
      class(law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, function) f
      real(wp), intent(out) :: stated(:)                 !! (function)
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(law%change, 1), size(stated)) :: total, change
      real(wp), dimension(size(law%square, 1), size(stated)) :: of_change, slope
      real(wp) :: square(size(law%square, 1), size(law%square, 1))
      real(wp) :: between, variance
      integer :: n, o

      n = size(values, 1)
      do o = 1, size(stated)
         call pair_up(values(:, o), total(:, o), change(:, o))
      end do
      call multiply(law%change, change, of_change, transposes_a=.true.)
      call multiply(law%total, total, slope, transposes_a=.true.)
      slope = 0.5_wp*(slope + of_change)   ! a b + a' b' of a pair
      square = law%square
      call solve_positive_definite(square, slope, error)
      if (allocated(error)) return
      do o = 1, size(stated)
         call find_scatter(total(:, o), change(:, o), between, variance)
         between = between - dot_product(slope(:, o), 2.0_wp*of_change(:, o) &
                                         - matmul(law%of_changes, slope(:, o))) &
                   /(2*size(change, 1))
         stated(o) = sqrt(max(between, 0.0_wp)*(1.0_wp/n - 1.0_wp/law%n_all) &
                          + max(variance, 0.0_wp)/law%n_independent)
      end do
   end subroutine error_of_points

   !> Computes sums and differences in pairs of neighbours; an odd last value is in none.
   pure subroutine pair_up(values, total, change)
      real(wp), intent(in), contiguous :: values(:)              !! (point)
      real(wp), intent(out), contiguous :: total(:), change(:)   !! (pair)
      integer :: m

      do m = 1, size(total)
         total(m) = values(2*m - 1) + values(2*m)
         change(m) = values(2*m - 1) - values(2*m)
      end do
   end subroutine pair_up

   !> Computes variances from sums and differences in pairs.
   pure subroutine find_scatter(total, change, between, variance)
      real(wp), intent(in), contiguous :: total(:), change(:)   !! (pair)
      real(wp), intent(out) :: between    !! half the mean square of the differences
      real(wp), intent(out) :: variance   !! of all values
      real(wp) :: mean, of_totals
      integer :: m

      between = 0.0_wp
      mean = 0.0_wp
      of_totals = 0.0_wp
      !$omp simd reduction(+:between, mean, of_totals)
      do m = 1, size(total)
         between = between + change(m)**2
         mean = mean + total(m)
         of_totals = of_totals + total(m)**2
      end do
      variance = ((of_totals + between)/4 - (mean/2)**2/size(total))/size(total)
      between = between/(2*size(total))
   end subroutine find_scatter

   !> Computes the weights of the points that keep the means of the polynomials; equal weights
   !> unless all are positive.
   subroutine weigh(mean, law, error)
      real(wp), intent(in) :: mean(:)   !! (polynomial) to be kept
      type(law_type), intent(inout) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: b(:, :), square(:, :), short(:, :)
      integer :: i, k, n

      n = size(law%x, 1)
      call find_polynomials(law%x, b)
      k = size(b, 2)
      allocate (law%square(k, k), law%of_changes(k, k), law%weight(n), short(k, 1))
      call multiply(b, b, law%square, transposes_a=.true.)
      do i = 1, k   ! inputs may depend on each other
         law%square(i, i) = law%square(i, i)*(1.0_wp + 1.0e-10_wp)
      end do
      short(:, 1) = n*mean - sum(b, 1)
      square = law%square
      call solve_positive_definite(square, short, error)
      if (allocated(error)) return
      law%weight(:) = 1.0_wp + matmul(b, short(:, 1))
      if (any(law%weight <= 0.0_wp)) law%weight = 1.0_wp
      law%weight = law%weight/sum(law%weight)
      allocate (law%total(n/2, k), law%change(n/2, k))
      do i = 1, k
         call pair_up(b(:, i), law%total(:, i), law%change(:, i))
      end do
      call multiply(law%change, law%change, law%of_changes, transposes_a=.true.)
   end subroutine weigh

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
