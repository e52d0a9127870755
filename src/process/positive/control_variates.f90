!> Averages over independent batches, freed of the noise that they share with quantities of known
!> mean.
module process_positive_control_variates
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: control_type, new_control

   !> Orthonormal controls over the batches, and what remains of their averages' errors.
   type :: control_type
      private
      integer :: n_groups = 0   !! independent runs; batch i belongs to run mod(i, n_groups)
      real(wp), allocatable :: direction(:, :)   !! (batch, control), centred, orthonormal
      !> (control) average less known mean, same combination
      real(wp), allocatable :: excess(:)
   contains
      procedure :: free
      procedure :: standard_error
   end type control_type

contains

   !> Controls from their batch averages less their known means.
   pure function new_control(deviations, n_groups) result(control)
      real(wp), intent(in) :: deviations(:, :)   !! (batch, control)
      integer, intent(in) :: n_groups            !! runs, whose batches follow one another in turns
      type(control_type) :: control
      real(wp) :: excess, norm, column(size(deviations, 1)), overlap
      integer :: i, j, pass

      control%n_groups = n_groups
      allocate (control%direction(size(deviations, 1), 0), control%excess(0))
      do j = 1, size(deviations, 2)
         excess = sum(deviations(:, j))/size(column)
         column = deviations(:, j) - excess
         norm = norm2(column)
         if (.not. norm > 0.0_wp) cycle
         column = column/norm
         excess = excess/norm
         do pass = 1, 2
            do i = 1, size(control%excess)
               overlap = dot_product(control%direction(:, i), column)
               column = column - overlap*control%direction(:, i)
               excess = excess - overlap*control%excess(i)
            end do
         end do
         norm = norm2(column)
         if (norm < 1.0e-8_wp) cycle   ! says nothing that the others do not
         control%direction = reshape([control%direction, column/norm], &
                                     [size(column), size(control%excess) + 1])
         control%excess = [control%excess, excess/norm]
      end do
   end function new_control

   !> The average over the batches less what the controls explain of its error, and what they leave
   !> of each batch's deviation from it. Where a quantity is linear in the controls, this is exact.
   pure subroutine free(self, series, average, rest)
      class(control_type), intent(in) :: self
      real(wp), intent(in) :: series(:)   !! (batch)
      real(wp), intent(out) :: average
      real(wp), intent(out) :: rest(:)    !! (batch) of mean 0
      real(wp) :: share
      integer :: j

      average = sum(series)/size(series)
      rest = series - average
      do j = 1, size(self%excess)
         share = dot_product(self%direction(:, j), rest)
         rest = rest - share*self%direction(:, j)
         average = average - share*self%excess(j)
      end do
   end subroutine free

   !> Of an average, from what is left of its batches. Batches of one run may depend on each other,
   !> runs do not.
   pure function standard_error(self, rest) result(error)
      class(control_type), intent(in) :: self
      real(wp), intent(in) :: rest(:)     !! (batch)
      real(wp) :: error
      real(wp) :: n, runs(self%n_groups)

      n = size(rest)
      runs = sum(reshape(rest, [self%n_groups, size(rest)/self%n_groups]), dim=2)/n
      error = sqrt(sum(runs**2)*self%n_groups/(self%n_groups - 1.0_wp)*n/(n - size(self%excess)))
   end function standard_error

end module process_positive_control_variates
