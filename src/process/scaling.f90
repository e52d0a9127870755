!> Scaling of processes: those that differ only in mean and scale share one fit.
!>
!> A positive process is fitted with mean 1, any other one with mean 0 and std 1; the result is then
!> scaled. A fit depends on its own request alone, so its bits do not depend on other processes.
module process_scaling
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: component, component_visitor, visit_components
   use process_model, only: process_model_type, process_request, request_label
   implicit none(type, external)
   private
   public :: scaled_request, first_of_fit, scale_to_request

   !> Multiplies the components of a process by powers of the unit of X.
   type, extends(component_visitor) :: scaling_visitor
      real(wp) :: unit = 1.0_wp   !! [unit of X]
   contains
      procedure :: visit_table => scale_table
   end type scaling_visitor

contains

   !> Request in the unit of the process: of mean 1 if it is positive, else of mean 0 and std 1. A
   !> request without a positive unit stays as it is.
   pure type(process_request) function scaled_request(request) result(unit)
      type(process_request), intent(in) :: request

      unit = request
      if (.not. unit_of(request) > 0.0_wp) return
      unit%mean = merge(1.0_wp, 0.0_wp, request%positive)
      unit%std = request%std/unit_of(request)
   end function scaled_request

   !> Number of the first process with the same fit, for each process. Fits are the same if the
   !> requests in the unit of the process are equal to the last digit of std/mean.
   pure function first_of_fit(requests) result(first)
      type(process_request), intent(in) :: requests(:)
      integer :: first(size(requests))
      integer(long) :: labels(size(requests))
      integer :: i

      labels = [(label_of_fit(scaled_request(requests(i))), i=1, size(labels))]
      first = [(findloc(labels, labels(i), 1), i=1, size(labels))]
   end function first_of_fit

   !> Hash of everything that the fit of a request depends on.
   pure integer(long) function label_of_fit(unit) result(label)
      type(process_request), intent(in) :: unit
      type(process_request) :: request

      request = unit
      if (.not. unit%positive) request%sampler = ''   ! has no effect
      label = label_of(request_label(request), &
                       label_of(trim(unit%bound_side)//' '//trim(unit%simulation)))
      label = label_of(label, merge(1, 0, unit%all_signs))
      label = label_of(label, unit%inversion_half_width)
      if (.not. unit%positive) return
      label = label_of(label, label_of(trim(unit%branch)))
      label = label_of(label, unit%fit_steps)
   end function label_of_fit

   !> Scales the model of the unit request to that of the request.
   subroutine scale_to_request(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(inout) :: model
      type(scaling_visitor) :: visitor

      model%request = request
      if (.not. model%is_solved) return
      visitor%unit = unit_of(request)
      call visit_components(visitor, model)
      if (request%positive) return
      model%mu = request%mean
      model%mean = request%mean
   end subroutine scale_to_request

   !> Scales a component by the power of the unit of X in its unit; adds the logarithm of the unit
   !> to an entropy, but not to its error.
   subroutine scale_table(self, item, values)
      class(scaling_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer :: n

      if (.not. allocated(values)) return
      select case (item%units)
      case ('unit of x')
         values = self%unit*values
      case ('unit of x squared')
         values = self%unit**2*values
      case ('1/unit of x squared')
         values = values/self%unit**2
      case ('nat')
         if (item%is_optional .and. .not. any(abs(values) > 0.0_wp)) return   ! absent
         n = merge(1, size(values, 2), item%axis%name == '')
         values(:, :n) = values(:, :n) + log(self%unit)
      end select
   end subroutine scale_table

   !> Unit of the process [unit of X].
   pure real(wp) function unit_of(request) result(unit)
      type(process_request), intent(in) :: request

      unit = merge(request%mean, request%std, request%positive)
   end function unit_of

end module process_scaling
