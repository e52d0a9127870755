!> The constraint on the correlation length, as the search for its signs sees it (Sec. 2.1).
module process_direct_constraint
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: length_constraint, new_constraint

   !> Eq. (11): sum a_m |K(m)| = 0.
   type :: length_constraint
      integer :: m_max = 0
      real(wp), allocatable :: weights(:)    !! a_m, m = 0..m_max
      integer, allocatable :: rewarded(:)    !! lags with a_m < 0: their signs are to be searched
      integer, allocatable :: penalized(:)   !! lags m >= 1 with a_m > 0: they can have K(m) = 0
   end type length_constraint

contains

   !> The constraint with these weights.
   pure function new_constraint(weights) result(constraint)
      real(wp), intent(in) :: weights(0:)   !! a_m, m = 0..m_max, Eqs. (13), (14)
      type(length_constraint) :: constraint
      integer :: m

      constraint%m_max = ubound(weights, 1)
      allocate (constraint%weights(0:constraint%m_max))
      constraint%weights(:) = weights
      constraint%rewarded = pack([(m, m=1, constraint%m_max)], weights(1:) < 0.0_wp)
      constraint%penalized = pack([(m, m=1, constraint%m_max)], weights(1:) > 0.0_wp)
   end function new_constraint

end module process_direct_constraint
