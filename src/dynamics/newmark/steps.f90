!> One step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck joints.
!>
!> Between transitions the structure is linear: M a + C v + K_s x changes in a step as the force
!> does, and the constant forces of slipping joints drop out. With
!>    v1 = v0 + h ((1 - gamma) a0 + gamma a1),  x1 = x0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1)
!> and S = M + gamma h C + beta h^2 K_s this is
!>    a1 = S^-1 [b (F1 - F0) + M a0/gamma - h K_s (v0 + h (1/2 - beta/gamma) a0)]
!>         - (1 - gamma)/gamma a0.
!> A map has the factors of a0, v0 and F1 - F0. Short frames have one for every pattern. Long frames
!> have only that with all joints stuck, and correct it by the Woodbury formula: g, the force that
!> the springs of the slipping joints would gain in the step, is taken back,
!>    (1/k - beta h^2 W' S^-1 W) g = W' (x1 - x0),   a1 grows by S^-1 W g.
module dynamics_newmark_steps
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_alignment, only: aligned_memory, register_width, whole_registers
   use dynamics_newmark_block, only: newmark_block, newmark_trial
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_response, only: march_work
   use numerics_lapack, only: solve_positive_definite, unit_matrix
   implicit none(type, external)
   private
   public :: newmark_steps, new_newmark_steps

   integer, parameter :: rows = register_width   !! rows of a short frame
   integer, parameter :: narrow = 5      !! columns for a0 of up to 5 dofs; of more: whole registers

   !> Maps of all levels of halving.
   type :: newmark_steps
      type(newmark_frame) :: frame
      integer :: max_halvings = 0
      !> (7, level) factors of a0, a1 in v1; of v0 (h), a0, a1 in x1; (1 - gamma)/gamma; h/dt
      real(wp), allocatable :: weight(:, :)
      !> (row, column, entry) a1 from a0 and v0 of the dofs, the changes of the forces and, in long
      !> frames, g (S^-1 W); entry = (max_halvings + 1) pattern + level, from 0
      real(wp), pointer, contiguous :: map(:, :, :) => null()
      integer :: columns = narrow         !! columns for a0, and for v0
      integer :: n_patterns = 1
      !> Long frames: first and last row that is not negligible in four columns of the map
      !> (1:2, four, level) and in a column of S^-1 W (1:2, joint, level)
      integer, allocatable :: span(:, :, :), gain_span(:, :, :)
      type(aligned_memory), private :: memory
   contains
      procedure :: try_steps
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
      real(wp), allocatable :: stiffness(:, :)
      real(wp), pointer, contiguous :: planes(:, :, :)
      real(wp) :: h
      logical :: is_stuck(frame%structure%n_joints)
      integer :: columns, entries, j, level, pattern

      steps%frame = frame
      steps%max_halvings = max_halvings
      allocate (steps%weight(7, 0:max_halvings))
      do level = 0, max_halvings
         h = dt*0.5_wp**level
         steps%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma, 0.5_wp**level]
      end do
      steps%columns = merge(narrow, frame%n_padded, frame%is_short .and. frame%n_dof <= narrow)
      columns = 2*steps%columns + frame%structure%n_forces
      if (frame%is_short) then
         steps%n_patterns = 2**frame%structure%n_joints
      else
         columns = columns + frame%structure%n_joints
         allocate (steps%span(2, steps%columns/2, 0:max_halvings), &
                   steps%gain_span(2, frame%structure%n_joints, 0:max_halvings))
      end if
      entries = steps%n_patterns*(max_halvings + 1)
      call steps%memory%reserve(int(frame%n_padded, long)*columns*entries)
      call steps%memory%assign_planes([frame%n_padded, columns, entries], planes)
      steps%map(1:, 1:, 0:) => planes
      do pattern = 0, steps%n_patterns - 1
         is_stuck = [(btest(pattern, j - 1) .or. .not. frame%is_short, j=1, size(is_stuck))]
         stiffness = frame%structure%stuck_stiffness(is_stuck)
         do level = 0, max_halvings
            call form_map(stiffness, level, (max_halvings + 1)*pattern + level, beta, gamma, steps, &
                          error)
            if (allocated(error)) return
         end do
      end do
   end subroutine new_newmark_steps

   !> Forms the map of one pattern and level, and finds the spans of a long frame. Columns beyond
   !> the dofs stay zero.
   subroutine form_map(stiffness, level, entry, beta, gamma, steps, error)
      real(wp), intent(in) :: stiffness(:, :)   !! K_s of the pattern (dof, dof) [N/m]
      integer, intent(in) :: level, entry
      real(wp), intent(in) :: beta, gamma
      type(newmark_steps), intent(inout) :: steps
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: inverse(steps%frame%n_dof, steps%frame%n_dof)   ! S^-1
      real(wp) :: full(steps%frame%n_dof, size(steps%map, 2))
      real(wp), allocatable :: s(:, :), mobility(:, :)
      integer :: i

      associate (structure => steps%frame%structure, h => steps%weight(3, level), &
                 n => steps%frame%n_dof, columns => steps%columns, &
                 map => steps%map(:steps%frame%n_rows, :, entry))
         s = structure%mass + gamma*h*structure%damping + beta*h**2*stiffness
         inverse = unit_matrix(n)
         call solve_positive_definite(s, inverse, error)
         if (allocated(error)) return
         full = 0.0_wp
         full(:, :n) = matmul(inverse, structure%mass/gamma &
                              - (h**2*(0.5_wp - beta/gamma))*stiffness)
         do i = 1, n
            full(i, i) = full(i, i) - steps%weight(6, level)
         end do
         full(:, columns + 1:columns + n) = -h*matmul(inverse, stiffness)
         associate (first => 2*columns + 1, last => 2*columns + structure%n_forces)
            full(:, first:last) = matmul(inverse, structure%load)
            if (.not. steps%frame%is_short) &
               full(:, last + 1:) = matmul(inverse, structure%direction)
         end associate
         map = steps%frame%rows_of(full)
         if (steps%frame%is_short) return
         mobility = transpose(steps%frame%rows_of(inverse))   ! alone, as gfortran 12 needs a copy
         mobility = steps%frame%rows_of(mobility)
         do i = 1, columns/2
            steps%span(:, i, level) = span_of(map(:, 4*i - 3:4*i), mobility)
         end do
         do i = 1, structure%n_joints
            associate (column => size(map, 2) - structure%n_joints + i)
               steps%gain_span(:, i, level) = span_of(map(:, column:column), mobility)
            end associate
         end do
      end associate
   end subroutine form_map

   !> First and last row that is not negligible in any of the columns, in whole registers; an empty
   !> range if all are zero. The other rows change products by less than rounding, in the norm of S.
   pure function span_of(matrix, mobility) result(span)
      real(wp), intent(in) :: matrix(:, :)     !! (row, column)
      real(wp), intent(in) :: mobility(:, :)   !! Z S^-1 Z' (row, row)
      integer :: span(2)
      real(wp) :: effect(size(matrix, 1))
      logical :: counts(size(matrix, 1))
      integer :: i, j

      counts = .false.
      do j = 1, size(matrix, 2)
         effect = [(abs(matrix(i, j))/sqrt(mobility(i, i)), i=1, size(effect))]
         counts = counts .or. effect > epsilon(1.0_wp)/size(effect)*maxval(effect)
      end do
      span(1) = 1 + register_width*((findloc(counts, .true., 1) - 1)/register_width)
      span(2) = whole_registers(findloc(counts, .true., 1, back=.true.))
   end function span_of

   !> Work of a step of dt, in multiplications of the exact march (march_work). A transition takes
   !> three trials for every two halvings, and the switch of the joint.
   pure type(march_work) function work(self)
      class(newmark_steps), intent(in) :: self
      real(wp), parameter :: per_switch = 1800.0_wp, per_trial = 250.0_wp   ! beside the products
      real(wp), parameter :: per_release = 750.0_wp, per_row = 20.0_wp      ! in long frames
      real(wp), parameter :: mean_level = 0.75_wp   ! mean span of all levels over that of level 0

      work%step = per_trial + size(self%map, 1)*size(self%map, 2)
      if (allocated(self%span)) &
         work%step = per_trial + per_release + per_row*size(self%map, 1) &
                     + mean_level*4*sum(self%span(2, :, 0) - self%span(1, :, 0) + 1)
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
      if (allocated(self%span)) then
         do k = 1, size(sample)
            associate (trial => block%trials(k), w => block%trials(k)%sample, &
                       old => block%trials(k)%slot)
               call try_long_frame(self, trial%level, &
                                   block%force(trial%step:trial%step + 1, &
                                               trial%column + 1:trial%column + block%n_forces), &
                                   block%bounds(:, :, w), block%motion(:, :, old, w), &
                                   block%motion(:, :, 1 - old, w), block%list, block%factor, &
                                   has_crossed(w))
            end associate
         end do
      else
         call try_short_frames(block%trials(:size(sample)), self%weight, block%n_forces, &
                               size(self%map, 2), self%map, block%force, block%bounds, &
                               block%motion, has_crossed)
      end if
   end subroutine try_steps

   !> Makes a trial step of a long frame: the map with all joints stuck, then the correction for the
   !> slipping ones.
   pure subroutine try_long_frame(self, level, force, bounds, old, new, list, factor, has_crossed)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: force(0:, :)                     !! (end of the step, force) [N]
      real(wp), intent(in), contiguous :: bounds(:, :), old(:, :)
      real(wp), intent(inout), contiguous :: new(:, :)
      integer, intent(inout), contiguous :: list(:)            !! buffer
      real(wp), intent(inout), contiguous :: factor(:, :)      !! buffer
      integer(long), intent(out) :: has_crossed
      integer :: f, j, m

      associate (rows => size(new, 1), columns => 2*self%columns)
         call multiply(rows, columns, self%span(:, :, level), self%map(:, :, level), old, new)
         do f = 1, size(force, 2)
            new(:, 1) = new(:, 1) + self%map(:, columns + f, level) &
                        *(self%weight(7, level)*(force(1, f) - force(0, f)))
         end do
         m = 0
         do j = 1, size(factor, 2)   ! without a branch, which could not be predicted
            list(m + 1) = j
            m = m + merge(0, 1, bounds(self%frame%row(j), 4) > 0.0_wp)
         end do
         call release(self, level, list(:m), old, self%map(:, columns + size(force, 2) + 1:, level), &
                      factor, new(:, 1))
         call finish_trial(rows, self%weight(:, level), bounds, old, new, has_crossed)
      end associate
   end subroutine try_long_frame

   !> Finds a = A f, four columns at a time.
   pure subroutine multiply(rows, n, span, matrix, f, a)
      integer, intent(in) :: rows, n, span(2, n/4)
      real(wp), intent(in) :: matrix(rows, n), f(n)
      real(wp), intent(inout) :: a(rows)
      integer :: i, j

      a = 0.0_wp
      do j = 1, n, 4
         do i = span(1, (j + 3)/4), span(2, (j + 3)/4)
            a(i) = a(i) + ((matrix(i, j)*f(j) + matrix(i, j + 1)*f(j + 1)) &
                           + (matrix(i, j + 2)*f(j + 2) + matrix(i, j + 3)*f(j + 3)))
         end do
      end do
   end subroutine multiply

   !> Adds S^-1 W g of the listed joints to a, so that they slip. Column j of `factor` has row j of
   !> the matrix from its diagonal on, then the right side, which g replaces. Eliminates by itself,
   !> since calls of LAPACK cost more than these few rows.
   pure subroutine release(self, level, list, old, gain, factor, a)
      type(newmark_steps), intent(in) :: self
      integer, intent(in) :: level, list(:)
      real(wp), intent(in), contiguous :: old(:, :), gain(:, :)   !! gain: S^-1 W
      real(wp), intent(inout), contiguous :: factor(:, :), a(:)
      real(wp) :: share
      integer :: i, j, k, m

      m = size(list)
      associate (weight => self%weight(:, level), row => self%frame%row, &
                 span => self%gain_span(:, :, level), &
                 stiffness => self%frame%structure%joint_stiffness)
         do j = 1, m
            do i = j, m
               factor(i, j) = -weight(5)*gain(row(list(i)), list(j))
            end do
            factor(j, j) = factor(j, j) + 1.0_wp/stiffness(list(j))
            factor(m + 1, j) = weight(3)*old(row(list(j)), 2) + weight(4)*old(row(list(j)), 1) &
                               + weight(5)*a(row(list(j)))
         end do
         do j = 1, m
            factor(j, j) = 1.0_wp/factor(j, j)
            do i = j + 1, m
               share = factor(i, j)*factor(j, j)
               do k = i, m + 1
                  factor(k, i) = factor(k, i) - share*factor(k, j)
               end do
            end do
         end do
         do j = m, 1, -1
            do i = j + 1, m
               factor(m + 1, j) = factor(m + 1, j) - factor(i, j)*factor(m + 1, i)
            end do
            factor(m + 1, j) = factor(m + 1, j)*factor(j, j)
            do i = span(1, list(j)), span(2, list(j))
               a(i) = a(i) + gain(i, list(j))*factor(m + 1, j)
            end do
         end do
      end associate
   end subroutine release

   !> Finds v1 and x1 from a1, and whether a joint is beyond its limit.
   pure subroutine finish_trial(n, weight, bounds, old, new, has_crossed)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight(7), bounds(n, 4), old(n, 3)
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

   !> Makes the trial steps of short frames: a1 by the maps, then v1 and x1, and whether a joint is
   !> beyond its limit. This kernel takes most of the time: every array has an explicit shape of
   !> whole registers. Rows of the motion: a 1..8, v 9..16, x 17..24.
   pure subroutine try_short_frames(trials, weight, n_forces, n_columns, map, force, bounds, &
                                    motion, has_crossed)
      type(newmark_trial), intent(in), contiguous :: trials(:)
      integer, intent(in) :: n_forces, n_columns
      real(wp), intent(in) :: weight(7, 0:*)
      real(wp), intent(in), contiguous :: force(0:, :)   !! (step, force, or force and sample) [N]
      real(wp), intent(in) :: map(rows, n_columns, 0:*), bounds(rows, 4, *)
      real(wp), intent(inout) :: motion(3*rows, 0:1, *)
      integer(long), intent(inout) :: has_crossed(*)
      real(wp) :: a(rows), change, rest(rows)
      integer(long) :: crossed
      integer :: columns, e, f, i, k, l, new, old, w

      columns = (n_columns - n_forces)/2
      do k = 1, size(trials)
         e = trials(k)%entry
         l = trials(k)%level
         w = trials(k)%sample
         old = trials(k)%slot
         new = 1 - old
         f = trials(k)%column + 1
         change = weight(7, l)*(force(trials(k)%step + 1, f) - force(trials(k)%step, f))
         !$omp simd
         do i = 1, rows
            a(i) = ((map(i, 1, e)*motion(1, old, w) + map(i, 2, e)*motion(2, old, w)) &
                    + (map(i, 3, e)*motion(3, old, w) + map(i, 4, e)*motion(4, old, w))) &
                   + map(i, 5, e)*motion(5, old, w)
            rest(i) = ((map(i, columns + 1, e)*motion(rows + 1, old, w) &
                        + map(i, columns + 2, e)*motion(rows + 2, old, w)) &
                       + (map(i, columns + 3, e)*motion(rows + 3, old, w) &
                          + map(i, columns + 4, e)*motion(rows + 4, old, w))) &
                      + (map(i, columns + 5, e)*motion(rows + 5, old, w) &
                         + map(i, 2*columns + 1, e)*change)
         end do
         if (columns > narrow) then
            !$omp simd
            do i = 1, rows
               a(i) = a(i) + ((map(i, 6, e)*motion(6, old, w) + map(i, 7, e)*motion(7, old, w)) &
                              + map(i, 8, e)*motion(8, old, w))
               rest(i) = rest(i) + ((map(i, 14, e)*motion(14, old, w) &
                                     + map(i, 15, e)*motion(15, old, w)) &
                                    + map(i, 16, e)*motion(16, old, w))
            end do
         end if
         do f = 2, n_forces
            associate (ends => force(trials(k)%step:trials(k)%step + 1, trials(k)%column + f))
               rest = rest + map(:, 2*columns + f, e)*(weight(7, l)*(ends(2) - ends(1)))
            end associate
         end do
         crossed = 0_long
         !$omp simd reduction(ior:crossed)
         do i = 1, rows
            block
               real(wp) :: a0, v0, a1, v1, x1

               a0 = motion(i, old, w)
               v0 = motion(rows + i, old, w)
               a1 = a(i) + rest(i)
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
