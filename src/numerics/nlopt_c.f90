!> NLopt's own procedures, as its C header declares them. Only `numerics_nlopt` uses them.
module numerics_nlopt_c
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_funptr, c_int, c_ptr
   implicit none(type, external)
   private
   public :: nlopt_add_equality_mconstraint
   public :: nlopt_algorithm_from_string, nlopt_create, nlopt_destroy, nlopt_force_stop
   public :: nlopt_optimize, nlopt_set_ftol_rel
   public :: nlopt_set_lower_bounds1, nlopt_set_maxeval, nlopt_set_min_objective
   public :: nlopt_set_upper_bounds1, nlopt_set_xtol_rel, nlopt_version

   interface
      subroutine nlopt_version(major, minor, bugfix) bind(c)
         import :: c_int
         integer(c_int), intent(out) :: major, minor, bugfix
      end subroutine nlopt_version

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

      function nlopt_set_lower_bounds1(optimizer, bound) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), value :: bound
         integer(c_int) :: code
      end function nlopt_set_lower_bounds1

      function nlopt_set_upper_bounds1(optimizer, bound) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), value :: bound
         integer(c_int) :: code
      end function nlopt_set_upper_bounds1

      function nlopt_set_ftol_rel(optimizer, tolerance) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), value :: tolerance
         integer(c_int) :: code
      end function nlopt_set_ftol_rel

      function nlopt_set_xtol_rel(optimizer, tolerance) result(code) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: optimizer
         real(c_double), value :: tolerance
         integer(c_int) :: code
      end function nlopt_set_xtol_rel

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

end module numerics_nlopt_c
