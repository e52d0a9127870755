!> The maximum of the entropy for all signs plus where g nearly touches zero (Sec. 2.2).
!>
!> As L0 nears m_max, or L1 its own limit, g falls at t = 0 to g_0/1e8 and below: the last digit of
!> delta, or of a coefficient of g, then decides K(0). Two things hold what those do not: y in
!> delta = touching (1 - 1/y^2), touching the delta at which g(0) = 0; and the spectral factor B, as
!> B(1)^2 = g(0). The symbol and what B misses of it are computed in extended precision; all else
!> only corrects, in double.
module process_direct_touching_symbol
   use core_kinds, only: extended, wp
   use process_autoregressive_spectral_factor, only: change_of_factor, equivalent_process, &
      reciprocal_of_process
   implicit none(type, external)
   private
   public :: solve_touching

   real(wp), parameter :: first = 32.0_wp   !! y: double precision suffices here

contains

   !> Finds where sum a_m K(m) = 0, K(m) the Fourier coefficients of 1/g, g = 1 + delta sum a_m
   !> cos(mt). `is_solved` is false where g touches zero elsewhere first, or not even B holds it.
   subroutine solve_touching(weights, delta, factor, reciprocal, is_solved)
      real(wp), intent(in) :: weights(0:)       !! a_m, m = 0..m_max; their sum is negative
      real(wp), intent(out) :: delta
      real(wp), intent(out) :: factor(0:)       !! B
      real(wp), intent(out) :: reciprocal(0:)   !! K(m), m = 0..m_max
      logical, intent(out) :: is_solved
      integer, parameter :: max_steps = 60
      real(wp), parameter :: widest = 8.0_wp, settled = 1.0e-14_wp
      real(wp), parameter :: rounding = 1.0e-8_wp   ! of K(m), at most; more shows in the residual
      real(extended) :: fine(0:ubound(weights, 1)), symbol(0:ubound(weights, 1))
      real(wp), allocatable :: a(:)
      real(wp) :: b0, change, height, last_height, last_y, y
      integer :: step

      y = first
      symbol = symbol_at(weights, y)
      call equivalent_process(real(symbol, wp), a, b0, is_solved)
      if (.not. is_solved) return
      fine = [1.0_wp, a]/b0
      last_y = 0.0_wp
      last_height = 0.0_wp
      do step = 1, max_steps
         call refine_factor(symbol, fine, is_solved)
         if (.not. is_solved) return
         factor = real(fine, wp)
         call reciprocal_of_process(factor(1:)/factor(0), 1.0_wp/factor(0), reciprocal, is_solved)
         if (.not. is_solved) return
         ! nearly linear in y, all the way
         height = dot_product(weights, reciprocal)*real(symbol(0), wp)
         is_solved = abs(y - last_y) <= settled*y
         if (is_solved) exit
         change = y
         if (step > 1) change = 0.0_wp   ! where rounding is left: the same height twice
         if (step > 1 .and. abs(height - last_height) > 0.0_wp) &
            change = -height*(y - last_y)/(height - last_height)
         is_solved = .not. abs(change) > settled*y .or. &
                     step > 2 .and. abs(change) <= rounding*y .and. abs(height) >= abs(last_height)
         if (is_solved) exit
         last_y = y
         last_height = height
         y = min(max(y + change, 0.5_wp*(1.0_wp + y)), widest*y)
         symbol = symbol_at(weights, y)
      end do
      delta = (1.0_wp - 1.0_wp/y**2)/(-sum(weights))
   end subroutine solve_touching

   !> g_m, m = 0..m_max, whose sum g(0) is 1/y^2 to more than double precision.
   pure function symbol_at(weights, y) result(symbol)
      real(wp), intent(in) :: weights(0:)
      real(wp), intent(in) :: y
      real(extended) :: symbol(0:ubound(weights, 1))

      symbol = weights
      symbol = -(1 - 1/real(y, extended)**2)/sum(symbol)*symbol
      symbol(0) = symbol(0) + 1
      symbol(1:) = symbol(1:)/2
   end function symbol_at

   !> Corrects B by Newton's method, see `equivalent_process`, until a step changes B(1) by its
   !> rounding only.
   pure subroutine refine_factor(symbol, factor, is_positive)
      real(extended), intent(in) :: symbol(0:)
      real(extended), intent(inout) :: factor(0:)   !! a start with zeros inside the circle
      logical, intent(out) :: is_positive
      integer, parameter :: max_iterations = 80
      real(wp), parameter :: settled = 1.0e-13_wp
      real(extended) :: missing(0:ubound(symbol, 1))
      real(wp) :: b(0:ubound(symbol, 1)), reciprocal(0:2*ubound(symbol, 1)), &
         step(0:ubound(symbol, 1))
      real(wp) :: last_move, move
      integer :: iteration, j, order

      order = ubound(symbol, 1)
      move = huge(1.0_wp)
      do iteration = 1, max_iterations
         missing = symbol
         do j = 0, order
            missing(:order - j) = missing(:order - j) - factor(j)*factor(j:)
         end do
         b = real(factor, wp)
         call reciprocal_of_process(b(1:)/b(0), 1.0_wp/b(0), reciprocal, is_positive)
         if (.not. is_positive) return
         step = change_of_factor(b, reciprocal, real(missing, wp))
         factor = factor + step
         last_move = move
         move = abs(sum(step))/real(sum(factor), wp)
         if (move <= settled .or. move <= 1.0e-9_wp .and. move >= last_move) return
      end do
      is_positive = .false.
   end subroutine refine_factor

end module process_direct_touching_symbol
