!> Processes that differ in nothing but mean and scale are one: what is fitted in their stead, and
!> how it is carried over to each.
!>
!> A positive process scales with its mean; any other one with its std, and its mean is added. What
!> is fitted depends on the request alone, so that its bits do not depend on what else is asked for.
module process_scaling
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: component, component_visitor, visit_components
   use process_model, only: process_model_type, process_request, request_label
   implicit none(type, external)
   private
   public :: unit_request, first_of_fit, carry_over

   !> Brings a process into another unit.
   type, extends(component_visitor) :: scaling_visitor
      real(wp) :: unit = 1.0_wp   !! of X, in that of before
   contains
      procedure :: visit_table => scale_table
   end type scaling_visitor

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
      integer(long) :: labels(size(requests))
      integer :: i

      labels = [(label_of_fit(unit_request(requests(i))), i=1, size(labels))]
      first = [(findloc(labels, labels(i), 1), i=1, size(labels))]
   end function first_of_fit

   !> Hash of all that the fit of a request depends on.
   pure integer(long) function label_of_fit(unit) result(label)
      type(process_request), intent(in) :: unit
      type(process_request) :: request

      request = unit
      if (.not. unit%positive) request%sampler = ''   ! of no meaning there
      label = label_of(request_label(request), &
                       label_of(trim(unit%bound_side)//' '//trim(unit%simulation)))
      label = label_of(label, merge(1, 0, unit%all_signs))
      label = label_of(label, unit%inversion_half_width)
      if (.not. unit%positive) return
      label = label_of(label, label_of(trim(unit%branch)))
      label = label_of(label, unit%fit_steps)
   end function label_of_fit

   !> Carries the process of the unit request over to the request itself, component by component.
   subroutine carry_over(request, model)
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
   end subroutine carry_over

   !> Scales a component by the power of the unit of X that its own unit has; an entropy grows by
   !> the logarithm, its error does not.
   subroutine scale_table(self, what, values)
      class(scaling_visitor), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer :: n

      if (.not. allocated(values)) return
      select case (what%units)
      case ('unit of x')
         values = self%unit*values
      case ('unit of x squared')
         values = self%unit**2*values
      case ('1/unit of x squared')
         values = values/self%unit**2
      case ('nat')
         if (what%is_optional .and. .not. any(abs(values) > 0.0_wp)) return   ! not there
         n = merge(1, size(values, 2), what%axis%name == '')
         values(:, :n) = values(:, :n) + log(self%unit)
      end select
   end subroutine scale_table

   !> One unit of the unit process [unit of X].
   pure function unit_of(request) result(unit)
      type(process_request), intent(in) :: request
      real(wp) :: unit

      unit = merge(request%mean, request%std, request%positive)
   end function unit_of

end module process_scaling
