!> Correlation lengths of a discrete stationary process (Sec. 2.1), summed to the last lag given.
!> The infinite sums of an autoregressive process are in `process_autoregressive_sums`.
module process_correlation
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: constraint_weights, correlation_length

   real(wp), parameter, public :: zero_correlation = 1.0e-9_wp   !! |K(m)|/K(0) that counts as 0

contains

   !> Length of Eq. (8), 'L0', or of Eq. (9), 'L1' [lags].
   pure real(wp) function correlation_length(definition, autocovariance) result(length)
      character(*), intent(in) :: definition
      !> K_XX(m), m = 0..m_max [unit of X squared]; needs K_XX(0) > 0
      real(wp), intent(in) :: autocovariance(0:)
      integer :: m

      select case (definition)
      case ('L0')
         length = sum(abs(autocovariance(1:)))/autocovariance(0)
      case ('L1')
         length = sum([(m*abs(autocovariance(m)), m=0, ubound(autocovariance, 1))])/ &
                  sum(abs(autocovariance))
      case default
         error stop 'correlation_length: the definition is L0 or L1'
      end select
   end function correlation_length

   !> Weights a_m, m = 0..m_max, of Eqs. (13) and (14): sum a_m |K_XX(m)| = 0 imposes the length,
   !> Eq. (11).
   pure function constraint_weights(definition, length, m_max) result(weights)
      character(*), intent(in) :: definition   !! 'L0' or 'L1'
      real(wp), intent(in) :: length           !! [lags]
      integer, intent(in) :: m_max
      real(wp) :: weights(0:m_max)
      integer :: m

      select case (definition)
      case ('L0')
         weights = [length, (-1.0_wp, m=1, m_max)]
      case ('L1')
         weights = [(length - m, m=0, m_max)]
      case default
         error stop 'constraint_weights: the definition is L0 or L1'
      end select
   end function constraint_weights

end module process_correlation
