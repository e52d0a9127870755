!> Mean and scatter of independent values, and how far to trust them.
module numerics_statistics
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: mean, standard_deviation, error_of_mean, error_of_deviation

contains

   !> Needs one value. Summed in the order given.
   pure function mean(values) result(average)
      real(wp), intent(in) :: values(:)
      real(wp) :: average

      average = sum(values)/size(values)
   end function mean

   !> Of the law the values come from (n - 1 in the denominator); needs two values.
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

   !> Standard error of the standard deviation for a law of any shape: that of the variance is
   !> (m4 - s^4 (n - 3)/(n - 1))/n, m4 the fourth central moment, and s = sqrt(variance) halves it
   !> relatively. Needs two values; zero where all are equal.
   pure function error_of_deviation(values) result(error)
      real(wp), intent(in) :: values(:)
      real(wp) :: error
      real(wp) :: fourth, s
      integer :: n

      n = size(values)
      s = standard_deviation(values)
      error = 0.0_wp
      if (.not. s > 0.0_wp) return
      fourth = sum(((values - mean(values))/s)**4)/n
      error = 0.5_wp*s*sqrt(max(fourth - (n - 3.0_wp)/(n - 1), 0.0_wp)/n)
   end function error_of_deviation

end module numerics_statistics
