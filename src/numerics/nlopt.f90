!> The one door to NLopt: minimization under bounds and equalities by its SLSQP, through its C
!> interface.
!>
!> A problem is an extension of `minimization_problem`. What NLopt returns is not believed:
!> constraints are evaluated once more where it stopped, and refused settings are errors before the
!> run instead of a run without them.
module numerics_nlopt
   use, intrinsic :: ieee_exceptions, only: ieee_get_halting_mode, ieee_set_halting_mode, ieee_usual
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funloc, c_int, &
                                          c_loc, c_null_char, c_null_ptr, c_ptr
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_nlopt_c, only: nlopt_add_equality_mconstraint, nlopt_algorithm_from_string, &
                               nlopt_create, nlopt_destroy, nlopt_force_stop, nlopt_optimize, &
                               nlopt_set_ftol_rel, nlopt_set_lower_bounds, nlopt_set_maxeval, &
                               nlopt_set_min_objective, nlopt_set_upper_bounds, &
                               nlopt_set_xtol_rel, nlopt_version
   implicit none(type, external)
   private
   public :: minimization_problem, minimization_settings, minimization_outcome, minimize
   public :: nlopt_library

   !> Function to be minimized. Extend it with the problem's own data.
   type, abstract :: minimization_problem
      integer :: n_equalities = 0   !! constraints c(x) = 0
   contains
      procedure(objective_interface), deferred :: objective
      procedure :: equalities => no_constraints
   end type minimization_problem

   abstract interface
      !> Finds f(x), and where it is asked for its gradient. A value that is not finite ends the
      !> search.
      subroutine objective_interface(self, x, value, gradient)
         import :: minimization_problem, wp
         implicit none(type, external)
         class(minimization_problem), intent(inout) :: self
         real(wp), intent(in) :: x(:)
         real(wp), intent(out) :: value
         real(wp), optional, intent(out) :: gradient(:)   !! (n)
      end subroutine objective_interface
   end interface

   !> How to search. Tolerances of 0 are not used.
   type :: minimization_settings
      real(wp), allocatable :: lower(:), upper(:)     !! (n) bounds; none when not allocated
      real(wp) :: relative_change_f = 1.0e-12_wp      !! stops when f changes by less
      real(wp) :: relative_change_x = 1.0e-12_wp
      real(wp) :: constraint_tolerance = 1.0e-10_wp   !! |c(x)| up to it is satisfied
      integer :: max_evaluations = 1000
   end type minimization_settings

   !> Where the search ended; constraints are evaluated anew at x.
   type :: minimization_outcome
      real(wp), allocatable :: x(:)
      logical :: is_feasible = .false.    !! every |c| is within the settings' tolerance
      logical :: is_converged = .false.   !! NLopt stopped by a tolerance on f or x
   end type minimization_outcome

   !> Data behind NLopt's void pointer.
   type :: traveller
      class(minimization_problem), pointer :: problem => null()
      type(c_ptr) :: optimizer = c_null_ptr
      !> Floating-point exceptions that halt us. NLopt's own arithmetic may raise them: its SLSQP
      !> divides by zero where constraints contradict each other.
      logical :: halts(size(ieee_usual)) = .false.
   end type traveller

   integer(c_int), parameter :: success = 1, ftol_reached = 3, xtol_reached = 4
   integer(c_int), parameter :: invalid_arguments = -2

contains

   !> Version of the library.
   function nlopt_library() result(text)
      character(:), allocatable :: text
      integer(c_int) :: major, minor, bugfix

      call nlopt_version(major, minor, bugfix)
      text = to_text(int(major))//'.'//to_text(int(minor))//'.'//to_text(int(bugfix))
   end function nlopt_library

   !> Searches from `start`. An error is a setting that NLopt refuses; how the search went is in the
   !! outcome.
   subroutine minimize(problem, settings, start, outcome, error)
      class(minimization_problem), target, intent(inout) :: problem
      type(minimization_settings), intent(in) :: settings
      real(wp), intent(in) :: start(:)   !! (n)
      type(minimization_outcome), intent(out) :: outcome
      type(error_type), allocatable, intent(out) :: error
      type(traveller), target :: luggage
      real(c_double) :: claimed
      integer(c_int) :: code

      luggage%problem => problem
      luggage%optimizer = nlopt_create(nlopt_algorithm_from_string('LD_SLSQP'//c_null_char), &
                                       size(start, kind=c_int))
      if (.not. c_associated(luggage%optimizer)) error stop 'minimize: NLopt gave no optimizer'
      call set_up(settings, size(start), luggage, error)
      if (.not. allocated(error)) then
         outcome%x = start
         call ieee_get_halting_mode(ieee_usual, luggage%halts)
         call ieee_set_halting_mode(ieee_usual, .false.)
         code = nlopt_optimize(luggage%optimizer, outcome%x, claimed)
         call ieee_set_halting_mode(ieee_usual, luggage%halts)
         if (code == invalid_arguments) then
            call raise(error, exit_bad_input, 'NLopt: the start must lie inside the bounds')
         else
            outcome%is_converged = any(code == [success, ftol_reached, xtol_reached])
            outcome%is_feasible = is_finite(claimed)
            if (outcome%is_feasible) outcome%is_feasible = &
               largest_defect(problem, outcome%x) <= settings%constraint_tolerance
         end if
      end if
      call nlopt_destroy(luggage%optimizer)
   end subroutine minimize

   !> Hands every setting over and insists that each is taken.
   subroutine set_up(settings, n, luggage, error)
      type(minimization_settings), intent(in) :: settings
      integer, intent(in) :: n   !! variables
      type(traveller), target, intent(in) :: luggage
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: tolerance(max(1, luggage%problem%n_equalities))
      integer(c_int) :: code(7)

      tolerance = settings%constraint_tolerance
      code = success
      associate (optimizer => luggage%optimizer, problem => luggage%problem)
         code(1) = nlopt_set_min_objective(optimizer, c_funloc(call_objective), c_loc(luggage))
         if (problem%n_equalities > 0) &
            code(2) = nlopt_add_equality_mconstraint(optimizer, &
                                           int(problem%n_equalities, c_int), &
                                           c_funloc(call_equalities), c_loc(luggage), tolerance)
         if (allocated(settings%lower)) then
            code(3) = invalid_arguments   ! NLopt does not know how many there are
            if (size(settings%lower) == n) &
               code(3) = nlopt_set_lower_bounds(optimizer, settings%lower)
         end if
         if (allocated(settings%upper)) then
            code(4) = invalid_arguments
            if (size(settings%upper) == n) &
               code(4) = nlopt_set_upper_bounds(optimizer, settings%upper)
         end if
         code(5) = nlopt_set_ftol_rel(optimizer, settings%relative_change_f)
         code(6) = nlopt_set_xtol_rel(optimizer, settings%relative_change_x)
         code(7) = nlopt_set_maxeval(optimizer, int(settings%max_evaluations, c_int))
      end associate
      if (any(code /= success)) &
         call raise(error, exit_bad_input, 'NLopt: a tolerance, or a bound (one for each of '// &
                    to_text(n)//' variables), was refused')
   end subroutine set_up

   !> Largest |c(x)|.
   function largest_defect(problem, x) result(largest)
      class(minimization_problem), intent(inout) :: problem
      real(wp), intent(in) :: x(:)
      real(wp) :: largest
      real(wp) :: values(problem%n_equalities)

      values = 0.0_wp
      if (size(values) > 0) call problem%equalities(x, values)
      largest = maxval(abs([0.0_wp, values]))
   end function largest_defect

   !> NLopt's objective: unpacks the problem and asks it.
   function call_objective(n, x, gradient, data) result(value) bind(c)
      integer(c_int), value :: n
      real(c_double), intent(in) :: x(n)
      type(c_ptr), value :: gradient, data   !! gradient is null where it is not needed
      real(c_double) :: value
      type(traveller), pointer :: luggage
      real(c_double), pointer :: slope(:)
      integer(c_int) :: code

      call c_f_pointer(data, luggage)
      call ieee_set_halting_mode(ieee_usual, luggage%halts)
      if (c_associated(gradient)) then
         call c_f_pointer(gradient, slope, [n])
         call luggage%problem%objective(x, value, slope)
      else
         call luggage%problem%objective(x, value)
      end if
      call ieee_set_halting_mode(ieee_usual, .false.)
      if (.not. is_finite(value)) code = nlopt_force_stop(luggage%optimizer)
   end function call_objective

   subroutine call_equalities(m, values, n, x, gradient, data) bind(c)
      integer(c_int), value :: m, n
      real(c_double), intent(out) :: values(m)
      real(c_double), intent(in) :: x(n)
      type(c_ptr), value :: gradient, data
      type(traveller), pointer :: luggage
      real(c_double), pointer :: jacobian(:, :)

      call c_f_pointer(data, luggage)
      call ieee_set_halting_mode(ieee_usual, luggage%halts)
      if (c_associated(gradient)) then
         call c_f_pointer(gradient, jacobian, [n, m])
         call luggage%problem%equalities(x, values, jacobian)
      else
         call luggage%problem%equalities(x, values)
      end if
      call ieee_set_halting_mode(ieee_usual, .false.)
   end subroutine call_equalities

   !> Stops: a problem that counts constraints must override it.
   subroutine no_constraints(self, x, values, jacobian)
      class(minimization_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: values(:)                   !! (constraint)
      real(wp), optional, intent(out) :: jacobian(:, :)    !! (n, constraint): d values/d x

      values = 0.0_wp*sum(x)
      if (present(jacobian)) jacobian = 0.0_wp
      if (self%n_equalities > 0) &
         error stop 'minimization_problem: constraints without a rule'
   end subroutine no_constraints

   !> True if x is neither infinite nor a NaN, judged by its exponent: a comparison would trap, and
   !> ieee_arithmetic saves and restores the processor's traps around every procedure that sees it.
   elemental function is_finite(x) result(is_so)
      real(wp), intent(in) :: x
      logical :: is_so
      integer(long), parameter :: exponents = 2047_long

      is_so = iand(ishft(transfer(x, exponents), -52), exponents) /= exponents
   end function is_finite

end module numerics_nlopt
