!> Averages over independent batches, freed of the noise that they share with quantities of known mean.
module process_control_variates
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: control_type, new_control

   !> Orthonormal controls over the batches, and what remains of their averages' errors.
   type :: control_type
      private
      real(wp), allocatable :: direction(:, :)   !! (batch, control), centred, orthonormal
      real(wp), allocatable :: excess(:)         !! (control) average less known mean, same combination
   contains
      procedure :: correct
   end type control_type

contains

   !> Controls from their batch averages less their known means.
   pure function new_control(deviations) result(control)
      real(wp), intent(in) :: deviations(:, :)   !! (batch, control)
      type(control_type) :: control
      real(wp) :: excess, norm, column(size(deviations, 1)), overlap
      integer :: i, j, pass

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
         control%direction = reshape([control%direction, column/norm], [size(column), size(control%excess) + 1])
         control%excess = [control%excess, excess/norm]
      end do
   end function new_control

   !> Subtracts from a value what the controls explain of its error, and gives the standard error left.
   pure subroutine correct(self, influence, value, standard_error)
      class(control_type), intent(in) :: self
      !> (batch) first-order change of the value by that batch; its average is the value's own error term
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
      standard_error = sqrt(sum(rest**2)/(real(n, wp)*(n - 1 - size(self%excess))))
   end subroutine correct

end module process_control_variates
