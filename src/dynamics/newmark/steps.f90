!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck sliders.
!>
!> Between transitions the chain is linear: M a + C v + K x changes in a step as the force does, and
!> the constant forces of sliding masses drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K this is, b the forced dof,
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K (v0 + h (1/2 - beta/gamma) a0)]
!>         - (1 - gamma)/gamma a0.
!> Short chains have S^-1 in a table, by pattern and level; with beta = gamma/2, as by default.
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_newmark_block, only: newmark_block
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_newmark_woodbury, only: inverse_of, new_newmark_system, newmark_system, &
                                        try_woodbury
   use dynamics_alignment, only: first_aligned, register_width
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! of a table: the longest chain that has one
   integer, parameter :: narrow = 5              !! columns of a table, up to the paper's chain

   !> Tables of steps, by level of halving and pattern of stuck sliders.
   type :: newmark_steps
      integer :: max_halvings = 0
      real(wp) :: beta = 0.0_wp, gamma = 0.0_wp
      real(wp), allocatable :: weight(:, :)       !! (5, level) see newmark_level
      real(wp), allocatable :: share(:)           !! (level) h/dt
      real(wp), allocatable :: rigid(:, :)        !! (rows, 5) b, M/gamma, K by diagonals
      real(wp), allocatable :: table(:)           !! (rows; columns; pattern; level)
      integer :: first_entry = 1                  !! of the table, where a cache line begins
      type(newmark_system), allocatable :: system !! where there are no tables
   contains
      procedure :: try
   end type newmark_steps

contains

   !> Tables for short rows of masses and average acceleration, else the system of all structures.
   subroutine new_newmark_steps(frame, dt, max_halvings, beta, gamma, steps, error)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(out) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: h
      integer :: level

      steps%max_halvings = max_halvings
      steps%beta = beta
      steps%gamma = gamma
      allocate (steps%weight(5, 0:max_halvings))
      allocate (steps%share(0:max_halvings))
      steps%share = [(0.5_wp**level, level=0, max_halvings)]
      do level = 0, max_halvings
         h = dt*steps%share(level)
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), h**2*beta]
      end do
      if (frame%is_row .and. frame%structure%n_dof <= rows .and. &
          .not. abs(beta - 0.5_wp*gamma) > 0.0_wp) then
         call note_rigid_part(steps, frame%structure)
         call fill_table(steps, frame%structure, error)
      else
         allocate (steps%system)
         call new_newmark_system(frame%structure, steps%weight, beta, gamma, steps%system, error)
      end if
   end subroutine new_newmark_steps

   !> Tries a step with each of the listed samples, at its own level. The new motion goes to the
   !> spare slot; has_passed is 1 where a slider is beyond its limit at the end of the step, else 0.
   pure subroutine try(self, sample, block, has_passed)
      class(newmark_steps), intent(in) :: self
      integer, intent(in) :: sample(:)               !! their numbers
      type(newmark_block), intent(inout) :: block
      integer(long), intent(inout) :: has_passed(:)  !! (all samples) set for those listed
      real(wp) :: load(rows, size(sample))
      integer :: k, w

      if (allocated(self%table)) then
         call form_loads(self, block, sample, block%motion, block%bounds, load)
         call solve_loads(self, block, sample, table_columns(block%n_dof), &
                          self%table(self%first_entry), load, block%motion)
         call finish_tries(self, block, sample, block%bounds, block%motion, has_passed)
      else
         do k = 1, size(sample)
            w = sample(k)
            call try_woodbury(self%system, level_of(self, block, w), block, w, has_passed(w))
         end do
      end if
   end subroutine try

   !> The level of halving of the step that a sample tries: h = dt/2^level.
   pure integer function level_of(self, block, w)
      type(newmark_steps), intent(in) :: self
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: w

      level_of = self%max_halvings - trailz(block%ticks(w))
   end function level_of

   !> The tries of short chains go in three passes over the samples, so that the operations of one
   !> wait for each other while those of the next proceed. Every array has an explicit shape and is
   !> whole registers long: here the time is spent. Rows of the motion: a 1..8, v 9..16, x 17..24.
   !>
   !> First what S^-1 is applied to, b dF + M a0/gamma - h K v0: with beta = gamma/2 that is all.
   pure subroutine form_loads(self, block, sample, motion, bounds, load)
      type(newmark_steps), intent(in) :: self
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: sample(:)
      real(wp), intent(in) :: motion(3*rows, 0:1, block%n_samples)
      real(wp), intent(in) :: bounds(rows, 4, block%n_samples)
      real(wp), intent(out) :: load(rows, size(sample))
      real(wp) :: change, h
      integer :: i, k, l, step, w

      do k = 1, size(sample)
         w = sample(k)
         l = level_of(self, block, w)
         step = int(shiftr(block%tick(w), self%max_halvings))
         associate (force => block%force(step:step + 1, block%column(w)))
            change = (force(2) - force(1))*self%share(l)
         end associate
         h = self%weight(3, l)
         associate (z => motion(:, :, w), s => block%slot(w) + 1, rigid => self%rigid)
            !$omp simd
            do i = 1, rows
               load(i, k) = rigid(i, 1)*change + rigid(i, 2)*z(i, s) &
                            - h*((rigid(i, 4) + bounds(i, 4, w))*z(rows + i, s) &
                                 + rigid(i, 3)*z(rows + i - 1, s) + rigid(i, 5)*z(rows + i + 1, s))
            end do
         end associate
      end do
   end subroutine form_loads

   !> Then a1 = S^-1 load - share a0, share = (1 - gamma)/gamma.
   pure subroutine solve_loads(self, block, sample, columns, table, load, motion)
      type(newmark_steps), intent(in) :: self
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: sample(:), columns
      real(wp), intent(in) :: table(rows, columns, 0:2**block%n_dof - 1, 0:self%max_halvings)
      real(wp), intent(in) :: load(rows, size(sample))
      real(wp), intent(inout) :: motion(3*rows, 0:1, block%n_samples)
      real(wp) :: share
      integer(long) :: old
      integer :: i, k, w

      share = (1.0_wp - self%gamma)/self%gamma
      do k = 1, size(sample)
         w = sample(k)
         old = block%slot(w)
         associate (t => table(:, :, block%pattern(w), level_of(self, block, w)), f => load(:, k))
            if (columns == narrow) then
               !$omp simd
               do i = 1, rows
                  motion(i, 1 - old, w) = (t(i, 1)*f(1) + t(i, 2)*f(2)) &
                                          + (t(i, 3)*f(3) + t(i, 4)*f(4)) &
                                          + t(i, 5)*f(5) - share*motion(i, old, w)
               end do
            else
               !$omp simd
               do i = 1, rows
                  motion(i, 1 - old, w) = ((t(i, 1)*f(1) + t(i, 2)*f(2)) &
                                           + (t(i, 3)*f(3) + t(i, 4)*f(4))) &
                                          + ((t(i, 5)*f(5) + t(i, 6)*f(6)) &
                                             + (t(i, 7)*f(7) + t(i, 8)*f(8))) &
                                          - share*motion(i, old, w)
               end do
            end if
         end associate
      end do
   end subroutine solve_loads

   !> Last v1 and x1, and whether a slider has passed its limit.
   pure subroutine finish_tries(self, block, sample, bounds, motion, has_passed)
      type(newmark_steps), intent(in) :: self
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: sample(:)
      real(wp), intent(in) :: bounds(rows, 4, block%n_samples)
      real(wp), intent(inout) :: motion(3*rows, 0:1, block%n_samples)
      integer(long), intent(inout) :: has_passed(:)
      real(wp) :: weight(5)
      integer(long) :: old, passed
      integer :: i, k, w

      do k = 1, size(sample)
         w = sample(k)
         weight = self%weight(:, level_of(self, block, w))
         old = block%slot(w)
         passed = 0_long
         !$omp simd reduction(ior:passed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1
               integer(long) :: is_out, is_back

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = motion(i, 1 - old, w)
               v1 = v0 + weight(1)*a0 + weight(2)*a1
               x1 = motion(2*rows + i, old, w) + weight(3)*v0 + weight(4)*a0 + weight(5)*a1
               motion(rows + i, 1 - old, w) = v1
               motion(2*rows + i, 1 - old, w) = x1
               is_out = merge(1_long, 0_long, abs(x1 - bounds(i, 1, w)) > bounds(i, 2, w))
               is_back = merge(1_long, 0_long, bounds(i, 3, w)*v1 < 0.0_wp)
               passed = ior(passed, ior(is_out, is_back))
            end block
         end do
         has_passed(w) = passed
      end do
   end subroutine finish_tries

   !> Notes the coefficients that do not depend on the sliders, in whole registers.
   pure subroutine note_rigid_part(self, structure)
      type(newmark_steps), intent(inout) :: self
      type(structure_type), intent(in) :: structure
      integer :: i, n

      n = structure%n_dof
      allocate (self%rigid(rows, 5), source=0.0_wp)
      self%rigid(:n, 1) = structure%load(:, 1)
      self%rigid(:n, 2) = structure%lumped_mass()/self%gamma
      do i = 1, n
         if (i > 1) self%rigid(i, 3) = structure%stiffness(i, i - 1)
         self%rigid(i, 4) = structure%stiffness(i, i)
         if (i < n) self%rigid(i, 5) = structure%stiffness(i, i + 1)
      end do
   end subroutine note_rigid_part

   !> S^-1 for all patterns and levels of a short row; what is beyond n is zero.
   subroutine fill_table(self, structure, error)
      type(newmark_steps), intent(inout) :: self
      type(structure_type), intent(in) :: structure
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :)
      integer :: columns, i, level, n, next, pattern

      n = structure%n_dof
      columns = table_columns(n)
      allocate (self%table(rows*columns*2**n*(self%max_halvings + 1) + rows), source=0.0_wp)
      self%first_entry = first_aligned(self%table)
      next = self%first_entry
      do level = 0, self%max_halvings
         do pattern = 0, 2**n - 1
            call inverse_of(structure, &
                            structure%stuck_stiffness([(btest(pattern, i), i=0, n - 1)]), &
                            self%weight(3, level), self%beta, self%gamma, inverse, error)
            if (allocated(error)) return
            do i = 1, n
               self%table(next:next + n - 1) = inverse(:, i)
               next = next + rows
            end do
            next = next + rows*(columns - n)
         end do
      end do
   end subroutine fill_table

   pure integer function table_columns(n)
      integer, intent(in) :: n

      table_columns = merge(narrow, rows, n <= narrow)
   end function table_columns

end module dynamics_newmark_steps
