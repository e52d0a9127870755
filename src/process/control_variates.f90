!> Averages over independent batches, freed of the noise that they share with quantities of known
!> mean.
module process_control_variates
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: control_type, new_control

   !> Orthonormal controls over the batches, and what remains of their averages' errors.
   type :: control_type
      private
      integer :: n_groups = 0                    !! independent runs; batch i belongs to run mod(i, n)
      real(wp), allocatable :: direction(:, :)   !! (batch, control), centred, orthonormal
      !> (control) average less known mean, same combination
      real(wp), allocatable :: excess(:)
   contains
      procedure :: correct
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

   !> Subtracts from a value what the controls explain of its error, and gives the standard error
   !> left.
   pure subroutine correct(self, influence, value, standard_error)
      class(control_type), intent(in) :: self
      !> (batch) first-order change of the value by that batch; its average is the value's own error
      !> term
      real(wp), intent(in) :: influence(:)
      real(wp), intent(inout) :: value
      real(wp), intent(out) :: standard_error
      real(wp) :: rest(size(influence)), share
      integer :: j, n

      n = size(influence)
      rest = influence - sum(influence)/n
      do j = 1, size(self%excess)
         share = dot_product(self%direction(:, j), rest)
         rest = rest - share*self%direction(:, j)
         value = value - share*self%excess(j)
      end do
      ! batches of one run may depend on each other, runs do not
      associate (run => sum(reshape(rest, [self%n_groups, n/self%n_groups]), dim=2)/n)
         standard_error = sqrt(sum(run**2)*self%n_groups/(self%n_groups - 1.0_wp) &
                               *n/(n - size(self%excess)))
      end associate
   end subroutine correct

end module process_control_variates
