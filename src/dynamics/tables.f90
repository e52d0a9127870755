!> What all samples of a march by tables share: exact steps, and how far they may be trusted.
module dynamics_tables
   use core_kinds, only: wp
   use structure_model, only: structure_type
   use dynamics_crossing, only: crossing_batch, new_batch, path_error
   use dynamics_propagator, only: levels, new_propagator, propagator_type, stride_of
   use dynamics_taylor, only: fastest_rate
   use dynamics_transitions, only: found_transitions
   implicit none(type, external)
   private
   public :: tables_type, new_tables, table_rate_step

   real(wp), parameter :: table_rate_step = 0.5_wp   !! longest stride in fastest time constants

   !> One chain's, for steps of one length.
   type :: tables_type
      type(structure_type) :: chain
      real(wp) :: h = 0.0_wp              !! [s]
      integer :: level = 1                !! of the longest stride
      real(wp) :: floor(levels) = 0.0_wp  !! share of the reach kept clear in quiet strides
      logical :: has_crossings(levels) = .false.   !! dynamics_crossing keeps the tolerance
      type(propagator_type) :: propagator
      type(crossing_batch) :: batch       !! room for transitions to be located
      type(found_transitions) :: found    !! and for those that are
   end type tables_type

contains

   !> For steps of length h, with transitions located to a tolerance relative to the amplitude.
   subroutine new_tables(chain, h, forced_dof, tolerance, tables)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      integer, intent(in) :: forced_dof
      real(wp), intent(in) :: tolerance
      type(tables_type), intent(out) :: tables
      real(wp) :: rate
      integer :: level

      rate = fastest_rate(chain)
      tables%chain = chain
      tables%h = h
      tables%floor = (rate*h*stride_of)**4/384.0_wp
      do level = 1, levels
         tables%has_crossings(level) = path_error(stride_of(level)*rate*h) <= tolerance
      end do
      ! not beyond what crossings allow, but for two steps, which pay even so
      tables%level = max(2, count(tables%has_crossings))
      tables%level = min(tables%level, count(stride_of*rate*h <= table_rate_step))
      tables%batch = new_batch(chain, h, forced_dof, rate, stride_of(tables%level), tolerance)
      call new_propagator(chain, h, forced_dof, tables%propagator)
   end subroutine new_tables

end module dynamics_tables
