!> Operators of the modal form: free motion in the modes of the structure with all joints stuck, and
!> what moving sliders add to it, over one part of a step.
!>
!> Time t runs from 0 to 1 over the part of length h. With x = Phi q, Phi' M Phi = 1, all joints
!> stuck: q'' + C^ q' + Omega^2 q = f(t) + S zeta(t), C^ = h Phi' C Phi, Omega = h omega, f the load
!> and the sliders at the start of the part, zeta the motion of the sliders since then, S = h^2 Phi'
!> W k. The path of joint j is u_j = (G q)_j, G = W' Phi. Numbers in brackets are formulas of
!> docs/exact_march.md.
module dynamics_exact_modal_operators
   use core_kinds, only: two_pi, wp
   use dynamics_exact_modal_ledger, only: modal_ledger
   use dynamics_exact_modal_terms, only: choose_terms, count_parts, joint_gain, modal_terms, &
                                         n_markov, path_degree
   use numerics_dense_product, only: pack_matrix, packed_matrix, padded_rows
   use numerics_exponential, only: exponential_type, find_exponential
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: modal_operators, new_modal_operators

   !> Operators of one part of a step; rows and columns are modes or joints.
   type, extends(modal_terms) :: modal_operators
      integer :: n_modes = 0, n_joints = 0
      logical :: decouples = .true.   !! C^ is diagonal
      real(wp), allocatable :: momentum(:, :)   !! M Phi (dof, mode): q = (M Phi)' x
      real(wp), allocatable :: slider_push(:, :)   !! S (mode, joint)
      real(wp), allocatable :: load(:, :)       !! h^2 Phi' b (mode, force)
      real(wp), allocatable :: direction(:, :)  !! W (dof, joint)
      !> (entry, mode), where C^ decouples: q, q' at 1 and at 1/2 from q, q', f(0), f' (M3)
      real(wp), allocatable :: rotation(:, :)
      !> (0:moment, q or q', mode) where C^ decouples (M6)
      real(wp), allocatable :: weight(:, :, :)
      type(packed_matrix) :: propagator         !! as rotation, but of all modes and without f'
      real(wp), allocatable :: rise(:, :)       !! (row of propagator, force) of f'
      type(packed_matrix) :: kick               !! as weight, but of all modes: rows q, q'
      type(packed_matrix) :: read, push, shape   !! G, S, Phi
      type(packed_matrix) :: answer(3:path_degree)   !! power k of a path from the sliders' (M5)
      type(packed_matrix) :: rest               !! as kick, less the uniform motion of the sliders
      real(wp), allocatable :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      type(modal_ledger) :: ledger
      real(wp), allocatable :: markov(:, :, :)  !! Y_d (joint, joint of the slider, d) (M5)
   contains
      procedure :: work
      procedure :: propagate
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
      work = work + self%n_reads*size(self%read%value)
      if (self%decouples) then
         work = work + (16.0_wp + 2.0_wp*self%n_moments)*self%n_modes &
                + (self%n_moments + 1.0_wp)*size(self%push%value)
      else
         work = work + size(self%propagator%value) + size(self%kick%value) + size(self%push%value)
      end if
   end function work

   !> Takes all modes ahead together (M3).
   pure subroutine propagate(self, force, pushed, now, ahead)
      class(modal_operators), intent(in) :: self
      real(wp), intent(in) :: force(:, :, 0:)          !! (lane, force, power) [N]
      real(wp), intent(in) :: pushed(:, :)             !! (lane, mode) S z
      real(wp), intent(inout), contiguous :: now(:, :, :)     !! (.., 1:3) q, q', f(0)
      real(wp), intent(inout), contiguous :: ahead(:, :, :)   !! (.., 1:4) q, q' at 1, at 1/2
      integer :: f, r, row

      do r = 1, self%n_modes
         now(:, r, 3) = pushed(:, r)
         do f = 1, size(self%load, 2)
            now(:, r, 3) = now(:, r, 3) + self%load(r, f)*force(:, f, 0)
         end do
      end do
      call self%propagator%multiply(now, ahead)
      do f = 1, size(self%load, 2)
         do r = 1, 4
            do row = 1, size(ahead, 2)
               ahead(:, row, r) = ahead(:, row, r) + force(:, f, 1)* &
                                  self%rise((r - 1)*size(ahead, 2) + row, f)
            end do
         end do
      end do
   end subroutine propagate

   !> Prepares the form for as many parts a step as the tolerance needs, relative to the rms.
   subroutine new_modal_operators(structure, dt, tolerance, operators)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_operators), intent(out) :: operators
      real(wp), allocatable :: gain(:, :), damping(:, :), omega(:), moved(:, :, :)
      integer :: r

      omega = two_pi*structure%frequencies_stuck   ! zero where rounding hides it
      operators%n_modes = structure%n_dof
      operators%n_joints = structure%n_joints
      gain = joint_gain(structure)
      operators%n_parts = count_parts(structure, dt, tolerance)
      operators%h = dt/operators%n_parts
      operators%direction = structure%direction
      operators%momentum = matmul(structure%mass, structure%modes_stuck)
      operators%load = operators%h**2*matmul(transpose(structure%modes_stuck), structure%load)
      operators%slider_push = operators%h**2*transpose(spread(structure%joint_stiffness, 2, &
                                                              structure%n_dof)*gain)
      if (size(structure%damping_ratio) > 0) then
         allocate (damping(structure%n_dof, structure%n_dof), source=0.0_wp)
         do r = 1, structure%n_dof
            damping(r, r) = 2.0_wp*structure%damping_ratio(r)*omega(r)*operators%h
         end do
      else
         damping = operators%h*matmul(transpose(structure%modes_stuck), &
                                      matmul(structure%damping, structure%modes_stuck))
      end if
      operators%decouples = is_diagonal(damping)
      call choose_terms(structure%joint_stiffness, gain, operators%h*omega, damping, tolerance, &
                        operators)
      call pack_matrix(gain, operators%read)
      call pack_matrix(operators%slider_push, operators%push)
      call pack_matrix(structure%modes_stuck, operators%shape)
      if (operators%decouples) then
         call put_rotations(operators%h*omega, damping, operators, moved)
      else
         call put_propagator(operators%h*omega, damping, operators, moved)
      end if
      call put_answers(gain, moved, operators)
      operators%rate = operators%h*omega
      call move_alloc(damping, operators%damping)
   end subroutine new_modal_operators

   !> True if the coupling of modes is below rounding.
   pure logical function is_diagonal(damping)
      real(wp), intent(in) :: damping(:, :)
      real(wp), parameter :: negligible = 1.0e-10_wp
      integer :: r, s

      is_diagonal = .false.
      do s = 1, size(damping, 2)
         do r = 1, size(damping, 1)
            if (r /= s .and. abs(damping(r, s)) > &
                negligible*sqrt(abs(damping(r, r)*damping(s, s)))) return
         end do
      end do
      is_diagonal = .true.
   end function is_diagonal

   !> Takes each mode by itself: a 2 x 2 exponential and its moments (M3), (M6).
   pure subroutine put_rotations(rate, damping, operators, moved)
      real(wp), intent(in) :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      type(modal_operators), intent(inout) :: operators
      real(wp), allocatable, intent(out) :: moved(:, :, :)   !! see put_answers
      type(exponential_type) :: half, full
      real(wp) :: a(2, 2), b(2, 1), fit(0:operators%n_moments, 0:operators%n_moments + 1), scale
      integer :: k, last, r

      last = operators%n_moments
      fit = kernel_fit(operators%n_moments)
      allocate (operators%rotation(16, size(rate)), operators%weight(0:last, 2, size(rate)), &
                moved(size(rate), operators%n_joints, n_markov))
      do r = 1, size(rate)
         scale = max(1.0_wp, rate(r))   ! of q', so that the matrix is balanced
         a = reshape([0.0_wp, -rate(r)**2/scale, scale, -damping(r, r)], [2, 2])
         b = reshape([0.0_wp, 1.0_wp/scale], [2, 1])
         call find_exponential(a, b, max(n_markov, last + 1), half, full)
         associate (to => operators%rotation(:, r))
            to(9:12) = [half%value(1, 1), half%value(1, 2)/scale, half%moment(1, 1, 0), &
                        0.5_wp*half%moment(1, 1, 0) - half%moment(1, 1, 1)]
            to(13:16) = [half%value(2, 1)*scale, half%value(2, 2), half%moment(2, 1, 0)*scale, &
                         (0.5_wp*half%moment(2, 1, 0) - half%moment(2, 1, 1))*scale]
            to(1:4) = [full%value(1, 1), full%value(1, 2)/scale, full%moment(1, 1, 0), &
                       full%moment(1, 1, 0) - full%moment(1, 1, 1)]
            to(5:8) = [full%value(2, 1)*scale, full%value(2, 2), full%moment(2, 1, 0)*scale, &
                       (full%moment(2, 1, 0) - full%moment(2, 1, 1))*scale]
         end associate
         do k = 1, n_markov
            moved(r, :, k) = full%moment(1, 1, k)*operators%slider_push(r, :)
         end do
         operators%weight(:, 1, r) = matmul(fit, full%moment(1, 1, 0:last + 1))
         operators%weight(:, 2, r) = matmul(fit, full%moment(2, 1, 0:last + 1))*scale
      end do
   end subroutine put_rotations

   !> Takes all modes together: the exponential of the first-order system and its moments (M3),
   !> (M6).
   pure subroutine put_propagator(rate, damping, operators, moved)
      real(wp), intent(in) :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      type(modal_operators), intent(inout) :: operators
      real(wp), allocatable, intent(out) :: moved(:, :, :)   !! see put_answers
      type(exponential_type) :: half, full
      real(wp), dimension(2*size(rate), 2*size(rate)) :: a
      real(wp) :: b(2*size(rate), size(rate)), scale(size(rate))
      real(wp) :: fit(0:operators%n_moments, 0:operators%n_moments + 1)
      real(wp) :: kernel(2*size(rate), size(rate))
      real(wp), allocatable :: kick(:, :), propagator(:, :), uniform(:, :)
      integer :: i, k, last, m, n, np, r

      n = size(rate)
      np = padded_rows(n)
      last = operators%n_moments
      scale = max(1.0_wp, rate)
      a = 0.0_wp
      b = 0.0_wp
      do r = 1, n
         a(r, n + r) = scale(r)
         a(n + r, r) = -rate(r)**2/scale(r)
         a(n + r, n + 1:) = -damping(r, :)*scale/scale(r)
         b(n + r, r) = 1.0_wp/scale(r)
      end do
      call find_exponential(a, b, max(n_markov, last + 1), half, full)
      call unscale(half)
      call unscale(full)

      allocate (propagator(4*np, 3*np), source=0.0_wp)
      allocate (operators%rise(4*np, size(operators%load, 2)), source=0.0_wp)
      do i = 0, 1   ! rows q, q'; columns q, q', f(0)
         associate (rows => [(r, r=i*n + 1, i*n + n)], at_full => [(r, r=i*np + 1, i*np + n)], &
                    at_half => [(r, r=(i + 2)*np + 1, (i + 2)*np + n)])
            do k = 0, 1
               propagator(at_half, k*np + 1:k*np + n) = half%value(rows, k*n + 1:k*n + n)
               propagator(at_full, k*np + 1:k*np + n) = full%value(rows, k*n + 1:k*n + n)
            end do
            propagator(at_half, 2*np + 1:2*np + n) = half%moment(rows, :, 0)
            propagator(at_full, 2*np + 1:2*np + n) = full%moment(rows, :, 0)
            operators%rise(at_half, :) = matmul(0.5_wp*half%moment(rows, :, 0) - &
                                                half%moment(rows, :, 1), operators%load)
            operators%rise(at_full, :) = matmul(full%moment(rows, :, 0) - &
                                                full%moment(rows, :, 1), operators%load)
         end associate
      end do
      call pack_matrix(propagator, operators%propagator)

      allocate (moved(n, operators%n_joints, n_markov))
      do k = 1, n_markov
         moved(:, :, k) = matmul(full%moment(:n, :, k), operators%slider_push)
      end do
      m = padded_rows(operators%n_joints)
      fit = kernel_fit(operators%n_moments)
      allocate (kick(2*np, m*(last + 1)), source=0.0_wp)
      do k = 0, last
         kernel = 0.0_wp
         do i = 0, last + 1
            kernel = kernel + fit(k, i)*full%moment(:, :, i)
         end do
         kick(1:n, k*m + 1:k*m + operators%n_joints) = matmul(kernel(:n, :), operators%slider_push)
         kick(np + 1:np + n, k*m + 1:k*m + operators%n_joints) = matmul(kernel(n + 1:, :), &
                                                                        operators%slider_push)
      end do
      call pack_matrix(kick, operators%kick)
      uniform = matmul(full%moment(:, :, 0) - full%moment(:, :, 1), operators%slider_push)
      do i = 0, 1
         kick(i*np + 1:i*np + n, :operators%n_joints) = &
            kick(i*np + 1:i*np + n, :operators%n_joints) - uniform(i*n + 1:i*n + n, :)
      end do
      call pack_matrix(kick, operators%rest)

   contains

      !> Goes from scaled q' back to q'.
      pure subroutine unscale(of)
         type(exponential_type), intent(inout) :: of
         integer :: s

         do s = 1, n
            of%value(n + s, :) = of%value(n + s, :)*scale(s)
            of%value(:, n + s) = of%value(:, n + s)/scale(s)
            of%moment(n + s, :, :) = of%moment(n + s, :, :)*scale(s)
         end do
      end subroutine unscale

   end subroutine put_propagator

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

   !> Answers of the joints to a slider: the integral of H(t - s) zeta(s), H(s) = G E(s) S, E the
   !> displacement after a unit impulse. H is taken as Y_0 s + Y_1 s^2/2 + Y_2 s^3/6, its
   !> least-squares fit on [0, 1] from its moments, so power e of a slider adds Y_d e!/k! to power k
   !> = e + d + 2 of a path (M5).
   pure subroutine put_answers(gain, moved, operators)
      real(wp), intent(in) :: gain(:, :)      !! G (joint, mode)
      real(wp), intent(in) :: moved(:, :, :)  !! integrals of E(s) s^p S (mode, joint, p), p = 1 ..
      type(modal_operators), intent(inout) :: operators
      !> of the normal equations 1/(i + j + 1)
      real(wp), parameter :: inverse(3, 3) = reshape([300.0_wp, -900.0_wp, 630.0_wp, -900.0_wp, &
                                                      2880.0_wp, -2100.0_wp, 630.0_wp, -2100.0_wp, &
                                                      1575.0_wp], [3, 3])
      real(wp) :: answer(size(gain, 1), padded_rows(size(gain, 1))*n_markov)
      integer :: d, e, k, m, mp

      m = size(gain, 1)
      mp = padded_rows(m)
      allocate (operators%markov(m, m, 0:n_markov - 1), source=0.0_wp)
      do d = 0, n_markov - 1
         do k = 1, n_markov
            operators%markov(:, :, d) = operators%markov(:, :, d) + inverse(d + 1, k)* &
                                        gamma(real(d + 2, wp))*matmul(gain, moved(:, :, k))
         end do
      end do
      do k = 3, path_degree
         associate (first => operators%first_power(k))
            answer = 0.0_wp
            do e = first, k - 2
               d = k - 2 - e
               answer(:, (e - first)*mp + 1:(e - first)*mp + m) = &
                  operators%markov(:, :, d)*(gamma(real(e + 1, wp))/gamma(real(k + 1, wp)))
            end do
            call pack_matrix(answer(:, :(k - 1 - first)*mp), operators%answer(k))
         end associate
      end do
   end subroutine put_answers

end module dynamics_exact_modal_operators
