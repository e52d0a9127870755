!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck sliders.
!>
!> Between transitions the chain is linear: M a + C v + K x changes in a step as the force does, and the
!> constant forces of sliding masses drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),   x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K this is, b the forced dof,
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K (v0 + h (1/2 - beta/gamma) a0)] - (1 - gamma)/gamma a0.
!> Short chains have this map in a table, by pattern and level. Longer ones have S^-1 of the stuck chain
!> by level, and the sliders that slip are a correction of low rank (Woodbury).
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_newmark_block, only: first_aligned, newmark_block, register_width
   use numerics_lapack, only: solve_positive_definite
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! of a table: the longest chain that has one

   type :: newmark_steps
      type(chain_type) :: chain
      integer :: forced_dof = 0
      integer :: max_halvings = 0
      real(wp) :: beta = 0.0_wp, gamma = 0.0_wp
      real(wp), allocatable :: size(:)            !! (level) h [s]
      real(wp), allocatable :: weight(:, :)       !! (6, level) of a0, a1 in v1; v0, a0, a1 in x1; dF
      real(wp), allocatable :: table(:)           !! (rows; dF, a0, v0; pattern; level) from first_entry
      integer :: first_entry = 1
      real(wp), allocatable :: inverse(:, :, :)   !! (n, n, level) S^-1 of the stuck chain, if no table
   contains
      procedure :: try
   end type newmark_steps

contains

   subroutine new_newmark_steps(chain, dt, max_halvings, beta, gamma, forced_dof, steps, error)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: dt
      integer, intent(in) :: max_halvings, forced_dof
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(out) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: h
      integer :: level

      steps%chain = chain
      steps%forced_dof = forced_dof
      steps%max_halvings = max_halvings
      steps%beta = beta
      steps%gamma = gamma
      allocate (steps%size(0:max_halvings), steps%weight(6, 0:max_halvings))
      do level = 0, max_halvings
         h = dt*0.5_wp**level
         steps%size(level) = h
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, &
                                   h, h**2*(0.5_wp - beta), h**2*beta, 0.5_wp**level]
      end do
      if (chain%n_dof <= rows) then
         call fill_table(steps, error)
      else
         call fill_inverse(steps, error)
      end if
   end subroutine new_newmark_steps

   !> Tries a step with each of the listed samples, at its own level. The new motion goes to the spare
   !> slot; has_passed is 1 where a slider is beyond its limit at the end of the step, else 0.
   subroutine try(self, sample, block, has_passed, error)
      class(newmark_steps), intent(in) :: self
      integer, intent(in) :: sample(:)               !! their numbers
      type(newmark_block), intent(inout) :: block
      integer(long), intent(out) :: has_passed(:)    !! (try)
      type(error_type), allocatable, intent(out) :: error
      integer :: k

      if (allocated(self%table)) then
         call try_by_table(block%n_dof, self%max_halvings, size(sample), sample, block%n_samples, &
                           block%tick, block%slot, block%level, block%pattern, block%column, &
                           ubound(block%force, 1), size(block%force, 2), block%force, self%weight, &
                           self%table(self%first_entry), block%motion, block%bounds, has_passed)
      else
         do k = 1, size(sample)
            call try_by_inverse(self, sample(k), block, has_passed(k), error)
            if (allocated(error)) return
         end do
      end if
   end subroutine try

   !> Every array has an explicit shape and whole registers: here the time is spent.
   pure subroutine try_by_table(n, max_halvings, n_tries, sample, n_samples, tick, slot, level, pattern, &
                                column, n_steps, n_columns, force, weight, table, motion, bounds, has_passed)
      integer, intent(in) :: n, max_halvings, n_tries, sample(n_tries), n_samples
      integer(long), intent(in) :: tick(n_samples)
      integer, intent(in) :: slot(n_samples), level(n_samples), pattern(n_samples), column(n_samples)
      integer, intent(in) :: n_steps, n_columns
      real(wp), intent(in) :: force(0:n_steps, n_columns)
      real(wp), intent(in) :: weight(6, 0:max_halvings)
      real(wp), intent(in) :: table(rows, 0:2*n, 0:2**n - 1, 0:max_halvings)
      real(wp), intent(inout) :: motion(rows, 3, 0:1, n_samples)
      real(wp), intent(in) :: bounds(rows, 3, n_samples)
      integer(long), intent(out) :: has_passed(n_tries)
      real(wp) :: a(rows), b(rows), change
      integer(long) :: passed
      integer :: i, j, k, l, old, p, step, w

      do k = 1, n_tries
         w = sample(k)
         l = level(w)
         p = pattern(w)
         old = slot(w)
         step = int(ishft(tick(w), -max_halvings))
         change = (force(step + 1, column(w)) - force(step, column(w)))*weight(6, l)
         !$omp simd
         do i = 1, rows
            a(i) = table(i, 0, p, l)*change
            b(i) = 0.0_wp
         end do
         do j = 1, n
            !$omp simd
            do i = 1, rows
               a(i) = a(i) + table(i, j, p, l)*motion(j, 1, old, w)
               b(i) = b(i) + table(i, n + j, p, l)*motion(j, 2, old, w)
            end do
         end do
         passed = 0_long
         !$omp simd reduction(ior:passed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1
               integer(long) :: is_out, is_back

               a0 = motion(i, 1, old, w)
               v0 = motion(i, 2, old, w)
               a1 = a(i) + b(i)
               v1 = v0 + weight(1, l)*a0 + weight(2, l)*a1
               x1 = motion(i, 3, old, w) + weight(3, l)*v0 + weight(4, l)*a0 + weight(5, l)*a1
               motion(i, 1, 1 - old, w) = a1
               motion(i, 2, 1 - old, w) = v1
               motion(i, 3, 1 - old, w) = x1
               is_out = merge(1_long, 0_long, abs(x1 - bounds(i, 1, w)) > bounds(i, 2, w))
               is_back = merge(1_long, 0_long, bounds(i, 3, w)*v1 < 0.0_wp)
               passed = ior(passed, ior(is_out, is_back))
            end block
         end do
         has_passed(k) = passed
      end do
   end subroutine try_by_table

   !> The same for one sample of a chain of any length.
   subroutine try_by_inverse(self, w, block, has_passed, error)
      class(newmark_steps), intent(in) :: self
      integer, intent(in) :: w
      type(newmark_block), intent(inout) :: block
      integer(long), intent(out) :: has_passed
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(block%n_dof) :: load, push, a1, v1, x1
      logical :: is_slipping(block%n_dof)
      integer :: j, l, n, step

      n = block%n_dof
      l = block%level(w)
      step = int(ishft(block%tick(w), -self%max_halvings))
      associate (h => self%size(l), weight => self%weight(:, l), inverse => self%inverse(:, :, l), &
                 k => self%chain%coupling, bounds => block%bounds(:n, :, w), &
                 a0 => block%motion(:n, 1, block%slot(w), w), v0 => block%motion(:n, 2, block%slot(w), w), &
                 x0 => block%motion(:n, 3, block%slot(w), w), next => block%motion(:n, :, 1 - block%slot(w), w))
         is_slipping = bounds(:, 2) >= huge(1.0_wp)
         push = h*(v0 + h*(0.5_wp - self%beta/self%gamma)*a0)
         load = self%chain%mass*a0/self%gamma - merge(0.0_wp, self%chain%contact_stiffness, is_slipping)*push
         do j = 1, n   ! the coupling is tridiagonal
            load(j) = load(j) - dot_product(k(max(j - 1, 1):min(j + 1, n), j), push(max(j - 1, 1):min(j + 1, n)))
         end do
         load(self%forced_dof) = load(self%forced_dof) + weight(6)* &
                                 (block%force(step + 1, block%column(w)) - block%force(step, block%column(w)))
         a1 = matmul(inverse, load)
         if (any(is_slipping) .and. self%beta > 0.0_wp) then
            call release(inverse, self%beta*h**2*self%chain%contact_stiffness, pack([(j, j=1, n)], is_slipping), &
                         a1, error)
            if (allocated(error)) return
         end if
         a1 = a1 - (1.0_wp - self%gamma)/self%gamma*a0
         v1 = v0 + weight(1)*a0 + weight(2)*a1
         x1 = x0 + weight(3)*v0 + weight(4)*a0 + weight(5)*a1
         next(:, 1) = a1
         next(:, 2) = v1
         next(:, 3) = x1
         has_passed = merge(1_long, 0_long, any(abs(x1 - bounds(:, 1)) > bounds(:, 2)) &
                            .or. any(bounds(:, 3)*v1 < 0.0_wp))
      end associate
   end subroutine try_by_inverse

   !> Woodbury: from u = S^-1 q of the stuck chain to that with the listed sliders slipping, whose
   !> stiffness is missing: u + A y, (D^-1 - A') y = u', A the columns of S^-1, ' its listed rows.
   subroutine release(inverse, stiffness, slipping, u, error)
      real(wp), intent(in) :: inverse(:, :)     !! (n, n)
      real(wp), intent(in) :: stiffness(:)      !! (n) D = beta h^2 k
      integer, intent(in) :: slipping(:)
      real(wp), intent(inout) :: u(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: small(size(slipping), size(slipping)), y(size(slipping), 1)
      integer :: i

      small = -inverse(slipping, slipping)
      do i = 1, size(slipping)
         small(i, i) = small(i, i) + 1.0_wp/stiffness(slipping(i))
      end do
      y(:, 1) = u(slipping)
      call solve_positive_definite(small, y, error)
      if (allocated(error)) return
      do i = 1, size(slipping)
         u = u + inverse(:, slipping(i))*y(i, 1)
      end do
   end subroutine release

   !> a1 from dF, a0 and v0, for all patterns and levels of a short chain; rows beyond n are zero.
   subroutine fill_table(self, error)
      type(newmark_steps), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      integer :: columns, i, level, n, next, pattern

      n = self%chain%n_dof
      columns = 2*n + 1
      allocate (self%table(rows*columns*2**n*(self%max_halvings + 1) + rows), source=0.0_wp)
      self%first_entry = first_aligned(self%table)
      next = self%first_entry
      do level = 0, self%max_halvings
         do pattern = 0, 2**n - 1
            call fill_entry(self, level, [(btest(pattern, i), i=0, n - 1)], &
                            self%table(next:next + rows*columns - 1), error)
            if (allocated(error)) return
            next = next + rows*columns
         end do
      end do
   end subroutine fill_table

   !> The map of one pattern and level: rows of register width, columns dF, a0 and v0.
   subroutine fill_entry(self, level, is_stuck, entry, error)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level
      logical, intent(in) :: is_stuck(:)
      real(wp), intent(inout) :: entry(rows, 0:2*size(is_stuck))
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(is_stuck), size(is_stuck)) :: inverse, stiffness, of_velocity
      integer :: i, n

      n = size(is_stuck)
      stiffness = self%chain%stiffness(is_stuck)
      call invert(self, level, stiffness, inverse, error)
      if (allocated(error)) return
      of_velocity = -self%size(level)*matmul(inverse, stiffness)
      entry(:n, 0) = inverse(:, self%forced_dof)
      entry(:n, n + 1:) = of_velocity
      entry(:n, 1:n) = self%size(level)*(0.5_wp - self%beta/self%gamma)*of_velocity
      do i = 1, n
         entry(:n, i) = entry(:n, i) + inverse(:, i)*self%chain%mass(i)/self%gamma
         entry(i, i) = entry(i, i) - (1.0_wp - self%gamma)/self%gamma
      end do
   end subroutine fill_entry

   subroutine fill_inverse(self, error)
      type(newmark_steps), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      logical :: is_stuck(self%chain%n_dof)
      integer :: level, n

      n = self%chain%n_dof
      is_stuck = .true.
      allocate (self%inverse(n, n, 0:self%max_halvings))
      do level = 0, self%max_halvings
         call invert(self, level, self%chain%stiffness(is_stuck), self%inverse(:, :, level), error)
         if (allocated(error)) return
      end do
   end subroutine fill_inverse

   !> S^-1 for one stiffness and level.
   subroutine invert(self, level, stiffness, inverse, error)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: stiffness(:, :)
      real(wp), intent(out) :: inverse(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(stiffness, 1), size(stiffness, 1)) :: s, unit
      integer :: i

      s = self%gamma*self%size(level)*self%chain%damping + self%beta*self%size(level)**2*stiffness
      unit = 0.0_wp
      do i = 1, size(s, 1)
         s(i, i) = s(i, i) + self%chain%mass(i)
         unit(i, i) = 1.0_wp
      end do
      call solve_positive_definite(s, unit, error)
      inverse = unit
   end subroutine invert

end module dynamics_newmark_steps
