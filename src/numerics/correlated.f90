!> Standard errors of averages of correlated values.
!>
!> The variance of an average is the sum of the autocovariance over all lags, divided by the number
!> of values. Beyond some lag an estimated autocovariance is noise. Geyer's initial monotone
!> sequence (Stat. Sci. 7, 1992) ends the sum: it adds pairs of neighbouring lags while their sums
!> are positive, and limits each sum to the one before.
module numerics_correlated
   use core_kinds, only: wp
   use numerics_statistics, only: error_of_mean, mean
   implicit none(type, external)
   private
   public :: autocovariance_of, error_of_average, error_of_batches

   integer, parameter, public :: n_batches = 8   !! parts of a march; scatter within 1/sqrt(2*7)

contains

   !> Autocovariance of a series about its own mean at lags 0..n/2 - 1.
   pure function autocovariance_of(series) result(autocovariance)
      real(wp), intent(in) :: series(:)
      real(wp) :: autocovariance(0:max(size(series)/2 - 1, 0))
      real(wp) :: centred(size(series))
      integer :: k, n

      n = size(series)
      centred = series - mean(series)
      do k = 0, ubound(autocovariance, 1)
         autocovariance(k) = dot_product(centred(:n - k), centred(1 + k:))/n
      end do
   end function autocovariance_of

   !> Standard error of the average of n values with an estimated autocovariance. The estimate is
   !> about the average, which lowers every lag by the variance of the average; the divisor corrects
   !> that. The error is at least that of independent values, also if neighbours alternate. For
   !> independent values it is some 15 % too large, because only positive pairs are added.
   pure function error_of_average(autocovariance, n) result(error)
      real(wp), intent(in) :: autocovariance(0:)   !! lags 0.. of n values
      integer, intent(in) :: n
      real(wp) :: error
      real(wp) :: pair, previous, total
      integer :: k, n_lags   ! n_lags in the sum, negative ones included

      error = 0.0_wp
      if (.not. autocovariance(0) > 0.0_wp) return
      previous = huge(1.0_wp)
      total = -autocovariance(0)
      n_lags = 1
      do k = 0, ubound(autocovariance, 1) - 1, 2
         pair = min(autocovariance(k) + autocovariance(k + 1), previous)
         if (.not. pair > 0.0_wp) exit
         total = total + 2.0_wp*pair
         previous = pair
         n_lags = 2*k + 3
      end do
      total = max(total, autocovariance(0))
      error = sqrt(total/(n - min(n_lags, n/2)))
   end function error_of_average

   !> Standard error of the mean of consecutive batches: from the scatter of the batches or of pairs
   !> of them, whichever is larger, because short batches are correlated.
   pure function error_of_batches(batches) result(error)
      real(wp), intent(in) :: batches(:)   !! an even number
      real(wp) :: error

      error = max(error_of_mean(batches), error_of_mean(0.5_wp*(batches(1::2) + batches(2::2))))
   end function error_of_batches

end module numerics_correlated
