!> Estimates of a regression joined with plain sampling's, and the errors they state: formulas (6),
!> (8) and (9) of docs/regression.md.
module statistics_blend
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_estimates, only: blank_estimates, estimates_type, stated_error
   use statistics_law, only: error_of_points, law_type
   implicit none(type, external)
   private
   public :: blend, join, state_error

contains

   !> Joins the estimates of a regression, as far from the truth as the means of some functions are
   !> over the points, with plain sampling's.
   subroutine join(law, values, n_samples, surrogate, plain, least, both, error)
      class(law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)    !! (point, output) of the functions
      integer, intent(in) :: n_samples                    !! of the case
      type(estimates_type), intent(in) :: surrogate
      type(estimates_type), intent(inout) :: plain        !! its influences are enlarged as both's
      real(wp), intent(in) :: least(:)                    !! (output) share of plain
      type(estimates_type), intent(out) :: both
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: of_points(size(least))
      integer :: o

      call blend(surrogate, plain, least, both)
      call error_of_points(law, values, of_points, error)
      if (allocated(error)) return
      allocate (both%stated(size(least)), both%ratio(size(least)))
      do o = 1, size(least)
         if (allocated(both%excess)) then
            both%influence(:, o) = both%excess(1, o)*both%influence(:, o)
            plain%influence(:, o) = both%excess(2, o)*plain%influence(:, o)
         end if
         call state_error(of_points(o), n_samples, both%influence(:, o), both%bias(o), &
                          plain%influence(:, o), 1.0_wp - both%share(o), both%stated(o), &
                          both%ratio(o))
      end do
   end subroutine join

   !> Blends surrogate and plain estimates with the plain share of least variance, at least
   !> `least`; 1 where plain sampling has no error. Both estimates are of the same samples,
   !> correlated as their influences are; the plain one may have further samples at the end, which
   !> belong to no surrogate.
   pure subroutine blend(surrogate, plain, least, both)
      type(estimates_type), intent(in) :: surrogate, plain
      real(wp), intent(in) :: least(:)               !! (output) share of plain
      type(estimates_type), intent(out) :: both
      real(wp) :: share(size(least)), ours, theirs, common
      integer :: o

      both = blank_estimates(size(plain%influence, 1), size(plain%value))
      do o = 1, size(plain%value)
         associate (n => size(surrogate%influence, 1), phi => surrogate%influence(:, o), &
                    psi => plain%influence(:, o))
            ours = sum(phi**2) + surrogate%bias(o)**2
            theirs = sum(psi**2) + plain%bias(o)**2
            common = sum(phi*psi(:n)) + surrogate%bias(o)*plain%bias(o)
            share(o) = 1.0_wp
            if (theirs > 0.0_wp) share(o) = &
               max(least(o), min(1.0_wp, max(0.0_wp, (ours - common) &
                                             /max(ours + theirs - 2.0_wp*common, tiny(ours)))))
            both%influence(:, o) = share(o)*psi
            both%influence(:n, o) = both%influence(:n, o) + (1.0_wp - share(o))*phi
         end associate
      end do
      both%share = share
      both%value = (1.0_wp - share)*surrogate%value + share*plain%value
      both%bias = (1.0_wp - share)*surrogate%bias + share*plain%bias
      if (allocated(plain%stretch)) &
         both%stretch = 1.0_wp + spread(share, 1, 2)*(plain%stretch - 1.0_wp)
      if (allocated(surrogate%excess)) then
         both%excess = surrogate%excess
         both%excess(1, :) = (1.0_wp - share)*both%excess(1, :) + share*both%excess(2, :)
         if (size(plain%influence, 1) > size(surrogate%influence, 1)) both%excess = 1.0_wp
      end if
   end subroutine blend

   !> States the error of the regression and of the points of the law for its share of the estimate,
   !> and how much larger plain sampling's is.
   pure subroutine state_error(of_points, n_samples, influence, bias, of_plain, share, stated, &
                               ratio)
      real(wp), intent(in) :: of_points                  !! standard error that the points leave
      integer, intent(in) :: n_samples
      real(wp), intent(in), contiguous :: influence(:)   !! (sample) of the estimate
      real(wp), intent(in) :: bias
      real(wp), intent(in), contiguous :: of_plain(:)    !! (sample) influences of plain sampling
      real(wp), intent(in) :: share                      !! of the regression
      real(wp), intent(out) :: stated, ratio
      real(wp) :: plain

      plain = stated_error(of_plain, 0.0_wp, n_samples)
      stated = plain
      if (share > 0.0_wp) stated = hypot(stated_error(influence, bias, n_samples), share*of_points)
      ratio = 1.0_wp
      if (stated > 0.0_wp) ratio = plain/stated
   end subroutine state_error

end module statistics_blend
