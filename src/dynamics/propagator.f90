!> Exact solutions of one step, and of several at once, for every stick pattern: what is the same
!> for all samples is tabulated once.
!>
!> With the pattern of stuck masses fixed, the chain under a linear force is z' = A z + loads, z =
!> (x, u), time in steps, u = h v. The matrix exponential gives the state after a step; the powers
!> of A tell how a load that sets in on one mass spreads. The tables of a pattern are built when it
!> is met first.
module dynamics_propagator
   use core_kinds, only: wp
   use structure_model, only: structure_type
   use dynamics_registers, only: first_aligned, register_width
   implicit none(type, external)
   private
   public :: propagator_type, new_propagator
   public :: width, columns, column_force, levels, stride_of

   integer, parameter :: width = register_width       !! most masses
   integer, parameter :: levels = 3                   !! tables of 1, 2 and 4 steps at once
   integer, parameter :: stride_of(levels) = [1, 2, 4]
   integer, parameter :: longest_stride = stride_of(levels)
   integer, parameter :: column_force = 3*width + 1   !! and on: between steps
   integer, parameter :: columns = 3*width + 1 + longest_stride

   integer, parameter :: step_length = 2*width*columns
   integer, parameter :: kick_length = width*width*width
   integer, parameter :: pull_length = 2*width*width

   !> Tables for the 2^n patterns; bit i-1 of a pattern says that mass i is stuck. They lie in one
   !> pool, each beginning on a cache line: pool(step) is table(16, 29, 0:2^n-1, 3) and so on.
   type :: propagator_type
      integer :: n = 0
      real(wp), allocatable :: pool(:)
      integer :: step = 0   !! (mass, x u, x u anchor force, pattern, level): state after a stride
      !> (mass, 0:7, mass, pattern): velocities of A^m times a unit load on one mass; displacements
      !> are the velocities of the power before, as x' = u
      integer :: kick = 0
      integer :: pull = 0   !! (mass, x u, mass): what pulls one mass back, but for its contact
      logical, allocatable :: is_built(:)   !! (0:2^n-1)
      real(wp), allocatable, private :: free(:, :)      !! A with all masses slipping, and its loads
      real(wp), allocatable :: contact(:)   !! h^2 k/m
      real(wp) :: force_scale = 0.0_wp      !! h^2/m of the forced mass [m/N]
      integer :: forced_dof = 0
   contains
      procedure :: build
      procedure :: at_step
      procedure :: at_kick
   end type propagator_type

contains

   !> Prepares the tables for steps of length h; at most 8 masses.
   subroutine new_propagator(chain, h, forced_dof, self)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s], with rate h at most about 1
      integer, intent(in) :: forced_dof
      type(propagator_type), intent(out) :: self   !! not copied: its pool begins on a cache line
      integer :: i, n, patterns

      n = chain%n_dof
      patterns = 2**n
      self%n = n
      self%contact = h**2*chain%joint_stiffness/chain%lumped_mass()
      allocate (self%free(3*n + 2, 3*n + 2), source=0.0_wp)
      do i = 1, n
         self%free(i, n + i) = 1.0_wp
         self%free(n + i, :n) = -h**2*chain%stiffness(i, :)/chain%mass(i, i)
         self%free(n + i, n + 1:2*n) = -h*chain%damping(i, :)/chain%mass(i, i)
         self%free(n + i, 2*n + 2 + i) = self%contact(i)
      end do
      self%forced_dof = forced_dof
      self%force_scale = h**2/chain%mass(forced_dof, forced_dof)
      self%free(n + forced_dof, 2*n + 1) = self%force_scale
      self%free(2*n + 1, 2*n + 2) = 1.0_wp   ! the force rises linearly

      allocate (self%pool(patterns*(levels*step_length + kick_length) + pull_length + width), &
                source=0.0_wp)
      self%step = first_aligned(self%pool)
      self%kick = self%step + levels*patterns*step_length
      self%pull = self%kick + patterns*kick_length
      allocate (self%is_built(0:patterns - 1), source=.false.)
      call put_pull(n, self%free, self%pool(self%pull))
   end subroutine new_propagator

   !> Builds the tables of one pattern from the powers of A with its loads: G^k/k!, k = 0, 1, ...
   !> As the norm of G is near 1, the series itself gives the exponential to rounding.
   subroutine build(self, pattern)
      class(propagator_type), intent(inout) :: self
      integer, intent(in) :: pattern
      integer, parameter :: terms = 26
      real(wp), allocatable :: g(:, :), term(:, :), total(:, :), response(:, :)
      real(wp) :: factorial
      integer :: i, k, level, n

      n = self%n
      allocate (g, source=self%free)
      do i = 1, n
         if (btest(pattern, i - 1)) g(n + i, i) = g(n + i, i) - self%contact(i)
      end do
      allocate (term, source=0.0_wp*g)
      do i = 1, size(g, 1)
         term(i, i) = 1.0_wp
      end do
      allocate (total, source=term)
      factorial = 1.0_wp
      do k = 0, terms
         if (k > 0) then
            term = matmul(g, term)/k
            total = total + term
            factorial = factorial*k
         end if
         if (k < width) call put_kick(n, k, factorial*term, self%pool(self%at_kick(pattern)))
      end do
      allocate (response, source=response_to(n, total))   ! assigned, its shape before is undefined
      do level = 1, levels
         if (level > 1) response = twice(n, response)
         call put_step(n, response, self%pool(self%at_step(pattern, level)))
      end do
      self%is_built(pattern) = .true.
   end subroutine build

   !> First element of a pattern's table in the pool.
   pure integer function at_step(self, pattern, level)
      class(propagator_type), intent(in) :: self
      integer, intent(in) :: pattern, level

      at_step = self%step + ((level - 1)*2**self%n + pattern)*step_length
   end function at_step

   pure integer function at_kick(self, pattern)
      class(propagator_type), intent(in) :: self
      integer, intent(in) :: pattern

      at_kick = self%kick + pattern*kick_length
   end function at_kick

   !> What state, anchors and force at both ends of a step make of the state: (x u, x u anchors
   !> forces), from the exponential, whose last but n columns belong to the force and its rise.
   pure function response_to(n, exponential) result(response)
      integer, intent(in) :: n
      real(wp), intent(in) :: exponential(:, :)
      real(wp) :: response(2*n, 3*n + 2)

      response(:, :2*n) = exponential(:2*n, :2*n)
      response(:, 2*n + 1:3*n) = exponential(:2*n, 2*n + 3:)
      response(:, 3*n + 1) = exponential(:2*n, 2*n + 1) - exponential(:2*n, 2*n + 2)
      response(:, 3*n + 2) = exponential(:2*n, 2*n + 2)
   end function response_to

   !> The same after twice as many steps, with the force at the end of each of them.
   pure function twice(n, once) result(response)
      integer, intent(in) :: n
      real(wp), intent(in) :: once(:, :)
      real(wp) :: response(2*n, 2*size(once, 2) - (3*n + 1))
      integer :: half

      half = size(once, 2)
      response(:, :half) = matmul(once(:, :2*n), once)
      response(:, half + 1:) = 0.0_wp
      response(:, 2*n + 1:3*n) = response(:, 2*n + 1:3*n) + once(:, 2*n + 1:3*n)
      response(:, half:) = response(:, half:) + once(:, 3*n + 1:)
   end function twice

   pure subroutine put_step(n, response, step)
      integer, intent(in) :: n
      real(wp), intent(in) :: response(:, :)
      real(wp), intent(inout) :: step(width, 2, columns)
      integer :: first, half, part

      do half = 1, 2
         first = (half - 1)*n
         associate (from => response(first + 1:first + n, :))
            do part = 0, 2   ! x, u, anchors
               step(:n, half, part*width + 1:part*width + n) = from(:, part*n + 1:part*n + n)
            end do
            step(:n, half, column_force:column_force + size(from, 2) - 3*n - 1) = from(:, 3*n + 1:)
         end associate
      end do
   end subroutine put_step

   pure subroutine put_pull(n, free, pull)
      integer, intent(in) :: n
      real(wp), intent(in) :: free(:, :)
      real(wp), intent(inout) :: pull(width, 2, width)
      integer :: i

      do i = 1, n
         pull(:n, 1, i) = -free(n + i, :n)
         pull(:n, 2, i) = -free(n + i, n + 1:2*n)
      end do
   end subroutine put_pull

   pure subroutine put_kick(n, k, power, kick)
      integer, intent(in) :: n, k
      real(wp), intent(in) :: power(:, :)
      real(wp), intent(inout) :: kick(width, 0:width - 1, width)
      integer :: i

      do i = 1, n
         kick(:n, k, i) = power(n + 1:2*n, n + i)
      end do
   end subroutine put_kick

end module dynamics_propagator
