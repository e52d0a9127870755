!> The paper's own way to the autocovariance (Sec. 2.2): the middle row of the inverse of a finite
!> matrix.
!>
!> Kept as a check of the direct method. With half-width M it errs like |largest pole|^(2M), and
!> costs M^3.
module process_direct_check
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: invert_matrix
   use numerics_toeplitz, only: dense_toeplitz
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_model, only: inversion_check, process_model_type
   implicit none(type, external)
   private
   public :: check_by_inversion

contains

   !> Inverts the matrix G of 2 half_width + 1 points; what that costs is for the caller to measure.
   subroutine check_by_inversion(model, half_width, check, error)
      type(process_model_type), intent(in) :: model   !! solved, without sign constraint
      integer, intent(in) :: half_width               !! M of Eq. (35), at least the order
      type(inversion_check), intent(out) :: check
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :)
      integer :: middle

      middle = half_width + 1
      call invert_matrix(dense_toeplitz(symbol_of_process(model%a, model%b0), 2*half_width + 1), &
                         inverse, error)
      if (allocated(error)) return
      check%half_width = half_width
      allocate (check%autocovariance(0:model%order))
      check%autocovariance(:) = inverse(middle:middle + model%order, middle)
      associate (exact => model%autocovariance(:model%order))
         check%error = maxval(abs(check%autocovariance - exact))/model%autocovariance(0)
      end associate
      check%expected_error = maxval(abs(model%poles))**(2.0_wp*half_width)
   end subroutine check_by_inversion

end module process_direct_check
