!> Operators of the modal form: free motion in the modes of the structure with all joints stuck, and
!> what moving sliders add to it, over one part of a step.
!>
!> Time t runs from 0 to 1 over the part of length h. With x = Phi q, Phi' M Phi = 1, all joints
!> stuck: q'' + C^ q' + Omega^2 q = f(t) + S zeta(t), C^ = h Phi' C Phi, Omega = h omega, f the load
!> and the sliders at the start of the part, zeta the motion of the sliders since then, S = h^2 Phi'
!> W k. The path of joint j is u_j = (G q)_j, G = W' Phi. Numbers in brackets are formulas of
!> docs/exact_march.md.
module dynamics_exact_modal_operators
   use core_error, only: error_type
   use core_kinds, only: two_pi, wp
   use dynamics_alignment, only: whole_registers
   use dynamics_exact_modal_blocks, only: modal_blocks, new_modal_blocks
   use dynamics_exact_modal_ledger, only: modal_ledger
   use dynamics_exact_modal_terms, only: choose_terms, count_parts, factorial, feel_joints, &
                                         joint_feel, modal_terms, n_markov, path_degree
   use numerics_exponential, only: exponential_type, find_exponential
   use numerics_lapack, only: unit_matrix
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: four, kernel_fit, modal_operators, new_modal_operators

   integer, parameter :: four = 4   !! rows whose sums stay in registers

   !> Operators of one part of a step. A row is a port of a block, a number that loads push and
   !> joints read: a mode where C^ is diagonal. Rows are padded to whole fours.
   type, extends(modal_terms) :: modal_operators
      integer :: n_modes = 0, n_joints = 0, n_forces = 0
      integer :: n_rows = 0                     !! of ports
      type(modal_blocks) :: blocks
      real(wp), allocatable :: momentum(:, :)   !! M Phi (dof, mode): q = (M Phi)' x
      real(wp), allocatable :: direction(:, :)  !! W (dof, joint)
      real(wp), allocatable :: push(:, :)       !! S (row, joint)
      real(wp), allocatable :: load(:, :)       !! h^2 Phi' b (row, force)
      !> G of displacements and, of blocks of two ports, of velocities (.., port), Phi of both (..,
      !> 1:2), by fours of joints and dofs, see by_fours
      real(wp), allocatable :: reads(:, :, :, :), shape(:, :, :, :)
      !> (entry, end, block) from both numbers, then push and its rise by ports; to both numbers at
      !> 1, by ports to p, then p', at 1/2 less those of the path through both ends, and to p' now
      !> (M3), (M4)
      real(wp), allocatable :: rotation(:, :, :)
      real(wp), allocatable :: weight(:, :, :)  !! (0:moment, number, row) (M6)
      !> Y_0, Y_1, Y_2 (joint, joint of the slider, 0:2), joints padded to whole registers (M5)
      real(wp), allocatable :: markov(:, :, :)
      !> (joint of the slider) bound of the answers to a slider that moves at rate 1 (M10)
      real(wp), allocatable :: coupling(:)
      real(wp), allocatable :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      real(wp), allocatable :: modal_load(:, :)         !! h^2 Phi' b (mode, force)
      type(modal_ledger) :: ledger
   contains
      procedure :: work
   end type modal_operators

contains

   !> Multiplications of one sample in one part, transitions aside (11).
   pure real(wp) function work(self)
      class(modal_operators), intent(in) :: self
      real(wp), parameter :: of_guard = 30.0_wp, moving = 0.25_wp   ! of the sliders
      integer :: k

      work = (self%n_moments + 1.0_wp)*size(self%push) + size(self%weight)
      do k = 3, path_degree
         work = work + padded(self%n_joints)*self%n_joints*max(0, k - 1 - self%first_power(k))
      end do
      work = moving*work + of_guard*self%n_joints + self%n_modes*size(self%rotation, 1)**2 &
             + padded(self%n_joints)*self%blocks%ports*sum(self%n_modes + 1.0_wp - self%first_read)
   end function work

   !> n, rounded up to whole fours.
   pure integer function padded(n)
      integer, intent(in) :: n

      padded = four*((n + four - 1)/four)
   end function padded

   !> A matrix by fours of rows, padded with zeros: (row of the four, column, four).
   pure function by_fours(matrix) result(fours)
      real(wp), intent(in) :: matrix(:, :)
      real(wp) :: fours(four, size(matrix, 2), padded(size(matrix, 1))/four)
      integer :: i

      fours = 0.0_wp
      do i = 1, size(matrix, 1)
         fours(1 + modulo(i - 1, four), :, 1 + (i - 1)/four) = matrix(i, :)
      end do
   end function by_fours

   !> Prepares the form for as many parts a step as the tolerance needs, relative to the rms.
   subroutine new_modal_operators(structure, dt, tolerance, operators, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_operators), intent(out) :: operators
      type(error_type), allocatable, intent(out) :: error
      type(joint_feel) :: joints
      integer :: i, m, r

      operators%n_modes = structure%n_dof
      operators%n_joints = structure%n_joints
      operators%n_forces = structure%n_forces
      call feel_joints(structure, joints)
      operators%n_parts = count_parts(structure, joints, dt, tolerance)
      operators%h = dt/operators%n_parts
      ! zero where rounding hides it
      operators%rate = operators%h*(two_pi*structure%frequencies_stuck)
      if (size(structure%damping_ratio) > 0) then
         allocate (operators%damping(structure%n_dof, structure%n_dof), source=0.0_wp)
         do r = 1, structure%n_dof
            operators%damping(r, r) = 2.0_wp*structure%damping_ratio(r) &
                                      *(two_pi*structure%frequencies_stuck(r))*operators%h
         end do
      else
         operators%damping = operators%h*matmul(transpose(structure%modes_stuck), &
                                                matmul(structure%damping, structure%modes_stuck))
      end if
      call new_modal_blocks(operators%rate, operators%damping, operators%blocks, error)
      if (allocated(error)) return

      allocate (operators%direction, source=structure%direction)
      operators%momentum = matmul(structure%mass, structure%modes_stuck)
      operators%modal_load = operators%h**2*matmul(transpose(structure%modes_stuck), &
                                                   structure%load)
      operators%load = operators%blocks%pushes(operators%modal_load)
      call choose_terms(structure%joint_stiffness, joints, operators%rate, operators%damping, &
                        operators%blocks, tolerance, operators)
      m = structure%n_joints
      associate (n => structure%n_dof, rows => operators%n_rows, ports => operators%blocks%ports)
         rows = ports*n
         allocate (operators%push(padded(rows), m), &
                   operators%reads(four, rows, padded(m)/four, ports), &
                   operators%shape(four, rows, padded(n)/four, 2), &
                   operators%weight(0:operators%n_moments, 2, padded(rows)), &
                   operators%rotation(2 + 2*ports, 4 + 2*ports, n), &
                   operators%markov(whole_registers(m), m, 0:n_markov - 1), source=0.0_wp)
         do i = 1, m
            operators%push(:rows, i:i) = operators%blocks%pushes( &
                                         reshape(operators%h**2*structure%joint_stiffness(i) &
                                                 *joints%gain(i, :), [n, 1]))
         end do
         do i = 1, 2
            operators%shape(:, :, :, i) = by_fours(operators%blocks%reads(structure%modes_stuck, &
                                                                          i == 2))
            if (i <= ports) operators%reads(:, :, :, i) = &
               by_fours(operators%blocks%reads(joints%gain, i == 2))
         end do
      end associate
      call put_blocks(operators%blocks%reads(joints%gain, .false.), operators)
      operators%coupling = [(maxval(sum(abs(operators%markov(:, i, :)), 2)), i=1, m)]
   end subroutine new_modal_operators

   !> Takes each block by itself: the exponential of its numbers, pushes and rises over the part
   !> (M3), the moments of its kernel (M6), and its answer to sliders (M5): the integral of H(t - s)
   !> zeta(s), H(s) = G E(s) S, E the displacement after a unit impulse. H is taken as Y_0 s + Y_1
   !> s^2/2 + Y_2 s^3/6, its least-squares fit on [0, 1] from its moments.
   pure subroutine put_blocks(gain, operators)
      real(wp), intent(in) :: gain(:, :)   !! G (joint, row)
      type(modal_operators), intent(inout) :: operators
      !> of the normal equations 1/(i + j + 1)
      real(wp), parameter :: inverse(3, 3) = reshape([300.0_wp, -900.0_wp, 630.0_wp, -900.0_wp, &
                                                      2880.0_wp, -2100.0_wp, 630.0_wp, -2100.0_wp, &
                                                      1575.0_wp], [3, 3])
      type(exponential_type) :: half, full
      real(wp), dimension(size(operators%rotation, 1), size(operators%rotation, 1)) :: a, ends, &
                                                                                      middle, slope
      real(wp), allocatable :: fit(:, :)
      real(wp) :: kernel(operators%blocks%ports, operators%blocks%ports)
      real(wp) :: scale   ! of the second number, so that A is balanced
      integer :: b, d, i, k, last, m, n, ports

      m = operators%n_joints
      fit = kernel_fit(operators%n_moments)
      last = size(fit, 1) - 1
      ports = operators%blocks%ports
      n = 2 + 2*ports
      do b = 1, operators%n_modes
         a = 0.0_wp
         a(:2, :2) = operators%blocks%block(:, :, b)
         scale = 1.0_wp
         if (abs(a(1, 2)) > 0.0_wp) scale = max(1.0_wp, sqrt(abs(a(2, 1)/a(1, 2))))
         do i = 1, ports
            a(2 - ports + i, 2 + i) = 1.0_wp
            a(2 + i, 2 + ports + i) = 1.0_wp
         end do
         operators%rotation(:, n + 1:, b) = transpose(a(:2, :))
         a(:, 2) = a(:, 2)*scale
         a(2, :) = a(2, :)/scale
         call find_exponential(a, a(:, 3:2 + ports), max(n_markov, last + 1), half, full)
         ends = unit_matrix(n) + full%value
         slope = a + matmul(a, full%value)
         middle = half%value - 0.5_wp*ends &
                  - (0.125_wp + operators%square/384.0_wp)*(2.0_wp*a - slope)
         slope = matmul(a, half%value) - 1.5_wp*(full%value - unit_matrix(n)) + 0.25_wp*slope
         ends(:2, :) = full%value(:2, :)
         ends(3:2 + ports, :) = middle(:ports, :)
         ends(3 + ports:, :) = slope(:ports, :)
         ends(2:4*ports - 2:2, :) = ends(2:4*ports - 2:2, :)*scale
         ends(:, 2) = ends(:, 2)/scale
         operators%rotation(:, :n, b) = transpose(ends)
         associate (rows => [(ports*(b - 1) + i, i=1, ports)])
            full%moment(2, :, :) = full%moment(2, :, :)*scale
            do i = 1, 2
               operators%weight(:last, i, rows) = matmul(fit, &
                                                         transpose(full%moment(i, :, 0:last + 1)))
            end do
            do d = 0, n_markov - 1
               kernel = 0.0_wp
               do k = 1, n_markov
                  kernel = kernel + factorial(d + 1)*inverse(d + 1, k)*full%moment(:ports, :, k)
               end do
               operators%markov(:m, :, d) = operators%markov(:m, :, d) + matmul( &
                                            gain(:, rows), &
                                            matmul(kernel, operators%push(rows, :)))
            end do
         end associate
      end do
   end subroutine put_blocks

   !> Weights of I_0 .. I_n of a slider's motion zeta from the moments of a kernel, integral of
   !> kernel(s) s^p: those with which the integral of kernel(1 - s) zeta(s) is exact where zeta is t
   !> or t^(i+1) (1 - t), i = 0 .. n - 1 (M6). These conditions have whole numbers as solutions.
   pure function kernel_fit(n) result(fit)
      integer, intent(in) :: n                             !! 2, or 4 and more, of which 4 count
      real(wp) :: fit(0:min(n, 4), 0:min(n, 4) + 1)   !! (weight, p)
      integer, parameter :: of_two(4, 0:2) = reshape([ &
                                             1, -9, 18, -10, &
                                             0, 36, -96, 60, &
                                             0, -60, 180, -120], [4, 3])
      integer, parameter :: of_four(6, 0:4) = reshape([ &
                                              1, -25, 150, -350, 350, -126, &
                                              0, 300, -2400, 6300, -6720, 2520, &
                                              0, -2100, 18900, -52920, 58800, -22680, &
                                              0, 8400, -80640, 235200, -268800, 105840, &
                                              0, -15120, 151200, -453600, 529200, -211680], [6, 5])

      if (n == 2) then
         fit = transpose(of_two)
      else
         fit = transpose(of_four)
      end if
   end function kernel_fit

end module dynamics_exact_modal_operators
