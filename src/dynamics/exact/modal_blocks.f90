!> Uncoupled blocks of two state variables, into which the modes are transformed (M3).
!>
!> The modes q'' + C^ q' + Omega^2 q = f are p' = A p + B f in 2 n state variables p, A of 2 x 2
!> blocks. If C^ is diagonal, block r is mode r, p = (q_r, q_r'). Forces drive its second variable
!> and joints move with its first: it has one port. If C^ couples modes, (q, q') = V p. The block of
!> a pair of poles a +- i b is [a, b; -b, a], that of two real poles diagonal. Forces drive both
!> variables and joints move with both: it has two ports. Numbers in brackets are formulas of
!> docs/modal_march.md.
module dynamics_exact_modal_blocks
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_eigenvalues, find_symmetric_eigenvectors, invert_matrix, &
                              unit_matrix
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: modal_blocks, new_modal_blocks

   real(wp), parameter :: negligible = 1.0e-10_wp   !! |C^_rs|/sqrt(C^_rr C^_ss) of no coupling
   real(wp), parameter :: rounding = 1.0e-14_wp     !! error of C^_rs over max C^_rr, for zero modes

   !> Blocks in the order of their rates. State variables 2 b - 1 and 2 b are those of block b.
   type :: modal_blocks
      integer :: ports = 1                       !! ports of a block
      real(wp), allocatable :: rate(:)           !! (block) max |pole|, or max(omega h, C^_rr)
      real(wp), allocatable :: block(:, :, :)    !! A (2, 2, block)
      real(wp), allocatable :: state(:, :), inverse(:, :)   !! V (q and q', variable) and V^-1
   contains
      procedure :: balance
      procedure :: scaled
      procedure :: metric
      procedure :: outputs
      procedure :: inputs
   end type modal_blocks

contains

   !> Finds the blocks. If poles, and so eigenvectors, coincide, C^ is changed in its tenth digit to
   !> separate them.
   subroutine new_modal_blocks(omega, damping, blocks, error)
      real(wp), intent(in) :: omega(:), damping(:, :)   !! Omega (mode), C^ (mode, mode)
      type(modal_blocks), intent(out) :: blocks
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: most_condition = 1.0e5_wp, tenth_digit = 1.0e-10_wp   ! (M3)
      real(wp), allocatable :: separated(:, :)
      real(wp) :: condition
      integer :: r

      call find_blocks(omega, damping, blocks, condition, error)
      if (allocated(error) .or. condition <= most_condition) return
      separated = damping
      do r = 1, size(omega)
         separated(r, r) = damping(r, r)*(1.0_wp + tenth_digit*r/size(omega))
      end do
      call find_blocks(omega, separated, blocks, condition, error)
   end subroutine new_modal_blocks

   !> True for each mode that damping couples with another mode.
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

   !> Finds V and the blocks. A mode that damping does not couple is a block itself, as the poles of
   !> one without stiffness may coincide. If all modes are blocks, these have one port.
   subroutine find_blocks(omega, damping, blocks, condition, error)
      real(wp), intent(in) :: omega(:), damping(:, :)
      type(modal_blocks), intent(inout) :: blocks
      real(wp), intent(out) :: condition   !! largest row norm of V^-1, if columns of V have norm 1
      type(error_type), allocatable, intent(out) :: error
      complex(wp), allocatable :: poles(:)
      real(wp), allocatable :: a(:, :), block(:, :, :), modes(:, :), rate(:), state(:, :), &
                               rotated(:, :), vectors(:, :)
      real(wp) :: scale(2*size(omega))
      integer, allocatable :: coupled(:), order(:)
      logical, allocatable :: couples(:)
      integer :: b, i, n, n_coupled, r

      n = size(omega)
      call rotate_zero_modes(omega, damping, rotated, modes, error)
      if (allocated(error)) return
      couples = is_coupled(omega, rotated)
      coupled = pack([(r, r=1, n)], couples)
      n_coupled = size(coupled)
      scale = 1.0_wp   ! scale of q', so that A is balanced
      scale(n + coupled) = max(1.0_wp, omega(coupled))
      allocate (a(2*n_coupled, 2*n_coupled), source=0.0_wp)
      associate (s => scale(n + coupled))
         do i = 1, n_coupled
            a(i, n_coupled + i) = s(i)
            a(n_coupled + i, i) = -omega(coupled(i))**2/s(i)
            a(n_coupled + i, n_coupled + 1:) = -rotated(coupled(i), coupled)*s/s(i)
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
         rate(b) = max(omega(r), abs(rotated(r, r)))
         block(:, :, b) = reshape([0.0_wp, -omega(r)**2, 1.0_wp, -rotated(r, r)], [2, 2])
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
      call move_alloc(state, blocks%state)
   end subroutine find_blocks

   !> Rotates the modes without stiffness so that damping does not couple them with each other.
   !> Otherwise a combination of them without damping would have coinciding poles.
   subroutine rotate_zero_modes(omega, damping, rotated, modes, error)
      real(wp), intent(in) :: omega(:), damping(:, :)
      real(wp), allocatable, intent(out) :: rotated(:, :)   !! C^ after the rotation
      real(wp), allocatable, intent(out) :: modes(:, :)     !! q = modes x rotated q of these modes
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: decay(count(.not. omega > 0.0_wp))
      integer :: n

      n = size(decay)
      rotated = damping
      modes = unit_matrix(n)
      if (n < 2) return
      modes = damping(:n, :n)
      call find_symmetric_eigenvectors(modes, decay, error)
      if (allocated(error)) return
      rotated(:n, :) = matmul(transpose(modes), rotated(:n, :))
      rotated(:, :n) = matmul(rotated(:, :n), modes)
   end subroutine rotate_zero_modes

   !> Sorts poles, complex pairs first and then real poles by size, and scales their vectors: the
   !> displacements of a pair, or of a real pole, have norm 1.
   pure subroutine pair_poles(poles, vectors)
      complex(wp), intent(inout) :: poles(:)
      real(wp), intent(inout) :: vectors(:, :)   !! (q and q', pole): real, imaginary part of a pair
      integer :: i, order(size(poles))
      real(wp) :: key(size(poles))

      key = abs(poles)
      where (abs(poles%im) > 0.0_wp) key = -1.0_wp   ! LAPACK returns pairs side by side
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

   !> Scale of the second variable of a block that balances its A.
   pure real(wp) function balance(self, b)
      class(modal_blocks), intent(in) :: self
      integer, intent(in) :: b

      balance = 1.0_wp
      associate (a => self%block(:, :, b))
         if (abs(a(1, 2)) > 0.0_wp) balance = max(1.0_wp, sqrt(abs(a(2, 1)/a(1, 2))))
      end associate
   end function balance

   !> Blocks of a part that is `factor` times as long.
   pure type(modal_blocks) function scaled(self, factor)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: factor

      scaled = self
      scaled%rate = factor*self%rate
      if (self%ports == 1) then   ! p remains (q, q')
         scaled%block(2, 1, :) = factor**2*self%block(2, 1, :)
         scaled%block(2, 2, :) = factor*self%block(2, 2, :)
         return
      end if
      scaled%block = factor*self%block
      associate (first => size(self%rate) + 1)   ! of q'
         scaled%state(first:, :) = factor*self%state(first:, :)
         scaled%inverse(:, first:) = self%inverse(:, first:)/factor
      end associate
   end function scaled

   !> N (variable, variable), p'N p = q'C^q + 2 q'q': zero between blocks of different poles (M9).
   pure function metric(self, damping)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: damping(:, :)   !! C^ (mode, mode)
      real(wp) :: metric(2*size(damping, 1), 2*size(damping, 1))

      associate (q => self%state(:size(damping, 1), :), v => self%state(size(damping, 1) + 1:, :))
         metric = matmul(transpose(q), matmul(damping, q) + v) + matmul(transpose(v), q)
      end associate
   end function metric

   !> Factors of the ports of all blocks (row, port) in gain times q, or in gain times q'.
   pure function outputs(self, gain, from_rate) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: gain(:, :)   !! (row, mode)
      logical, intent(in) :: from_rate     !! True: times q'
      real(wp) :: factors(size(gain, 1), self%ports*size(gain, 2))
      integer :: first, n

      n = size(gain, 2)
      first = merge(3 - self%ports, 1, from_rate)
      associate (state => self%state(merge(n, 0, from_rate) + 1:, first::3 - self%ports))
         factors = matmul(gain, state(:n, :))
      end associate
   end function outputs

   !> Factors of loads on the modes in the ports of all blocks (port, column).
   pure function inputs(self, load) result(factors)
      class(modal_blocks), intent(in) :: self
      real(wp), intent(in) :: load(:, :)   !! (mode, column)
      real(wp) :: factors(self%ports*size(load, 1), size(load, 2))

      associate (first => 3 - self%ports)
         factors = matmul(self%inverse(first::first, size(load, 1) + 1:), load)
      end associate
   end function inputs

end module dynamics_exact_modal_blocks
