!> Whether a positive process has the signs by which its correlation length was summed: those of the
!> unconstrained process.
module process_positive_signs
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use process_positive_law, only: positive_law
   implicit none(type, external)
   private
   public :: require_signs

contains

   !> Fails where a K(m) clearly has another sign: by 5 standard errors and a thousandth of K(0).
   subroutine require_signs(law, autocovariance, standard_error, error)
      class(positive_law), intent(in) :: law
      real(wp), intent(in) :: autocovariance(0:)    !! (0:n_lags) K(m), with its standard errors
      real(wp), intent(in) :: standard_error(0:)
      type(error_type), allocatable, intent(out) :: error
      integer :: m

      do m = 1, ubound(autocovariance, 1)
         if (sign(1.0_wp, law%companion_autocovariance(m))*autocovariance(m) >= &
             -max(5.0_wp*standard_error(m), 1.0e-3_wp*autocovariance(0))) cycle
         call raise(error, exit_no_solution, law%name(size(law%a))// &
                    ': the search ended where K('//to_text(m)//') has changed its sign')
         return
      end do
   end subroutine require_signs

end module process_positive_signs
