!> &accuracy: errors that are wanted, and how they are watched.
module config_groups_accuracy
   use campaign_plan, only: accuracy_settings
   use config_text_value_table, only: about, between, not_negative, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: accuracy_group

   !> Errors that are wanted, as the scene says them. By default nothing is watched.
   type, extends(accuracy_settings) :: accuracy_group
   contains
      procedure :: visit
   end type accuracy_group

contains

   subroutine visit(self, visitor)
      class(accuracy_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%target_slip_points, about('target_slip_points', &
         'wanted numerical error of slip fractions, in points of percent; 0: none', '%', &
         not_negative(), shapes_samples=.false.))
      call visitor%visit(self%target_band_ratio, about('target_band_ratio', &
         'wanted numerical error of band ratios, relative; 0: none', rule=not_negative(), &
         shapes_samples=.false.))
      call visitor%visit(self%target_statistical, about('target_statistical', &
         'wanted standard error of mean slip fractions, in points of percent; 0: none', '%', &
         not_negative(), shapes_samples=.false.))
      call visitor%visit(self%sample_until_met, about('sample_until_met', &
         'take samples until target_statistical is met, n_samples at a time', &
         shapes_samples=.false.))
      call visitor%visit(self%audit, about('audit', &
         'share of the samples repeated by event, at a thousandth of its tolerance', &
         rule=between(0.0_wp, 1.0_wp), shapes_samples=.false.))
   end subroutine visit

end module config_groups_accuracy
