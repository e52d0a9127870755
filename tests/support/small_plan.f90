!> The paper's chain with a short march, for tests of campaigns.
module small_plan
   use campaign_plan, only: case_type, plan_type
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use structure_chain, only: build_chain
   implicit none(type, external)
   private
   public :: new_small_plan

contains

   !> Two levels of force without process, the exact method, spectra asked for.
   subroutine new_small_plan(n_steps, plan)
      integer, intent(in) :: n_steps
      type(plan_type), intent(out) :: plan
      type(error_type), allocatable :: error
      real(wp) :: one(5)

      one = 1.0_wp
      plan%title = 'small'
      plan%seed = 2016_long
      plan%has_structure = .true.
      call build_chain(one, 25*one, 50*one, 10*one, 0.005_wp*one, plan%structure, error)
      plan%friction = 0.2_wp*one
      allocate (plan%processes(0))
      plan%excitation%kind = 'band_limited'
      plan%excitation%band = [0.0_wp, 2.5_wp]
      plan%excitation%dof = 5
      plan%excitation%file = ''
      plan%integration%method = 'event'
      plan%integration%dt = 0.00843_wp
      plan%integration%n_steps = n_steps
      plan%integration%tolerance = 1.0e-9_wp
      plan%cases = [case_type(0, 3.7_wp, 1), case_type(0, 41.1_wp, 70)]
      plan%output%slip = .true.
      plan%output%spectrum = .true.
      plan%output%percentiles = [5.0_wp, 95.0_wp]
      plan%output%segment_length = 1024
   end subroutine new_small_plan

end module small_plan
