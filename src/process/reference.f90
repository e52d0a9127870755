!> Reference laws, which maximum-entropy processes are compared with: independent values, one value
!> for all points, and given values.
!>
!> A correlation length of 0 asks for independent values, one of 1e12 or more for one value at all
!> points. The law of a value is that of largest entropy: normal, or normal truncated at 0 if it is
!> positive.
module process_reference
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: stream_type
   use process_model, only: gaussian_entropy, process_model_type, process_request
   use process_positive_truncated_normal, only: draw_truncated, fit_truncated_normal, &
                                                hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: draw_reference, fit_reference, has_one_value, is_reference, law_name

   real(wp), parameter :: longest = 1.0e12_wp   !! from this L0 on all points have one value
   integer, parameter :: n_lags = 30            !! lags of the autocovariance that are stored

contains

   !> True if a reference law is asked for.
   pure logical function is_reference(request)
      type(process_request), intent(in) :: request

      is_reference = request%method == 'values' .or. has_one_value(request) .or. &
                     abs(request%correlation_length) <= 0.0_wp
   end function is_reference

   !> True if all points have the same value.
   pure logical function has_one_value(request)
      type(process_request), intent(in) :: request

      has_one_value = request%correlation_length >= longest .and. request%method /= 'values'
   end function has_one_value

   !> Name of the kind of law that is asked for.
   pure function law_name(request) result(name)
      type(process_request), intent(in) :: request
      character(:), allocatable :: name

      if (.not. is_reference(request)) then
         name = 'maximum entropy'
      else if (request%method == 'values') then
         name = 'given values'
      else if (has_one_value(request)) then
         name = 'fully correlated'
      else
         name = 'independent'
      end if
   end function law_name

   !> Fits a reference law. Given values are described by their mean and std alone.
   subroutine fit_reference(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable :: error

      model%request = request
      model%order = 1
      model%a = [0.0_wp]
      model%poles = [(0.0_wp, 0.0_wp)]
      model%memory = 1
      model%mu = request%mean
      model%b0 = request%std
      model%mean = request%mean
      model%std = request%std
      model%entropy_bound = gaussian_entropy(request%std)
      model%entropy = model%entropy_bound
      allocate (model%autocovariance(0:n_lags), source=0.0_wp)
      model%autocovariance(0) = request%std**2
      if (request%positive .and. request%method /= 'values') then
         call fit_truncated_normal(request%mean, request%std, model%mu, model%b0, error)
         if (allocated(error)) then
            model%reason = error%message
            return
         end if
         associate (c => model%mu/model%b0)
            model%lambda = exp(log_acceptance(c))
            model%acceptance_ratio = model%lambda
            model%acceptance_mean = model%lambda
            model%acceptance_geometric = model%lambda
            model%entropy = gaussian_entropy(model%b0) + log_acceptance(c) &
                            - 0.5_wp*c*hazard_ratio(c)
         end associate
      end if
      if (has_one_value(request)) then
         model%autocovariance(:) = request%std**2
         model%l0 = request%correlation_length
         model%l1 = request%correlation_length
         model%l0_cut = request%correlation_length
         model%l1_cut = request%correlation_length
         model%entropy = -huge(1.0_wp)   ! stands for minus infinity
      end if
      model%is_solved = .true.
   end subroutine fit_reference

   !> Draws independent values, or one value at all points.
   subroutine draw_reference(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)   !! (point) [unit of X]
      real(wp) :: factor, hazard, u(size(values))
      integer :: i

      if (.not. model%request%positive) then
         call stream%normals(values)
         values = model%mu + model%b0*values
      else
         call stream%uniforms(u)
         do i = 1, size(values)
            call draw_truncated(model%mu/model%b0, u(i), values(i), hazard, factor)
         end do
         values = model%b0*values
      end if
      if (has_one_value(model%request)) values = values(1)
   end subroutine draw_reference

end module process_reference
