!> Mean and scatter of independent values with their standard errors.
module numerics_statistics
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: mean, standard_deviation, error_of_mean
   public :: n_sums, sums_of, joined_sums, deviation_of_sums, mean_error_of_sums, &
             deviation_error_of_sums, freedoms_of_sums

   integer, parameter :: n_sums = 5   !! numbers that `sums_of` returns

contains

   !> Mean of one value or more.
   pure function mean(values) result(average)
      real(wp), intent(in) :: values(:)
      real(wp) :: average

      average = sum(values)/size(values)
   end function mean

   !> Standard deviation of two values or more, with the denominator n - 1.
   pure function standard_deviation(values) result(deviation)
      real(wp), intent(in) :: values(:)
      real(wp) :: deviation

      deviation = sqrt(sum((values - mean(values))**2)/(size(values) - 1))
   end function standard_deviation

   !> Standard error of the mean of two values or more.
   pure function error_of_mean(values) result(error)
      real(wp), intent(in) :: values(:)
      real(wp) :: error

      error = standard_deviation(values)/sqrt(real(size(values), wp))
   end function error_of_mean

   !> Number of values, their mean, and the sums of their deviations from it to the powers 2, 3 and
   !> 4.
   pure function sums_of(values) result(sums)
      real(wp), intent(in) :: values(:)   !! one or more
      real(wp) :: sums(n_sums)

      sums(1) = size(values)
      sums(2) = mean(values)
      sums(3) = sum((values - sums(2))**2)
      sums(4) = sum((values - sums(2))**3)
      sums(5) = sum((values - sums(2))**4)
   end function sums_of

   !> The sums of `sums_of` for two groups of values together (Pebay 2008).
   pure function joined_sums(one, other) result(sums)
      real(wp), intent(in) :: one(n_sums), other(n_sums)
      real(wp) :: sums(n_sums)
      real(wp) :: d

      sums = one + other
      d = other(2) - one(2)
      associate (a => one(1), b => other(1), n => one(1) + other(1))
         sums(2) = one(2) + d*b/n
         sums(3) = sums(3) + d**2*a*b/n
         sums(4) = sums(4) + d**3*a*b*(a - b)/n**2 + 3.0_wp*d/n*(a*other(3) - b*one(3))
         sums(5) = sums(5) + d**4*a*b*(a**2 - a*b + b**2)/n**3 &
                   + 6.0_wp*(d/n)**2*(a**2*other(3) + b**2*one(3)) &
                   + 4.0_wp*d/n*(a*other(4) - b*one(4))
      end associate
   end function joined_sums

   !> Standard deviation; needs two values.
   pure real(wp) function deviation_of_sums(sums)
      real(wp), intent(in) :: sums(n_sums)

      deviation_of_sums = sqrt(sums(3)/(sums(1) - 1))
   end function deviation_of_sums

   !> Standard error of the mean; needs two values.
   pure real(wp) function mean_error_of_sums(sums)
      real(wp), intent(in) :: sums(n_sums)

      mean_error_of_sums = deviation_of_sums(sums)/sqrt(sums(1))
   end function mean_error_of_sums

   !> Effective number of values behind the variance: (sum of squares)^2/(sum of fourth powers) of
   !> the deviations from the mean; all values if they are equal.
   pure real(wp) function freedoms_of_sums(sums)
      real(wp), intent(in) :: sums(n_sums)

      freedoms_of_sums = sums(1)
      if (sums(5) > 0.0_wp) freedoms_of_sums = sums(3)**2/sums(5)
   end function freedoms_of_sums

   !> Standard error of the standard deviation s for a law of any shape: the variance of s^2 is
   !> (m4 - s^4 (n - 3)/(n - 1))/n with the fourth central moment m4, and the relative error of s is
   !> half that of s^2. For two or three values m4 is that of a normal law. Zero if all values are
   !> equal; needs two values.
   pure real(wp) function deviation_error_of_sums(sums) result(error)
      real(wp), intent(in) :: sums(n_sums)
      real(wp) :: s

      s = deviation_of_sums(sums)
      error = 0.0_wp
      if (.not. s > 0.0_wp) return
      associate (n => sums(1))
         error = 0.5_wp*s*sqrt(max(sums(5)/(n*s**4) - (n - 3.0_wp)/(n - 1), 0.0_wp)/n)
         if (n < 4.0_wp) error = s/sqrt(2.0_wp*(n - 1.0_wp))
      end associate
   end function deviation_error_of_sums

end module numerics_statistics
