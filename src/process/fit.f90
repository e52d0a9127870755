!> Fit of any requested process, and a forecast whether it can be fitted.
module process_fit
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use process_direct_fit, only: conclude_direct, fit_unconstrained
   use process_direct_limits, only: certainly_feasible_m_max, check_sign_count
   use process_direct_sign_search, only: sign_search_result
   use process_model, only: process_model_type, process_request
   use process_order, only: choose_order, fit_positive_order
   use process_positive_fit, only: fit_positive, predict_positive
   use process_realization, only: burn_in_length, widest_margin
   use process_reference, only: fit_reference, is_reference
   use process_scaling, only: scale_to_request, scaled_request
   implicit none(type, external)
   private
   public :: fit_process, fit_from_sign_search, predict_process

contains

   !> Fits the requested process. If there is none, `model%is_solved` is false and `model%reason`
   !> says why.
   subroutine fit_process(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed   !! seed of simulations in the fit of a positive one
      type(process_model_type), intent(out) :: model
      type(process_request) :: resolved
      type(error_type), allocatable :: error

      if (is_reference(request)) then
         call fit_reference(scaled_request(request), model)
         call scale_to_request(request, model)
         return
      end if
      call resolve_order(scaled_request(request), resolved, error)
      if (.not. allocated(error)) then
         if (request%positive .and. request%order == 0) then
            call fit_positive_order(resolved, seed, model)
         else if (request%positive) then
            call fit_positive(resolved, seed, model)
         else
            call fit_unconstrained(resolved, model, error)
         end if
         if (request%positive .and. .not. (model%is_solved .or. request%bounds(1) > 0.0_wp)) &
            call take_lower_order(resolved, seed, model)
      end if
      if (allocated(error)) then
         model%is_solved = .false.
         model%reason = error%message
      end if
      call scale_to_request(request, model)
      call check_simulation(model)
   end subroutine fit_process

   !> Takes the process of order 2, else of order 1, which every order contains, in place of one
   !> that was refused; `model%reason` says so. Both lengths leave order 2 nothing to search.
   subroutine take_lower_order(request, seed, model)
      type(process_request), intent(in) :: request   !! positive, with its order
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model   !! stays as it is if there is none
      type(process_request) :: lower
      type(process_model_type) :: other

      if (request%method == 'direct') return
      lower = request
      do while (lower%order > merge(2, 1, request%correlation == 'both'))
         lower%order = min(lower%order - 1, 2)
         call fit_positive(lower, seed, other)
         if (.not. other%is_solved) cycle
         other%reason = model%reason//'; taken is the process of order = '//to_text(lower%order)
         model = other
         return
      end do
   end subroutine take_lower_order

   !> Fits a process of the direct method by the result of a complete search for its signs.
   subroutine fit_from_sign_search(request, search, model)
      type(process_request), intent(in) :: request
      type(sign_search_result), intent(in) :: search
      type(process_model_type), intent(out) :: model

      call conclude_direct(request, search, model)
      call check_simulation(model)
   end subroutine fit_from_sign_search

   !> Refuses a process whose memory is too long for the matrix of Eq. (38), if that is asked for.
   subroutine check_simulation(model)
      type(process_model_type), intent(inout) :: model

      if (.not. model%is_solved .or. model%request%positive .or. &
          model%request%simulation /= 'matrix') return
      if (burn_in_length(model) <= widest_margin(model)) return
      model%is_solved = .false.
      model%reason = "simulation = 'matrix': the process forgets a start after "// &
                     to_text(burn_in_length(model))//' points, margins of the matrix have at '// &
                     'most '//to_text(widest_margin(model))//": take 'stationary'"
   end subroutine check_simulation

   !> Predicts, mostly within a fraction of a second, whether a fit finds the process. A positive
   !> one whose fit needs a long search gets the branch 'open'.
   subroutine predict_process(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(process_request) :: resolved
      type(error_type), allocatable :: error

      if (is_reference(request)) then
         call fit_process(request, seed, model)
         return
      end if
      call resolve_order(scaled_request(request), resolved, error)
      if (.not. allocated(error)) then
         if (request%positive) then
            call predict_positive(resolved, seed, model, error)
         else if (request%method == 'autoregressive' .or. &
                  resolved%order < certainly_feasible_m_max(resolved)) then
            resolved%all_signs = .false.   ! a short search decides it
            call fit_unconstrained(resolved, model, error)
         end if
      end if
      if (allocated(error)) model%reason = error%message
      model%request = request
      model%is_solved = .not. allocated(model%reason)
   end subroutine predict_process

   !> Resolves the order of a request: the given one, or a chosen one for 0. Fails if no order has
   !> the process, or if the request is invalid.
   subroutine resolve_order(request, resolved, error)
      type(process_request), intent(in) :: request
      type(process_request), intent(out) :: resolved
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: complaint

      resolved = request
      if (.not. (request%std > 0.0_wp .and. request%std <= huge(1.0_wp))) then
         call raise(error, exit_bad_input, 'std = '//to_text(request%std)// &
                    ': must be finite and positive')
         return
      end if
      call choose_order(request, resolved%order, error)
      if (allocated(error) .or. request%method /= 'direct') return
      call check_sign_count(resolved, complaint)
      if (allocated(complaint)) call raise(error, exit_bad_input, complaint)
   end subroutine resolve_order

end module process_fit
