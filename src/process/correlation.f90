!> Correlation lengths of a discrete stationary process (Sec. 2.1), cut at the last lag supplied.
!>
!> The infinite sums of an autoregressive process are in `process_autoregressive_model`.
module process_correlation
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: correlation_length, correlation_length_l0, correlation_length_l1, constraint_weights

contains

   !> The length by its definition's name, 'L0' or 'L1'. Unit: lags.
   pure function correlation_length(definition, autocovariance) result(length)
      character(*), intent(in) :: definition
      real(wp), intent(in) :: autocovariance(0:)   !! K_XX(m), m = 0..m_max
      real(wp) :: length

      select case (definition)
      case ('L0')
         length = correlation_length_l0(autocovariance)
      case ('L1')
         length = correlation_length_l1(autocovariance)
      case default
         error stop 'correlation_length: the definition is L0 or L1'
      end select
   end function correlation_length

   !> Eq. (8). Unit: lags.
   pure function correlation_length_l0(autocovariance) result(length)
      !> K_XX(m), m = 0..m_max [unit of X squared]; needs K_XX(0) > 0
      real(wp), intent(in) :: autocovariance(0:)
      real(wp) :: length

      length = sum(abs(autocovariance(1:)))/autocovariance(0)
   end function correlation_length_l0

   !> Eq. (9). Unit: lags.
   pure function correlation_length_l1(autocovariance) result(length)
      !> K_XX(m), m = 0..m_max [unit of X squared]; needs K_XX(0) > 0
      real(wp), intent(in) :: autocovariance(0:)
      real(wp) :: length
      integer :: m

      length = sum([(m*abs(autocovariance(m)), m=0, ubound(autocovariance, 1))])/ &
               sum(abs(autocovariance))
   end function correlation_length_l1

   !> a_m of Eqs. (13), (14), m = 0..m_max: sum a_m |K_XX(m)| = 0 imposes the length, Eq. (11).
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
