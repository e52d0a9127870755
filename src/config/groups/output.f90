!> &output: what is kept. What is not asked for is not computed.
module config_groups_output
   use campaign_plan, only: output_settings
   use config_text_value_table, only: about, between, choice_length, inside, &
      not_negative, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: output_group

   !> Results to keep, as the scene says them.
   type, extends(output_settings) :: output_group
      character(choice_length), allocatable :: quantities(:)
   contains
      procedure :: visit
      procedure :: keeps
   end type output_group

contains

   subroutine visit(self, visitor)
      class(output_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit_choices(self%quantities, about('quantities', 'what is computed and kept', &
         choices='slip spectrum energy history realizations transitions'), &
         default=[character(choice_length) :: 'slip', 'spectrum'])
      call visitor%visit(self%dofs, about('dofs', &
         'whose spectra and histories are kept, ascending; 0: all', rule=not_negative(), &
         used=self%keeps('spectrum') .or. self%keeps('history')), default=[0])
      call visitor%visit(self%percentiles, about('percentiles', &
         'of slip fractions and spectra, ascending', '%', inside(0.0_wp, 100.0_wp), &
         shapes_samples=.false.), default=[5.0_wp, 95.0_wp])
      call visitor%visit(self%segment_length, about('segment_length', &
         'of the spectra: steps of a Welch segment, or all there are', &
         rule=between(8.0_wp, 1.0e8_wp), used=self%keeps('spectrum')))
      call visitor%visit(self%spectrum_every, about('spectrum_every', &
         'every so many steps enter the spectra; 0: chosen and stated', rule=not_negative(), &
         used=self%keeps('spectrum')))
      call visitor%visit(self%samples, about('samples', &
         'spectra and slip series of every sample are kept; '// &
         'else their statistics alone: none can be added later', used=self%keeps('spectrum')))
   end subroutine visit

   pure logical function keeps(self, quantity)
      class(output_group), intent(in) :: self
      character(*), intent(in) :: quantity

      keeps = any(self%quantities == quantity)
   end function keeps

end module config_groups_output
