!> List of the components of a solved process, with name, unit, meaning and axes of each. Visitors
!> write a process to a file, read it, send it to other ranks or scale it.
module process_components
   use core_kinds, only: wp
   use process_model, only: innovation_scale, process_model_type
   use process_reference, only: has_one_value
   implicit none(type, external)
   private
   public :: axis_type, component, component_visitor, reset_components, visit_components

   !> Axis of an array: its name, its meaning and the number of its first element.
   type :: axis_type
      character(16) :: name = ''
      character(32) :: about = ''
      integer :: first = 1
   end type axis_type

   !> Name, unit, meaning and axes of a component. Texts, integers and processor times have a name
   !> alone.
   type :: component
      character(24) :: name = ''
      character(20) :: units = '1'            !! '1': dimensionless
      character(112) :: about = ''
      type(axis_type) :: axis = axis_type()   !! axis of a list, second axis of a table
      type(axis_type) :: rows = axis_type()   !! first axis of a table
      logical :: is_whole = .false.           !! integers
      logical :: is_optional = .false.        !! absent if it is 0
   end type component

   !> Reads or sets each component. Unallocated arrays and texts, and optional numbers that are 0,
   !> are absent. A visitor must have `visit_table`, for real tables. All other components reach it
   !> as tables of one row: lists, a number with its standard error, integers as reals, a text as
   !> character codes; a visitor may override `visit_real` and `visit_text`.
   type, abstract :: component_visitor
   contains
      generic :: visit => visit_real, visit_integer, visit_text, visit_reals, visit_integers, &
         visit_integer_table
      procedure(act_on_table), deferred :: visit_table
      procedure :: visit_real, visit_text
      procedure, private :: visit_integer, visit_reals, visit_integers, visit_integer_table
   end type component_visitor

   abstract interface
      subroutine act_on_table(self, item, values)
         import :: component, component_visitor, wp
         implicit none(type, external)
         class(component_visitor), intent(inout) :: self
         type(component), intent(in) :: item
         real(wp), allocatable, intent(inout) :: values(:, :)   !! (item%rows, item%axis)
      end subroutine act_on_table
   end interface

   type(axis_type), parameter :: &
      by_order = axis_type('order', 'number of the coefficient', 1), &
      by_lag = axis_type('lag', 'lag', 0), &
      by_g_lag = axis_type('g_lag', 'lag of G', 0), &
      by_node = axis_type('node', 'number of the node', 1), &
      by_sign = axis_type('sign', 'lag of the sign', 1), &
      by_solution = axis_type('solution', 'number of the solution', 1), &
      by_inversion_lag = axis_type('inversion_lag', 'lag', 0)

contains

   subroutine visit_real(self, item, value, error)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), intent(inout) :: value
      real(wp), intent(inout), optional :: error
      real(wp), allocatable :: numbers(:)

      numbers = [value]
      if (present(error)) numbers = [value, error]
      call self%visit(item, numbers)
      value = numbers(1)
      if (present(error)) error = numbers(2)
   end subroutine visit_real

   subroutine visit_text(self, item, value)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      character(:), allocatable, intent(inout) :: value
      integer, allocatable :: codes(:)
      integer :: i

      if (allocated(value)) then
         codes = [(iachar(value(i:i)), i=1, len(value))]
         deallocate (value)
      end if
      call self%visit(item, codes)
      if (.not. allocated(codes)) return
      allocate (character(size(codes)) :: value)
      do i = 1, size(codes)
         value(i:i) = achar(codes(i))
      end do
   end subroutine visit_text

   subroutine visit_integer(self, item, value)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      integer, intent(inout) :: value
      real(wp) :: number

      number = value
      call self%visit_real(as_integers(item), number)
      value = nint(number)
   end subroutine visit_integer

   subroutine visit_reals(self, item, values)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: table(:, :)

      if (allocated(values)) then
         table = reshape(values, [1, size(values)])
         deallocate (values)
      end if
      call self%visit_table(item, table)
      if (.not. allocated(table)) return
      allocate (values(item%axis%first:item%axis%first + size(table, 2) - 1))
      values(:) = table(1, :)
   end subroutine visit_reals

   subroutine visit_integers(self, item, values)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      integer, allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: numbers(:)

      if (allocated(values)) numbers = real(values, wp)
      call self%visit(as_integers(item), numbers)
      if (allocated(numbers)) values = nint(numbers)
   end subroutine visit_integers

   subroutine visit_integer_table(self, item, values)
      class(component_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      integer, allocatable, intent(inout) :: values(:, :)
      real(wp), allocatable :: numbers(:, :)

      if (allocated(values)) numbers = real(values, wp)
      call self%visit_table(as_integers(item), numbers)
      if (allocated(numbers)) values = nint(numbers)
   end subroutine visit_integer_table

   !> Copy of a component, marked as integers.
   pure type(component) function as_integers(item)
      type(component), intent(in) :: item

      as_integers = item
      as_integers%is_whole = .true.
   end function as_integers

   !> Resets all components but the request.
   subroutine reset_components(model)
      type(process_model_type), intent(inout) :: model
      type(process_model_type) :: blank

      blank%request = model%request
      model = blank
   end subroutine reset_components

   !> Visits every component but the request. Which components there are follows from the request
   !> and the components before.
   subroutine visit_components(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model
      character(:), allocatable :: status

      status = trim(merge('solved    ', 'infeasible', model%is_solved))
      call visitor%visit(component('status'), status)
      call visitor%visit(component('reason'), model%reason)
      call visitor%visit(component('fit_seconds'), model%seconds)
      model%is_solved = .false.
      if (allocated(status)) model%is_solved = status == 'solved'
      if (.not. model%is_solved) return
      if (model%request%method == 'values') then
         call visit_moments(visitor, model)
         return
      end if
      call visitor%visit(component('order_found'), model%order)
      call visit_law(visitor, model)
      call visit_correlation(visitor, model)
      if (model%request%positive) call visit_positive(visitor, model)
      if (.not. has_one_value(model%request)) call visit_entropies(visitor, model)
      call visit_direct(visitor, model)
   end subroutine visit_components

   !> Visits the coefficients of Eq. (39) or, if there are none, the matrix G of Eq. (25).
   subroutine visit_law(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model
      real(wp), allocatable :: im(:), re(:)

      call visitor%visit(component('g', '1/unit of x squared', 'row of the matrix G, Eq. (25)', &
                                   by_g_lag), model%g)
      if (allocated(model%g)) then
         model%b0 = innovation_scale(model%g)
         call visitor%visit(component('centre', 'unit of x', &
                           'value c of the density exp(-(x - c)'' G (x - c)/2) on x > 0'), model%mu)
         call visitor%visit(component('nodes', 'unit of x', &
                      'values x_j by which the transition density is summed', by_node), model%nodes)
         call visitor%visit(component('weights', '1', 'weights w_j of that sum', by_node), &
                            model%weights)
         return
      end if
      call visitor%visit(component('a', '1', 'a_q of z_n = b0 w_n - sum a_q z_(n-q)', by_order), &
                         model%a)
      call visitor%visit(component('b0', 'unit of x', 'scale of the innovations'), model%b0)
      call visitor%visit(component('mu', 'unit of x', 'mean of the underlying Gaussian process'), &
                         model%mu)
      if (allocated(model%poles)) then
         re = real(model%poles, wp)
         im = aimag(model%poles)
      end if
      call visitor%visit(component('poles_real', '1', 'real part of the poles', by_order), re)
      call visitor%visit(component('poles_imag', '1', 'imaginary part of the poles', by_order), im)
      if (allocated(model%poles)) deallocate (model%poles)
      if (.not. (allocated(re) .and. allocated(im))) return
      if (size(re) == size(im)) model%poles = cmplx(re, im, wp)   ! unless the file is damaged
   end subroutine visit_law

   subroutine visit_correlation(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model

      call visitor%visit(component('autocovariance', 'unit of x squared', 'autocovariance K_XX', &
                                   by_lag), model%autocovariance)
      call visitor%visit(component('autocovariance_error', 'unit of x squared', &
                        'standard error of the autocovariance', by_lag), model%autocovariance_error)
      call visit_moments(visitor, model)
      call visitor%visit(component('L0', 'lag', 'correlation length, Eq. (8), infinite sum'), &
                         model%l0, model%l0_error)
      call visitor%visit(component('L1', 'lag', 'correlation length, Eq. (9), infinite sum'), &
                         model%l1, model%l1_error)
      call visitor%visit(component('L0_cut', 'lag', &
                                   'correlation length, Eq. (8), cut at the order'), model%l0_cut)
      call visitor%visit(component('L1_cut', 'lag', &
                                   'correlation length, Eq. (9), cut at the order'), model%l1_cut)
   end subroutine visit_correlation

   !> Visits the mean and std achieved, with standard errors.
   subroutine visit_moments(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model

      call visitor%visit(component('mean_found', 'unit of x', 'mean achieved'), model%mean, &
                         model%mean_error)
      call visitor%visit(component('std_found', 'unit of x', 'standard deviation achieved'), &
                         model%std, model%std_error)
   end subroutine visit_moments

   !> Visits the memory, the signs of the autocovariance and, if known, the statistics of the other
   !> law with the same coefficients.
   subroutine visit_positive(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model
      character(*), parameter :: same = ' of the other law with the same a, b0 and mu'
      integer :: first_sign

      call visitor%visit(component('memory'), model%memory)
      call visitor%visit(component('branch'), model%branch)
      if (allocated(model%branch)) then
         first_sign = 0
         if (allocated(model%autocovariance)) then   ! unless the file is damaged
            if (size(model%autocovariance) > 1) &
               first_sign = nint(sign(1.0_wp, model%autocovariance(1)))
         end if
         call visitor%visit(component('sign_of_first_lag'), first_sign)
         call visitor%visit(component('nonnegative_entropy', 'nat', &
                              'entropy per point of the other law''s process with K(m) >= 0, a '// &
                                      'larger one', is_optional=.true.), model%nonnegative_entropy)
      end if
      call visitor%visit(component('other_std', 'unit of x', 'standard deviation'//same, &
                                   is_optional=.true.), model%other%std, model%other%std_error)
      if (.not. model%other%std > 0.0_wp) return
      call visitor%visit(component('other_mean', 'unit of x', 'mean'//same), model%other%mean, &
                         model%other%mean_error)
      call visitor%visit(component('other_L0', 'lag', 'correlation length'//same), model%other%l0, &
                         model%other%l0_error)
      call visitor%visit(component('other_entropy', 'nat', 'entropy per point'//same), &
                         model%other%entropy, model%other%entropy_error)
   end subroutine visit_positive

   subroutine visit_entropies(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model
      logical :: alternates

      call visitor%visit(component('entropy', 'nat', 'entropy per point'), model%entropy, &
                         model%entropy_error)
      call visitor%visit(component('entropy_bound', 'nat', &
            'entropy per point of white noise of the same variance, Eq. (42)'), model%entropy_bound)
      call visitor%visit(component('optimality', '1', &
                                 'largest residual of the optimality conditions'), model%optimality)
      if (allocated(model%g)) return
      alternates = allocated(model%branch)
      if (alternates) alternates = model%branch == 'alternating'
      if (.not. alternates) &
         call visitor%visit(component('lambda', '1', &
                                  'limit of the acceptance of one more point, Eq. (45), of the '// &
                             'exact law with these a, b0 and mu'), model%lambda, model%lambda_error)
      call visitor%visit(component('acceptance_ratio', '1', 'points accepted of those proposed'), &
                         model%acceptance_ratio)
      call visitor%visit(component('acceptance_mean', '1', &
                          'mean over the past of the probability to accept'), model%acceptance_mean)
      call visitor%visit(component('acceptance_geometric', '1', &
           'geometric mean over the past of the probability to accept'), model%acceptance_geometric)
   end subroutine visit_entropies

   !> Visits the multipliers of the direct method, the solutions of its sign search and the check by
   !> inversion.
   subroutine visit_direct(visitor, model)
      class(component_visitor), intent(inout) :: visitor
      type(process_model_type), intent(inout) :: model

      call visitor%visit(component('signs', '1', 'sign s_m of the autocovariance', by_sign), &
                         model%signs)
      if (allocated(model%signs)) then
         call visitor%visit(component('delta', '1', 'multiplier lambda_2/lambda_3'), model%delta)
         call visitor%visit(component('lambda_3', '1/unit of x squared', &
                                      'multiplier of the variance'), model%lambda_3)
         call visitor%visit(component('search'), model%search)
         call visitor%visit(component('n_examined'), model%n_examined)
         call visitor%visit(component('n_consistent'), model%n_consistent)
         if (.not. model%request%positive) &
            call visitor%visit(component('entropy_ceiling', 'nat', &
                          'entropy per point that no sign sequence exceeds'), model%entropy_ceiling)
         call visitor%visit(component('solutions_signs', '1', 'signs of each solution', &
                                      by_solution, by_sign), model%solutions_signs)
         call visitor%visit(component('solutions_delta', '1', 'delta of each', by_solution), &
                            model%solutions_delta)
         call visitor%visit(component('solutions_lambda_3', '1/unit of x squared', &
                                      'lambda_3 of each', by_solution), model%solutions_lambda_3)
         call visitor%visit(component('solutions_entropy', 'nat', 'entropy per point of each', &
                                      by_solution), model%solutions_entropy)
      end if
      if (model%request%inversion_half_width == 0) return
      associate (check => model%inversion)
         call visitor%visit(component('inversion_half_width'), check%half_width)
         call visitor%visit(component('inversion_seconds'), check%seconds)
         call visitor%visit(component('direct_seconds'), check%seconds_of_fit)
         call visitor%visit(component('inversion_autocovariance', 'unit of x squared', &
                             'K_XX by inversion, Eq. (35)', by_inversion_lag), check%autocovariance)
         call visitor%visit(component('inversion_error', '1', &
                                      'largest error of the inversion, over K_XX(0)'), check%error)
         call visitor%visit(component('inversion_expected_error', '1', &
                         'largest pole to the power of twice the half-width'), check%expected_error)
      end associate
   end subroutine visit_direct

end module process_components
