!> Maximum of a smooth function under a few equality constraints, from a start nearby.
!>
!> Sequential quadratic programming with an inverse Hessian (BFGS). Gradients are found by
!> differences unless the objective has its own. Functions may be sampled with common random
!> numbers: smooth and expensive.
module numerics_constrained_maximum
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: solve_positive_definite, unit_matrix
   implicit none(type, external)
   private
   public :: objective_type, maximum_result, maximize, projected_gradient, restore_constraints, &
             step_to_maximum

   !> Result of a search.
   type :: maximum_result
      logical :: is_converged = .false.
      real(wp) :: violation = huge(1.0_wp)      !! largest constraint in magnitude
      real(wp) :: residual = 0.0_wp             !! largest component of the Lagrangian's gradient
      real(wp), allocatable :: jacobian(:, :)   !! (constraint, variable) of the last differences
      real(wp), allocatable :: multipliers(:)   !! (constraint) d maximum/d constraint
      real(wp), allocatable :: metric(:, :)     !! inverse Hessian of the Lagrangian, by BFGS
   end type maximum_result

   !> Function to be maximized and the point of its search; extend it with the data of the problem.
   !>
   !> A state is the result of an evaluation: first the constraints, zero if satisfied, then the
   !> values that `gain` needs. Only differences of the function need be known.
   type, abstract :: objective_type
      real(wp), allocatable :: point(:)
      integer :: n_constraints = 0
      type(maximum_result) :: found   !! result of the last search
   contains
      procedure(evaluate_objective), deferred :: evaluate
      procedure(gain_of_objective), deferred :: gain
      procedure :: differentiate
   end type objective_type

   abstract interface
      !> Finds the state at a point; `is_inside` is false outside the function's domain.
      subroutine evaluate_objective(self, point, state, is_inside)
         import :: objective_type, wp
         class(objective_type), intent(inout) :: self
         real(wp), intent(in) :: point(:)
         real(wp), allocatable, intent(out) :: state(:)
         logical, intent(out) :: is_inside
      end subroutine evaluate_objective

      !> Increase of the function from one state to another.
      pure real(wp) function gain_of_objective(self, from, to)
         import :: objective_type, wp
         class(objective_type), intent(in) :: self
         real(wp), intent(in) :: from(:), to(:)
      end function gain_of_objective
   end interface

contains

   !> Moves the point to the maximum. Starts with the inverse Hessian of the last search, if it has
   !> the same number of variables. Gives up where the constraints contradict each other.
   subroutine maximize(objective, step, tolerance, max_iterations)
      class(objective_type), intent(inout) :: objective
      real(wp), intent(in) :: step          !! step of finite differences
      real(wp), intent(in) :: tolerance     !! largest constraint and gradient of the Lagrangian
      integer, intent(in) :: max_iterations
      ! beyond it the gradients of the constraints are nearly dependent: processes have up to 400
      real(wp), parameter :: largest_multiplier = 1.0e5_wp
      real(wp), dimension(size(objective%point)) :: change, gradient, old_gradient
      real(wp), dimension(objective%n_constraints, size(objective%point)) :: jacobian, old_jacobian
      real(wp) :: multipliers(objective%n_constraints), penalty
      real(wp), allocatable :: metric(:, :), state(:)
      integer :: iteration
      logical :: is_inside, is_regular

      call move_alloc(objective%found%metric, metric)
      objective%found = maximum_result()
      objective%found%metric = unit_matrix(size(change))
      if (allocated(metric)) then
         if (size(metric, 1) == size(change)) objective%found%metric = metric
      end if
      call objective%evaluate(objective%point, state, is_inside)
      penalty = 0.0_wp
      associate (found => objective%found, n => objective%n_constraints)
         do iteration = 1, max_iterations
            if (is_inside) call objective%differentiate(state, step, gradient, jacobian, is_inside)
            if (.not. is_inside) return
            if (iteration > 1) &
               call update_metric(change, old_gradient - gradient - &
                                  matmul(multipliers, old_jacobian - jacobian), found%metric)
            call step_to_maximum(found%metric, jacobian, gradient, state(:n), change, multipliers, &
                                 is_regular)
            if (.not. is_regular .or. maxval(abs(multipliers)) > largest_multiplier) return
            found%jacobian = jacobian
            found%multipliers = multipliers
            found%violation = maxval(abs(state(:n)))
            found%residual = maxval(abs(projected_gradient(gradient, jacobian)))
            found%is_converged = max(found%violation, found%residual) <= tolerance
            if (found%is_converged) return
            change = change*min(1.0_wp, 0.5_wp/max(norm2(change), tiny(1.0_wp)))
            penalty = max(penalty, 2.0_wp*maxval(abs(multipliers)))
            old_gradient = gradient
            old_jacobian = jacobian
            call search_line(objective, change, state, penalty, tolerance, is_inside)
         end do
      end associate
   end subroutine maximize

   !> Moves the point along `change`, shortened until the gain minus a penalty on the constraints
   !> does not fall. Before it is shortened, a failed step is corrected for the curvature of the
   !> constraints, but by less than its length: a nearly singular metric asks for more.
   !> If no step is accepted the point stays, and `is_inside` is false.
   subroutine search_line(objective, change, state, penalty, tolerance, is_inside)
      class(objective_type), intent(inout) :: objective
      real(wp), intent(inout) :: change(:)
      real(wp), allocatable, intent(inout) :: state(:)
      real(wp), intent(in) :: penalty, tolerance
      logical, intent(out) :: is_inside
      integer, parameter :: max_tries = 12
      real(wp), allocatable :: trial(:)
      real(wp) :: uncorrected(size(change))
      integer :: i, n
      logical :: is_regular

      n = objective%n_constraints
      do i = 1, max_tries
         call objective%evaluate(objective%point + change, trial, is_inside)
         if (is_accepted()) exit
         uncorrected = change
         if (is_inside) then
            call correct_step(objective%found, trial(:n), change, is_regular)
            if (is_regular) is_regular = norm2(change - uncorrected) < norm2(uncorrected)
            if (is_regular) call objective%evaluate(objective%point + change, trial, is_inside)
            if (is_regular .and. is_accepted()) exit
         end if
         change = 0.4_wp*uncorrected
      end do
      is_inside = i <= max_tries
      if (.not. is_inside) return
      objective%point = objective%point + change
      call move_alloc(trial, state)

   contains

      function is_accepted()
         logical :: is_accepted

         is_accepted = is_inside
         if (is_inside) is_accepted = objective%gain(state, trial) + &
                                      penalty*(sum(abs(state(:n))) - sum(abs(trial(:n)))) &
                                      >= -tolerance**2
      end function is_accepted

   end subroutine search_line

   !> Adds to a step the shortest one, in the metric, that makes the linearized constraints zero.
   subroutine correct_step(found, constraints, change, is_regular)
      type(maximum_result), intent(in) :: found
      real(wp), intent(in) :: constraints(:)
      real(wp), intent(inout) :: change(:)
      logical, intent(out) :: is_regular
      real(wp) :: back(size(change)), multipliers(size(constraints))

      call step_to_maximum(found%metric, found%jacobian, 0.0_wp*change, constraints, back, &
                           multipliers, is_regular)
      if (is_regular) change = change + back
   end subroutine correct_step

   !> Moves the point onto the constraints by the shortest steps in the metric of the last search;
   !> each step updates the Jacobian (Broyden).
   subroutine restore_constraints(objective, tolerance, max_iterations)
      class(objective_type), intent(inout) :: objective
      real(wp), intent(in) :: tolerance
      integer, intent(in) :: max_iterations
      real(wp), dimension(size(objective%point)) :: change, direction
      real(wp) :: constraints(objective%n_constraints)
      real(wp), allocatable :: state(:)
      integer :: i
      logical :: is_inside, is_regular

      objective%found%violation = huge(1.0_wp)
      do i = 1, max_iterations
         call objective%evaluate(objective%point, state, is_inside)
         if (.not. is_inside) return
         constraints = state(:size(constraints))
         objective%found%violation = maxval(abs(constraints))
         if (i > 1) then   ! constraints after the last step: the Jacobian's error along it
            direction = change/dot_product(change, change)
            objective%found%jacobian = objective%found%jacobian &
                                       + spread(constraints, 2, size(change)) &
                                       *spread(direction, 1, size(constraints))
         end if
         if (objective%found%violation <= tolerance) return
         change = 0.0_wp
         call correct_step(objective%found, constraints, change, is_regular)
         if (.not. is_regular) return
         objective%point = objective%point + change
      end do
   end subroutine restore_constraints

   !> Finds gradient and Jacobian at the point by forward differences, or backward ones at the
   !> domain's edge.
   subroutine differentiate(self, state, step, gradient, jacobian, is_inside)
      class(objective_type), intent(inout) :: self
      real(wp), intent(in) :: state(:), step
      real(wp), intent(out) :: gradient(:), jacobian(:, :)
      logical, intent(out) :: is_inside
      real(wp), allocatable :: moved_state(:)
      real(wp) :: moved(size(gradient))
      integer :: i, n, direction

      n = size(jacobian, 1)
      is_inside = .true.
      do i = 1, size(moved)
         do direction = 1, -1, -2
            moved = self%point
            moved(i) = moved(i) + direction*step
            call self%evaluate(moved, moved_state, is_inside)
            if (is_inside) exit
         end do
         if (.not. is_inside) return
         gradient(i) = self%gain(state, moved_state)/(direction*step)
         jacobian(:, i) = (moved_state(:n) - state(:n))/(direction*step)
      end do
   end subroutine differentiate

   !> Finds the step H (g - J' lambda) of sequential quadratic programming, with the multipliers
   !> lambda for which the linearized constraints are zero after it. `is_regular` is false if the
   !> gradients of the constraints are linearly dependent.
   subroutine step_to_maximum(metric, jacobian, gradient, constraints, change, multipliers, &
                              is_regular)
      real(wp), intent(in) :: metric(:, :)     !! H, inverse Hessian (variable, variable)
      real(wp), intent(in) :: jacobian(:, :)   !! J (constraint, variable)
      real(wp), intent(in) :: gradient(:), constraints(:)
      real(wp), intent(out) :: change(:), multipliers(:)
      logical, intent(out) :: is_regular
      type(error_type), allocatable :: error
      real(wp), dimension(size(constraints), size(constraints)) :: factor, matrix
      real(wp) :: right(size(constraints), 1)
      integer :: i

      matrix = matmul(jacobian, matmul(metric, transpose(jacobian)))
      right(:, 1) = matmul(jacobian, matmul(metric, gradient)) + constraints
      change = 0.0_wp
      multipliers = 0.0_wp
      factor = matrix
      call solve_positive_definite(factor, right, error)   ! leaves its Cholesky factor
      is_regular = .not. allocated(error)
      if (is_regular) &
         is_regular = all([(factor(i, i)**2 > epsilon(1.0_wp)*matrix(i, i), i=1, size(right))])
      if (.not. is_regular) return
      multipliers = right(:, 1)
      change = matmul(metric, gradient - matmul(multipliers, jacobian))
   end subroutine step_to_maximum

   !> Part of the gradient orthogonal to the gradients of the constraints; all of it if these are
   !> linearly dependent.
   function projected_gradient(gradient, jacobian) result(rest)
      real(wp), intent(in) :: gradient(:), jacobian(:, :)
      real(wp) :: rest(size(gradient))
      real(wp) :: change(size(gradient)), multipliers(size(jacobian, 1)), zero(size(jacobian, 1))
      integer :: pass
      logical :: is_regular

      rest = gradient
      zero = 0.0_wp
      do pass = 1, 2   ! the second removes the rounding error of the first
         call step_to_maximum(unit_matrix(size(rest)), jacobian, rest, zero, change, multipliers, &
                              is_regular)
         if (is_regular) rest = change
      end do
   end function projected_gradient

   !> Updates the inverse Hessian by BFGS; a pair without positive curvature is skipped.
   pure subroutine update_metric(change, curvature, metric)
      real(wp), intent(in) :: change(:), curvature(:)
      real(wp), intent(inout) :: metric(:, :)
      real(wp) :: image(size(change)), inner, scale
      integer :: i, j

      inner = dot_product(change, curvature)
      if (.not. inner > 1.0e-3_wp*norm2(change)*norm2(curvature)) return
      image = matmul(metric, curvature)
      scale = (1.0_wp + dot_product(curvature, image)/inner)/inner
      do j = 1, size(change)
         do i = 1, size(change)
            metric(i, j) = metric(i, j) + scale*change(i)*change(j) &
                           - (image(i)*change(j) + change(i)*image(j))/inner
         end do
      end do
   end subroutine update_metric

end module numerics_constrained_maximum
