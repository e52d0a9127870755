!> The energy ledger of one piece of motion: integrals of the powers over its Taylor polynomials.
!>
!> Stored energy changes by input - viscous - friction; what does not close is the march's own
!> error.
module dynamics_ledger
   use core_kinds, only: wp
   use structure_model, only: structure_type
   use dynamics_taylor, only: find_drag, lanes, rows, taylor_type
   use numerics_quadrature, only: gauss_legendre
   implicit none(type, external)
   private
   public :: ledger_type, new_ledger

   integer, parameter :: abreast = 4   !! nodes taken together

   !> What the integrals need; energies in J.
   type :: ledger_type
      real(wp), allocatable :: node(:), weight(:)   !! Gauss and Legendre, on (0, 1)
      real(wp), allocatable :: scale(:)             !! (dof) m/h^2 [kg/s^2]
   contains
      procedure :: add_work
   end type ledger_type

contains

   !> As many nodes as integrate the power of the fastest motion a thousand times better than the
   !> tolerance: powers change at twice its rate, and n nodes leave (n!)^4/((2n + 1) (2n)!^3) times
   !> the derivative of order 2n.
   pure function new_ledger(chain, taylor, rate_step, tolerance) result(ledger)
      type(structure_type), intent(in) :: chain
      type(taylor_type), intent(in) :: taylor
      real(wp), intent(in) :: rate_step, tolerance   !! fastest rate times h; relative
      type(ledger_type) :: ledger
      integer, parameter :: most = 4*abreast
      integer :: n

      do n = abreast, most - 1, abreast
         if ((2.0_wp*rate_step)**(2*n)*gamma(n + 1.0_wp)**4 <= &
             1.0e-3_wp*tolerance*(2*n + 1)*gamma(2*n + 1.0_wp)**3) exit
      end do
      allocate (ledger%node(n), ledger%weight(n))
      call gauss_legendre(0.0_wp, 1.0_wp, ledger%node, ledger%weight)
      ledger%scale = chain%lumped_mass()/taylor%h**2
   end function new_ledger

   !> Adds the work of the force, the dampers and the sliders over [0, span] of each lane.
   pure subroutine add_work(self, taylor, x, held, anchor, force, span, work)
      class(ledger_type), intent(in) :: self
      type(taylor_type), intent(in) :: taylor
      real(wp), intent(in) :: x(lanes, 0:taylor%n + 1, 0:taylor%order)   !! Taylor coefficients
      real(wp), intent(in) :: held(lanes, taylor%n), anchor(lanes, taylor%n)   !! see taylor%expand
      real(wp), intent(in) :: force(lanes, 0:1), span(lanes)             !! [N], [steps]
      real(wp), intent(inout) :: work(lanes, 3)   !! input, viscous, friction [J]
      real(wp) :: velocity(lanes, taylor%n, abreast), time(lanes, abreast)
      integer :: first, g, l

      do first = 0, size(self%node) - 1, abreast
         do g = 1, abreast
            time(:, g) = self%node(first + g)*span
         end do
         call find_velocities(taylor%n, taylor%order, x, time, velocity)
         do g = 1, abreast
            !$omp simd
            do l = 1, lanes
               work(l, 1) = work(l, 1) + self%weight(first + g)*span(l)* &
                            (force(l, 0) + force(l, 1)*time(l, g))*velocity(l, taylor%forced_dof, g)
            end do
            call add_viscous(taylor%n, taylor%damping, self%scale, self%weight(first + g), span, &
                             velocity(1, 1, g), work(1, 2))
         end do
      end do
      call add_friction(taylor%n, taylor%order, taylor%contact, self%scale, held, anchor, x, span, &
                        work(1, 3))
   end subroutine add_work

   !> Velocities at four times [m/step].
   pure subroutine find_velocities(n, order, x, time, velocity)
      integer, intent(in) :: n, order
      real(wp), intent(in) :: x(lanes, 0:n + 1, 0:order), time(lanes, abreast)
      real(wp), intent(out) :: velocity(lanes, n, abreast)
      real(wp), dimension(lanes) :: v1, v2, v3, v4
      integer :: i, k, l

      do i = 1, n
         v1 = 0.0_wp
         v2 = 0.0_wp
         v3 = 0.0_wp
         v4 = 0.0_wp
         do k = order, 1, -1
            !$omp simd
            do l = 1, lanes
               v1(l) = v1(l)*time(l, 1) + k*x(l, i, k)
               v2(l) = v2(l)*time(l, 2) + k*x(l, i, k)
               v3(l) = v3(l)*time(l, 3) + k*x(l, i, k)
               v4(l) = v4(l)*time(l, 4) + k*x(l, i, k)
            end do
         end do
         velocity(:, i, 1) = v1
         velocity(:, i, 2) = v2
         velocity(:, i, 3) = v3
         velocity(:, i, 4) = v4
      end do
   end subroutine find_velocities

   !> Adds the power of the dampers at one node.
   pure subroutine add_viscous(n, damping, scale, weight, span, velocity, work)
      integer, intent(in) :: n
      real(wp), intent(in) :: damping(rows, n, (n + rows - 1)/rows)   !! see taylor_type
      real(wp), intent(in) :: scale(n), weight, span(lanes), velocity(lanes, n)
      real(wp), intent(inout) :: work(lanes)
      real(wp) :: drag(lanes, rows), power(lanes)
      integer :: block, i, l

      power = 0.0_wp
      do block = 1, size(damping, 3)
         call find_drag(n, damping(:, :, block), velocity, drag)
         do i = rows*(block - 1) + 1, min(n, rows*block)
            !$omp simd
            do l = 1, lanes
               power(l) = power(l) + scale(i)*velocity(l, i)*drag(l, i - rows*(block - 1))
            end do
         end do
      end do
      work = work + weight*span*power
   end subroutine add_viscous

   !> Adds what the sliders that slip take: their force is constant, so only the way counts.
   pure subroutine add_friction(n, order, contact, scale, held, anchor, x, span, work)
      integer, intent(in) :: n, order
      real(wp), intent(in) :: contact(n), scale(n), held(lanes, n), anchor(lanes, n)
      real(wp), intent(in) :: x(lanes, 0:n + 1, 0:order), span(lanes)
      real(wp), intent(inout) :: work(lanes)
      real(wp) :: way(lanes)
      integer :: i, k, l

      do i = 1, n
         way = 0.0_wp
         do k = order, 1, -1
            !$omp simd
            do l = 1, lanes
               way(l) = (way(l) + x(l, i, k))*span(l)
            end do
         end do
         !$omp simd
         do l = 1, lanes
            work(l) = work(l) - (1.0_wp - held(l, i))*scale(i)*contact(i)*anchor(l, i)*way(l)
         end do
      end do
   end subroutine add_friction

end module dynamics_ledger
