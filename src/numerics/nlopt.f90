!> The one door to NLopt: minimization under bounds, equalities and inequalities, through its C
!> interface.
!>
!> A problem is an extension of `minimization_problem`. What NLopt returns is not believed:
!> objective and constraints are evaluated once more where it stopped, and refused settings (an
!> algorithm without constraints, say) are errors before the run instead of a run without them.
module numerics_nlopt
   use, intrinsic :: ieee_exceptions, only: ieee_get_halting_mode, ieee_set_halting_mode, ieee_usual
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funloc, &
                                          c_int, c_loc, c_null_char, c_null_ptr, c_ptr
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_nlopt_c, only: nlopt_add_equality_mconstraint, nlopt_add_inequality_mconstraint, &
                               nlopt_algorithm_from_string, nlopt_create, nlopt_destroy, &
                               nlopt_force_stop, nlopt_optimize, nlopt_set_ftol_rel, &
                               nlopt_set_initial_step1, nlopt_set_lower_bounds, &
                               nlopt_set_maxeval, nlopt_set_min_objective, &
                               nlopt_set_upper_bounds, nlopt_set_xtol_rel, nlopt_version
   implicit none(type, external)
   private
   public :: minimization_problem, minimization_settings, minimization_outcome, minimize
   public :: nlopt_library

   !> Function to be minimized. Extend it with the problem's own data.
   type, abstract :: minimization_problem
      integer :: n_equalities = 0     !! constraints c(x) = 0
      integer :: n_inequalities = 0   !! constraints c(x) <= 0
   contains
      procedure(objective_interface), deferred :: objective
      procedure :: equalities => no_constraints
      procedure :: inequalities => no_constraints
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
      character(:), allocatable :: algorithm          !! NLopt's name; 'LD_SLSQP' when not allocated
      real(wp), allocatable :: lower(:), upper(:)     !! (n) bounds; none when not allocated
      real(wp) :: initial_step = 0.0_wp               !! without gradients; 0: NLopt's choice
      real(wp) :: relative_change_f = 1.0e-12_wp      !! stops when f changes by less
      real(wp) :: relative_change_x = 1.0e-12_wp
      real(wp) :: constraint_tolerance = 1.0e-10_wp   !! |c(x)| up to it is satisfied
      integer :: max_evaluations = 1000
   end type minimization_settings

   !> Where the search ended; value and violation are evaluated anew at x.
   type :: minimization_outcome
      real(wp), allocatable :: x(:)
      real(wp) :: value = 0.0_wp
      real(wp) :: violation = 0.0_wp          !! largest |c| of equalities, c of inequalities
      logical :: is_feasible = .false.        !! violation within the settings' tolerance
      logical :: is_converged = .false.       !! NLopt stopped by a tolerance on f or x
      integer :: code = 0                     !! NLopt's return code
      character(:), allocatable :: meaning    !! text of the code
      integer :: n_evaluations = 0
   end type minimization_outcome

   !> Data behind NLopt's void pointer.
   type :: traveller
      class(minimization_problem), pointer :: problem => null()
      type(c_ptr) :: optimizer = c_null_ptr
      integer :: n_evaluations = 0
      logical :: met_non_finite = .false.
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
      character(:), allocatable :: algorithm
      real(c_double) :: claimed
      integer(c_int) :: number

      algorithm = 'LD_SLSQP'
      if (allocated(settings%algorithm)) algorithm = settings%algorithm
      number = nlopt_algorithm_from_string(c_text(algorithm))
      if (number < 0) then
         call raise(error, exit_bad_input, "NLopt: algorithm '"//algorithm// &
                    "': there is none of this name")
         return
      end if
      luggage%problem => problem
      luggage%optimizer = nlopt_create(number, size(start, kind=c_int))
      if (.not. c_associated(luggage%optimizer)) error stop 'minimize: NLopt gave no optimizer'
      call set_up(settings, algorithm, size(start), luggage, error)
      if (.not. allocated(error)) then
         outcome%x = start
         call ieee_get_halting_mode(ieee_usual, luggage%halts)
         call ieee_set_halting_mode(ieee_usual, .false.)
         outcome%code = nlopt_optimize(luggage%optimizer, outcome%x, claimed)
         call ieee_set_halting_mode(ieee_usual, luggage%halts)
         if (outcome%code == invalid_arguments) then
            call raise(error, exit_bad_input, "NLopt: algorithm '"//algorithm// &
                       "': the start must lie inside the bounds, and some algorithms need bounds")
         else
            call examine(problem, settings, luggage, outcome)
         end if
      end if
      call nlopt_destroy(luggage%optimizer)
   end subroutine minimize

   !> Hands every setting over and insists that each is taken.
   subroutine set_up(settings, algorithm, n, luggage, error)
      type(minimization_settings), intent(in) :: settings
      character(*), intent(in) :: algorithm
      integer, intent(in) :: n   !! variables
      type(traveller), target, intent(in) :: luggage
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: tolerance(max(1, luggage%problem%n_equalities, luggage%problem%n_inequalities))
      integer(c_int) :: code(9)

      tolerance = settings%constraint_tolerance
      code = success
      associate (optimizer => luggage%optimizer, problem => luggage%problem)
         code(1) = nlopt_set_min_objective(optimizer, c_funloc(call_objective), c_loc(luggage))
         if (problem%n_equalities > 0) &
            code(2) = nlopt_add_equality_mconstraint(optimizer, &
                                           int(problem%n_equalities, c_int), &
                                           c_funloc(call_equalities), c_loc(luggage), tolerance)
         if (problem%n_inequalities > 0) &
            code(3) = nlopt_add_inequality_mconstraint(optimizer, &
                                         int(problem%n_inequalities, c_int), &
                                         c_funloc(call_inequalities), c_loc(luggage), tolerance)
         if (allocated(settings%lower)) then
            code(4) = invalid_arguments   ! NLopt does not know how many there are
            if (size(settings%lower) == n) &
               code(4) = nlopt_set_lower_bounds(optimizer, settings%lower)
         end if
         if (allocated(settings%upper)) then
            code(5) = invalid_arguments
            if (size(settings%upper) == n) &
               code(5) = nlopt_set_upper_bounds(optimizer, settings%upper)
         end if
         code(6) = nlopt_set_ftol_rel(optimizer, settings%relative_change_f)
         code(7) = nlopt_set_xtol_rel(optimizer, settings%relative_change_x)
         code(8) = nlopt_set_maxeval(optimizer, int(settings%max_evaluations, c_int))
         if (settings%initial_step > 0.0_wp) &
            code(9) = nlopt_set_initial_step1(optimizer, settings%initial_step)
      end associate
      if (any(code(2:3) /= success)) then
         call raise(error, exit_bad_input, "NLopt: algorithm '"//algorithm// &
                    "': takes no constraints of this kind")
      else if (any(code /= success)) then
         call raise(error, exit_bad_input, "NLopt: algorithm '"//algorithm// &
                    "': a tolerance, or a bound (one for each of "//to_text(n)// &
                    ' variables), was refused')
      end if
   end subroutine set_up

   !> Evaluates anew where NLopt stopped, and reads its code.
   subroutine examine(problem, settings, luggage, outcome)
      class(minimization_problem), intent(inout) :: problem
      type(minimization_settings), intent(in) :: settings
      type(traveller), intent(in) :: luggage
      type(minimization_outcome), intent(inout) :: outcome
      real(wp) :: equal(problem%n_equalities), unequal(problem%n_inequalities)

      call problem%objective(outcome%x, outcome%value)
      equal = 0.0_wp
      unequal = 0.0_wp
      if (size(equal) > 0) call problem%equalities(outcome%x, equal)
      if (size(unequal) > 0) call problem%inequalities(outcome%x, unequal)
      outcome%violation = max(maxval(abs([0.0_wp, equal])), maxval([0.0_wp, unequal]))
      outcome%is_feasible = outcome%violation <= settings%constraint_tolerance .and. &
                            is_finite(outcome%value)
      outcome%is_converged = any(outcome%code == [success, ftol_reached, xtol_reached])
      outcome%n_evaluations = luggage%n_evaluations
      outcome%meaning = meaning_of(outcome%code)
      if (luggage%met_non_finite) outcome%meaning = 'the objective was not finite at a trial point'
   end subroutine examine

   pure function meaning_of(code) result(meaning)
      integer, intent(in) :: code
      character(:), allocatable :: meaning

      select case (code)
      case (1)
         meaning = 'done'
      case (2)
         meaning = 'the value to stop at was reached'
      case (3)
         meaning = 'the objective no longer changes'
      case (4)
         meaning = 'the point no longer moves'
      case (5)
         meaning = 'the limit of evaluations was reached'
      case (6)
         meaning = 'the time limit was reached'
      case (-1)
         meaning = 'NLopt failed'
      case (-3)
         meaning = 'out of memory'
      case (-4)
         meaning = 'rounding limits further progress'
      case (-5)
         meaning = 'the search was stopped'
      case default
         meaning = 'NLopt returned '//to_text(code)
      end select
   end function meaning_of

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
      luggage%n_evaluations = luggage%n_evaluations + 1
      if (c_associated(gradient)) then
         call c_f_pointer(gradient, slope, [n])
         call luggage%problem%objective(x, value, slope)
      else
         call luggage%problem%objective(x, value)
      end if
      call ieee_set_halting_mode(ieee_usual, .false.)
      if (is_finite(value)) return
      luggage%met_non_finite = .true.
      code = nlopt_force_stop(luggage%optimizer)
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

   subroutine call_inequalities(m, values, n, x, gradient, data) bind(c)
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
         call luggage%problem%inequalities(x, values, jacobian)
      else
         call luggage%problem%inequalities(x, values)
      end if
      call ieee_set_halting_mode(ieee_usual, .false.)
   end subroutine call_inequalities

   !> Stops: a problem that counts constraints must override it.
   subroutine no_constraints(self, x, values, jacobian)
      class(minimization_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: values(:)                   !! (constraint)
      real(wp), optional, intent(out) :: jacobian(:, :)    !! (n, constraint): d values/d x

      values = 0.0_wp*sum(x)
      if (present(jacobian)) jacobian = 0.0_wp
      if (self%n_equalities + self%n_inequalities > 0) &
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

   !> A C string.
   pure function c_text(text) result(characters)
      character(*), intent(in) :: text
      character(kind=c_char) :: characters(len(text) + 1)
      integer :: i

      characters = [(text(i:i), i=1, len(text)), c_null_char]
   end function c_text

end module numerics_nlopt
