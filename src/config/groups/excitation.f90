!> &excitation: the forces on the structure.
module config_groups_excitation
   use campaign_plan, only: excitation_settings
   use config_text_value_table, only: about, not_negative, positive, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: excitation_group

   !> Forces as the scene says them, with the levels that make cases.
   type, extends(excitation_settings) :: excitation_group
      real(wp), allocatable :: variance(:)    !! empty: not given
      real(wp), allocatable :: frequency(:)   !! empty: not given
      real(wp), allocatable :: amplitude(:)   !! empty: not given
      character(:), allocatable :: psd        !! path of a file; '': none
      real(wp), allocatable :: factor(:)
   contains
      procedure :: visit
      procedure :: n_levels
   end type excitation_group

contains

   subroutine visit(self, visitor)
      class(excitation_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%kind, about('kind', &
         'Gaussian noise of a flat or of a given spectrum, sines, or a history of your own', &
         choices='band_limited psd sine file'))
      call visitor%visit(self%band, about('band', 'the noise has no power outside of it', 'Hz', &
         not_negative(), length=2, used=self%kind == 'band_limited'), default=[0.0_wp, 2.5_wp])
      call visitor%visit(self%variance, about('variance', &
         'of the noise, in expectation; one or several, each a case', 'N^2', positive()))
      call visitor%visit(self%frequency, about('frequency', 'sine: one or several, each a case', &
         'Hz', positive(), used=self%kind == 'sine'))
      call visitor%visit(self%amplitude, about('amplitude', &
         'sine: one or several, each a case at every frequency', 'N', positive(), &
         used=self%kind == 'sine'))
      call visitor%visit_text(self%psd, about('psd', &
         'one-sided density, a text file: Hz and N^2/Hz on a line, linear in between', &
         shapes_samples=.false.))
      call visitor%visit_text(self%file, about('file', &
         'a history, text (force, or time and force) or HDF5, beside the scene '// &
         'or in the current folder', shapes_samples=.false.))
      call visitor%visit(self%factor, about('factor', &
         'of the force of file or psd; one or several, each a case', rule=positive(), &
         used=self%kind == 'file' .or. self%kind == 'psd'), default=[1.0_wp])
      call visitor%visit(self%dof, about('dof', 'the forced dof; 0: the last', &
         rule=not_negative()))
      call visitor%visit(self%base, about('base', &
         'the force is a ground acceleration in m/s^2 of all dofs alike, or of each by its '// &
         'load; motion relative to the ground'))
      call visitor%visit(self%per_sample, about('per_sample', &
         'a force record of its own for each sample; else only the friction differs'))
   end subroutine visit

   !> Cases that each process has.
   pure integer function n_levels(self)
      class(excitation_group), intent(in) :: self

      select case (self%kind)
      case ('band_limited')
         n_levels = size(self%variance)
      case ('sine')
         n_levels = size(self%frequency)*size(self%amplitude)
      case default
         n_levels = size(self%factor)
      end select
   end function n_levels

end module config_groups_excitation
