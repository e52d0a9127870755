!> &excitation: the force on one mass of the chain.
module config_excitation
   use config_entries, only: about, choice_length, entry_type, not_negative, positive, &
                             visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: excitation_group

   !> Defaults are the paper's noise; its variance must be given.
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
      type(entry_type) :: entry

      entry = about('kind', 'Gaussian noise of a flat spectrum, or a history of your own', &
                    choices='band_limited file')
      call visitor%visit(self%kind, entry)
      entry = about('band', 'the noise has no power outside of it', 'Hz', not_negative(), &
                    length=2, used=self%kind == 'band_limited')
      call visitor%visit(self%band, entry, default=[0.0_wp, 2.5_wp])
      entry = about('variance', 'of the noise, in expectation; one or several, each a case', &
                    'N^2', positive())
      call visitor%visit(self%variance, entry, default=[real(wp) ::])
      entry = about('dof', 'the forced mass; 0: the last', rule=not_negative())
      call visitor%visit(self%dof, entry)
      entry = about('file', &
                    'a history, text (force, or time and force) or HDF5, beside the scene '// &
                    'or in the current folder', &
                    shapes_samples=.false.)
      call visitor%visit_text(self%file, entry)
      entry = about('per_sample', &
                    'a force record of its own for each sample; else only the friction differs')
      call visitor%visit(self%per_sample, entry)
   end subroutine visit

end module config_excitation
