!> The energy ledger of one piece of motion: exact integrals of the powers over its Taylor
!> polynomials.
!>
!> Stored energy changes by input - viscous - friction; what does not close is the march's own
!> error.
module dynamics_ledger
   use core_kinds, only: wp
   use dynamics_chain, only: chain_type
   use dynamics_taylor, only: lanes, taylor_type
   implicit none(type, external)
   private
   public :: ledger_type, new_ledger, gauss_legendre

   !> What the integrals need; energies in J.
   type :: ledger_type
      real(wp), allocatable :: node(:), weight(:)   !! Gauss and Legendre, on (0, 1)
      real(wp), allocatable :: damping(:, :)        !! C/h^2 (dof, dof): velocities in m/step
   contains
      procedure :: add_input_and_viscous
   end type ledger_type

contains

   !> Half the order and two points more: exact to the order to which the polynomials themselves
   !> are.
   pure function new_ledger(chain, taylor) result(ledger)
      type(chain_type), intent(in) :: chain
      type(taylor_type), intent(in) :: taylor
      type(ledger_type) :: ledger

      call gauss_legendre(taylor%order/2 + 2, ledger%node, ledger%weight)
      ledger%damping = chain%damping/taylor%h**2
   end function new_ledger

   !> Adds the work of the force and of the dampers over [0, span] of each lane.
   pure subroutine add_input_and_viscous(self, taylor, x, force, span, input, viscous)
      class(ledger_type), intent(in) :: self
      type(taylor_type), intent(in) :: taylor
      real(wp), intent(in) :: x(lanes, 0:taylor%n + 1, 0:taylor%order)   !! Taylor coefficients
      real(wp), intent(in) :: force(lanes, 0:1), span(lanes)             !! [N], [steps]
      real(wp), intent(inout) :: input(lanes), viscous(lanes)            !! [J]
      real(wp) :: velocity(lanes, taylor%n), power(lanes), time(lanes)
      integer :: g, i, j, k, l

      do g = 1, size(self%node)
         time = self%node(g)*span
         power = 0.0_wp
         do i = 1, taylor%n
            velocity(:, i) = 0.0_wp
            do k = taylor%order, 1, -1
               !$omp simd
               do l = 1, lanes
                  velocity(l, i) = velocity(l, i)*time(l) + k*x(l, i, k)
               end do
            end do
         end do
         do j = 1, taylor%n
            do i = 1, taylor%n
               !$omp simd
               do l = 1, lanes
                  power(l) = power(l) + velocity(l, i)*self%damping(i, j)*velocity(l, j)
               end do
            end do
         end do
         viscous = viscous + self%weight(g)*span*taylor%h*power
         input = input + self%weight(g)*span*(force(:, 0) + force(:, 1)*time)* &
                 velocity(:, taylor%forced_dof)
      end do
   end subroutine add_input_and_viscous

   !> Nodes and weights on (0, 1): Newton's iteration on the Legendre polynomial.
   pure subroutine gauss_legendre(n, node, weight)
      integer, intent(in) :: n
      real(wp), allocatable, intent(out) :: node(:), weight(:)
      real(wp), parameter :: pi = 4.0_wp*atan(1.0_wp)
      integer, parameter :: newton_steps = 6   ! from 1e-2/n^2, and each doubles the digits
      real(wp) :: x, p, below, next, slope
      integer :: i, k, step

      allocate (node(n), weight(n))
      do i = 1, n
         x = cos(pi*(i - 0.25_wp)/(n + 0.5_wp))
         do step = 1, newton_steps
            below = 1.0_wp
            p = x
            do k = 2, n
               next = ((2*k - 1)*x*p - (k - 1)*below)/k
               below = p
               p = next
            end do
            slope = n*(x*p - below)/(x**2 - 1.0_wp)
            x = x - p/slope
         end do
         node(i) = 0.5_wp*(1.0_wp - x)
         weight(i) = 1.0_wp/((1.0_wp - x**2)*slope**2)
      end do
   end subroutine gauss_legendre

end module dynamics_ledger
