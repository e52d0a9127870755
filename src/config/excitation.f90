!> &excitation: the force on one mass of the chain.
module config_excitation
   use config_entries, only: about, choice_length, not_negative, positive, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: excitation_group

   type :: excitation_group
      character(choice_length) :: kind = 'band_limited'
      real(wp), allocatable :: band(:)
      real(wp), allocatable :: variance(:)    !! empty: not given
      integer :: dof = 0
      character(:), allocatable :: file
      logical :: per_sample = .false.
   contains
      procedure :: visit
   end type excitation_group

contains

   subroutine visit(self, visitor)
      class(excitation_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%kind, about('kind', &
         'Gaussian noise of a flat spectrum, or a history of your own', &
         choices=[character(choice_length) :: 'band_limited', 'file']))
      call visitor%visit(self%band, about('band', 'the noise has no power outside of it', 'Hz', &
         not_negative(), length=2, used=self%kind == 'band_limited'), default=[0.0_wp, 2.5_wp])
      call visitor%visit(self%variance, about('variance', &
         'of the noise, in expectation; one or several, each a case', 'N^2', positive()), &
         default=[real(wp) ::])
      call visitor%visit(self%dof, about('dof', 'the forced mass; 0: the last', &
         rule=not_negative()))
      call visitor%visit_text(self%file, about('file', &
         'a history, text or HDF5, looked for beside the scene, then in the current directory', &
         shapes_samples=.false.))
      call visitor%visit(self%per_sample, about('per_sample', &
         'a force record of its own for each sample; else only the friction differs'))
   end subroutine visit

end module config_excitation
