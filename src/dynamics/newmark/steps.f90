!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck joints.
!>
!> Between transitions the structure is linear: M a + C v + K_s x changes in a step as the force
!> does, and the constant forces of slipping joints drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K_s this is
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K_s (v0 + h (1/2 - beta/gamma) a0)]
!>         - (1 - gamma)/gamma a0.
!> Short frames have the three factors of a0, v0 and F1 - F0 in tables, by pattern and level.
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory, register_width
   use dynamics_newmark_block, only: newmark_block, newmark_try
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_newmark_woodbury, only: inverse_of, new_newmark_system, newmark_system, &
                                        try_woodbury
   use dynamics_response, only: march_work
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! of a table
   integer, parameter :: narrow = 5              !! columns of one, up to the paper's chain; else 8

   !> Steps of all levels of halving; of a short frame tables, by level and pattern of stuck joints.
   type :: newmark_steps
      integer :: max_halvings = 0
      !> (6, level) of a0, a1 in v1; of v0 (so h), a0, a1 in x1; (1 - gamma)/gamma
      real(wp), allocatable :: weight(:, :)
      real(wp), allocatable :: share(:)           !! (level) h/dt
      !> a1 from a0, v0 and the changes of the forces (row, column, entry 2^joints level + pattern)
      real(wp), pointer, contiguous :: map(:, :, :) => null()
      integer :: columns = narrow                 !! of each of the first two factors
      integer :: n_patterns = 1
      type(aligned_memory), private :: memory
      type(newmark_system), allocatable :: system !! where there are no tables
   contains
      procedure :: try
      procedure :: work
   end type newmark_steps

contains

   !> Prepares tables for short frames, else the system of all structures.
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
      allocate (steps%weight(6, 0:max_halvings))
      allocate (steps%share(0:max_halvings))
      steps%share = [(0.5_wp**level, level=0, max_halvings)]
      do level = 0, max_halvings
         h = dt*steps%share(level)
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma]
      end do
      if (frame%is_short) then
         call fill_tables(steps, frame%structure, beta, gamma, error)
      else
         allocate (steps%system)
         call new_newmark_system(frame%structure, steps%weight, beta, gamma, steps%system, error)
      end if
   end subroutine new_newmark_steps

   !> Fills tables of all patterns and levels of a short frame; rows beyond n are zero.
   subroutine fill_tables(self, structure, beta, gamma, error)
      type(newmark_steps), intent(inout) :: self
      type(structure_type), intent(in) :: structure   !! of the frame
      real(wp), intent(in) :: beta, gamma
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), stiffness(:, :)
      integer :: entries, i, j, level, n, pattern

      n = structure%n_dof
      self%n_patterns = 2**structure%n_joints
      entries = self%n_patterns*(self%max_halvings + 1)
      self%columns = merge(narrow, rows, n <= narrow)
      call self%memory%start(rows*(2*self%columns + structure%n_forces)*entries)
      call self%memory%take([rows, 2*self%columns + structure%n_forces, entries], self%map)
      do pattern = 0, self%n_patterns - 1
         stiffness = structure%stuck_stiffness([(btest(pattern, j), j=0, structure%n_joints - 1)])
         do level = 0, self%max_halvings
            associate (h => self%weight(3, level), columns => self%columns, &
                       map => self%map(:n, :, self%n_patterns*level + pattern + 1))
               call inverse_of(structure, stiffness, h, beta, gamma, inverse, error)
               if (allocated(error)) return
               map(:, :n) = matmul(inverse, structure%mass/gamma &
                                   - (h**2*(0.5_wp - beta/gamma))*stiffness)
               do i = 1, n
                  map(i, i) = map(i, i) - self%weight(6, level)
               end do
               map(:, columns + 1:columns + n) = -h*matmul(inverse, stiffness)
               map(:, 2*columns + 1:) = matmul(inverse, structure%load)
            end associate
         end do
      end do
   end subroutine fill_tables

   !> Work of a step of dt, in multiplications of the exact march. A transition is found and left by
   !> three tries for every two halvings, and made.
   pure type(march_work) function work(self)
      class(newmark_steps), intent(in) :: self
      real(wp), parameter :: of_switch = 1800.0_wp, of_try = 250.0_wp   ! that are no products

      if (allocated(self%system)) then
         work%step = self%system%work()
      else
         work%step = of_try + rows*size(self%map, 2)
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
         call try_maps(size(sample), block%tries, self%weight, self%columns, self%map, &
                       block%change, block%bounds, block%motion, has_passed)
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

   !> Tries the steps of short frames: a1 by the tables, v1 and x1, and whether a joint has passed
   !> its limit. Every array has an explicit shape and is whole registers long: here the time is
   !> spent. Rows of the motion: a 1..8, v 9..16, x 17..24.
   pure subroutine try_maps(n_tries, tries, weight, columns, map, change, bounds, motion, &
                            has_passed)
      integer, intent(in) :: n_tries, columns
      type(newmark_try), intent(in) :: tries(n_tries)
      real(wp), intent(in) :: weight(6, 0:*), change(:, :)   !! change (try, force)
      real(wp), intent(in) :: map(rows, 2*columns + size(change, 2), 0:*), bounds(rows, 4, *)
      real(wp), intent(inout) :: motion(3*rows, 0:1, *)
      integer(long), intent(inout) :: has_passed(*)
      real(wp) :: a(rows), more(rows)
      integer(long) :: passed
      integer :: e, i, j, k, l, new, old, w

      do k = 1, n_tries
         e = tries(k)%entry
         l = tries(k)%level
         w = tries(k)%sample
         old = tries(k)%slot
         new = 1 - old
         !$omp simd
         do i = 1, rows
            a(i) = ((map(i, 1, e)*motion(1, old, w) + map(i, 2, e)*motion(2, old, w)) &
                    + (map(i, 3, e)*motion(3, old, w) + map(i, 4, e)*motion(4, old, w))) &
                   + map(i, 5, e)*motion(5, old, w)
            more(i) = ((map(i, columns + 1, e)*motion(rows + 1, old, w) &
                        + map(i, columns + 2, e)*motion(rows + 2, old, w)) &
                       + (map(i, columns + 3, e)*motion(rows + 3, old, w) &
                          + map(i, columns + 4, e)*motion(rows + 4, old, w))) &
                      + (map(i, columns + 5, e)*motion(rows + 5, old, w) &
                         + map(i, 2*columns + 1, e)*change(k, 1))
         end do
         if (columns > narrow) then
            !$omp simd
            do i = 1, rows
               a(i) = a(i) + ((map(i, 6, e)*motion(6, old, w) + map(i, 7, e)*motion(7, old, w)) &
                              + map(i, 8, e)*motion(8, old, w))
               more(i) = more(i) + ((map(i, 14, e)*motion(14, old, w) &
                                     + map(i, 15, e)*motion(15, old, w)) &
                                    + map(i, 16, e)*motion(16, old, w))
            end do
         end if
         do j = 2, size(change, 2)
            more = more + map(:, 2*columns + j, e)*change(k, j)
         end do
         passed = 0_long
         !$omp simd reduction(ior:passed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1
               integer(long) :: is_out, is_back

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = a(i) + more(i)
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
   end subroutine try_maps

end module dynamics_newmark_steps
