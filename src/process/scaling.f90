!> Processes that differ in nothing but mean and scale are one: what is fitted in their stead, and
!> how it is carried over to each.
!>
!> A positive process scales with its mean; any other one with its std, and its mean is added. What
!> is fitted depends on the request alone, so that its bits do not depend on what else is asked for.
module process_scaling
   use core_kinds, only: wp
   use process_model, only: innovation_scale, process_model_type, process_request
   implicit none(type, external)
   private
   public :: unit_request, first_of_fit, carry_over

contains

   !> The request of mean 1, if it is positive, or of mean 0 and std 1, whose process is the wanted
   !> one in another unit. What has no such unit stays as it is, to be refused.
   pure function unit_request(request) result(unit)
      type(process_request), intent(in) :: request
      type(process_request) :: unit
      logical :: is_scalable   ! the request can be met, as far as mean and std tell

      unit = request
      is_scalable = request%std > 0.0_wp .and. request%std <= huge(1.0_wp) .and. &
                    abs(request%mean) <= huge(1.0_wp)
      if (request%positive) is_scalable = is_scalable .and. request%mean > 0.0_wp
      if (.not. is_scalable) return
      unit%mean = merge(1.0_wp, 0.0_wp, request%positive)
      unit%std = request%std/unit_of(request)
   end function unit_request

   !> Numbers of the processes that are fitted: of each one, the first that has the same fit. The
   !> ratio std/mean is a rounded one: where two differ in the last place, each has its own fit.
   pure function first_of_fit(requests) result(first)
      type(process_request), intent(in) :: requests(:)
      integer :: first(size(requests))
      type(process_request) :: units(size(requests))
      integer :: i, j

      do i = 1, size(requests)
         units(i) = unit_request(requests(i))
         first(i) = i
         do j = 1, i - 1
            if (first(j) < j) cycle
            if (.not. is_same(units(i), units(j))) cycle
            first(i) = j
            exit
         end do
      end do
   end function first_of_fit

   pure function is_same(a, b)
      type(process_request), intent(in) :: a, b
      logical :: is_same

      is_same = a%method == b%method .and. a%correlation == b%correlation .and. &
                .not. any(abs([a%correlation_length, a%second_length, a%bound_l0, a%bound_l1, &
                               a%upper_bound, a%mean, a%std] - &
                              [b%correlation_length, b%second_length, b%bound_l0, b%bound_l1, &
                               b%upper_bound, b%mean, b%std]) > 0.0_wp) &
                .and. a%order == b%order .and. a%max_order == b%max_order &
                .and. a%bound_side == b%bound_side .and. (a%all_signs .eqv. b%all_signs) &
                .and. a%inversion_half_width == b%inversion_half_width &
                .and. (a%positive .eqv. b%positive) .and. a%simulation == b%simulation
      if (is_same .and. a%positive) &
         is_same = a%sampler == b%sampler .and. a%branch == b%branch &
                   .and. a%fit_steps == b%fit_steps
   end function is_same

   !> Carries the process of the unit request over to the request itself. Entropies grow by the
   !> logarithm of the unit.
   subroutine carry_over(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(inout) :: model
      real(wp) :: gain, unit

      model%request = request
      if (.not. model%is_solved) return
      unit = unit_of(request)
      gain = log(unit)
      model%b0 = unit*model%b0
      model%autocovariance(:) = unit**2*model%autocovariance
      if (allocated(model%autocovariance_error)) &
         model%autocovariance_error(:) = unit**2*model%autocovariance_error
      if (request%positive) then
         model%mu = unit*model%mu
         model%mean = unit*model%mean
         if (allocated(model%g)) then
            model%g(:) = model%g/unit**2
            model%b0 = innovation_scale(model%g)
            if (allocated(model%nodes)) model%nodes(:) = unit*model%nodes
         end if
         if (abs(model%nonnegative_entropy) > 0.0_wp) &
            model%nonnegative_entropy = model%nonnegative_entropy + gain
         if (model%other_std > 0.0_wp) model%other_entropy = model%other_entropy + gain
         model%other_mean = unit*model%other_mean
         model%other_std = unit*model%other_std
      else
         model%mu = request%mean
         model%mean = request%mean
      end if
      model%std = unit*model%std
      model%mean_error = unit*model%mean_error
      model%std_error = unit*model%std_error
      model%entropy = model%entropy + gain
      model%entropy_bound = model%entropy_bound + gain
      if (request%method /= 'direct') return
      model%lambda_3 = model%lambda_3/unit**2
      if (.not. request%positive) model%entropy_ceiling = model%entropy_ceiling + gain
      if (allocated(model%inversion%autocovariance)) &
         model%inversion%autocovariance(:) = unit**2*model%inversion%autocovariance
      if (allocated(model%solutions_lambda_3)) &
         model%solutions_lambda_3(:) = model%solutions_lambda_3/unit**2
      if (allocated(model%solutions_entropy)) &
         model%solutions_entropy(:) = model%solutions_entropy + gain
   end subroutine carry_over

   !> One unit of the unit process [unit of X].
   pure function unit_of(request) result(unit)
      type(process_request), intent(in) :: request
      real(wp) :: unit

      unit = merge(request%mean, request%std, request%positive)
   end function unit_of

end module process_scaling
