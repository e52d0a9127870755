!> Blocks of two numbers that the modes part into: between transitions each goes on by itself.
!>
!> The modes q'' + C^ q' + Omega^2 q = f are p' = A p + B f in 2 n numbers, A of 2 x 2 blocks (M3).
!> Where C^ is diagonal, block r is mode r, p = (q_r, q_r'): f pushes its second number and joints
!> read its first, so it has one port. Where C^ couples modes, (q, q') = V p. The block of a pair of
!> poles a +- i b is [a, b; -b, a], that of two real poles diagonal: f pushes both numbers and
!> joints read both, so it has two ports. Numbers in brackets are formulas of docs/exact_march.md.
module dynamics_exact_modal_blocks
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_eigenvalues, find_symmetric_eigenvectors, invert_matrix, &
                              unit_matrix
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: modal_blocks, new_modal_blocks

   real(wp), parameter :: negligible = 1.0e-10_wp   !! of sqrt(C_rr C_ss)
   real(wp), parameter :: rounding = 1.0e-14_wp     !! of the largest C_rr: couplings of zero modes

   !> Blocks in the order of their rates. Numbers of a block stand one after another; of one port,
   !> the first is read and the second pushed.
   type :: modal_blocks
      integer :: ports = 1
      real(wp), allocatable :: rate(:)         !! (block) largest |pole|; of a mode omega h or C^_rr
      real(wp), allocatable :: block(:, :, :)    !! A (2, 2, block)
      real(wp), allocatable :: state(:, :), inverse(:, :)   !! V (q q', number) and V^-1
   contains
      procedure :: metric
      procedure :: reads
      procedure :: pushes
      procedure :: numbers
   end type modal_blocks

contains

   !> Finds the blocks. Where poles coincide, eigenvectors do too: they part where C^ is changed in
   !> its tenth digit.
   subroutine new_modal_blocks(omega, damping, blocks, error)
      real(wp), intent(in) :: omega(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      type(modal_blocks), intent(out) :: blocks
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: most_condition = 1.0e5_wp, tenth_digit = 1.0e-10_wp   ! (M3)
      real(wp), allocatable :: apart(:, :)
      real(wp) :: condition
      integer :: r

      call find_blocks(omega, damping, blocks, condition, error)
      if (allocated(error) .or. condition <= most_condition) return
      apart = damping
      do r = 1, size(omega)
         apart(r, r) = damping(r, r)*(1.0_wp + tenth_digit*r/size(omega))
      end do
      call find_blocks(omega, apart, blocks, condition, error)
   end subroutine new_modal_blocks

   !> True for each mode that damping couples with another.
   pure function is_coupled(omega, damping) result(coupled)
      real(wp), intent(in) :: omega(:), damping(:, :)
      logical :: coupled(size(omega))
      real(wp), dimension(size(omega)) :: decay, least
      integer :: r

      decay = [(abs(damping(r, r)), r=1, size(omega))]
      coupled = .false.
      do r = 1, size(omega)
         least = negligible*sqrt(decay*decay(r))
         where (.not. min(omega, omega(r)) > 0.0_wp) least = max(least, rounding*maxval(decay))
         least(r) = decay(r)
         coupled = coupled .or. abs(damping(:, r)) > least
      end do
   end function is_coupled

   !> Finds V and the blocks. Modes that damping does not couple are blocks by themselves: poles of
   !> those without stiffness may coincide. If all are, blocks have one port.
   subroutine find_blocks(omega, damping, blocks, condition, error)
      real(wp), intent(in) :: omega(:), damping(:, :)
      type(modal_blocks), intent(inout) :: blocks
      real(wp), intent(out) :: condition   !! largest row of V^-1, of columns of length 1
      type(error_type), allocatable, intent(out) :: error
      complex(wp), allocatable :: poles(:)
      real(wp), allocatable :: a(:, :), block(:, :, :), modes(:, :), rate(:), state(:, :), &
                               turned(:, :), vectors(:, :)
      real(wp) :: scale(2*size(omega))
      integer, allocatable :: coupled(:), order(:)
      logical, allocatable :: couples(:)
      integer :: b, i, n, n_coupled, r

      n = size(omega)
      call turn_zero_modes(omega, damping, turned, modes, error)
      if (allocated(error)) return
      couples = is_coupled(omega, turned)
      coupled = pack([(r, r=1, n)], couples)
      n_coupled = size(coupled)
      scale = 1.0_wp   ! of q', so that A is balanced
      scale(n + coupled) = max(1.0_wp, omega(coupled))
      allocate (a(2*n_coupled, 2*n_coupled), source=0.0_wp)
      associate (s => scale(n + coupled))
         do i = 1, n_coupled
            a(i, n_coupled + i) = s(i)
            a(n_coupled + i, i) = -omega(coupled(i))**2/s(i)
            a(n_coupled + i, n_coupled + 1:) = -turned(coupled(i), coupled)*s/s(i)
         end do
      end associate
      poles = [complex(wp) ::]
      if (n_coupled > 0) call find_eigenvalues(a, poles, error, vectors)
      if (allocated(error)) return
      if (n_coupled > 0) call pair_poles(poles, vectors)
      allocate (state(2*n, 2*n), block(2, 2, n), source=0.0_wp)
      allocate (rate(n))
      do b = 1, n_coupled
         rate(b) = maxval(abs(poles(2*b - 1:2*b)))
         block(:, :, b) = reshape([poles(2*b - 1)%re, -poles(2*b - 1)%im, -poles(2*b)%im, &
                                   poles(2*b)%re], [2, 2])
         state([coupled, n + coupled], 2*b - 1:2*b) = vectors(:, 2*b - 1:2*b)
      end do
      do r = 1, n
         if (couples(r)) cycle
         rate(b) = max(omega(r), abs(turned(r, r)))
         block(:, :, b) = reshape([0.0_wp, -omega(r)**2, 1.0_wp, -turned(r, r)], [2, 2])
         state(r, 2*b - 1) = 1.0_wp
         state(n + r, 2*b) = 1.0_wp
         b = b + 1
      end do
      order = sort_order(rate)
      blocks%ports = merge(2, 1, n_coupled > 0)
      blocks%rate = rate(order)
      blocks%block = block(:, :, order)
      state = state(:, [(2*order(1 + (i - 1)/2) - modulo(i, 2), i=1, 2*n)])
      blocks%inverse = transpose(state)
      if (n_coupled > 0) call invert_matrix(state, blocks%inverse, error)
      if (allocated(error)) return
      condition = sqrt(maxval(sum(blocks%inverse**2, 2)*sum(state**2, 1)))
      do i = 1, 2*n
         state(i, :) = state(i, :)*scale(i)
         blocks%inverse(:, i) = blocks%inverse(:, i)/scale(i)
      end do
      do i = 0, n, n
         associate (zero => [(i + r, r=1, size(modes, 1))])
            state(zero, :) = matmul(modes, state(zero, :))
            blocks%inverse(:, zero) = matmul(blocks%inverse(:, zero), transpose(modes))
         end associate
      end do
      blocks%state = state
   end subroutine find_blocks

   !> Turns modes without stiffness such that damping does not couple them with each other: poles of
   !> one that it does not reach coincide.
   subroutine turn_zero_modes(omega, damping, turned, modes, error)
      real(wp), intent(in) :: omega(:), damping(:, :)
      real(wp), allocatable, intent(out) :: turned(:, :)   !! C^ of the turned modes
      real(wp), allocatable, intent(out) :: modes(:, :)    !! q = modes x turned q, of these
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: decay(count(.not. omega > 0.0_wp))
      integer :: n

      n = size(decay)
      turned = damping
      modes = unit_matrix(n)
      if (n < 2) return
      modes = damping(:n, :n)
      call find_symmetric_eigenvectors(modes, decay, error)
      if (allocated(error)) return
      turned(:n, :) = matmul(transpose(modes), turned(:n, :))
      turned(:, :n) = matmul(turned(:, :n), modes)
   end subroutine turn_zero_modes

   !> Puts pairs of poles first and real ones by their size, and scales their vectors: displacements
   !> of a pair, or of a real pole, have length 1.
   pure subroutine pair_poles(poles, vectors)
      complex(wp), intent(inout) :: poles(:)
      real(wp), intent(inout) :: vectors(:, :)   !! (q q', pole): real and imaginary parts of a pair
      integer :: i, order(size(poles))
      real(wp) :: key(size(poles))

      key = abs(poles)
      where (abs(poles%im) > 0.0_wp) key = -1.0_wp   ! LAPACK has pairs together
      order = sort_order(key)
      poles = poles(order)
      vectors = vectors(:, order)
      i = 1
      associate (places => vectors(:size(poles)/2, :))
         do while (i <= size(poles))
            associate (last => merge(i + 1, i, abs(poles(i)%im) > 0.0_wp))
               vectors(:, i:last) = vectors(:, i:last)/norm2(places(:, i:last))
               i = last + 1
            end associate
         end do
      end associate
   end subroutine pair_poles

   !> N of the numbers of all blocks, p'N p = q'C^q + 2 q'q': zero between blocks of different poles
   !> (M9).
   pure function metric(self, damping)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: damping(:, :)   !! C^ (mode, mode)
      real(wp) :: metric(2*size(damping, 1), 2*size(damping, 1))

      associate (q => self%state(:size(damping, 1), :), v => self%state(size(damping, 1) + 1:, :))
         metric = matmul(transpose(q), matmul(damping, q) + v) + matmul(transpose(v), q)
      end associate
   end function metric

   !> Factors of the numbers of all ports in what is read from q, or from q', of which one port has
   !> the second numbers.
   pure function reads(self, gain, from_rate) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: gain(:, :)   !! (row, mode)
      logical, intent(in) :: from_rate
      real(wp) :: factors(size(gain, 1), self%ports*size(gain, 2))
      integer :: first, n

      n = size(gain, 2)
      first = merge(3 - self%ports, 1, from_rate)
      associate (state => self%state(merge(n, 0, from_rate) + 1:, first::3 - self%ports))
         factors = matmul(gain, state(:n, :))
      end associate
   end function reads

   !> Pushes of the numbers of all ports where loads push q''.
   pure function pushes(self, load) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: load(:, :)   !! (mode, column)
      real(wp) :: factors(self%ports*size(load, 1), size(load, 2))

      associate (first => 3 - self%ports)
         factors = matmul(self%inverse(first::first, size(load, 1) + 1:), load)
      end associate
   end function pushes

   !> Numbers of all blocks, as the march keeps them: by ports, or first and second ones apart.
   pure function numbers(self, q, velocity) result(p)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: q(:), velocity(:)   !! q' (mode)
      real(wp) :: p(self%ports*size(q), 3 - self%ports)

      p = transpose(reshape(matmul(self%inverse, [q, velocity]), [size(p, 2), size(p, 1)]))
   end function numbers

end module dynamics_exact_modal_blocks
