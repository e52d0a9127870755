!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck joints.
!>
!> Between transitions the structure is linear: M a + C v + K_s x changes in a step as the force
!> does, and the constant forces of slipping joints drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K_s this is
!>    a1 = S^-1 p - (1 - gamma)/gamma a0,
!>    p = b (F1 - F0) + M a0/gamma - h K_s (v0 + h (1/2 - beta/gamma) a0).
!> Short frames have K_s and S^-1 for every pattern. Long frames have only those with all joints
!> stuck, and correct a1 by the Woodbury formula: g, the force that the springs of the slipping
!> joints would gain in the step, is taken back,
!>    (1/k - beta h^2 W' S^-1 W) g = W' (x1 - x0),   a1 grows by S^-1 W g.
!> All this is in Z S^-1 Z', because the paths W' x of the joints are among the rows Z x.
module dynamics_newmark_steps
   use core_alignment, only: aligned_memory, register_width, whole_registers
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_newmark_block, only: newmark_block, newmark_trial
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_response, only: march_work
   use numerics_lapack, only: solve_positive_definite, unit_matrix
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! rows of a short frame, and of a register
   integer, parameter :: narrow = 5      !! columns of up to 5 dofs; of more: whole registers
   integer, parameter :: n_weights = 8

   !> Matrices of all levels of halving. Rows are those of the frame, padded.
   type :: newmark_steps
      type(newmark_frame) :: frame
      integer :: max_halvings = 0
      integer :: columns = narrow         !! columns of S^-1
      integer :: n_patterns = 1
      logical :: is_lumped = .false.      !! True if M is diagonal
      !> Long frames have K_s and M by diagonals, that with offset k of the entries (i, 1 + modulo(i
      !> - 1 + k, n)); offsets of those that are not zero
      integer, allocatable :: stiffness_offset(:), mass_offset(:)
      !> (1:8, level) factors of a0, a1 in v1; of v0 (h), a0, a1 in x1; (1 - gamma)/gamma; h/dt; h
      !> (1/2 - beta/gamma)
      real(wp), allocatable :: weight(:, :)
      !> (row, column, entry) Z S^-1 of a short frame, Z S^-1 Z' of a long one; entry =
      !> (max_halvings + 1) pattern + level, from 0
      real(wp), pointer, contiguous :: inverse(:, :, :) => null()
      !> (row, column or diagonal, pattern from 1) K_s; (row, column or diagonal, 1) M/gamma without
      !> its diagonal; (row, :, 1) its diagonal, then b of each force
      real(wp), pointer, contiguous, dimension(:, :, :) :: stiffness => null(), mass => null(), &
                                                           diagonal => null()
      !> Long frames: first and last register of rows that are not negligible in four columns of
      !> Z S^-1 Z' (1:2, four, level)
      integer, allocatable :: span(:, :, :)
      real(wp), allocatable :: flexibility(:)   !! long frames: 1/k of the joint of a row [m/N]
      type(aligned_memory), private :: memory
   contains
      procedure :: try_steps
      procedure :: work
   end type newmark_steps

contains

   !> Prepares the matrices of all levels and, of a short frame, of all patterns.
   subroutine new_newmark_steps(frame, dt, max_halvings, beta, gamma, steps, error)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(out) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(frame%n_dof, frame%n_dof) :: coupled_mass, stiffness
      real(wp) :: h
      logical :: is_stuck(frame%structure%n_joints)
      integer :: i, j, level, pattern

      coupled_mass = frame%structure%mass/gamma
      do i = 1, frame%n_dof
         coupled_mass(i, i) = 0.0_wp
      end do
      steps%frame = frame
      steps%max_halvings = max_halvings
      steps%is_lumped = frame%structure%has_lumped_mass()
      allocate (steps%weight(n_weights, 0:max_halvings))
      do level = 0, max_halvings
         h = dt*0.5_wp**level
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma, 0.5_wp**level, &
                                   h*(0.5_wp - beta/gamma)]
      end do
      is_stuck = .true.
      stiffness = frame%structure%stuck_stiffness(is_stuck)
      steps%stiffness_offset = offsets_of(stiffness)
      steps%mass_offset = offsets_of(coupled_mass)
      call allocate_matrices(steps)
      associate (n => frame%n_dof, structure => frame%structure)
         steps%diagonal(:n, 1, 1) = [(structure%mass(i, i)/gamma, i=1, n)]
         steps%diagonal(:n, 2:, 1) = structure%load
         if (frame%is_short) then
            steps%mass(:n, :n, 1) = coupled_mass
         else
            call copy_diagonals(coupled_mass, steps%mass_offset, steps%mass(:, :, 1))
            call copy_diagonals(stiffness, steps%stiffness_offset, steps%stiffness(:, :, 1))
         end if
         do pattern = 0, steps%n_patterns - 1
            if (frame%is_short) then
               is_stuck = [(btest(pattern, j - 1), j=1, size(is_stuck))]
               stiffness = structure%stuck_stiffness(is_stuck)
               steps%stiffness(:n, :n, 1 + pattern) = stiffness
            end if
            do level = 0, max_halvings
               call form_inverse(stiffness, pattern, level, beta, gamma, steps, error)
               if (allocated(error)) return
            end do
         end do
      end associate
   end subroutine new_newmark_steps

   !> Offsets k of the diagonals (i, 1 + modulo(i - 1 + k, n)) that are not zero.
   pure function offsets_of(matrix) result(offsets)
      real(wp), intent(in) :: matrix(:, :)
      integer, allocatable :: offsets(:)
      logical :: has_entry(0:size(matrix, 1) - 1)
      integer :: i, j

      has_entry = .false.
      do j = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (abs(matrix(i, j)) > 0.0_wp) has_entry(modulo(j - i, size(has_entry))) = .true.
         end do
      end do
      offsets = pack([(i, i=0, ubound(has_entry, 1))], has_entry)
   end function offsets_of

   !> Copies the diagonals of a matrix with the listed offsets to columns.
   pure subroutine copy_diagonals(matrix, offsets, diagonals)
      real(wp), intent(in) :: matrix(:, :)
      integer, intent(in) :: offsets(:)
      real(wp), intent(inout) :: diagonals(:, :)   !! (row, diagonal)
      integer :: d, i

      do d = 1, size(offsets)
         do i = 1, size(matrix, 1)
            diagonals(i, d) = matrix(i, 1 + modulo(i - 1 + offsets(d), size(matrix, 1)))
         end do
      end do
   end subroutine copy_diagonals

   !> Allocates all matrices, filled with zeros.
   subroutine allocate_matrices(steps)
      type(newmark_steps), intent(inout) :: steps
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: entries, n_mass, n_stiffness

      associate (frame => steps%frame, structure => steps%frame%structure, n => steps%columns)
         n = merge(narrow, frame%n_padded, frame%is_short .and. frame%n_dof <= narrow)
         n_mass = n
         n_stiffness = n
         if (frame%is_short) then
            steps%n_patterns = 2**structure%n_joints
         else
            n_mass = size(steps%mass_offset)
            n_stiffness = size(steps%stiffness_offset)
            allocate (steps%span(2, n/4, 0:steps%max_halvings))
            allocate (steps%flexibility(n), source=0.0_wp)
            steps%flexibility(frame%row) = 1.0_wp/structure%joint_stiffness
         end if
         entries = steps%n_patterns*(steps%max_halvings + 1)
         call steps%memory%reserve(int(frame%n_padded, long)*(n*entries + n_mass &
                                                              + n_stiffness*steps%n_patterns &
                                                              + 1 + structure%n_forces))
         call steps%memory%assign_planes([frame%n_padded, n, entries], planes)
         steps%inverse(1:, 1:, 0:) => planes
         call steps%memory%assign_planes([frame%n_padded, n_stiffness, steps%n_patterns], &
                                         steps%stiffness)
         call steps%memory%assign_planes([frame%n_padded, n_mass, 1], steps%mass)
         call steps%memory%assign_planes([frame%n_padded, 1 + structure%n_forces, 1], &
                                         steps%diagonal)
      end associate
   end subroutine allocate_matrices

   !> Forms S^-1 of one pattern and level, and what a long frame needs beside it.
   subroutine form_inverse(stiffness, pattern, level, beta, gamma, steps, error)
      real(wp), intent(in) :: stiffness(:, :)   !! K_s
      integer, intent(in) :: pattern, level
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(inout) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: inverse(steps%frame%n_dof, steps%frame%n_dof)   ! S^-1
      real(wp), allocatable :: columns(:, :), s(:, :)
      integer :: i

      associate (structure => steps%frame%structure, frame => steps%frame, &
                 h => steps%weight(3, level), n => steps%frame%n_dof, m => steps%frame%n_rows, &
                 entry => (steps%max_halvings + 1)*pattern + level)
         s = structure%mass + gamma*h*structure%damping + beta*h**2*stiffness
         inverse = unit_matrix(n)
         call solve_positive_definite(s, inverse, error)
         if (allocated(error)) return
         if (frame%is_short) then
            steps%inverse(:m, :n, entry) = frame%rows_of(inverse)
            return
         end if
         columns = transpose(frame%rows_of(inverse))   ! alone, as gfortran 12 needs a copy
         steps%inverse(:m, :m, level) = frame%rows_of(columns)
         do i = 1, steps%columns/4
            steps%span(:, i, level) = span_of(that_count(steps%inverse(:m, :m, level), 4*i - 3, &
                                                         min(4*i, m)))
         end do
      end associate
   end subroutine form_inverse

   !> Rows of Z S^-1 Z' that are not negligible in any of the columns first..last. The others change
   !> products by less than rounding, in the norm of S.
   pure function that_count(matrix, first, last) result(counts)
      real(wp), intent(in) :: matrix(:, :)   !! (row, row)
      integer, intent(in) :: first, last
      logical :: counts(size(matrix, 1))
      real(wp) :: effect(size(matrix, 1))
      integer :: i, j

      counts = .false.
      do j = first, last
         effect = [(abs(matrix(i, j))/sqrt(matrix(i, i)), i=1, size(effect))]
         counts = counts .or. effect > epsilon(1.0_wp)/size(effect)*maxval(effect)
      end do
   end function that_count

   !> First and last register of rows in which a row counts; an empty range if none does.
   pure function span_of(counts) result(span)
      logical, intent(in) :: counts(:)   !! (row)
      integer :: span(2)

      span(1) = 1 + (findloc(counts, .true., 1) - 1)/rows
      span(2) = whole_registers(findloc(counts, .true., 1, back=.true.))/rows
   end function span_of

   !> Work of a step of dt, in multiplications of the exact march (march_work). A transition takes
   !> three trials for every two halvings, and the switch of the joint.
   pure type(march_work) function work(self)
      class(newmark_steps), intent(in) :: self
      real(wp), parameter :: per_switch = 1800.0_wp, per_trial = 250.0_wp   ! beside the products
      real(wp), parameter :: per_release = 750.0_wp, per_row = 20.0_wp      ! in long frames
      real(wp), parameter :: mean_level = 0.75_wp   ! mean span of all levels over that of level 0

      associate (n => size(self%inverse, 1), n_fours => (self%frame%n_dof + 3)/4)
         work%step = per_trial + n*(2*self%columns + self%frame%structure%n_forces)
         if (allocated(self%span)) &
            work%step = per_trial + per_release + per_row*n &
                        + mean_level*4*rows*sum(self%span(2, :n_fours, 0) &
                                                - self%span(1, :n_fours, 0) + 1)
      end associate
      work%transition = (1.0_wp + 1.5_wp*self%max_halvings)*work%step + per_switch
   end function work

   !> Makes a trial step of each listed sample, at its own level. The new motion is put into the
   !> other slot; has_crossed is 1 if a joint is beyond its limit at the end of the step, else 0.
   pure subroutine try_steps(self, sample, block, has_crossed)
      class(newmark_steps), intent(in) :: self
      integer, intent(in), contiguous :: sample(:)                 !! numbers of samples
      type(newmark_block), intent(inout) :: block
      integer(long), intent(inout), contiguous :: has_crossed(:)   !! (all samples); only listed set
      integer :: k

      call block%list_trials(sample)
      associate (trials => block%trials(:size(sample)))
         if (.not. self%frame%is_short) then
            do k = 1, size(trials)
               associate (w => trials(k)%sample, old => trials(k)%slot)
                  call find_long_push(self, trials(k), block%force, block%motion(:, :, old, w), &
                                      block%motion(:, :, 1 - old, w))
                  call try_long_frame(self, trials(k)%level, block%bounds(:, :, w), &
                                      block%motion(:, :, old, w), block%motion(:, :, 1 - old, w), &
                                      block%list, block%factor, has_crossed(w))
               end associate
            end do
            return
         end if
         call find_pushes(trials, self%weight, self%columns, block%n_forces, self%stiffness, &
                          self%diagonal, block%force, block%motion, block%push)
         if (.not. self%is_lumped) call add_coupled_mass(trials, self%columns, self%mass, &
                                                         block%motion, block%push)
         call try_short_frames(trials, self%weight, self%columns, self%inverse, block%bounds, &
                               block%push, block%motion, has_crossed)
      end associate
   end subroutine try_steps

   !> Finds p of a trial step of a long frame, in place of its new x.
   pure subroutine find_long_push(self, trial, force, old, new)
      type(newmark_steps), intent(in) :: self
      type(newmark_trial), intent(in) :: trial
      real(wp), intent(in), contiguous :: force(0:, :)   !! (step, force, or force and sample) [N]
      real(wp), intent(in), contiguous :: old(:, :)
      real(wp), intent(inout), contiguous :: new(:, :)   !! column 3: p; the others are a buffer
      real(wp) :: change
      integer :: f

      associate (weight => self%weight(:, trial%level), n => self%frame%n_dof)
         new(:, 3) = self%diagonal(:, 1, 1)*old(:, 1)
         do f = 1, self%frame%structure%n_forces
            change = weight(7)*(force(trial%step + 1, trial%column + f) &
                                - force(trial%step, trial%column + f))
            new(:, 3) = new(:, 3) + self%diagonal(:, f + 1, 1)*change
         end do
         new(:, 1) = -weight(3)*(old(:, 2) + weight(8)*old(:, 1))
         call add_diagonals(size(new, 1)/rows, n, self%stiffness_offset, self%stiffness, new, &
                            new(:, 3))
         if (self%is_lumped) return
         new(:, 1) = old(:, 1)
         call add_diagonals(size(new, 1)/rows, n, self%mass_offset, self%mass, new, new(:, 3))
      end associate
   end subroutine find_long_push

   !> Adds to p the product of a matrix, given by its diagonals, with the first n numbers of a
   !> buffer, which are repeated after them.
   pure subroutine add_diagonals(registers, n, offset, diagonal, vector, p)
      integer, intent(in) :: registers, n
      integer, intent(in), contiguous :: offset(:)
      real(wp), intent(in) :: diagonal(rows, registers, size(offset))
      real(wp), intent(inout) :: vector(2*rows*registers), p(rows, registers)
      real(wp) :: total(rows)
      integer :: d, i, r

      !$omp simd
      do i = 1, n
         vector(n + i) = vector(i)
      end do
      do r = 1, registers
         total = p(:, r)
         do d = 1, size(offset)
            !$omp simd
            do i = 1, rows
               total(i) = total(i) + diagonal(i, r, d)*vector(rows*(r - 1) + offset(d) + i)
            end do
         end do
         p(:, r) = total
      end do
   end subroutine add_diagonals

   !> Makes a trial step of a long frame: a1 with all joints stuck, then the correction for the
   !> slipping ones.
   pure subroutine try_long_frame(self, level, bounds, old, new, list, factor, has_crossed)
      class(newmark_steps), intent(in) :: self
      integer, intent(in) :: level
      real(wp), intent(in), contiguous :: bounds(:, :), old(:, :)
      real(wp), intent(inout), contiguous :: new(:, :)         !! column 3: p
      integer, intent(inout), contiguous :: list(:)            !! buffer
      real(wp), intent(inout), contiguous :: factor(:, :)      !! buffer
      integer(long), intent(out) :: has_crossed
      integer :: j, m

      associate (weight => self%weight(:, level), registers => size(new, 1)/rows, &
                 inverse => self%inverse(:, :, level), span => self%span(:, :, level))
         new(:, 1) = -weight(6)*old(:, 1)
         call add_product(registers, self%frame%n_dof, span, inverse, new(:, 3), new)
         new(:, 2) = weight(3)*old(:, 2) + weight(4)*old(:, 1) + weight(5)*new(:, 1)
         m = 0
         do j = 1, size(self%frame%row)   ! without a branch, which could not be predicted
            list(m + 1) = self%frame%row(j)
            m = m + merge(0, 1, bounds(list(m + 1), 4) > 0.0_wp)
         end do
         call release(registers, list(:m), weight(5), self%flexibility, span, inverse, new(:, 2), &
                      factor, new)
         call finish_trial(size(new, 1), weight, bounds, old, new, has_crossed)
      end associate
   end subroutine try_long_frame

   !> Adds A f to a, four columns at a time. f is zero beyond n.
   pure subroutine add_product(registers, n, span, matrix, f, a)
      integer, intent(in) :: registers, n
      integer, intent(in) :: span(2, 2*registers)
      real(wp), intent(in) :: matrix(rows, registers, rows*registers), f(rows*registers)
      real(wp), intent(inout) :: a(rows, registers)
      integer :: j, r

      do j = 1, n, 4
         do r = span(1, (j + 3)/4), span(2, (j + 3)/4)
            a(:, r) = a(:, r) + ((matrix(:, r, j)*f(j) + matrix(:, r, j + 1)*f(j + 1)) &
                                 + (matrix(:, r, j + 2)*f(j + 2) + matrix(:, r, j + 3)*f(j + 3)))
         end do
      end do
   end subroutine add_product

   !> Adds S^-1 W g to a, so that the joints of the listed rows slip. Row j of the matrix is in
   !> column j of `factor` from its diagonal on. Eliminates by itself, since calls of LAPACK cost
   !> more than these few rows.
   pure subroutine release(registers, list, beta_h2, flexibility, span, inverse, g, factor, a)
      integer, intent(in) :: registers
      integer, intent(in), contiguous :: list(:)
      real(wp), intent(in) :: beta_h2, flexibility(rows*registers)
      integer, intent(in) :: span(2, 2*registers)
      real(wp), intent(in) :: inverse(rows*registers, rows*registers)
      real(wp), intent(inout) :: g(rows*registers)   !! (row) first the right side Z (x1 - x0)
      real(wp), intent(inout), contiguous :: factor(:, :)
      real(wp), intent(inout) :: a(rows*registers)
      real(wp) :: share
      integer :: i, j, k

      do j = 1, size(list)
         do i = j, size(list)
            factor(i, j) = -beta_h2*inverse(list(i), list(j))
         end do
         factor(j, j) = factor(j, j) + flexibility(list(j))
      end do
      do j = 1, size(list)
         factor(j, j) = 1.0_wp/factor(j, j)
         do i = j + 1, size(list)
            share = factor(i, j)*factor(j, j)
            g(list(i)) = g(list(i)) - share*g(list(j))
            do k = i, size(list)
               factor(k, i) = factor(k, i) - share*factor(k, j)
            end do
         end do
      end do
      do j = size(list), 1, -1
         do i = j + 1, size(list)
            g(list(j)) = g(list(j)) - factor(i, j)*g(list(i))
         end do
         g(list(j)) = g(list(j))*factor(j, j)
         associate (four => (list(j) + 3)/4)
            do i = rows*span(1, four) - rows + 1, rows*span(2, four)
               a(i) = a(i) + inverse(i, list(j))*g(list(j))
            end do
         end associate
      end do
   end subroutine release

   !> Finds v1 and x1 from a1, and whether a joint is beyond its limit.
   pure subroutine finish_trial(n, weight, bounds, old, new, has_crossed)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight(n_weights), bounds(n, 4), old(n, 3)
      real(wp), intent(inout) :: new(n, 3)
      integer(long), intent(out) :: has_crossed
      integer :: i

      has_crossed = 0_long
      !$omp simd reduction(ior:has_crossed)
      do i = 1, n
         new(i, 2) = old(i, 2) + weight(1)*old(i, 1) + weight(2)*new(i, 1)
         new(i, 3) = old(i, 3) + weight(3)*old(i, 2) + weight(4)*old(i, 1) + weight(5)*new(i, 1)
         has_crossed = ior(has_crossed, is_beyond(bounds(i, 1), bounds(i, 2), bounds(i, 3), &
                                                  new(i, 2), new(i, 3)))
      end do
   end subroutine finish_trial

   !> 1 if the joint of a row is beyond its limit, |w.x - z| > reach or d w.v < 0, else 0.
   pure integer(long) function is_beyond(slider, reach, direction, velocity, place)
      real(wp), intent(in) :: slider, reach, direction, velocity, place

      is_beyond = ior(merge(1_long, 0_long, abs(place - slider) > reach), &
                      merge(1_long, 0_long, direction*velocity < 0.0_wp))
   end function is_beyond

   !> Finds p of the trial steps of short frames. This kernel and the next take most of the time:
   !> every array has an explicit shape of whole registers. Rows of the motion: a 1..8, v 9..16, x
   !> 17..24. The first force stands apart: in one loop over all of them, which is a tenth slower,
   !> gfortran 12 reads beyond the last one.
   pure subroutine find_pushes(trials, weight, columns, n_forces, stiffness, diagonal, force, &
                               motion, push)
      type(newmark_trial), intent(in), contiguous :: trials(:)
      integer, intent(in) :: columns, n_forces
      real(wp), intent(in) :: weight(n_weights, 0:*)
      real(wp), intent(in) :: stiffness(rows, columns, 0:*), diagonal(rows, 0:n_forces)
      real(wp), intent(in), contiguous :: force(0:, :)   !! (step, force, or force and sample) [N]
      real(wp), intent(in) :: motion(3*rows, 0:1, *)
      real(wp), intent(inout) :: push(rows, *)           !! (row, trial)
      real(wp) :: change, v(rows)
      integer :: f, i, k, l, old, p, w

      do k = 1, size(trials)
         l = trials(k)%level
         p = trials(k)%pattern
         w = trials(k)%sample
         old = trials(k)%slot
         f = trials(k)%column + 1
         change = weight(7, l)*(force(trials(k)%step + 1, f) - force(trials(k)%step, f))
         !$omp simd
         do i = 1, rows
            v(i) = -weight(3, l)*(motion(rows + i, old, w) + weight(8, l)*motion(i, old, w))
         end do
         !$omp simd
         do i = 1, rows
            push(i, k) = ((stiffness(i, 1, p)*v(1) + stiffness(i, 2, p)*v(2)) &
                          + (stiffness(i, 3, p)*v(3) + stiffness(i, 4, p)*v(4))) &
                         + (stiffness(i, 5, p)*v(5) + (diagonal(i, 0)*motion(i, old, w) &
                                                       + diagonal(i, 1)*change))
         end do
         if (columns > narrow) then
            !$omp simd
            do i = 1, rows
               push(i, k) = push(i, k) + ((stiffness(i, 6, p)*v(6) + stiffness(i, 7, p)*v(7)) &
                                          + stiffness(i, 8, p)*v(8))
            end do
         end if
         do f = 2, n_forces
            associate (ends => force(trials(k)%step:trials(k)%step + 1, trials(k)%column + f))
               push(:, k) = push(:, k) + diagonal(:, f)*(weight(7, l)*(ends(2) - ends(1)))
            end associate
         end do
      end do
   end subroutine find_pushes

   !> Adds M a0/gamma without the diagonal of M to p of short frames.
   pure subroutine add_coupled_mass(trials, columns, mass, motion, push)
      type(newmark_trial), intent(in), contiguous :: trials(:)
      integer, intent(in) :: columns
      real(wp), intent(in) :: mass(rows, columns), motion(3*rows, 0:1, *)
      real(wp), intent(inout) :: push(rows, *)   !! (row, trial)
      integer :: j, k

      do k = 1, size(trials)
         do j = 1, columns
            push(:, k) = push(:, k) + mass(:, j)*motion(j, trials(k)%slot, trials(k)%sample)
         end do
      end do
   end subroutine add_coupled_mass

   !> Makes the trial steps of short frames: a1, then v1 and x1, and whether a joint is beyond its
   !> limit.
   pure subroutine try_short_frames(trials, weight, columns, inverse, bounds, push, motion, &
                                    has_crossed)
      type(newmark_trial), intent(in), contiguous :: trials(:)
      integer, intent(in) :: columns
      real(wp), intent(in) :: weight(n_weights, 0:*)
      real(wp), intent(in) :: inverse(rows, columns, 0:*), bounds(rows, 4, *), push(rows, *)
      real(wp), intent(inout) :: motion(3*rows, 0:1, *)
      integer(long), intent(inout) :: has_crossed(*)
      real(wp) :: a(rows)
      integer(long) :: crossed
      integer :: e, i, k, l, new, old, w

      do k = 1, size(trials)
         e = trials(k)%entry
         l = trials(k)%level
         w = trials(k)%sample
         old = trials(k)%slot
         new = 1 - old
         !$omp simd
         do i = 1, rows
            a(i) = ((inverse(i, 1, e)*push(1, k) + inverse(i, 2, e)*push(2, k)) &
                    + (inverse(i, 3, e)*push(3, k) + inverse(i, 4, e)*push(4, k))) &
                   + (inverse(i, 5, e)*push(5, k) - weight(6, l)*motion(i, old, w))
         end do
         if (columns > narrow) then
            !$omp simd
            do i = 1, rows
               a(i) = a(i) + ((inverse(i, 6, e)*push(6, k) + inverse(i, 7, e)*push(7, k)) &
                              + inverse(i, 8, e)*push(8, k))
            end do
         end if
         crossed = 0_long
         !$omp simd reduction(ior:crossed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = a(i)
               v1 = v0 + weight(1, l)*a0 + weight(2, l)*a1
               x1 = motion(2*rows + i, old, w) + weight(3, l)*v0 + weight(4, l)*a0 + weight(5, l)*a1
               motion(i, new, w) = a1
               motion(rows + i, new, w) = v1
               motion(2*rows + i, new, w) = x1
               crossed = ior(crossed, is_beyond(bounds(i, 1, w), bounds(i, 2, w), bounds(i, 3, w), &
                                                v1, x1))
            end block
         end do
         has_crossed(w) = crossed
      end do
   end subroutine try_short_frames

end module dynamics_newmark_steps
