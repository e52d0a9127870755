!> Mean and scatter of independent values with their standard errors.
module numerics_statistics
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: mean, standard_deviation, error_of_mean, error_of_deviation, moments_type, n_sums, &
             sums_of

   integer, parameter :: n_sums = 5   !! of sums_of

   !> Sums for mean, scatter and their errors, of values in groups of any size.
   type :: moments_type
      integer :: n = 0
      real(wp) :: mean = 0.0_wp
      real(wp), private :: second = 0.0_wp, third = 0.0_wp, fourth = 0.0_wp   !! central, times n
   contains
      procedure :: add
      procedure :: join
      procedure :: standard_deviation => deviation_of_moments
      procedure :: error_of_mean => mean_error_of_moments
      procedure :: error_of_deviation => deviation_error_of_moments
      procedure :: freedoms
   end type moments_type

contains

   !> Mean of one value or more, summed in their order.
   pure function mean(values) result(average)
      real(wp), intent(in) :: values(:)
      real(wp) :: average

      average = sum(values)/size(values)
   end function mean

   !> Standard deviation of the values' law (n - 1 in the denominator); n >= 2.
   pure function standard_deviation(values) result(deviation)
      real(wp), intent(in) :: values(:)
      real(wp) :: deviation

      deviation = sqrt(sum((values - mean(values))**2)/(size(values) - 1))
   end function standard_deviation

   !> Standard error of the mean; needs two values.
   pure function error_of_mean(values) result(error)
      real(wp), intent(in) :: values(:)
      real(wp) :: error

      error = standard_deviation(values)/sqrt(real(size(values), wp))
   end function error_of_mean

   !> Standard error of the standard deviation, as for moments below.
   pure function error_of_deviation(values) result(error)
      real(wp), intent(in) :: values(:)
      real(wp) :: error
      type(moments_type) :: moments

      call moments%add(values)
      error = moments%error_of_deviation()
   end function error_of_deviation

   !> Adds values to the sums.
   pure subroutine add(self, values)
      class(moments_type), intent(inout) :: self
      real(wp), intent(in) :: values(:)   !! one or more

      call self%join(sums_of(values))
   end subroutine add

   !> Number of values, their mean, and sums of deviations from it to the powers 2 to 4.
   pure function sums_of(values) result(sums)
      real(wp), intent(in) :: values(:)   !! one or more
      real(wp) :: sums(n_sums)

      sums(1) = size(values)
      sums(2) = mean(values)
      sums(3) = sum((values - sums(2))**2)
      sums(4) = sum((values - sums(2))**3)
      sums(5) = sum((values - sums(2))**4)
   end function sums_of

   !> Adds the values of other sums; powers of deviations from two means are joined after Pebay
   !> (2008).
   pure subroutine join(self, sums)
      class(moments_type), intent(inout) :: self
      real(wp), intent(in) :: sums(n_sums)   !! as sums_of has them
      real(wp) :: a, b, d, n, second, third

      a = self%n
      b = sums(1)
      n = a + b
      if (self%n == 0) then
         self%mean = sums(2)
         self%second = sums(3)
         self%third = sums(4)
         self%fourth = sums(5)
      else
         d = sums(2) - self%mean
         second = self%second
         third = self%third
         self%mean = self%mean + d*b/n
         self%second = second + sums(3) + d**2*a*b/n
         self%third = third + sums(4) + d**3*a*b*(a - b)/n**2 + 3.0_wp*d/n*(a*sums(3) - b*second)
         self%fourth = self%fourth + sums(5) + d**4*a*b*(a**2 - a*b + b**2)/n**3 &
                       + 6.0_wp*(d/n)**2*(a**2*sums(3) + b**2*second) &
                       + 4.0_wp*d/n*(a*sums(4) - b*third)
      end if
      self%n = nint(n)
   end subroutine join

   !> Standard deviation; needs two values, as do the errors below.
   elemental function deviation_of_moments(self) result(deviation)
      class(moments_type), intent(in) :: self
      real(wp) :: deviation

      deviation = sqrt(self%second/(self%n - 1))
   end function deviation_of_moments

   elemental function mean_error_of_moments(self) result(error)
      class(moments_type), intent(in) :: self
      real(wp) :: error

      error = self%standard_deviation()/sqrt(real(self%n, wp))
   end function mean_error_of_moments

   !> Values that carry the scatter: (sum of squares)^2/(sum of fourth powers) of deviations from
   !> the mean; all if they are equal.
   elemental real(wp) function freedoms(self)
      class(moments_type), intent(in) :: self

      freedoms = self%n
      if (self%fourth > 0.0_wp) freedoms = self%second**2/self%fourth
   end function freedoms

   !> Standard error of the standard deviation s for a law of any shape: the variance of s^2 is
   !> (m4 - s^4 (n - 3)/(n - 1))/n with the fourth central moment m4, and the relative error of s is
   !> half of that of s^2. Zero if all values are equal.
   elemental function deviation_error_of_moments(self) result(error)
      class(moments_type), intent(in) :: self
      real(wp) :: error
      real(wp) :: s

      s = self%standard_deviation()
      error = 0.0_wp
      if (.not. s > 0.0_wp) return
      associate (n => real(self%n, wp))
         error = 0.5_wp*s*sqrt(max(self%fourth/(n*s**4) - (n - 3.0_wp)/(n - 1), 0.0_wp)/n)
      end associate
   end function deviation_error_of_moments

end module numerics_statistics
