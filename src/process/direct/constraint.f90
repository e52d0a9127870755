!> Constraint on the correlation length, Eq. (11), and the lags whose signs must be searched.
module process_direct_constraint
   use core_kinds, only: wp
   use process_correlation, only: constraint_weights
   use process_model, only: process_request
   implicit none(type, external)
   private
   public :: length_constraint, constraint_of

   !> Eq. (11): sum a_m |K(m)| = 0.
   type :: length_constraint
      integer :: m_max = 0
      real(wp), allocatable :: weights(:)    !! a_m, m = 0..m_max
      integer, allocatable :: rewarded(:)    !! lags m >= 1 with a_m < 0, whose signs are searched
      integer, allocatable :: penalized(:)   !! lags m >= 1 with a_m > 0, where K(m) = 0 is possible
   end type length_constraint

contains

   !> Constraint of a request of the direct method.
   pure type(length_constraint) function constraint_of(request) result(constraint)
      type(process_request), intent(in) :: request
      integer :: m

      constraint%m_max = request%order
      allocate (constraint%weights(0:request%order))
      constraint%weights(:) = constraint_weights(request%correlation, request%correlation_length, &
                                                 request%order)
      constraint%rewarded = pack([(m, m=1, request%order)], constraint%weights(1:) < 0.0_wp)
      constraint%penalized = pack([(m, m=1, request%order)], constraint%weights(1:) > 0.0_wp)
   end function constraint_of

end module process_direct_constraint
