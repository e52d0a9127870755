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
   use dynamics_alignment, only: whole_registers
   use dynamics_exact_modal_ledger, only: modal_ledger
   use dynamics_exact_modal_steps, only: rows_ahead
   use dynamics_exact_modal_terms, only: choose_terms, count_parts, feel_joints, joint_feel, &
                                         modal_terms, n_markov, path_degree
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
      !> Where C^ decouples, from q, q', f(0), f' (entry, .., mode): q, q' at 1, both at 1/2 less
      !> those of the cubic through both ends (M3), (M4); q' at 1/2 itself, for the ledger
      real(wp), allocatable :: rotation(:, :, :), half(:, :)
      !> (0:moment, q or q', mode) where C^ decouples (M6)
      real(wp), allocatable :: weight(:, :, :)
      !> Where it does not, from all modes: q, q' at 1; values and slopes of paths at 1/2 less those
      !> of the cubics; q' at 1/2
      type(rows_ahead) :: propagator, middle, velocity_at_half
      type(packed_matrix) :: kick               !! as weight, but of all modes: rows q, q'
      !> as kick, less the uniform motion of the sliders; behind `answer`, gfortran 12 leaks it
      type(packed_matrix) :: rest
      type(packed_matrix) :: reads(4), push, shape   !! G, of the modes that are read; S, Phi
      type(packed_matrix) :: answer(3:path_degree)   !! power k of a path from the sliders' (M5)
      real(wp), allocatable :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
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
      if (self%decouples) then
         work = work + (16.0_wp + 2.0_wp*self%n_moments)*self%n_modes &
                + (self%n_moments + 1.0_wp)*size(self%push%value)
      else
         work = work + size(self%propagator%from%value) + size(self%middle%from%value) &
                + size(self%kick%value) + size(self%push%value)
      end if
   end function work

   !> Prepares the form for as many parts a step as the tolerance needs, relative to the rms.
   subroutine new_modal_operators(structure, dt, tolerance, operators)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(modal_operators), intent(out) :: operators
      type(joint_feel) :: joints
      real(wp), allocatable :: damping(:, :), omega(:), moved(:, :, :)
      integer :: r

      omega = two_pi*structure%frequencies_stuck   ! zero where rounding hides it
      operators%n_modes = structure%n_dof
      operators%n_joints = structure%n_joints
      call feel_joints(structure, joints)
      operators%n_parts = count_parts(structure, joints, dt, tolerance)
      operators%h = dt/operators%n_parts
      allocate (operators%direction, source=structure%direction)
      operators%momentum = matmul(structure%mass, structure%modes_stuck)
      operators%load = operators%h**2*matmul(transpose(structure%modes_stuck), structure%load)
      operators%slider_push = operators%h**2*transpose(spread(structure%joint_stiffness, 2, &
                                                              structure%n_dof)*joints%gain)
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
      call choose_terms(structure%joint_stiffness, joints, operators%h*omega, damping, tolerance, &
                        operators)
      call pack_matrix(joints%gain, operators%reads(1))
      call pack_matrix(joints%gain, operators%reads(2))
      call pack_matrix(operators%slider_push, operators%push)
      call pack_matrix(structure%modes_stuck, operators%shape)
      do r = 3, 4
         associate (first => merge(operators%first_read(r), operators%n_modes + 1, &
                                   operators%decouples))
            call pack_matrix(joints%gain(:, first:), operators%reads(r))
         end associate
      end do
      if (operators%decouples) then
         call put_rotations(operators%h*omega, damping, operators, moved)
      else
         call put_propagator(operators%h*omega, damping, joints%gain, operators, moved)
      end if
      call put_answers(joints%gain, moved, operators)
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
      real(wp), parameter :: start_q(4) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
      real(wp), parameter :: start_p(4) = [0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp]
      real(wp) :: a(2, 2), b(2, 1), fit(0:operators%n_moments, 0:operators%n_moments + 1), scale
      integer :: k, last, r

      last = operators%n_moments
      fit = kernel_fit(operators%n_moments)
      allocate (operators%rotation(4, 4, size(rate)), operators%half(4, size(rate)), &
                operators%weight(0:last, 2, size(rate)), &
                moved(size(rate), operators%n_joints, n_markov))
      do r = 1, size(rate)
         scale = max(1.0_wp, rate(r))   ! of q', so that the matrix is balanced
         a = reshape([0.0_wp, -rate(r)**2/scale, scale, -damping(r, r)], [2, 2])
         b = reshape([0.0_wp, 1.0_wp/scale], [2, 1])
         call find_exponential(a, b, max(n_markov, last + 1), half, full)
         associate (q => at_end(1.0_wp, 1, full), p => at_end(1.0_wp, 2, full), &
                    half_q => at_end(0.5_wp, 1, half), half_p => at_end(0.5_wp, 2, half), &
                    to => operators%rotation(:, :, r))
            to(:, 1) = q
            to(:, 2) = p
            to(:, 3) = half_q - 0.5_wp*(start_q + q) - 0.125_wp*(start_p - p)
            to(:, 4) = half_p - 1.5_wp*(q - start_q) + 0.25_wp*(start_p + p)
            operators%half(:, r) = half_p
         end associate
         do k = 1, n_markov
            moved(r, :, k) = full%moment(1, 1, k)*operators%slider_push(r, :)
         end do
         operators%weight(:, 1, r) = matmul(fit, full%moment(1, 1, 0:last + 1))
         operators%weight(:, 2, r) = matmul(fit, full%moment(2, 1, 0:last + 1))*scale
      end do

   contains

      !> Factors of q, q', f(0), f' in q (row 1) or q' (2) after a time.
      pure function at_end(time, row, of) result(factor)
         real(wp), intent(in) :: time
         integer, intent(in) :: row
         type(exponential_type), intent(in) :: of
         real(wp) :: factor(4)

         factor = merge(1.0_wp, scale, row == 1)* &
                  [of%value(row, 1), of%value(row, 2)/scale, of%moment(row, 1, 0), &
                   time*of%moment(row, 1, 0) - of%moment(row, 1, 1)]
      end function at_end

   end subroutine put_rotations

   !> Takes all modes together: the exponential of the first-order system and its moments (M3),
   !> (M6).
   pure subroutine put_propagator(rate, damping, gain, operators, moved)
      real(wp), intent(in) :: rate(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      real(wp), intent(in) :: gain(:, :)               !! G (joint, mode)
      type(modal_operators), intent(inout) :: operators
      real(wp), allocatable, intent(out) :: moved(:, :, :)   !! see put_answers
      type(exponential_type) :: half, full
      real(wp), dimension(2*size(rate), 2*size(rate)) :: a
      real(wp) :: b(2*size(rate), size(rate)), scale(size(rate))
      real(wp) :: fit(0:operators%n_moments, 0:operators%n_moments + 1)
      real(wp) :: kernel(2*size(rate), size(rate))
      real(wp), allocatable :: kick(:, :), uniform(:, :), values(:, :)
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

      associate (start => unit_rows(), end => rows_at(1.0_wp, full), &
                 middle => rows_at(0.5_wp, half), q => [(r, r=1, n)], p => [(r, r=n + 1, 2*n)])
         call pack_rows(stacked(end(q, :), end(p, :)), operators%propagator)
         call pack_rows(middle(p, :), operators%velocity_at_half)
         values = matmul(gain, middle(q, :) - 0.5_wp*(start(q, :) + end(q, :)) &
                         - 0.125_wp*(start(p, :) - end(p, :)))
         if (operators%first_read(4) <= n) &
            values = stacked(values, matmul(gain, middle(p, :) - 1.5_wp*(end(q, :) - start(q, :)) &
                                            + 0.25_wp*(start(p, :) + end(p, :))))
         call pack_rows(values, operators%middle)
      end associate

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

      !> Rows q, q' after a time, from q, q', f(0), f' (mode) of each force.
      pure function rows_at(time, of) result(rows)
         real(wp), intent(in) :: time
         type(exponential_type), intent(in) :: of
         real(wp), allocatable :: rows(:, :)

         allocate (rows(2*n, 3*n + size(operators%load, 2)))
         rows(:, :2*n) = of%value
         rows(:, 2*n + 1:3*n) = of%moment(:, :, 0)
         rows(:, 3*n + 1:) = matmul(time*of%moment(:, :, 0) - of%moment(:, :, 1), operators%load)
      end function rows_at

      !> Rows q, q' at the start.
      pure function unit_rows() result(rows)
         real(wp) :: rows(2*n, 3*n + size(operators%load, 2))
         integer :: s

         rows = 0.0_wp
         do s = 1, 2*n
            rows(s, s) = 1.0_wp
         end do
      end function unit_rows

      !> Rows of a and of b, each padded.
      pure function stacked(a, b) result(rows)
         real(wp), intent(in) :: a(:, :), b(:, :)
         real(wp) :: rows(2*padded_rows(size(a, 1)), size(a, 2))

         rows = 0.0_wp
         rows(:size(a, 1), :) = a
         rows(size(rows, 1)/2 + 1:size(rows, 1)/2 + size(b, 1), :) = b
      end function stacked

      !> Packs rows, the columns of modes padded.
      pure subroutine pack_rows(rows, to)
         real(wp), intent(in) :: rows(:, :)
         type(rows_ahead), intent(out) :: to
         real(wp) :: from(size(rows, 1), 3*np)
         integer :: s

         from = 0.0_wp
         do s = 0, 2
            from(:, s*np + 1:s*np + n) = rows(:, s*n + 1:s*n + n)
         end do
         call pack_matrix(from, to%from)
         to%rise = rows(:, 3*n + 1:)
      end subroutine pack_rows

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

   !> Adds the answers of the joints to a slider: the integral of H(t - s) zeta(s), H(s) = G E(s) S,
   !> E the displacement after a unit impulse. H is taken as Y_0 s + Y_1 s^2/2 + Y_2 s^3/6, its
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
