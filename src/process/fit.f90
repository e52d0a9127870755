!> Any requested process: the one call that solves it or says why not.
module process_fit
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use process_ar_fit, only: fit_ar
   use process_model, only: process_model_type, process_request
   use process_positive_fit, only: fit_positive
   implicit none(type, external)
   private
   public :: fit_process, differ_only_in_scale

contains

   !> Solves the request; `model%is_solved` tells whether, `model%reason` why not.
   subroutine fit_process(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed   !! of the simulated values that a statistical fit matches
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable :: error

      if (request%method == 'autoregressive' .and. request%positive) then
         call fit_positive(request, seed, model)
         return
      end if
      if (request%method == 'autoregressive') then
         call fit_ar(request%correlation, request%correlation_length, request%order, request%std, &
                     model, error)
         model%mu = request%mean
         model%mean = request%mean
      else
         call raise(error, exit_bad_input, "method = '"//request%method//"': no such fit with this sign (seed "// &
                    to_text(seed)//')')
      end if
      model%request = request
      if (allocated(error)) then
         model%is_solved = .false.
         model%reason = error%message
      end if
   end subroutine fit_process

   !> Whether one process is the other times a factor (and, without sign, moved): one fit serves
   !! both.
   pure function differ_only_in_scale(request, other) result(is_so)
      type(process_request), intent(in) :: request, other
      logical :: is_so
      real(wp), parameter :: rounding = 4*epsilon(1.0_wp)

      is_so = (request%positive .eqv. other%positive) .and. request%method == other%method .and. &
              request%correlation == other%correlation .and. request%order == other%order .and. &
              all(same([request%correlation_length, request%bound_l0, request%bound_l1], &
                       [other%correlation_length, other%bound_l0, other%bound_l1]))
      if (is_so .and. request%order == 0) is_so = request%max_order == other%max_order
      if (is_so .and. request%positive) is_so = request%sampler == other%sampler .and. &
                                                abs(request%mean*other%std - other%mean*request%std) <= &
                                                rounding*abs(request%mean*other%std)
   end function differ_only_in_scale

   elemental function same(x, y) result(is_so)
      real(wp), intent(in) :: x, y
      logical :: is_so

      is_so = .not. abs(x - y) > 0.0_wp
   end function same

end module process_fit
