!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck joints.
!>
!> Between transitions the structure is linear: M a + C v + K_s x changes in a step as the force
!> does, and the constant forces of slipping joints drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K_s this is
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K_s (v0 + h (1/2 - beta/gamma) a0)]
!>         - (1 - gamma)/gamma a0.
!> The three factors of a0, v0 and F1 - F0 stand in maps. Short frames have one for every pattern.
!> Long ones have that of all joints stuck, and take back what the springs of the slipping joints
!> gain in a step, g: their extension is x1 - x0 of the stuck structure and beta h^2 W' S^-1 W g,
!>    (1/k - beta h^2 W' S^-1 W) g = W' (x1 - x0),   a1 grows by S^-1 W g.
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory, register_width, whole_registers
   use dynamics_newmark_block, only: newmark_block, newmark_try
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_response, only: march_work
   use numerics_lapack, only: solve_positive_definite, unit_matrix
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! of a short frame
   integer, parameter :: narrow = 5              !! columns of one, up to the paper's chain; else 8

   !> Steps of all levels of halving.
   type :: newmark_steps
      type(newmark_frame) :: frame
      integer :: max_halvings = 0
      !> (6, level) of a0, a1 in v1; of v0 (so h), a0, a1 in x1; (1 - gamma)/gamma
      real(wp), allocatable :: weight(:, :)
      real(wp), allocatable :: share(:)           !! (level) h/dt
      !> a1 from a0 and v0 of the dofs and the changes of the forces (row, column, entry n_patterns
      !> level + pattern from 0); of long frames the rows of the dofs alone
      real(wp), pointer, contiguous :: map(:, :, :) => null()
      integer :: columns = narrow                 !! of each of the first two factors
      integer :: n_patterns = 1
      !> Long frames: (2, column, level) rows of the map that count, the same for four columns;
      !> S^-1 W (row, joint, level) and its rows that count; 1/k (joint)
      integer, allocatable :: span(:, :, :), gain_span(:, :, :)
      real(wp), allocatable :: gain(:, :, :), compliance(:)
      type(aligned_memory), private :: memory
   contains
      procedure :: try
      procedure :: work
   end type newmark_steps

contains

   !> Prepares the maps of all levels and, of a short frame, of all patterns.
   subroutine new_newmark_steps(frame, dt, max_halvings, beta, gamma, steps, error)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(out) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), stiffness(:, :)
      real(wp), pointer, contiguous :: planes(:, :, :)
      real(wp) :: h
      logical :: is_stuck(frame%structure%n_joints)
      integer :: entries, j, level, pattern

      steps%frame = frame
      steps%max_halvings = max_halvings
      allocate (steps%weight(6, 0:max_halvings))
      allocate (steps%share(0:max_halvings))
      steps%share = [(0.5_wp**level, level=0, max_halvings)]
      do level = 0, max_halvings
         h = dt*steps%share(level)
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma]
      end do
      steps%columns = merge(narrow, frame%n_padded, frame%is_short .and. frame%n_dof <= narrow)
      if (frame%is_short) steps%n_patterns = 2**frame%structure%n_joints
      entries = steps%n_patterns*(max_halvings + 1)
      associate (columns => 2*steps%columns + frame%structure%n_forces)
         call steps%memory%start(int(frame%n_padded, long)*columns*entries)
         call steps%memory%take([frame%n_padded, columns, entries], planes)
         steps%map(1:, 1:, 0:) => planes
      end associate
      if (.not. frame%is_short) then
         associate (joints => frame%structure%n_joints)
            allocate (steps%gain(frame%n_padded, joints, 0:max_halvings), source=0.0_wp)
            allocate (steps%gain_span(2, joints, 0:max_halvings))
            allocate (steps%span(2, 2*steps%columns, 0:max_halvings))
         end associate
         steps%compliance = 1.0_wp/frame%structure%joint_stiffness
      end if
      do pattern = 0, steps%n_patterns - 1
         is_stuck = [(btest(pattern, j - 1) .or. .not. frame%is_short, j=1, size(is_stuck))]
         stiffness = frame%structure%stuck_stiffness(is_stuck)
         do level = 0, max_halvings
            call inverse_of(frame%structure, stiffness, steps%weight(3, level), beta, gamma, &
                            inverse, error)
            if (allocated(error)) return
            call put_map(frame, stiffness, inverse, beta, gamma, steps%weight(:, level), &
                         steps%map(:, :, steps%n_patterns*level + pattern))
            if (.not. frame%is_short) call put_gain(frame, inverse, level, steps)
         end do
      end do
   end subroutine new_newmark_steps

   !> Finds S^-1 for one stiffness and length of step.
   subroutine inverse_of(structure, stiffness, h, beta, gamma, inverse, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: stiffness(:, :), h, beta, gamma
      real(wp), allocatable, intent(out) :: inverse(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: s(:, :)

      s = structure%mass + gamma*h*structure%damping + beta*h**2*stiffness
      allocate (inverse, source=unit_matrix(size(s, 1)))
      call solve_positive_definite(s, inverse, error)
   end subroutine inverse_of

   !> Puts the three factors of one pattern and level; what is not put stays zero.
   pure subroutine put_map(frame, stiffness, inverse, beta, gamma, weight, map)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in), dimension(:, :) :: stiffness, inverse   !! K of the pattern, S^-1
      real(wp), intent(in) :: beta, gamma, weight(6)
      real(wp), intent(inout) :: map(:, :)   !! (row, column)
      real(wp) :: full(frame%n_dof, size(map, 2))
      integer :: columns, i

      associate (structure => frame%structure, h => weight(3), n => frame%n_dof)
         columns = (size(map, 2) - structure%n_forces)/2
         full = 0.0_wp
         full(:, :n) = matmul(inverse, structure%mass/gamma &
                              - (h**2*(0.5_wp - beta/gamma))*stiffness)
         do i = 1, n
            full(i, i) = full(i, i) - weight(6)
         end do
         full(:, columns + 1:columns + n) = -h*matmul(inverse, stiffness)
         full(:, 2*columns + 1:) = matmul(inverse, structure%load)
         if (frame%is_short) then
            map(:frame%n_rows, :) = frame%rows_of(full)
         else
            map(:n, :) = full
         end if
      end associate
   end subroutine put_map

   !> Finds S^-1 W of one level, and the rows that count in it and in the map.
   pure subroutine put_gain(frame, inverse, level, steps)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: inverse(:, :)   !! S^-1
      integer, intent(in) :: level
      type(newmark_steps), intent(inout) :: steps
      real(wp) :: at_joints(frame%structure%n_joints), mobility(frame%n_rows), size_of(frame%n_dof)
      integer :: i, j

      associate (n => frame%n_dof, columns => steps%columns, gain => steps%gain(:, :, level), &
                 map => steps%map(:, :, level), span => steps%span(:, :, level))
         gain(:frame%n_rows, :) = frame%rows_of(matmul(inverse, frame%structure%direction))
         at_joints = [(gain(frame%row(j), j), j=1, size(at_joints))]
         mobility(:n) = [(inverse(i, i), i=1, n)]
         mobility(frame%row) = at_joints
         steps%gain_span(:, :, level) = span_of(gain(:frame%n_rows, :), mobility, at_joints)
         span(1, :) = huge(span)   ! none
         span(2, :) = 0
         size_of = [(abs(map(i, i)), i=1, n)]
         span(:, :n) = span_of(map(:n, :n), size_of*mobility(:n), size_of/mobility(:n))
         ! a = omega v counts beside of_v v, omega = sqrt(|of_v|/h)
         size_of = [(sqrt(abs(map(i, columns + i))/steps%weight(3, level)), i=1, n)]
         span(:, columns + 1:columns + n) = span_of(map(:n, columns + 1:columns + n), &
                                                    size_of*mobility(:n), size_of/mobility(:n))
         do j = 1, 2*columns, 4
            span(1, j:j + 3) = minval(span(1, j:j + 3))
            span(2, j:j + 3) = maxval(span(2, j:j + 3))
         end do
      end associate
   end subroutine put_gain

   !> From the first to the last row, in whole registers, in which a column counts; none where all
   !> is zero. What is left out changes no product beyond rounding, measured by the energy that S
   !> stands for.
   pure function span_of(matrix, of_row, of_column) result(span)
      real(wp), intent(in) :: matrix(:, :), of_row(:), of_column(:)   !! sizes, squared
      integer :: span(2, size(matrix, 2))
      real(wp) :: least
      integer :: i, j

      least = epsilon(1.0_wp)/size(matrix, 1)
      span(1, :) = huge(span)
      span(2, :) = 0
      do j = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (abs(matrix(i, j)) <= least*sqrt(of_row(i)*of_column(j))) cycle
            span(1, j) = min(span(1, j), i - modulo(i - 1, register_width))
            span(2, j) = whole_registers(i)
         end do
      end do
   end function span_of

   !> Work of a step of dt, in multiplications of the exact march. A transition is found and left by
   !> three tries for every two halvings, and made.
   pure type(march_work) function work(self)
      class(newmark_steps), intent(in) :: self
      real(wp), parameter :: of_switch = 1800.0_wp, of_try = 250.0_wp   ! that are no products
      real(wp), parameter :: of_release = 750.0_wp, of_row = 20.0_wp    ! of long frames
      real(wp), parameter :: narrower = 0.75_wp   ! products of all levels over those of the first

      work%step = of_try + size(self%map, 1)*size(self%map, 2)
      if (allocated(self%span)) &
         work%step = of_try + of_release + of_row*size(self%map, 1) &
                     + narrower*sum(max(0, self%span(2, :, 0) - self%span(1, :, 0) + 1))
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
      if (allocated(self%span)) then
         do k = 1, size(sample)
            associate (w => block%tries(k)%sample, old => block%tries(k)%slot)
               call try_long(self, block%tries(k)%level, block%change(k, :), &
                             block%bounds(:, :, w), block%motion(:, :, old, w), &
                             block%motion(:, :, 1 - old, w), block%list, block%factor, &
                             has_passed(w))
            end associate
         end do
      else
         call try_maps(size(sample), block%tries, self%weight, self%columns, self%map, &
                       block%change, block%bounds, block%motion, has_passed)
      end if
   end subroutine try

   !> Tries a step of a long frame: the map of all joints stuck, then the slipping ones let go.
   pure subroutine try_long(self, level, change, bounds, old, new, list, factor, has_passed)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: change(:)                        !! (force) [N]
      real(wp), intent(in), contiguous :: bounds(:, :), old(:, :)
      real(wp), intent(inout), contiguous :: new(:, :)
      integer, intent(inout), contiguous :: list(:)            !! room
      real(wp), intent(inout), contiguous :: factor(:, 0:)     !! room
      integer(long), intent(out) :: has_passed
      integer :: f, j, m, r

      associate (rows => size(new, 1), columns => self%columns)
         call multiply(rows, 2*columns, self%span(:, :, level), self%map(:, :, level), old, new)
         do f = 1, size(change)
            new(:, 1) = new(:, 1) + self%map(:, 2*columns + f, level)*change(f)
         end do
         do r = self%frame%n_dof + 1, self%frame%n_rows
            new(r, 1) = self%frame%rows%row_times(r, new(:, 1))
         end do
         m = 0
         do j = 1, size(factor, 1)   ! without a branch, for nobody can guess it
            list(m + 1) = j
            m = m + merge(0, 1, bounds(self%frame%row(j), 4) > 0.0_wp)
         end do
         if (m > 0) call release(self, level, list(:m), old, factor, new(:, 1))
         call end_try(rows, self%weight(:, level), bounds, old, new, has_passed)
      end associate
   end subroutine try_long

   !> Finds a = A f, four columns at a time.
   pure subroutine multiply(rows, n, span, matrix, f, a)
      integer, intent(in) :: rows, n, span(2, n)
      real(wp), intent(in) :: matrix(rows, n), f(n)
      real(wp), intent(inout) :: a(rows)
      integer :: i, j

      a = 0.0_wp
      do j = 1, n, 4
         do i = span(1, j), span(2, j)   ! the same for these four
            a(i) = a(i) + ((matrix(i, j)*f(j) + matrix(i, j + 1)*f(j + 1)) &
                           + (matrix(i, j + 2)*f(j + 2) + matrix(i, j + 3)*f(j + 3)))
         end do
      end do
   end subroutine multiply

   !> Lets the listed joints slip, a by a + S^-1 W g. By factors L D L' made here and not by LAPACK,
   !> whose calls cost more than these few rows.
   pure subroutine release(self, level, list, old, factor, a)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level, list(:)
      real(wp), intent(in), contiguous :: old(:, :)
      real(wp), intent(inout), contiguous :: factor(:, 0:), a(:)   !! factor: g in column 0
      real(wp) :: pivot, share
      integer :: i, j, k, m

      m = size(list)
      associate (weight => self%weight(:, level), gain => self%gain(:, :, level), &
                 span => self%gain_span(:, :, level), row => self%frame%row)
         do j = 1, m
            do i = j, m
               factor(i, j) = -weight(5)*gain(row(list(i)), list(j))
            end do
            factor(j, j) = factor(j, j) + self%compliance(list(j))
            factor(j, 0) = weight(3)*old(row(list(j)), 2) + weight(4)*old(row(list(j)), 1) &
                           + weight(5)*a(row(list(j)))
         end do
         do j = 1, m
            pivot = 1.0_wp/factor(j, j)
            do i = j + 1, m
               share = factor(i, j)*pivot
               do k = i, m
                  factor(k, i) = factor(k, i) - factor(k, j)*share
               end do
               factor(i, 0) = factor(i, 0) - factor(j, 0)*share
            end do
            factor(j, 0) = factor(j, 0)*pivot
            do k = j + 1, m
               factor(k, j) = factor(k, j)*pivot
            end do
         end do
         do j = m, 1, -1
            do i = j + 1, m
               factor(j, 0) = factor(j, 0) - factor(i, j)*factor(i, 0)
            end do
            do i = span(1, list(j)), span(2, list(j))
               a(i) = a(i) + gain(i, list(j))*factor(j, 0)
            end do
         end do
      end associate
   end subroutine release

   !> Finds v1 and x1 from a1, and if a joint is beyond its limit.
   pure subroutine end_try(n, weight, bounds, old, new, has_passed)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight(6), bounds(n, 4), old(n, 3)
      real(wp), intent(inout) :: new(n, 3)
      integer(long), intent(out) :: has_passed
      integer :: i

      has_passed = 0_long
      !$omp simd reduction(ior:has_passed)
      do i = 1, n
         new(i, 2) = old(i, 2) + weight(1)*old(i, 1) + weight(2)*new(i, 1)
         new(i, 3) = old(i, 3) + weight(3)*old(i, 2) + weight(4)*old(i, 1) + weight(5)*new(i, 1)
         has_passed = ior(has_passed, is_beyond(bounds(i, 1), bounds(i, 2), bounds(i, 3), &
                                                new(i, 2), new(i, 3)))
      end do
   end subroutine end_try

   !> 1 if the joint of a row is beyond its limit: too far from its slider, or moving back.
   pure integer(long) function is_beyond(slider, reach, way, velocity, place)
      real(wp), intent(in) :: slider, reach, way, velocity, place

      is_beyond = ior(merge(1_long, 0_long, abs(place - slider) > reach), &
                      merge(1_long, 0_long, way*velocity < 0.0_wp))
   end function is_beyond

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

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = a(i) + more(i)
               v1 = v0 + weight(1, l)*a0 + weight(2, l)*a1
               x1 = motion(2*rows + i, old, w) + weight(3, l)*v0 + weight(4, l)*a0 + weight(5, l)*a1
               motion(i, new, w) = a1
               motion(rows + i, new, w) = v1
               motion(2*rows + i, new, w) = x1
               passed = ior(passed, is_beyond(bounds(i, 1, w), bounds(i, 2, w), bounds(i, 3, w), &
                                              v1, x1))
            end block
         end do
         has_passed(w) = passed
      end do
   end subroutine try_maps

end module dynamics_newmark_steps
