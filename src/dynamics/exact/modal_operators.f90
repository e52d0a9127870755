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
   use dynamics_exact_modal_terms, only: choose_terms, count_parts, feel_joints, joint_feel, &
                                         modal_terms, n_markov, path_degree
   use numerics_dense_product, only: pack_matrix, packed_matrix, padded_rows
   use numerics_exponential, only: exponential_type, find_exponential
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: kernel_fit, modal_operators, new_modal_operators

   !> Operators of one part of a step. A row of ports is a number of a block that loads push and
   !> joints read: a mode where C^ is diagonal.
   type, extends(modal_terms) :: modal_operators
      integer :: n_modes = 0, n_joints = 0
      integer :: n_rows = 0                     !! of ports
      type(modal_blocks) :: blocks
      real(wp), allocatable :: momentum(:, :)   !! M Phi (dof, mode): q = (M Phi)' x
      real(wp), allocatable :: slider_push(:, :)   !! S (row, joint)
      real(wp), allocatable :: load(:, :)       !! h^2 Phi' b (row, force)
      real(wp), allocatable :: direction(:, :)  !! W (dof, joint)
      !> (entry, end, block) from both numbers, the pushes and their rises to both numbers at 1, and
      !> to p of the ports, then p', at 1/2 less those of the cubic through both ends (M3), (M4)
      real(wp), allocatable :: rotation(:, :, :)
      real(wp), allocatable :: weight(:, :, :, :)   !! (0:moment, port, number, block) (M6)
      !> G of displacements, velocities, and both at half the part, of the blocks that are read; S;
      !> Phi of displacements and velocities
      type(packed_matrix) :: reads(4), push, shape(2)
      type(packed_matrix) :: answer(3:path_degree)   !! power k of a path from the sliders' (M5)
      real(wp), allocatable :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      real(wp), allocatable :: modal_load(:, :)         !! h^2 Phi' b (mode, force)
      type(modal_ledger) :: ledger
      !> Y_0, Y_1, Y_2 (joint, joint of the slider), joints padded to whole registers (M5)
      real(wp), allocatable :: markov(:, :)
   contains
      procedure :: work
   end type modal_operators

contains

   !> Multiplications of one sample in one part, transitions aside.
   pure real(wp) function work(self)
      class(modal_operators), intent(in) :: self
      integer :: k

      work = 80.0_wp*self%n_joints   ! polynomials, integrals, guards
      do k = 3, path_degree
         work = work + size(self%answer(k)%value)
      end do
      do k = 1, 4
         work = work + size(self%reads(k)%value)
      end do
      work = work + size(self%rotation) + size(self%weight) &
             + (self%n_moments + 1.0_wp)*size(self%push%value)
   end function work

   !> Prepares the form for as many parts a step as the tolerance needs, relative to the rms.
   subroutine new_modal_operators(structure, dt, tolerance, operators, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_operators), intent(out) :: operators
      type(error_type), allocatable, intent(out) :: error
      type(joint_feel) :: joints
      real(wp), allocatable :: gain(:, :), moved(:, :, :)
      integer :: i, r

      operators%n_modes = structure%n_dof
      operators%n_joints = structure%n_joints
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
      operators%slider_push = operators%blocks%pushes( &
                              operators%h**2*transpose(spread(structure%joint_stiffness, 2, &
                                                              structure%n_dof)*joints%gain))
      operators%n_rows = size(operators%slider_push, 1)
      call choose_terms(structure%joint_stiffness, joints, operators%rate, operators%damping, &
                        operators%blocks, tolerance, operators)
      do i = 4, 1, -1
         gain = operators%blocks%reads(joints%gain, i == 2)
         associate (first => operators%blocks%ports*(operators%first_read(i) - 1) + 1)
            call pack_matrix(gain(:, first:), operators%reads(i))
         end associate
      end do
      do i = 1, 2
         call pack_matrix(operators%blocks%reads(structure%modes_stuck, i == 2), &
                          operators%shape(i))
      end do
      call pack_matrix(operators%slider_push, operators%push)
      call put_rotations(operators, moved)
      call put_answers(gain, moved, operators)
   end subroutine new_modal_operators

   !> Takes each block by itself: a 2 x 2 exponential and its moments (M3), (M6).
   pure subroutine put_rotations(operators, moved)
      type(modal_operators), intent(inout) :: operators
      real(wp), allocatable, intent(out) :: moved(:, :, :)   !! see put_answers
      type(exponential_type) :: half, full
      real(wp) :: a(2, 2), b(2, operators%blocks%ports), scale
      real(wp) :: fit(0:operators%n_moments, 0:operators%n_moments + 1)
      real(wp), dimension(2, 2 + 2*operators%blocks%ports) :: at_0, at_half, at_1, middle, slope
      integer :: i, k, last, n, ports, r

      last = operators%n_moments
      fit = kernel_fit(last)
      ports = operators%blocks%ports
      n = 2 + 2*ports
      allocate (operators%rotation(n, n, operators%n_modes), &
                operators%weight(0:last, ports, 2, operators%n_modes), &
                moved(operators%n_rows, operators%n_joints, n_markov))
      do r = 1, operators%n_modes
         scale = 1.0_wp   ! of the second number, so that the matrix is balanced
         if (ports == 1) scale = max(1.0_wp, operators%rate(r))
         a = operators%blocks%block(:, :, r)
         a(1, 2) = a(1, 2)*scale
         a(2, 1) = a(2, 1)/scale
         b(:, ports) = [0.0_wp, 1.0_wp/scale]
         if (ports == 2) b(:, 1) = [1.0_wp, 0.0_wp]
         call find_exponential(a, b, max(n_markov, last + 1), half, full)
         at_0 = 0.0_wp
         at_0(1, 1) = 1.0_wp
         at_0(2, 2) = 1.0_wp/scale
         at_half = numbers_at(0.5_wp, half)
         at_1 = numbers_at(1.0_wp, full)
         middle = at_half - 0.5_wp*(at_0 + at_1) &
                  - 0.125_wp*(rates_at(0.0_wp, at_0) - rates_at(1.0_wp, at_1))
         slope = rates_at(0.5_wp, at_half) - 1.5_wp*(at_1 - at_0) &
                 + 0.25_wp*(rates_at(0.0_wp, at_0) + rates_at(1.0_wp, at_1))
         at_1(2, :) = at_1(2, :)*scale
         operators%rotation(:, :, r) = reshape([transpose(at_1), transpose(middle(:ports, :)), &
                                                transpose(slope(:ports, :))], [n, n])
         do i = 1, 2
            operators%weight(:, :, i, r) = matmul(fit, transpose(full%moment(i, :, 0:last + 1))) &
                                           *merge(scale, 1.0_wp, i == 2)
         end do
         associate (push => operators%slider_push(ports*(r - 1) + 1:ports*r, :))
            do k = 1, n_markov
               moved(ports*(r - 1) + 1:ports*r, :, k) = matmul(full%moment(:ports, :, k), push)
            end do
         end associate
      end do

   contains

      !> Factors of both numbers, the pushes and their rises in both numbers after a time.
      pure function numbers_at(time, of) result(factors)
         real(wp), intent(in) :: time
         type(exponential_type), intent(in) :: of
         real(wp) :: factors(2, n)

         factors(:, 1) = of%value(:, 1)
         factors(:, 2) = of%value(:, 2)/scale
         factors(:, 3:2 + ports) = of%moment(:, :, 0)
         factors(:, 3 + ports:) = time*of%moment(:, :, 0) - of%moment(:, :, 1)
      end function numbers_at

      !> The same of their rates.
      pure function rates_at(time, numbers) result(factors)
         real(wp), intent(in) :: time, numbers(2, n)
         real(wp) :: factors(2, n)

         factors = matmul(a, numbers)
         factors(:, 3:2 + ports) = factors(:, 3:2 + ports) + b
         factors(:, 3 + ports:) = factors(:, 3 + ports:) + time*b
      end function rates_at

   end subroutine put_rotations

   !> Weights of I_0 .. I_n of a slider's motion zeta from the moments of a kernel, integral of
   !> kernel(s) s^p: those with which the integral of kernel(1 - s) zeta(s) is exact where zeta is t
   !> or t^(i+1) (1 - t), i = 0 .. n - 1 (M6).
   pure function kernel_fit(n) result(fit)
      integer, intent(in) :: n
      real(wp) :: fit(0:n, 0:n + 1)   !! (weight, p)
      real(wp) :: a(0:n - 1, n), factorial(0:2*n + 2), binomial
      integer :: i, k, p

      factorial = [(gamma(k + 1.0_wp), k=0, 2*n + 2)]
      fit = 0.0_wp
      do i = 0, n - 1
         do k = 1, n   ! I_k
            a(i, k) = factorial(i + 1)/factorial(i + 1 + k) - factorial(i + 2)/factorial(i + 2 + k)
         end do
         binomial = 1.0_wp
         do p = 1, i + 2   ! s (1 - s)^(i+1)
            fit(i + 1, p) = binomial
            binomial = -binomial*(i + 2 - p)/p
         end do
      end do
      do i = 0, n - 1   ! Gauss and Jordan
         fit(i + 1, :) = fit(i + 1, :)/a(i, i + 1)
         a(i, :) = a(i, :)/a(i, i + 1)
         do k = 0, n - 1
            if (k == i) cycle
            fit(k + 1, :) = fit(k + 1, :) - a(k, i + 1)*fit(i + 1, :)
            a(k, :) = a(k, :) - a(k, i + 1)*a(i, :)
         end do
      end do
      fit(0, 0:1) = [1.0_wp, -1.0_wp]
      do k = 1, n
         fit(0, :) = fit(0, :) - fit(k, :)/factorial(k + 1)
      end do
   end function kernel_fit

   !> Adds the answers of the joints to a slider: the integral of H(t - s) zeta(s), H(s) = G E(s) S,
   !> E the displacement after a unit impulse. H is taken as Y_0 s + Y_1 s^2/2 + Y_2 s^3/6, its
   !> least-squares fit on [0, 1] from its moments, so power e of a slider adds Y_d e!/k! to power k
   !> = e + d + 2 of a path (M5).
   pure subroutine put_answers(gain, moved, operators)
      real(wp), intent(in) :: gain(:, :)      !! G (joint, row)
      real(wp), intent(in) :: moved(:, :, :)  !! integrals of E(s) s^p S (row, joint, p), p = 1 ..
      type(modal_operators), intent(inout) :: operators
      !> of the normal equations 1/(i + j + 1)
      real(wp), parameter :: inverse(3, 3) = reshape([300.0_wp, -900.0_wp, 630.0_wp, -900.0_wp, &
                                                      2880.0_wp, -2100.0_wp, 630.0_wp, -2100.0_wp, &
                                                      1575.0_wp], [3, 3])
      real(wp) :: answer(size(gain, 1), padded_rows(size(gain, 1))*n_markov)
      integer :: d, e, k, m, mp

      m = size(gain, 1)
      mp = padded_rows(m)
      allocate (operators%markov(whole_registers(m), m*n_markov), source=0.0_wp)
      do d = 0, n_markov - 1
         associate (markov => operators%markov(:m, d*m + 1:(d + 1)*m))
            do k = 1, n_markov
               markov = markov + inverse(d + 1, k)*gamma(real(d + 2, wp)) &
                        *matmul(gain, moved(:, :, k))
            end do
         end associate
      end do
      do k = 3, path_degree
         associate (first => operators%first_power(k))
            answer = 0.0_wp
            do e = first, k - 2
               d = k - 2 - e
               answer(:, (e - first)*mp + 1:(e - first)*mp + m) = &
                  operators%markov(:m, d*m + 1:(d + 1)*m) &
                  *(gamma(real(e + 1, wp))/gamma(real(k + 1, wp)))
            end do
            call pack_matrix(answer(:, :(k - 1 - first)*mp), operators%answer(k))
         end associate
      end do
   end subroutine put_answers

end module dynamics_exact_modal_operators
