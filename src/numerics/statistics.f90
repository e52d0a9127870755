!> Mean and scatter of independent values, and how far to trust them.
module numerics_statistics
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: mean, standard_deviation, error_of_mean, error_of_deviation, moments_type

   !> Sums for mean, scatter and their errors, of values that come in groups of any size.
   type :: moments_type
      integer :: n = 0
      real(wp) :: mean = 0.0_wp
      real(wp), private :: second = 0.0_wp, third = 0.0_wp, fourth = 0.0_wp   !! central, times n
   contains
      procedure :: add
      procedure :: standard_deviation => deviation_of_moments
      procedure :: error_of_mean => mean_error_of_moments
      procedure :: error_of_deviation => deviation_error_of_moments
   end type moments_type

contains

   !> Needs one value. Summed in the order given.
   pure function mean(values) result(average)
      real(wp), intent(in) :: values(:)
      real(wp) :: average

      average = sum(values)/size(values)
   end function mean

   !> Standard deviation of the law the values come from (n - 1 in the denominator); n >= 2.
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

   !> Standard error of the standard deviation, as of moments below.
   pure function error_of_deviation(values) result(error)
      real(wp), intent(in) :: values(:)
      real(wp) :: error
      type(moments_type) :: moments

      call moments%add(values)
      error = moments%error_of_deviation()
   end function error_of_deviation

   !> Takes more values; sums of powers of deviations from two means join as Pebay (2008) has it.
   pure subroutine add(self, values)
      class(moments_type), intent(inout) :: self
      real(wp), intent(in) :: values(:)   !! one or more
      type(moments_type) :: ours, both
      real(wp) :: a, b, d, n

      ours%n = size(values)
      ours%mean = mean(values)
      ours%second = sum((values - ours%mean)**2)
      ours%third = sum((values - ours%mean)**3)
      ours%fourth = sum((values - ours%mean)**4)
      a = self%n
      b = ours%n
      n = a + b
      d = ours%mean - self%mean
      both = ours
      if (self%n > 0) then
         both%n = self%n + ours%n
         both%mean = self%mean + d*b/n
         both%second = self%second + ours%second + d**2*a*b/n
         both%third = self%third + ours%third + d**3*a*b*(a - b)/n**2 &
                      + 3.0_wp*d/n*(a*ours%second - b*self%second)
         both%fourth = self%fourth + ours%fourth + d**4*a*b*(a**2 - a*b + b**2)/n**3 &
                       + 6.0_wp*(d/n)**2*(a**2*ours%second + b**2*self%second) &
                       + 4.0_wp*d/n*(a*ours%third - b*self%third)
      end if
      call replace(self, both)
   end subroutine add

   pure subroutine replace(moments, by)
      class(moments_type), intent(inout) :: moments
      type(moments_type), intent(in) :: by

      moments%n = by%n
      moments%mean = by%mean
      moments%second = by%second
      moments%third = by%third
      moments%fourth = by%fourth
   end subroutine replace

   !> Needs two values, as do the errors below.
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

   !> Standard error of the standard deviation for a law of any shape: that of the variance is
   !> (m4 - s^4 (n - 3)/(n - 1))/n, m4 the fourth central moment, and s = sqrt(variance) halves it
   !> relatively. Zero where all are equal.
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
