!> How far std/mean of a positive process can go at a given correlation length, before anything is
!> fitted.
!>
!> Coefficients of the unconstrained optimum's shape are made stronger and stronger, mu always such
!> that the length is the wanted one: std/mean grows towards a limit, reached as mu runs away to
!> minus infinity (without correlation it is the exponential law's, 1). For order 1 this is every
!> process there is.
module process_positive_limit
   use core_kinds, only: wp
   use numerics_root_search, only: new_root_search, root_search
   use process_autoregressive_model, only: coefficients_of
   use process_positive_law, only: positive_law
   use process_positive_moments, only: positive_moments
   implicit none(type, external)
   private
   public :: follow_family

   !> relative, of the wanted length along the family
   real(wp), parameter :: length_tolerance = 1.0e-3_wp

contains

   !> Follows the family until it has the wanted ratio: `point` (ln factor, coordinate) is then near
   !> the solution. Where it ends before, `limit` is the largest std/mean met, less its error; it
   !> begins where the sample's noise leaves a mu for the wanted length.
   subroutine follow_family(law, point, limit, is_reached)
      class(positive_law), intent(inout) :: law   !! with a shape
      real(wp), intent(inout) :: point(2)
      real(wp), intent(out) :: limit
      logical, intent(out) :: is_reached
      integer, parameter :: max_doublings = 7
      real(wp), parameter :: certainly = 3.0_wp   ! standard errors
      real(wp) :: inner(2), outer(2), ratio, slack
      integer :: i
      logical :: has_begun, is_found

      limit = 0.0_wp
      has_begun = .false.
      is_reached = .false.
      point(1) = log(1.02_wp)
      ! sum a_q tends to -1 as the factor grows: halve what is missing
      slack = slack_at(law, exp(point(1)))
      outer = point
      do i = 1, max_doublings
         inner = outer
         if (i > 1) then
            slack = 0.5_wp*slack
            outer(1) = log(factor_of(law, slack, exp(inner(1))))
         end if
         if (.not. has_begun) outer(2) = point(2)
         call match_length(law, outer, ratio, is_found)
         if (.not. is_found .and. .not. has_begun) cycle
         if (.not. is_found) exit
         is_reached = ratio >= law%wanted_ratio
         if (is_reached .or. ratio < limit) exit   ! it grows to its limit, or has a maximum
         limit = ratio - certainly*law%moments%ratio_error
         has_begun = .true.
      end do
      if (.not. is_reached) return
      do i = 1, merge(6, 0, has_begun)   ! halve the stretch in which the ratio is passed
         point = 0.5_wp*(inner + outer)
         call match_length(law, point, ratio, is_found)
         if (ratio >= law%wanted_ratio .or. .not. is_found) then
            outer = point
         else
            inner = point
         end if
      end do
      point = outer
   end subroutine follow_family

   !> The factor at which 1 + sum a_q is `slack`.
   function factor_of(law, slack, start) result(factor)
      class(positive_law), intent(in) :: law
      real(wp), intent(in) :: slack
      real(wp), intent(in) :: start   !! smaller than it
      real(wp) :: factor
      real(wp) :: high, low
      integer :: i

      low = start
      high = start
      do while (slack_at(law, high) > slack)
         high = 2.0_wp*high
      end do
      do i = 1, 50
         factor = 0.5_wp*(low + high)
         if (slack_at(law, factor) > slack) then
            low = factor
         else
            high = factor
         end if
      end do
   end function factor_of

   !> 1 + sum a_q; 0 where there is no process any more.
   function slack_at(law, factor) result(slack)
      class(positive_law), intent(in) :: law
      real(wp), intent(in) :: factor
      real(wp) :: slack
      real(wp), allocatable :: kappa(:)
      real(wp) :: unused

      call law%unfold([log(factor), 0.0_wp], kappa, unused)
      slack = 0.0_wp
      if (all(abs(kappa) < 1.0_wp)) slack = 1.0_wp + sum(coefficients_of(kappa))
   end function slack_at

   !> The coordinate that gives the wanted length at this factor, and std/mean there. The length
   !> grows with mu, up to that of the Gaussian. Where there is none the moments stay those of
   !> before, from which the next chains start.
   subroutine match_length(law, point, ratio, is_found)
      class(positive_law), intent(inout) :: law
      real(wp), intent(inout) :: point(2)
      real(wp), intent(out) :: ratio
      logical, intent(out) :: is_found
      integer, parameter :: max_steps = 20
      type(root_search) :: search
      type(positive_moments) :: before
      real(wp), allocatable :: kappa(:), state(:)
      real(wp) :: unused
      logical :: is_inside
      integer :: i

      before = law%moments
      call law%unfold(point, kappa, unused)
      call law%settle(coefficients_of(kappa))
      search = new_root_search(0.25_wp)
      ratio = 0.0_wp
      do i = 1, max_steps
         call law%evaluate(point, state, is_inside)
         if (.not. is_inside) exit
         ratio = law%moments%ratio
         is_found = abs(state(2)) <= length_tolerance
         if (is_found) return
         call search%advance(point(2), state(2))
      end do
      is_found = .false.
      law%moments = before
   end subroutine match_length

end module process_positive_limit
