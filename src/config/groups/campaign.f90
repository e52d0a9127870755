!> &campaign: how many samples, and how long they may take.
module config_groups_campaign
   use config_text_value_table, only: about, choice_length, not_negative, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: campaign_group

   !> Defaults are those of the paper, without its deterministic runs.
   type :: campaign_group
      integer :: n_samples = 100
      logical :: deterministic = .false.
      character(choice_length) :: estimator = 'pooled'
      real(wp) :: walltime = 0.0_wp
   contains
      procedure :: visit
   end type campaign_group

contains

   subroutine visit(self, visitor)
      class(campaign_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%n_samples, about('n_samples', &
         'of every case with drawn friction; 0: no such case', rule=not_negative(), &
         shapes_samples=.false.))
      call visitor%visit(self%deterministic, about('deterministic', &
         'also one sample per level of the force, before the others, with '// &
         'chain%friction or else process%mean', shapes_samples=.false.))
      call visitor%visit(self%estimator, about('estimator', &
         'of statistics over the friction: regression over all cases of one force, '// &
         'regression over each case, or sample statistics alone', shapes_samples=.false., &
         choices='pooled regression plain'))
      call visitor%visit(self%walltime, about('walltime', &
         'stop at a sample boundary after that long; 0: no limit', 'min', not_negative(), &
         shapes_samples=.false.))
   end subroutine visit

end module config_groups_campaign
