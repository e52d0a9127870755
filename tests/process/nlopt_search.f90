!> Minimization in a box under equality constraints by SLSQP of NLopt, through its C interface: an
!> algorithm that has nothing in common with the program's own.
!>
!> A problem is an extension of `minimization_problem`. The constraints are evaluated again at the
!> last point; NLopt's own code of success is not used.
module nlopt_search
   use, intrinsic :: ieee_exceptions, only: ieee_get_halting_mode, ieee_set_halting_mode, ieee_usual
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funloc, &
                                          c_funptr, c_int, c_loc, c_null_char, c_null_ptr, c_ptr
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: minimization_problem, minimize

   !> Function to be minimized; extend it with the data of the problem.
   type, abstract :: minimization_problem
      integer :: n_equalities = 0   !! number of constraints c(x) = 0
   contains
      procedure(objective_interface), deferred :: objective
      procedure(equalities_interface), deferred :: equalities
   end type minimization_problem

   abstract interface
      !> Finds f(x), and its gradient if present. A value that is not finite ends the search.
      subroutine objective_interface(self, x, value, gradient)
         import :: minimization_problem, wp
         implicit none(type, external)
         class(minimization_problem), intent(inout) :: self
         real(wp), intent(in) :: x(:)
         real(wp), intent(out) :: value
         real(wp), optional, intent(out) :: gradient(:)   !! (n)
      end subroutine objective_interface

      !> Finds c(x), and its derivatives if present.
      subroutine equalities_interface(self, x, values, jacobian)
         import :: minimization_problem, wp
         implicit none(type, external)
         class(minimization_problem), intent(inout) :: self
         real(wp), intent(in) :: x(:)
         real(wp), intent(out) :: values(:)                   !! (constraint)
         real(wp), optional, intent(out) :: jacobian(:, :)    !! (n, constraint): d values/d x
      end subroutine equalities_interface
   end interface

   abstract interface
      !> Sets a bound or a tolerance.
      function set_number(optimizer, number) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), value :: number
         integer(c_int) :: code
      end function set_number
   end interface
   procedure(set_number), bind(c) :: nlopt_set_ftol_rel, nlopt_set_lower_bounds1, &
                                     nlopt_set_upper_bounds1, nlopt_set_xtol_rel

   !> Other procedures of NLopt, as its C header declares them.
   interface
      function nlopt_algorithm_from_string(name) result(algorithm) bind(c)
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: name(*)
         integer(c_int) :: algorithm
      end function nlopt_algorithm_from_string

      function nlopt_create(algorithm, n) result(optimizer) bind(c)
         import :: c_int, c_ptr
         integer(c_int), value :: algorithm, n
         type(c_ptr) :: optimizer
      end function nlopt_create

      subroutine nlopt_destroy(optimizer) bind(c)
         import :: c_ptr
         type(c_ptr), value :: optimizer
      end subroutine nlopt_destroy

      function nlopt_set_min_objective(optimizer, f, data) result(code) bind(c)
         import :: c_funptr, c_int, c_ptr
         type(c_ptr), value :: optimizer, data
         type(c_funptr), value :: f
         integer(c_int) :: code
      end function nlopt_set_min_objective

      function nlopt_add_equality_mconstraint(optimizer, m, f, data, tolerance) result(code) bind(c)
         import :: c_double, c_funptr, c_int, c_ptr
         type(c_ptr), value :: optimizer, data
         integer(c_int), value :: m
         type(c_funptr), value :: f
         real(c_double), intent(in) :: tolerance(*)
         integer(c_int) :: code
      end function nlopt_add_equality_mconstraint

      function nlopt_set_maxeval(optimizer, n) result(code) bind(c)
         import :: c_int, c_ptr
         type(c_ptr), value :: optimizer
         integer(c_int), value :: n
         integer(c_int) :: code
      end function nlopt_set_maxeval

      function nlopt_force_stop(optimizer) result(code) bind(c)
         import :: c_int, c_ptr
         type(c_ptr), value :: optimizer
         integer(c_int) :: code
      end function nlopt_force_stop

      function nlopt_optimize(optimizer, x, value) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), intent(inout) :: x(*)
         real(c_double), intent(out) :: value
         integer(c_int) :: code
      end function nlopt_optimize
   end interface

   !> Data that NLopt passes to the callbacks below.
   type :: callback_data
      class(minimization_problem), pointer :: problem => null()
      type(c_ptr) :: optimizer = c_null_ptr
      !> true for floating-point exceptions that halt the program; NLopt may raise them: its SLSQP
      !> divides by zero if constraints contradict each other
      logical :: halts(size(ieee_usual)) = .false.
   end type callback_data

contains

   !> Minimizes f from a start in the box, until f and x change relatively by less than 1e-12.
   subroutine minimize(problem, bound, tolerance, max_evaluations, x, is_feasible)
      class(minimization_problem), target, intent(inout) :: problem
      real(wp), intent(in) :: bound        !! largest |x| of the box
      real(wp), intent(in) :: tolerance    !! largest |c(x)| of a satisfied constraint
      integer, intent(in) :: max_evaluations
      real(wp), intent(inout) :: x(:)      !! (n) start, then the last point
      logical, intent(out) :: is_feasible  !! true if all constraints are satisfied there
      real(wp), parameter :: relative_change = 1.0e-12_wp
      type(callback_data), target :: callback
      real(wp) :: tolerances(problem%n_equalities), values(problem%n_equalities)
      real(c_double) :: value
      integer(c_int) :: code(8)

      callback%problem => problem
      callback%optimizer = nlopt_create(nlopt_algorithm_from_string('LD_SLSQP'//c_null_char), &
                                       size(x, kind=c_int))
      tolerances = tolerance
      associate (optimizer => callback%optimizer)
         code(1) = nlopt_set_min_objective(optimizer, c_funloc(call_objective), c_loc(callback))
         code(2) = nlopt_add_equality_mconstraint(optimizer, size(tolerances, kind=c_int), &
                                                  c_funloc(call_equalities), c_loc(callback), &
                                                  tolerances)
         code(3) = nlopt_set_lower_bounds1(optimizer, -bound)
         code(4) = nlopt_set_upper_bounds1(optimizer, bound)
         code(5) = nlopt_set_ftol_rel(optimizer, relative_change)
         code(6) = nlopt_set_xtol_rel(optimizer, relative_change)
         code(7) = nlopt_set_maxeval(optimizer, int(max_evaluations, c_int))
         if (any(code(:7) < 0)) error stop 'minimize: NLopt refuses a setting'
         call ieee_get_halting_mode(ieee_usual, callback%halts)
         call ieee_set_halting_mode(ieee_usual, .false.)
         code(8) = nlopt_optimize(optimizer, x, value)   ! its last point is used even if it fails
         call ieee_set_halting_mode(ieee_usual, callback%halts)
         call nlopt_destroy(optimizer)
      end associate
      is_feasible = is_finite(value)
      if (.not. is_feasible) return
      call problem%equalities(x, values)
      is_feasible = all(abs(values) <= tolerance)
   end subroutine minimize

   !> Objective for NLopt; ends the search if it is not finite.
   function call_objective(n, x, gradient, data) result(value) bind(c)
      integer(c_int), value :: n
      real(c_double), intent(in) :: x(n)
      type(c_ptr), value :: gradient, data   !! gradient is null if it is not needed
      real(c_double) :: value
      type(callback_data), pointer :: callback
      real(c_double), pointer :: derivatives(:)
      integer(c_int) :: code

      call c_f_pointer(data, callback)
      call ieee_set_halting_mode(ieee_usual, callback%halts)
      derivatives => null()   ! an absent argument
      if (c_associated(gradient)) call c_f_pointer(gradient, derivatives, [n])
      call callback%problem%objective(x, value, derivatives)
      call ieee_set_halting_mode(ieee_usual, .false.)
      if (.not. is_finite(value)) code = nlopt_force_stop(callback%optimizer)
   end function call_objective

   !> Evaluates the constraints for NLopt.
   subroutine call_equalities(m, values, n, x, gradient, data) bind(c)
      integer(c_int), value :: m, n
      real(c_double), intent(out) :: values(m)
      real(c_double), intent(in) :: x(n)
      type(c_ptr), value :: gradient, data
      type(callback_data), pointer :: callback
      real(c_double), pointer :: jacobian(:, :)

      call c_f_pointer(data, callback)
      call ieee_set_halting_mode(ieee_usual, callback%halts)
      jacobian => null()
      if (c_associated(gradient)) call c_f_pointer(gradient, jacobian, [n, m])
      call callback%problem%equalities(x, values, jacobian)
      call ieee_set_halting_mode(ieee_usual, .false.)
   end subroutine call_equalities

   !> True if x is neither infinite nor a NaN, by its exponent: a comparison would trap, and
   !> procedures that use ieee_arithmetic save and restore the processor's traps at each call.
   elemental function is_finite(x) result(is_so)
      real(wp), intent(in) :: x
      logical :: is_so
      integer(long), parameter :: largest = 2047_long   ! exponent of infinities and NaNs

      is_so = iand(ishft(transfer(x, largest), -52), largest) /= largest
   end function is_finite

end module nlopt_search
