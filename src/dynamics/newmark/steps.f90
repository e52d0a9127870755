!> Trial steps of Newmark's scheme, each sample at its own level of halving: a1 from S^-1 p by the
!> formulas of dynamics_newmark_matrices, then v1 and x1, and whether a joint is beyond its limit.
module dynamics_newmark_steps
   use core_alignment, only: rows => register_width
   use core_kinds, only: long, wp
   use dynamics_newmark_block, only: newmark_block, newmark_trial
   use dynamics_newmark_matrices, only: n_weights, narrow, newmark_matrices
   implicit none(type, external)
   private
   public :: try_steps

contains

   !> Makes a trial step of each listed sample, at its own level. The new motion is put into the
   !> other slot; has_crossed is 1 if a joint is beyond its limit at the end of the step, else 0.
   pure subroutine try_steps(self, sample, block, has_crossed)
      type(newmark_matrices), intent(in) :: self
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
      type(newmark_matrices), intent(in) :: self
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
      type(newmark_matrices), intent(in) :: self
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
