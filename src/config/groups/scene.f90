!> &scene: what the study is called, and the seed of all its random numbers.
module config_groups_scene
   use config_text_value_table, only: about, visitor_type
   use core_kinds, only: long
   implicit none(type, external)
   private
   public :: heading_group

   !> Title and seed.
   type :: heading_group
      character(:), allocatable :: title
      integer(long) :: seed = 2016
   contains
      procedure :: visit
   end type heading_group

contains

   subroutine visit(self, visitor)
      class(heading_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit_text(self%title, about('title', &
         'what the results are called; empty: the name of the scene file', &
         shapes_samples=.false.))
      call visitor%visit(self%seed, about('seed', 'of every random number, any whole number'))
   end subroutine visit

end module config_groups_scene
