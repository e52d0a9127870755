!> Matrices of a step of Newmark's scheme, for every step size dt/2^level and every pattern of stuck
!> joints.
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
module dynamics_newmark_matrices
   use core_alignment, only: aligned_memory, rows => register_width, whole_registers
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_response, only: march_work
   use numerics_lapack, only: solve_positive_definite, unit_matrix
   implicit none(type, external)
   private
   public :: n_weights, narrow, newmark_matrices, new_newmark_matrices

   integer, parameter :: narrow = 5   !! columns of up to 5 dofs; of more: whole registers
   integer, parameter :: n_weights = 8

   !> Matrices of all levels of halving. Rows are those of the frame, padded.
   type :: newmark_matrices
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
      procedure :: work
   end type newmark_matrices

contains

   !> Prepares the matrices of all levels and, of a short frame, of all patterns.
   subroutine new_newmark_matrices(frame, dt, max_halvings, beta, gamma, matrices, error)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: beta, gamma
      type(newmark_matrices), intent(out) :: matrices
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(frame%n_dof, frame%n_dof) :: coupled_mass, stiffness
      real(wp) :: h
      logical :: is_stuck(frame%structure%n_joints)
      integer :: i, j, level, pattern

      coupled_mass = frame%structure%mass/gamma
      do i = 1, frame%n_dof
         coupled_mass(i, i) = 0.0_wp
      end do
      matrices%frame = frame
      matrices%max_halvings = max_halvings
      matrices%is_lumped = frame%structure%has_lumped_mass()
      allocate (matrices%weight(n_weights, 0:max_halvings))
      do level = 0, max_halvings
         h = dt*0.5_wp**level
         matrices%weight(:, level) = [h*(1.0_wp - gamma), h*gamma, h, h**2*(0.5_wp - beta), &
                                   h**2*beta, (1.0_wp - gamma)/gamma, 0.5_wp**level, &
                                   h*(0.5_wp - beta/gamma)]
      end do
      is_stuck = .true.
      stiffness = frame%structure%stuck_stiffness(is_stuck)
      matrices%stiffness_offset = offsets_of(stiffness)
      matrices%mass_offset = offsets_of(coupled_mass)
      call allocate_matrices(matrices)
      associate (n => frame%n_dof, structure => frame%structure)
         matrices%diagonal(:n, 1, 1) = [(structure%mass(i, i)/gamma, i=1, n)]
         matrices%diagonal(:n, 2:, 1) = structure%load
         if (frame%is_short) then
            matrices%mass(:n, :n, 1) = coupled_mass
         else
            call copy_diagonals(coupled_mass, matrices%mass_offset, matrices%mass(:, :, 1))
            call copy_diagonals(stiffness, matrices%stiffness_offset, matrices%stiffness(:, :, 1))
         end if
         do pattern = 0, matrices%n_patterns - 1
            if (frame%is_short) then
               is_stuck = [(btest(pattern, j - 1), j=1, size(is_stuck))]
               stiffness = structure%stuck_stiffness(is_stuck)
               matrices%stiffness(:n, :n, 1 + pattern) = stiffness
            end if
            do level = 0, max_halvings
               call form_inverse(stiffness, pattern, level, beta, gamma, matrices, error)
               if (allocated(error)) return
            end do
         end do
      end associate
   end subroutine new_newmark_matrices

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
   subroutine allocate_matrices(matrices)
      type(newmark_matrices), intent(inout) :: matrices
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: entries, n_mass, n_stiffness

      associate (frame => matrices%frame, structure => matrices%frame%structure, &
                 n => matrices%columns)
         n = merge(narrow, frame%n_padded, frame%is_short .and. frame%n_dof <= narrow)
         n_mass = n
         n_stiffness = n
         if (frame%is_short) then
            matrices%n_patterns = 2**structure%n_joints
         else
            n_mass = size(matrices%mass_offset)
            n_stiffness = size(matrices%stiffness_offset)
            allocate (matrices%span(2, n/4, 0:matrices%max_halvings))
            allocate (matrices%flexibility(n), source=0.0_wp)
            matrices%flexibility(frame%row) = 1.0_wp/structure%joint_stiffness
         end if
         entries = matrices%n_patterns*(matrices%max_halvings + 1)
         call matrices%memory%reserve(int(frame%n_padded, long)*(n*entries + n_mass &
                                                              + n_stiffness*matrices%n_patterns &
                                                              + 1 + structure%n_forces))
         call matrices%memory%assign_planes([frame%n_padded, n, entries], planes)
         matrices%inverse(1:, 1:, 0:) => planes
         call matrices%memory%assign_planes([frame%n_padded, n_stiffness, matrices%n_patterns], &
                                         matrices%stiffness)
         call matrices%memory%assign_planes([frame%n_padded, n_mass, 1], matrices%mass)
         call matrices%memory%assign_planes([frame%n_padded, 1 + structure%n_forces, 1], &
                                         matrices%diagonal)
      end associate
   end subroutine allocate_matrices

   !> Forms S^-1 of one pattern and level, and what a long frame needs beside it.
   subroutine form_inverse(stiffness, pattern, level, beta, gamma, matrices, error)
      real(wp), intent(in) :: stiffness(:, :)   !! K_s
      integer, intent(in) :: pattern, level
      real(wp), intent(in) :: beta, gamma
      type(newmark_matrices), intent(inout) :: matrices
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: inverse(matrices%frame%n_dof, matrices%frame%n_dof)   ! S^-1
      real(wp), allocatable :: columns(:, :), s(:, :)
      integer :: i

      associate (structure => matrices%frame%structure, frame => matrices%frame, &
                 h => matrices%weight(3, level), n => matrices%frame%n_dof, &
                 m => matrices%frame%n_rows, &
                 entry => (matrices%max_halvings + 1)*pattern + level)
         s = structure%mass + gamma*h*structure%damping + beta*h**2*stiffness
         inverse = unit_matrix(n)
         call solve_positive_definite(s, inverse, error)
         if (allocated(error)) return
         if (frame%is_short) then
            matrices%inverse(:m, :n, entry) = frame%rows_of(inverse)
            return
         end if
         columns = transpose(frame%rows_of(inverse))   ! alone, as gfortran 12 needs a copy
         matrices%inverse(:m, :m, level) = frame%rows_of(columns)
         do i = 1, matrices%columns/4
            matrices%span(:, i, level) = span_of(that_count(matrices%inverse(:m, :m, level), &
                                                            4*i - 3, min(4*i, m)))
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
      class(newmark_matrices), intent(in) :: self
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

end module dynamics_newmark_matrices
