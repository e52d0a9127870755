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
   use numerics_lapack, only: find_eigenvectors, find_symmetric_eigenvectors, invert_matrix
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: modal_blocks, new_modal_blocks

   real(wp), parameter :: negligible = 1.0e-10_wp   !! of sqrt(C_rr C_ss)
   real(wp), parameter :: rounding = 1.0e-14_wp     !! of the largest C_rr: couplings of zero modes

   !> Blocks in the order of their rates.
   type :: modal_blocks
      integer :: ports = 1
      !> (block) omega h, with two ports the largest |pole|; the same, at least C^_rr
      real(wp), allocatable :: rate(:), fastest(:)
      real(wp), allocatable :: block(:, :, :)   !! A (2, 2, block)
      !> With two ports, V (q q', number) and V^-1: numbers of a block stand one after another
      real(wp), allocatable :: state(:, :), inverse(:, :)
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

      if (all(is_alone(omega, damping))) then
         blocks%rate = omega
         blocks%fastest = [(max(omega(r), abs(damping(r, r))), r=1, size(omega))]
         allocate (blocks%block(2, 2, size(omega)))
         do r = 1, size(omega)
            blocks%block(:, :, r) = block_of(omega(r), damping(r, r), 1.0_wp)
         end do
         return
      end if
      blocks%ports = 2
      call find_blocks(omega, damping, blocks, condition, error)
      if (allocated(error) .or. condition <= most_condition) return
      apart = damping
      do r = 1, size(omega)
         apart(r, r) = damping(r, r)*(1.0_wp + tenth_digit*r/size(omega))
      end do
      call find_blocks(omega, apart, blocks, condition, error)
   end subroutine new_modal_blocks

   !> True for each mode that damping does not couple with another.
   pure function is_alone(omega, damping) result(alone)
      real(wp), intent(in) :: omega(:), damping(:, :)
      logical :: alone(size(omega))
      real(wp) :: least, most
      integer :: r, s

      most = 0.0_wp
      do r = 1, size(omega)
         most = max(most, abs(damping(r, r)))
      end do
      alone = .true.
      do s = 1, size(omega)
         do r = 1, size(omega)
            if (r == s) cycle
            least = negligible*sqrt(abs(damping(r, r)*damping(s, s)))
            if (.not. min(omega(r), omega(s)) > 0.0_wp) least = max(least, rounding*most)
            if (abs(damping(r, s)) > least) alone(r) = .false.
         end do
      end do
   end function is_alone

   !> Block of a mode by itself, its second number q'/scale.
   pure function block_of(omega, damping, scale) result(block)
      real(wp), intent(in) :: omega, damping, scale
      real(wp) :: block(2, 2)

      block = reshape([0.0_wp, -omega**2/scale, scale, -damping], [2, 2])
   end function block_of

   !> Finds V and the blocks of two ports. Modes that damping does not couple are blocks by
   !> themselves: poles of those without stiffness may coincide.
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
      couples = .not. is_alone(omega, turned)
      coupled = pack([(r, r=1, n)], couples)
      n_coupled = size(coupled)
      scale = 1.0_wp   ! of q', so that A is balanced
      scale(n + 1:) = max(1.0_wp, omega)
      allocate (a(2*n_coupled, 2*n_coupled), source=0.0_wp)
      associate (s => scale(n + coupled))
         do i = 1, n_coupled
            a(i, n_coupled + i) = s(i)
            a(n_coupled + i, i) = -omega(coupled(i))**2/s(i)
            a(n_coupled + i, n_coupled + 1:) = -turned(coupled(i), coupled)*s/s(i)
         end do
      end associate
      poles = [complex(wp) ::]
      if (n_coupled > 0) call find_eigenvectors(a, poles, vectors, error)
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
         block(:, :, b) = block_of(omega(r), turned(r, r), scale(n + r))
         state(r, 2*b - 1) = 1.0_wp
         state(n + r, 2*b) = 1.0_wp
         b = b + 1
      end do
      order = sort_order(rate)
      blocks%rate = rate(order)
      blocks%fastest = blocks%rate
      blocks%block = block(:, :, order)
      state = state(:, [(2*order(1 + (i - 1)/2) - modulo(i, 2), i=1, 2*n)])
      call invert_matrix(state, blocks%inverse, error)
      if (allocated(error)) return
      condition = sqrt(maxval(sum(blocks%inverse**2, 2)*sum(state**2, 1)))
      do i = 1, 2*n
         state(i, :) = state(i, :)*scale(i)
         blocks%inverse(:, i) = blocks%inverse(:, i)/scale(i)
      end do
      blocks%state = state
      do i = 0, n, n
         blocks%state(i + 1:i + n, :) = matmul(modes, state(i + 1:i + n, :))
         blocks%inverse(:, i + 1:i + n) = matmul(blocks%inverse(:, i + 1:i + n), transpose(modes))
      end do
   end subroutine find_blocks

   !> Turns modes without stiffness such that damping does not couple them with each other: poles of
   !> one that it does not reach coincide.
   subroutine turn_zero_modes(omega, damping, turned, modes, error)
      real(wp), intent(in) :: omega(:), damping(:, :)
      real(wp), allocatable, intent(out) :: turned(:, :)   !! C^ of the turned modes
      real(wp), allocatable, intent(out) :: modes(:, :)    !! q = modes x turned q
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: decay(:), zero(:, :)
      integer :: n_zero, r

      n_zero = count(.not. omega > 0.0_wp)
      allocate (modes(size(omega), size(omega)), source=0.0_wp)
      do r = 1, size(omega)
         modes(r, r) = 1.0_wp
      end do
      turned = damping
      if (n_zero < 2) return
      zero = damping(:n_zero, :n_zero)
      allocate (decay(n_zero))
      call find_symmetric_eigenvectors(zero, decay, error)
      if (allocated(error)) return
      modes(:n_zero, :n_zero) = zero
      turned(:n_zero, :) = matmul(transpose(zero), turned(:n_zero, :))
      turned(:, :n_zero) = matmul(turned(:, :n_zero), zero)
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
      integer :: n, r

      n = size(damping, 1)
      if (self%ports == 2) then
         associate (q => self%state(:n, :), v => self%state(n + 1:, :))
            metric = matmul(transpose(q), matmul(damping, q) + v) + matmul(transpose(v), q)
         end associate
         return
      end if
      metric = 0.0_wp
      do r = 1, n
         metric(2*r - 1:2*r, 2*r - 1:2*r) = reshape([damping(r, r), 1.0_wp, 1.0_wp, 0.0_wp], [2, 2])
      end do
   end function metric

   !> Factors of the numbers of all ports in what is read from q, or from q'; with one port q' is a
   !> number itself.
   pure function reads(self, gain, from_rate) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: gain(:, :)   !! (row, mode)
      logical, intent(in) :: from_rate
      real(wp), allocatable :: factors(:, :)
      integer :: first

      if (self%ports == 1) then
         allocate (factors, source=gain)   ! not by =, which would read bounds
      else
         first = merge(size(gain, 2), 0, from_rate)
         factors = matmul(gain, self%state(first + 1:first + size(gain, 2), :))
      end if
   end function reads

   !> Pushes of the numbers of all ports where loads push q''.
   pure function pushes(self, load) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: load(:, :)   !! (mode, column)
      real(wp) :: factors(self%ports*size(load, 1), size(load, 2))

      if (self%ports == 1) then
         factors = load
      else
         factors = matmul(self%inverse(:, size(load, 1) + 1:), load)
      end if
   end function pushes

   !> Numbers of all blocks, as the march keeps them: q and q', or p.
   pure function numbers(self, q, velocity) result(p)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: q(:), velocity(:)   !! q' (mode)
      real(wp) :: p(self%ports*size(q), 3 - self%ports)

      if (self%ports == 1) then
         p = reshape([q, velocity], shape(p))
      else
         p(:, 1) = matmul(self%inverse, [q, velocity])
      end if
   end function numbers

end module dynamics_exact_modal_blocks
