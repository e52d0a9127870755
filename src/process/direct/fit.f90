!> Direct method (Sec. 2.2): fits the process whose inverse covariance is a banded Toeplitz matrix,
!> with the signs of largest entropy. It is an autoregressive process of order m_max, Eq. (39).
!>
!> The imposed length is cut at m_max, Eq. (11); the infinite sum is larger.
module process_direct_fit
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use numerics_lapack, only: invert_matrix
   use process_autoregressive_description, only: describe_ar
   use process_autoregressive_fit, only: fit_ar
   use process_autoregressive_model, only: autocovariance_of, innovation_std, reflection_of
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_autoregressive_sums, only: correlation_sums, positive_sums
   use process_correlation, only: constraint_weights, correlation_length, zero_correlation
   use process_direct_constraint, only: constraint_of, length_constraint
   use process_direct_limits, only: certainly_infeasible_m_max, check_sign_count, &
                                    reason_of_failure, reason_of_inaccuracy
   use process_direct_sign_search, only: count_sequences, is_all_plus_best, limit_of_entropy, &
                                         search_all_signs, sign_search_result, search_structured
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: inversion_check, process_model_type, process_request
   implicit none(type, external)
   private
   public :: fit_direct, fit_unconstrained, count_search_parts, conclude_direct, check_by_inversion
   public :: integer_signs, list_solutions, mirror_image, canonical_image

   character(*), parameter :: every_sequence = 'all sequences'
   real(wp), parameter :: optimality_tolerance = 1.0e-8_wp

contains

   !> Fits the process of any sign by either method. For a positive request the search for signs is
   !> short.
   subroutine fit_unconstrained(request, model, error)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_request) :: unsigned

      if (request%method == 'direct') then
         unsigned = request
         unsigned%all_signs = request%all_signs .and. .not. request%positive
         unsigned%positive = .false.
         call fit_direct(unsigned, model)
         if (.not. model%is_solved) call raise(error, exit_no_solution, model%reason)
      else
         call fit_ar(request, model, error)
         model%mu = request%mean
         model%mean = request%mean
      end if
   end subroutine fit_unconstrained

   !> Fits a process. If there is none, `model%is_solved` is false and `model%reason` says why.
   subroutine fit_direct(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      type(length_constraint) :: constraint
      type(sign_search_result) :: search
      character(:), allocatable :: searched
      logical :: is_certain

      model%request = request
      call check_sign_count(request, model%reason)
      if (allocated(model%reason)) return
      if (request%order <= certainly_infeasible_m_max(request)) then
         model%reason = reason_of_failure(request, is_certain=.true.)
         return
      end if
      constraint = constraint_of(request)
      call search_signs(constraint, request%all_signs, search, is_certain, searched)
      call describe_best(request, search, searched, is_certain, model)
      if (is_certain .or. .not. model%is_solved) return
      call limit_of_entropy(constraint, model%entropy_ceiling)
      model%entropy_ceiling = model%entropy_ceiling + log(request%std)
   end subroutine fit_direct

   !> Number of parts into which the search of a request should be divided; 1 if it is short.
   integer function count_search_parts(request) result(n)
      type(process_request), intent(in) :: request
      integer, parameter :: part_size = 1024   ! sequences, in some 0.05 s
      character(:), allocatable :: complaint

      n = 1
      if (request%method /= 'direct' .or. request%positive .or. .not. request%all_signs .or. &
          abs(request%correlation_length) <= 0.0_wp) return
      call check_sign_count(request, complaint)
      if (allocated(complaint)) return
      if (request%order <= certainly_infeasible_m_max(request)) return
      n = int(max(1_long, count_sequences(constraint_of(request))/part_size))
   end function count_search_parts

   !> Fills the model from the search of all sequences. If parts are missing, it stays unsolved,
   !> without a reason.
   subroutine conclude_direct(request, search, model)
      type(process_request), intent(in) :: request
      type(sign_search_result), intent(in) :: search
      type(process_model_type), intent(inout) :: model

      model%request = request
      if (search%n_examined < count_sequences(constraint_of(request))) return
      call describe_best(request, search, every_sequence, .true., model)
   end subroutine conclude_direct

   !> Fills the model from the best solution of a search, with a list of all solutions; or gives the
   !> reason why there is none.
   subroutine describe_best(request, search, searched, is_certain, model)
      type(process_request), intent(in) :: request
      type(sign_search_result), intent(in) :: search
      character(*), intent(in) :: searched   !! sequences that were searched
      logical, intent(in) :: is_certain   !! no sequence has more entropy
      type(process_model_type), intent(inout) :: model
      type(sequence_solution) :: solutions(size(search%solutions))   ! in the unit of X
      integer :: i

      if (size(search%solutions) == 0) then
         model%reason = reason_of_failure(request, is_certain)
         return
      end if
      do i = 1, size(solutions)
         solutions(i) = canonical_image(search%solutions(i))
      end do
      call fill_model(request, solutions(1), model)
      model%request = request
      model%search = searched
      model%n_examined = int(search%n_examined)
      model%n_consistent = int(search%n_consistent)
      model%entropy_ceiling = model%entropy
      solutions%lambda_3 = solutions%lambda_3/request%std**2
      solutions%entropy = solutions%entropy + log(request%std)
      call list_solutions(solutions, model)
   end subroutine describe_best

   !> Stores a list of solutions in the model.
   pure subroutine list_solutions(solutions, model)
      type(sequence_solution), intent(in) :: solutions(:)   !! solutions by descending entropy
      type(process_model_type), intent(inout) :: model
      integer :: i

      model%solutions_signs = reshape([(integer_signs(solutions(i)%s), i=1, size(solutions))], &
                                      [size(solutions(1)%s), size(solutions)])
      model%solutions_delta = solutions%delta
      model%solutions_lambda_3 = solutions%lambda_3
      model%solutions_entropy = solutions%entropy
   end subroutine list_solutions

   !> Searches all sequences if they are few or if that is asked for, else likely ones. If these
   !> give a solution that is not proven to be best, searches all if that takes a second at most.
   subroutine search_signs(constraint, all_signs, search, is_certain, searched)
      type(length_constraint), intent(in) :: constraint
      logical, intent(in) :: all_signs
      type(sign_search_result), intent(out) :: search
      logical, intent(out) :: is_certain   !! no sequence has more entropy
      character(:), allocatable, intent(out) :: searched   !! sequences that were searched
      integer(long), parameter :: most_sequences = 2048   ! in a fraction of a second
      integer(long), parameter :: longer_factor = 8       ! times as many in a second
      type(sequence_solution) :: best
      integer(long) :: most_affordable

      most_affordable = most_sequences/(1 + size(constraint%penalized)/4)
      if (count_sequences(constraint) > most_affordable .and. .not. all_signs) then
         call search_structured(constraint, best)
         is_certain = is_all_plus_best(constraint)
         if (is_certain .or. .not. best%is_feasible .or. &
             count_sequences(constraint) > longer_factor*most_affordable) then
            searched = trim(merge('all plus  ', 'structured', is_certain))
            search%n_examined = 1
            allocate (search%solutions(0))
            if (best%is_feasible) search%solutions = [best]
            return
         end if
      end if
      call search_all_signs(constraint, 1, 1, search)
      is_certain = .true.
      searched = every_sequence
   end subroutine search_signs

   !> Fills the model from one solution, and checks it by its a_q alone.
   subroutine fill_model(request, solution, model)
      type(process_request), intent(in) :: request
      type(sequence_solution), intent(in) :: solution   !! sigma_X = 1
      type(process_model_type), intent(out) :: model
      type(correlation_sums), allocatable :: sums   ! absent unless all K(m) are known to be > 0
      type(error_type), allocatable :: error
      real(wp) :: b0, kappa(request%order)

      kappa = reflection_of(solution%a)
      b0 = request%std*innovation_std(kappa, 1.0_wp)
      ! for all s_m = +1 and no penalized lag 1/g is a series in powers of a sum of cosines with
      ! positive factors, so all K(m) > 0
      if (all(solution%s > 0.0_wp) .and. is_all_plus_best(constraint_of(request))) &
         sums = positive_sums(kappa)
      call describe_ar(solution%a, b0, model, error, sums)
      if (allocated(error)) then
         model%reason = error%message
         return
      end if
      model%mu = request%mean
      model%mean = request%mean
      model%signs = integer_signs(solution%s)
      model%delta = solution%delta
      model%lambda_3 = solution%lambda_3/request%std**2
      model%optimality = residual(request, solution)
      ! from the solution, as results by the a_q are sensitive to their rounding
      model%entropy = solution%entropy + log(request%std)
      model%autocovariance(:request%order) = request%std**2*solution%correlation
      model%l0_cut = correlation_length('L0', solution%correlation)
      model%l1_cut = correlation_length('L1', solution%correlation)
      model%is_solved = model%optimality <= optimality_tolerance
      if (.not. model%is_solved) model%reason = reason_of_inaccuracy(request, model%optimality)
   end subroutine fill_model

   !> Residual of the optimality conditions, by the a_q: largest error of the length, of
   !> lambda_3 = 1/(2 sigma^2), and of the entries of G over g_0, Eqs. (23), (28) and (30):
   !> g_0 = 1 + delta a_0 (a factor 2 is missing in print) and g_m = delta a_m s_m/2, with
   !> s_m = sgn K(m), or any s_m in [-1, 1] if K(m) = 0.
   pure real(wp) function residual(request, solution) result(largest)
      type(process_request), intent(in) :: request
      type(sequence_solution), intent(in) :: solution
      real(wp), dimension(size(solution%s)) :: kappa, signs
      real(wp), dimension(0:size(signs)) :: rho, symbol, wanted, weights

      kappa = reflection_of(solution%a)
      rho = autocovariance_of(kappa, size(kappa))
      symbol = symbol_of_process(solution%a, innovation_std(kappa, 1.0_wp))
      signs = merge(max(-1.0_wp, min(1.0_wp, solution%s)), sign(1.0_wp, rho(1:)), &
                    abs(rho(1:)) <= zero_correlation)
      associate (length => request%correlation_length, definition => request%correlation)
         weights = constraint_weights(definition, length, size(signs))
         wanted = [1.0_wp + solution%delta*weights(0), 0.5_wp*solution%delta*weights(1:)*signs]
         largest = max(maxval(abs(symbol - wanted))/symbol(0), &
                       abs(2.0_wp*solution%lambda_3 - 1.0_wp), &
                       abs(correlation_length(definition, rho) - length)/max(length, tiny(length)))
      end associate
   end function residual

   !> Solution or its mirror image, whichever has K(m) > 0 at the first odd lag where it is not 0.
   pure type(sequence_solution) function canonical_image(solution) result(image)
      type(sequence_solution), intent(in) :: solution
      integer :: first

      image = solution
      first = 2*findloc(abs(solution%correlation(1::2)) > zero_correlation, .true., dim=1) - 1
      if (first < 1) return
      if (solution%correlation(first) < 0.0_wp) image = mirror_image(solution)
   end function canonical_image

   !> Solution with (-1)^m K(m).
   pure type(sequence_solution) function mirror_image(solution) result(image)
      type(sequence_solution), intent(in) :: solution

      image = solution
      image%s(1::2) = -image%s(1::2)
      image%correlation(1::2) = -image%correlation(1::2)
      image%a(1::2) = -image%a(1::2)
   end function mirror_image

   !> Sign as an integer; 0 if K(m) = 0, with s_m inside (-1, 1).
   elemental integer function integer_signs(s) result(signs)
      real(wp), intent(in) :: s

      signs = merge(nint(sign(1.0_wp, s)), 0, abs(s) > 1.0_wp - 1.0e-9_wp)
   end function integer_signs

   !> Computes K(m) by Eq. (35), the paper's method: the inverse of a matrix G of 2 half_width + 1
   !> points. Its error is about |largest pole|^(2 half_width), its cost grows as half_width^3. The
   !> caller measures its time.
   subroutine check_by_inversion(model, half_width, check, error)
      type(process_model_type), intent(in) :: model   !! solved, without sign constraint
      integer, intent(in) :: half_width               !! M of Eq. (35), at least the order
      type(inversion_check), intent(out) :: check
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), matrix(:, :)
      integer :: i, m, middle

      middle = half_width + 1
      allocate (matrix(2*half_width + 1, 2*half_width + 1), source=0.0_wp)
      associate (g => [symbol_of_process(model%a, model%b0)])   ! lower bound 1
         do i = 1, size(matrix, 1)
            do m = 0, min(model%order, i - 1)
               matrix(i, i - m) = g(m + 1)
               matrix(i - m, i) = g(m + 1)
            end do
         end do
      end associate
      call invert_matrix(matrix, inverse, error)
      if (allocated(error)) return
      check%half_width = half_width
      allocate (check%autocovariance(0:model%order))
      check%autocovariance(:) = inverse(middle:middle + model%order, middle)
      associate (exact => model%autocovariance(:model%order))
         check%error = maxval(abs(check%autocovariance - exact))/model%autocovariance(0)
      end associate
      check%expected_error = maxval(abs(model%poles))**(2.0_wp*half_width)
   end subroutine check_by_inversion

end module process_direct_fit
