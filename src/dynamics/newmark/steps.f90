!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck joints.
!>
!> Between transitions the structure is linear: M a + C v + K_s x changes in a step as the force
!> does, and the constant forces of slipping joints drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K_s this is
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K_s (v0 + h (1/2 - beta/gamma) a0)]
!>         - (1 - gamma)/gamma a0.
!> Short frames have S^-1 M in tables, by pattern and level; with beta = gamma/2, as by default.
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory, register_width
   use dynamics_newmark_block, only: newmark_block, newmark_try
   use dynamics_newmark_diagonals, only: diagonal_matrix, diagonals_of
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_newmark_woodbury, only: inverse_of, new_newmark_system, newmark_system, &
                                        try_woodbury
   use dynamics_response, only: march_work
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! of a table
   integer, parameter :: narrow = 5              !! columns of one, up to the paper's chain; else 8

   !> Tables of steps, by level of halving and pattern of stuck joints.
   type :: newmark_steps
      integer :: max_halvings = 0
      real(wp) :: beta = 0.0_wp, gamma = 0.0_wp
      !> (6, level) of a0, a1 in v1; of v0 (so h), a0, a1 in x1; (1 - gamma)/gamma
      real(wp), allocatable :: weight(:, :)
      real(wp), allocatable :: share(:)           !! (level) h/dt
      !> S^-1 M (row, column, entry 2^joints level + pattern), M^-1 b (row, force, 1), and the
      !> diagonals (row, 1:4, group) of M^-1 [K W], of 16 columns
      real(wp), pointer, contiguous :: solution(:, :, :) => null(), load(:, :, :) => null(), &
                                       diagonals(:, :, :) => null()
      integer, allocatable :: offset(:, :)        !! (1:4, group) column less row of a diagonal
      integer :: n_patterns = 1
      type(aligned_memory), private :: memory
      type(newmark_system), allocatable :: system !! where there are no tables
   contains
      procedure :: try
      procedure :: work
   end type newmark_steps

contains

   !> Prepares tables for short frames and average acceleration, else the system of all structures.
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
      allocate (steps%weight(6, 0:max_halvings))
      allocate (steps%share(0:max_halvings))
      steps%share = [(0.5_wp**level, level=0, max_halvings)]
      do level = 0, max_halvings
         h = dt*steps%share(level)
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma]
      end do
      if (frame%is_short .and. .not. abs(beta - 0.5_wp*gamma) > 0.0_wp) then
         call fill_tables(steps, frame, error)
      else
         allocate (steps%system)
         call new_newmark_system(frame%structure, steps%weight, beta, gamma, steps%system, error)
      end if
   end subroutine new_newmark_steps

   !> Fills tables of all patterns and levels of a short frame; what is beyond n is zero.
   subroutine fill_tables(self, frame, error)
      type(newmark_steps), intent(inout) :: self
      type(newmark_frame), intent(in) :: frame
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), stiffness(:, :)
      integer :: columns, j, level, n, pattern

      associate (structure => frame%structure)
         n = structure%n_dof
         columns = merge(narrow, rows, n <= narrow)
         self%n_patterns = 2**structure%n_joints
         call fill_diagonals(self, frame, rows*(columns*self%n_patterns*(self%max_halvings + 1) &
                                                + structure%n_forces))
         call self%memory%take([rows, columns, self%n_patterns*(self%max_halvings + 1)], &
                               self%solution)
         call self%memory%take([rows, structure%n_forces, 1], self%load)
         self%load(:n, :, 1) = matmul(frame%inverse_mass, structure%load)
         do pattern = 0, self%n_patterns - 1
            stiffness = structure%stuck_stiffness([(btest(pattern, j), &
                                                    j=0, structure%n_joints - 1)])
            do level = 0, self%max_halvings
               call inverse_of(structure, stiffness, self%weight(3, level), self%beta, self%gamma, &
                               inverse, error)
               if (allocated(error)) return
               self%solution(:n, :n, self%n_patterns*level + pattern + 1) = &
                  matmul(inverse, structure%mass)
            end do
         end do
      end associate
   end subroutine fill_tables

   !> Fills in the diagonals of M^-1 [K W], four to a group; allocates so many reals more.
   subroutine fill_diagonals(self, frame, more)
      type(newmark_steps), intent(inout) :: self
      type(newmark_frame), intent(in) :: frame
      integer, intent(in) :: more
      type(diagonal_matrix) :: matrix
      real(wp) :: full(rows, 2*rows)
      integer :: d, n

      n = frame%structure%n_dof
      full = 0.0_wp
      full(:n, :n) = matmul(frame%inverse_mass, frame%structure%stiffness)
      full(:n, rows + 1:rows + frame%structure%n_joints) = frame%kick
      call diagonals_of(full, matrix)
      associate (groups => (matrix%n_diagonals + 3)/4)
         call self%memory%start(more + rows*4*groups)
         call self%memory%take([rows, 4, groups], self%diagonals)
         allocate (self%offset(4, groups), source=0)
      end associate
      do d = 0, matrix%n_diagonals - 1
         self%offset(modulo(d, 4) + 1, d/4 + 1) = matrix%offset(d + 1)
         self%diagonals(:, modulo(d, 4) + 1, d/4 + 1) = matrix%value(:, d + 1)
      end do
   end subroutine fill_diagonals

   !> Work of a step of dt, in multiplications of the exact march. A transition is found and left by
   !> three tries for every two halvings, and made.
   pure type(march_work) function work(self)
      class(newmark_steps), intent(in) :: self
      real(wp), parameter :: of_switch = 1800.0_wp, of_try = 160.0_wp   ! that are no products

      if (allocated(self%system)) then
         work%step = self%system%work()
      else
         work%step = of_try + rows*(13 + 4*size(self%offset, 2) + size(self%solution, 2))
      end if
      work%transition = (1.0_wp + 1.5_wp*self%max_halvings)*work%step + of_switch
   end function work

   !> Tries a step with each of the listed samples, at its own level. The new motion goes to the
   !> spare slot; has_passed is 1 where a joint is beyond its limit at the end of the step, else 0.
   pure subroutine try(self, sample, block, has_passed)
      class(newmark_steps), intent(in) :: self
      integer, intent(in), contiguous :: sample(:)               !! their numbers
      type(newmark_block), intent(inout) :: block
      integer(long), intent(inout), contiguous :: has_passed(:)  !! (all samples) for those listed
      integer :: f, k

      call list_tries(size(sample), sample, self%max_halvings, self%n_patterns, block%ticks, &
                      block%slot, block%pattern, block%tries)
      do f = 1, block%n_forces
         call find_changes(size(sample), block%tries, self%max_halvings, block%tick, block%column, &
                           self%share, ubound(block%force, 1), block%force(0, f), &
                           block%change(1, f))
      end do
      if (allocated(self%system)) then
         do k = 1, size(sample)
            call try_woodbury(self%system, k, block, has_passed(sample(k)))
         end do
      else
         associate (n => size(sample))
            call begin_loads(n, block%tries, self%weight, block%bounds, block%motion, self%load, &
                             block%change, block%stack, block%loads)
            call add_springs(n, size(self%offset, 2), self%offset, self%diagonals, &
                             block%stack, block%loads)
            if (block%n_forces > 1) call add_forces(n, block%n_forces, self%load, block%change, &
                                                    block%loads)
            call finish_tries(n, block%tries, self%weight, size(self%solution, 2), self%solution, &
                              block%bounds, block%loads, block%motion, has_passed)
         end associate
      end if
   end subroutine try

   !> Lists what the tries depend on. Arrays of an explicit shape keep their addresses in registers.
   pure subroutine list_tries(n_tries, sample, max_halvings, n_patterns, ticks, slot, pattern, &
                              tries)
      integer, intent(in) :: n_tries, sample(n_tries), max_halvings, n_patterns
      integer(long), intent(in) :: ticks(*), slot(*)   !! (sample)
      integer, intent(in) :: pattern(*)                !! (sample)
      type(newmark_try), intent(inout) :: tries(n_tries)   !! written only
      integer :: k, l, w

      do k = 1, n_tries
         w = sample(k)
         l = max_halvings - trailz(ticks(w))
         tries(k)%sample = w
         tries(k)%slot = int(slot(w))
         tries(k)%level = l
         tries(k)%entry = n_patterns*l + pattern(w)
      end do
   end subroutine list_tries

   !> Finds how much a force changes in each try.
   pure subroutine find_changes(n_tries, tries, max_halvings, tick, column, share, n_steps, &
                                force, change)
      integer, intent(in) :: n_tries
      type(newmark_try), intent(in) :: tries(n_tries)
      integer, intent(in) :: max_halvings, n_steps
      integer(long), intent(in) :: tick(*)          !! (sample)
      integer, intent(in) :: column(*)              !! (sample) before its own
      real(wp), intent(in) :: share(0:*)            !! (level)
      real(wp), intent(in) :: force(0:n_steps, *)   !! (step, column) [N]
      real(wp), intent(out) :: change(n_tries)
      integer :: c, k, step, w

      do k = 1, n_tries
         w = tries(k)%sample
         c = column(w) + 1
         step = int(shiftr(tick(w), max_halvings))
         change(k) = share(tries(k)%level)*(force(step + 1, c) - force(step, c))
      end do
   end subroutine find_changes

   !> Begins the tries of short frames. They go in passes over the samples, so that the operations
   !> of one wait for each other while those of the next proceed. Every array has an explicit shape
   !> and is whole registers long: here the time is spent. Rows of the motion: a 1..8, v 9..16, x
   !> 17..24.
   !>
   !> First -h v0, which is -h w.v0 in its first rows, and the same times the stiffness of the stuck
   !> joints; a0/gamma and M^-1 b dF of the first force begin what S^-1 M is applied to.
   pure subroutine begin_loads(n_tries, tries, weight, bounds, motion, load, change, stack, loads)
      integer, intent(in) :: n_tries
      type(newmark_try), intent(in) :: tries(n_tries)
      real(wp), intent(in) :: weight(6, 0:*), bounds(rows, 4, *)
      real(wp), intent(in) :: motion(3*rows, 0:1, *), load(rows)
      real(wp), intent(in) :: change(n_tries)
      real(wp), intent(inout) :: stack(4*rows, n_tries)   !! 8 zeros, -h v0, -h k w.v0, 8 zeros
      real(wp), intent(out) :: loads(rows, n_tries)
      real(wp) :: h
      integer :: i, k, s, w

      do k = 1, n_tries
         s = tries(k)%slot
         w = tries(k)%sample
         h = weight(3, tries(k)%level)
         !$omp simd
         do i = 1, rows
            stack(rows + i, k) = -h*motion(rows + i, s, w)
            stack(2*rows + i, k) = bounds(i, 4, w)*(-h*motion(rows + i, s, w))
            loads(i, k) = (1.0_wp + weight(6, 0))*motion(i, s, w) + load(i)*change(k)
         end do
      end do
   end subroutine begin_loads

   !> Adds -h M^-1 K_s v0.
   pure subroutine add_springs(n_tries, n_groups, offset, diagonals, stack, loads)
      integer, intent(in) :: n_tries, n_groups, offset(4, n_groups)
      real(wp), intent(in) :: diagonals(rows, 4, n_groups), stack(4*rows, n_tries)
      real(wp), intent(inout) :: loads(rows, n_tries)
      integer :: g, i, k, o1, o2, o3, o4

      do g = 1, n_groups
         o1 = rows + offset(1, g)
         o2 = rows + offset(2, g)
         o3 = rows + offset(3, g)
         o4 = rows + offset(4, g)
         do k = 1, n_tries
            !$omp simd
            do i = 1, rows
               loads(i, k) = loads(i, k) + ((diagonals(i, 1, g)*stack(i + o1, k) &
                                             + diagonals(i, 2, g)*stack(i + o2, k)) &
                                            + (diagonals(i, 3, g)*stack(i + o3, k) &
                                               + diagonals(i, 4, g)*stack(i + o4, k)))
            end do
         end do
      end do
   end subroutine add_springs

   !> Adds M^-1 b dF of other forces.
   pure subroutine add_forces(n_tries, n_forces, load, change, loads)
      integer, intent(in) :: n_tries, n_forces
      real(wp), intent(in) :: load(rows, n_forces), change(:, :)
      real(wp), intent(inout) :: loads(rows, n_tries)
      integer :: f, i, k

      do f = 2, n_forces
         do k = 1, n_tries
            !$omp simd
            do i = 1, rows
               loads(i, k) = loads(i, k) + load(i, f)*change(k, f)
            end do
         end do
      end do
   end subroutine add_forces

   !> Finds last a1 = S^-1 M load - share a0, share = (1 - gamma)/gamma, v1 and x1, and whether a
   !> joint has passed its limit.
   pure subroutine finish_tries(n_tries, tries, weight, columns, solution, bounds, loads, motion, &
                                has_passed)
      integer, intent(in) :: n_tries, columns
      type(newmark_try), intent(in) :: tries(n_tries)
      real(wp), intent(in) :: weight(6, 0:*), solution(rows, columns, 0:*)
      real(wp), intent(in) :: bounds(rows, 4, *), loads(rows, n_tries)
      real(wp), intent(inout) :: motion(3*rows, 0:1, *)
      integer(long), intent(inout) :: has_passed(*)
      real(wp) :: a(rows)
      integer(long) :: passed
      integer :: e, i, k, l, new, old, w

      do k = 1, n_tries
         e = tries(k)%entry
         l = tries(k)%level
         w = tries(k)%sample
         old = tries(k)%slot
         new = 1 - old
         passed = 0_long
         !$omp simd
         do i = 1, rows
            a(i) = ((solution(i, 1, e)*loads(1, k) + solution(i, 2, e)*loads(2, k)) &
                    + (solution(i, 3, e)*loads(3, k) + solution(i, 4, e)*loads(4, k))) &
                   + solution(i, 5, e)*loads(5, k)
         end do
         if (columns > narrow) then
            !$omp simd
            do i = 1, rows
               a(i) = a(i) + ((solution(i, 6, e)*loads(6, k) + solution(i, 7, e)*loads(7, k)) &
                              + solution(i, 8, e)*loads(8, k))
            end do
         end if
         !$omp simd reduction(ior:passed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1
               integer(long) :: is_out, is_back

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = a(i) - weight(6, l)*a0
               v1 = v0 + weight(1, l)*a0 + weight(2, l)*a1
               x1 = motion(2*rows + i, old, w) + weight(3, l)*v0 + weight(4, l)*a0 + weight(5, l)*a1
               motion(i, new, w) = a1
               motion(rows + i, new, w) = v1
               motion(2*rows + i, new, w) = x1
               is_out = merge(1_long, 0_long, abs(x1 - bounds(i, 1, w)) > bounds(i, 2, w))
               is_back = merge(1_long, 0_long, bounds(i, 3, w)*v1 < 0.0_wp)
               passed = ior(passed, ior(is_out, is_back))
            end block
         end do
         has_passed(w) = passed
      end do
   end subroutine finish_tries

end module dynamics_newmark_steps
