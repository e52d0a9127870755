!> Any requested process: the one call that solves it or says why not.
module process_fit
   use core_error, only: error_type
   use core_kinds, only: long
   use process_ar_fit, only: fit_ar
   use process_model, only: process_model_type, process_request
   implicit none(type, external)
   private
   public :: fit_process

contains

   !> Solves the request; `model%is_solved` tells whether, `model%reason` why not.
   subroutine fit_process(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed   !! of the simulated values that a statistical fit matches
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable :: error

      call fit_ar(request%correlation, request%correlation_length, request%order, request%std, model, error)
      model%request = request
      model%mu = request%mean
      model%mean = request%mean
      if (allocated(error)) then
         model%is_solved = .false.
         model%reason = error%message
      end if
   end subroutine fit_process

end module process_fit
