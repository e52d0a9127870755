!> Operators of the modal form for one part of a step: the free motion of the modes of the structure
!> with all joints stuck, and what moving sliders add to it.
!>
!> Time t runs from 0 to 1 over the part of length h. With x = Phi q, Phi' M Phi = 1, all joints
!> stuck: q'' + C^ q' + Omega^2 q = f(t) + S zeta(t), C^ = h Phi' C Phi, Omega = h omega, f the load
!> and the pull of the sliders at the start of the part, zeta the motion of the sliders since then,
!> S = h^2 Phi' W k. The path of joint j is u_j = (G q)_j, G = W' Phi. Numbers in brackets are
!> formulas of docs/modal_march.md.
module dynamics_exact_modal_operators
   use core_alignment, only: whole_registers
   use core_error, only: error_type
   use core_kinds, only: two_pi, wp
   use dynamics_exact_modal_blocks, only: modal_blocks, new_modal_blocks
   use dynamics_exact_modal_ledger, only: modal_ledger
   use dynamics_exact_modal_terms, only: choose_terms, parts_of_step, factorial, &
                                         find_joint_properties, joint_properties, modal_terms, &
                                         n_markov, path_degree
   use numerics_exponential, only: exponential_type, find_exponential
   use numerics_lapack, only: unit_matrix
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: strip, kernel_fit, modal_operators, new_modal_operators

   integer, parameter :: strip = 4   !! rows of a strip, whose sums stay in registers

   !> Operators of one part of a step. A row is a port of a block, and a mode if C^ is diagonal.
   !> Rows, joints and dofs are padded to whole strips.
   type, extends(modal_terms) :: modal_operators
      integer :: n_modes = 0, n_joints = 0, n_forces = 0
      integer :: n_rows = 0                     !! number of ports of all blocks
      type(modal_blocks) :: blocks
      real(wp), allocatable :: momentum(:, :)   !! M Phi (dof, mode): q = (M Phi)' x
      real(wp), allocatable :: push(:, :)       !! S (row, joint)
      real(wp), allocatable :: load(:, :)       !! h^2 Phi' b (row, force)
      !> Ports to w.x and, if blocks have two ports, to w.v (.., 1:ports); to x and v of the dofs
      !> (.., 1:2): matrices by strips of joints and of dofs, see by_strips
      real(wp), allocatable :: outputs(:, :, :, :), shape(:, :, :, :)
      !> (input, output, block) (M3), (M4). Inputs: p, then force and its rise of each port.
      !> Outputs: p at 1; of each port what p at 1/2, then what p' at 1/2 adds to the cubic; p' at 0
      real(wp), allocatable :: propagator(:, :, :)
      !> (joint of the strip, force, strip, 1:2) what the rise of a force adds to e and s of a joint
      !> by the blocks that are not read at half the part (M4)
      real(wp), allocatable :: rise(:, :, :, :)
      real(wp), allocatable :: weight(:, :, :)  !! w_k (0:moment, variable, row) (M6)
      !> Y_0, Y_1, Y_2 (joint, joint of the slider, 0:2), joints padded to whole registers (M5)
      real(wp), allocatable :: markov(:, :, :)
      !> (joint of the slider) bound of the responses of all joints to a slider of speed 1 (M10)
      real(wp), allocatable :: coupling(:)
      real(wp), allocatable :: damping(:, :)      !! C^ (mode, mode)
      real(wp), allocatable :: modal_load(:, :)   !! h^2 Phi' b (mode, force)
      type(modal_ledger) :: ledger
   contains
      procedure :: work
   end type modal_operators

contains

   !> Multiplications of one sample in one part without transitions (11).
   pure real(wp) function work(self)
      class(modal_operators), intent(in) :: self
      real(wp), parameter :: per_guard = 30.0_wp, moving_share = 0.25_wp   ! moving sliders
      integer :: k

      work = (self%n_moments + 1.0_wp)*size(self%push) + size(self%weight)
      do k = 3, path_degree
         work = work + padded(self%n_joints)*self%n_joints*max(0, k - 1 - self%first_power(k))
      end do
      work = moving_share*work + per_guard*self%n_joints &
             + self%n_modes*size(self%propagator, 1)**2 &
             + padded(self%n_joints)*self%blocks%ports &
             *(2.0_wp*self%n_modes + sum(self%n_modes + 1.0_wp - self%first_midpoint))
   end function work

   !> n, rounded up to whole strips.
   pure integer function padded(n)
      integer, intent(in) :: n

      padded = strip*((n + strip - 1)/strip)
   end function padded

   !> A matrix by strips of rows, padded with zeros: (row of the strip, column, strip).
   pure function by_strips(matrix) result(strips)
      real(wp), intent(in) :: matrix(:, :)
      real(wp) :: strips(strip, size(matrix, 2), padded(size(matrix, 1))/strip)
      integer :: i

      strips = 0.0_wp
      do i = 1, size(matrix, 1)
         strips(1 + modulo(i - 1, strip), :, 1 + (i - 1)/strip) = matrix(i, :)
      end do
   end function by_strips

   !> Prepares the operators for as many parts in a step as the tolerance needs.
   subroutine new_modal_operators(structure, dt, tolerance, operators, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance   !! relative to the rms displacement
      type(modal_operators), intent(out) :: operators
      type(error_type), allocatable, intent(out) :: error
      type(joint_properties) :: joints
      real(wp) :: rate(structure%n_dof)   ! Omega
      integer :: i, m

      operators%n_modes = structure%n_dof
      operators%n_joints = structure%n_joints
      operators%n_forces = structure%n_forces
      call find_joint_properties(structure, joints)
      rate = dt*(two_pi*structure%frequencies_stuck)
      call new_modal_blocks(rate, dt*joints%damping, operators%blocks, error)
      if (allocated(error)) return
      operators%n_parts = parts_of_step(joints, operators%blocks, dt, tolerance)
      operators%h = dt/operators%n_parts
      operators%damping = operators%h*joints%damping
      operators%blocks = operators%blocks%scaled(1.0_wp/operators%n_parts)
      rate = rate/operators%n_parts
      operators%momentum = matmul(structure%mass, structure%modes_stuck)
      operators%modal_load = operators%h**2*matmul(transpose(structure%modes_stuck), &
                                                   structure%load)
      operators%load = operators%blocks%inputs(operators%modal_load)
      call choose_terms(joints, operators%modal_load, rate, operators%damping, operators%blocks, &
                        tolerance, operators)
      m = structure%n_joints
      associate (n => structure%n_dof, rows => operators%n_rows, ports => operators%blocks%ports)
         rows = ports*n
         allocate (operators%push(padded(rows), m), &
                   operators%outputs(strip, rows, padded(m)/strip, ports), &
                   operators%shape(strip, rows, padded(n)/strip, 2), &
                   operators%weight(0:operators%n_moments, 2, padded(rows)), &
                   operators%propagator(2 + 2*ports, 4 + 2*ports, n), &
                   operators%markov(whole_registers(m), m, 0:n_markov - 1), source=0.0_wp)
         do i = 1, m
            operators%push(:rows, i:i) = operators%blocks%inputs( &
                                         reshape(operators%h**2*structure%joint_stiffness(i) &
                                                 *joints%gain(i, :), [n, 1]))
         end do
         do i = 1, 2
            operators%shape(:, :, :, i) = &
               by_strips(operators%blocks%outputs(structure%modes_stuck, i == 2))
            if (i <= ports) operators%outputs(:, :, :, i) = &
               by_strips(operators%blocks%outputs(joints%gain, i == 2))
         end do
      end associate
      call form_blocks(operators%blocks%outputs(joints%gain, .false.), operators)
      call form_rise(operators%blocks%outputs(joints%gain, .false.), operators)
      operators%coupling = [(maxval(sum(abs(operators%markov(:, i, :)), 2)), i=1, m)]
   end subroutine new_modal_operators

   !> Forms the operators of each block: its propagator (M3), the weights of the sliders' integrals
   !> (M6), and its share in the response of joints to sliders (M5), the integral of H(t - s)
   !> zeta(s), H(s) = G E(s) S, E the displacement after a unit impulse. H is fitted by Y_0 s +
   !> Y_1 s^2/2 + Y_2 s^3/6, least squares on [0, 1], from its moments.
   pure subroutine form_blocks(gain, operators)
      real(wp), intent(in) :: gain(:, :)   !! G (joint, row)
      type(modal_operators), intent(inout) :: operators
      !> Inverse of the normal equations' matrix 1/(i + j + 1)
      real(wp), parameter :: inverse(3, 3) = reshape([300.0_wp, -900.0_wp, 630.0_wp, -900.0_wp, &
                                                      2880.0_wp, -2100.0_wp, 630.0_wp, -2100.0_wp, &
                                                      1575.0_wp], [3, 3])
      type(exponential_type) :: half, full
      real(wp), dimension(size(operators%propagator, 1), size(operators%propagator, 1)) :: &
         a, ends, middle, slope
      real(wp), allocatable :: fit(:, :)
      real(wp) :: kernel(operators%blocks%ports, operators%blocks%ports)
      real(wp) :: scale   ! scale of the second variable
      integer :: b, d, i, k, last, m, n, ports

      m = operators%n_joints
      fit = kernel_fit(operators%n_moments)
      last = size(fit, 1) - 1
      ports = operators%blocks%ports
      n = 2 + 2*ports
      do b = 1, operators%n_modes
         a = 0.0_wp
         a(:2, :2) = operators%blocks%block(:, :, b)
         scale = operators%blocks%balance(b)
         do i = 1, ports
            a(2 - ports + i, 2 + i) = 1.0_wp
            a(2 + i, 2 + ports + i) = 1.0_wp
         end do
         operators%propagator(:, n + 1:, b) = transpose(a(:2, :))
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
         operators%propagator(:, :n, b) = transpose(ends)
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
   end subroutine form_blocks

   !> Forms what the rises of the forces add at half the part by blocks that are not read there.
   pure subroutine form_rise(gain, operators)
      real(wp), intent(in) :: gain(:, :)   !! G (joint, row)
      type(modal_operators), intent(inout) :: operators
      real(wp) :: added(size(gain, 2), operators%n_forces)   ! (row, force)
      integer :: b, i, k

      allocate (operators%rise(strip, operators%n_forces, size(operators%outputs, 3), 2))
      associate (ports => operators%blocks%ports)
         do k = 1, 2
            added = 0.0_wp
            do b = 1, operators%first_midpoint(k) - 1
               associate (rows => [(ports*(b - 1) + i, i=1, ports)])
                  added(rows, :) = matmul( &
                     transpose(operators%propagator(3 + ports:2 + 2*ports, &
                                                    3 + ports*(k - 1):2 + ports*k, b)), &
                     operators%load(rows, :))
               end associate
            end do
            operators%rise(:, :, :, k) = by_strips(matmul(gain, added))
         end do
      end associate
   end subroutine form_rise

   !> Factors of a kernel's moments, the integrals of kernel(s) s^p, in the weights w_k of (M6): the
   !> integral of kernel(1 - s) zeta(s) is sum w_k I_k, exactly if zeta is t or t^(i+1) (1 - t),
   !> i = 0 .. n - 1. The solutions of these conditions are whole numbers.
   pure function kernel_fit(n) result(fit)
      integer, intent(in) :: n                        !! 2, or 4 and more, which give the same
      real(wp) :: fit(0:min(n, 4), 0:min(n, 4) + 1)   !! (weight, p)
      integer, parameter :: fit_2(4, 0:2) = reshape([ &
                                            1, -9, 18, -10, &
                                            0, 36, -96, 60, &
                                            0, -60, 180, -120], [4, 3])
      integer, parameter :: fit_4(6, 0:4) = reshape([ &
                                            1, -25, 150, -350, 350, -126, &
                                            0, 300, -2400, 6300, -6720, 2520, &
                                            0, -2100, 18900, -52920, 58800, -22680, &
                                            0, 8400, -80640, 235200, -268800, 105840, &
                                            0, -15120, 151200, -453600, 529200, -211680], [6, 5])

      if (n == 2) then
         fit = transpose(fit_2)
      else
         fit = transpose(fit_4)
      end if
   end function kernel_fit

end module dynamics_exact_modal_operators
