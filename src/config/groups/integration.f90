!> &integration: how the motion is marched through time.
module config_groups_integration
   use campaign_plan, only: integration_settings
   use config_text_value_table, only: about, between, inside, not_negative, positive, &
      visitor_type
   use core_kinds, only: wp
   use dynamics_newmark_march, only: most_halvings
   implicit none(type, external)
   private
   public :: fewest_measured, integration_group

   integer, parameter :: fewest_measured = 64   !! steps behind n_discard: two spans of slip series

   !> Settings of the march, as the scene says them.
   type, extends(integration_settings) :: integration_group
   contains
      procedure :: visit
   end type integration_group

contains

   subroutine visit(self, visitor)
      class(integration_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%method, about('method', &
         'newmark: the scheme of Sec. 3; event: exact transitions', choices='newmark event'))
      call visitor%visit(self%dt, about('dt', 'time step', 's', positive()))
      call visitor%visit(self%n_steps, about('n_steps', '0: as many as a force file has', &
         rule=between(0.0_wp, 2.0e9_wp)))
      call visitor%visit(self%n_discard, about('n_discard', 'first steps that enter no statistic', &
         rule=not_negative()))
      call visitor%visit(self%max_halvings, about('max_halvings', &
         'newmark: a transition is closed in on down to dt/2^max_halvings', &
         rule=between(0.0_wp, real(most_halvings, wp)), used=self%method == 'newmark'))
      call visitor%visit(self%beta, about('beta', 'newmark', rule=between(0.0_wp, 0.5_wp), &
         used=self%method == 'newmark'))
      call visitor%visit(self%gamma, about('gamma', 'newmark; below 0.5 it would feed energy', &
         rule=between(0.5_wp, 1.0_wp), used=self%method == 'newmark'))
      call visitor%visit(self%tolerance, about('tolerance', &
         'event: displacement error relative to its rms', rule=inside(0.0_wp, 1.0_wp), &
         used=self%method == 'event'))
   end subroutine visit

end module config_groups_integration
