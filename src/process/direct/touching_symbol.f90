!> Maximum of the entropy for all signs +, if the symbol g nearly touches zero (Sec. 2.2).
!>
!> As L0 approaches m_max, or L1 its limit, g(0) falls below 1e-8 g_0, and K(0) depends on the last
!> digits of delta and of the g_m. So the unknown is y in delta = delta_0 (1 - 1/y^2), with
!> g(0) = 0 at delta_0, and g is represented by its spectral factor B, B(1)^2 = g(0). The symbol and
!> its difference from |B|^2 are computed in extended precision, corrections in double precision.
module process_direct_touching_symbol
   use core_kinds, only: extended, wp
   use process_autoregressive_spectral_factor, only: change_of_factor, equivalent_process, &
                                                     reciprocal_of_process
   implicit none(type, external)
   private
   public :: solve_touching

   real(wp), parameter :: first = 32.0_wp   !! first y, where double precision is enough

contains

   !> Finds the delta at which sum a_m K(m) = 0, K(m) the Fourier coefficients of 1/g,
   !> g = 1 + delta sum a_m cos(mt). There is no solution if g touches zero elsewhere before, or to
   !> the precision of B.
   subroutine solve_touching(weights, delta, factor, reciprocal, is_solved)
      real(wp), intent(in) :: weights(0:)       !! a_m, m = 0..m_max; their sum is negative
      real(wp), intent(out) :: delta
      real(wp), intent(out) :: factor(0:)       !! B
      real(wp), intent(out) :: reciprocal(0:)   !! K(m), m = 0..m_max
      logical, intent(out) :: is_solved
      integer, parameter :: max_steps = 60
      real(wp), parameter :: widest = 8.0_wp, settled = 1.0e-14_wp
      real(wp), parameter :: rounding = 1.0e-8_wp   ! largest error of K(m)
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
         ! nearly linear in y
         height = dot_product(weights, reciprocal)*real(symbol(0), wp)
         is_solved = abs(y - last_y) <= settled*y
         if (is_solved) exit
         change = y
         if (step > 1) change = 0.0_wp   ! if the height is the same twice, by rounding
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

   !> Symbol g_m, m = 0..m_max, with g(0) = 1/y^2 to more than double precision.
   pure function symbol_at(weights, y) result(symbol)
      real(wp), intent(in) :: weights(0:)
      real(wp), intent(in) :: y
      real(extended) :: symbol(0:ubound(weights, 1))

      symbol = weights
      symbol = -(1 - 1/real(y, extended)**2)/sum(symbol)*symbol
      symbol(0) = symbol(0) + 1
      symbol(1:) = symbol(1:)/2
   end function symbol_at

   !> Corrects B by Newton's method, as `equivalent_process`, until a step changes B(1) by rounding
   !> alone.
   pure subroutine refine_factor(symbol, factor, is_positive)
      real(extended), intent(in) :: symbol(0:)
      real(extended), intent(inout) :: factor(0:)   !! start, with zeros inside the circle
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
