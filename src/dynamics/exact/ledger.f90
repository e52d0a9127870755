!> Work of the force and of the dampers over a piece of motion, from the power series of its paths.
!>
!> Stored energy changes by input - viscous - friction. The joints' share needs no integral: a joint
!> that slips takes mu N times its way (dynamics_joint).
module dynamics_exact_ledger
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, width
   use dynamics_exact_series, only: series_type
   use numerics_quadrature, only: gauss_legendre
   implicit none(type, external)
   private
   public :: ledger_type, new_ledger

   !> Works are in J.
   type :: ledger_type
      real(wp), allocatable :: node(:), weight(:)   !! Gauss and Legendre, on (0, 1)
      real(wp), allocatable :: mass(:)              !! (row) m/h^2 [kg/s^2], 0 without a dof
   contains
      procedure :: add_part
      procedure :: add_piece
   end type ledger_type

contains

   !> As many nodes as integrate the power of the fastest motion a thousand times better than the
   !> tolerance: powers change at twice its rate, and n nodes leave (n!)^4/((2n + 1) (2n)!^3) times
   !> the derivative of order 2n.
   pure function new_ledger(series, mass, tolerance) result(ledger)
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: mass(:)     !! (dof) [kg]
      real(wp), intent(in) :: tolerance
      type(ledger_type) :: ledger
      integer, parameter :: most = 12
      integer :: n

      do n = 2, most - 1
         if ((2.0_wp*series%rate)**(2*n)*gamma(n + 1.0_wp)**4 <= &
             1.0e-3_wp*tolerance*(2*n + 1)*gamma(2*n + 1.0_wp)**3) exit
      end do
      allocate (ledger%node(n), ledger%weight(n), ledger%mass(series%n_dof))
      call gauss_legendre(0.0_wp, 1.0_wp, ledger%node, ledger%weight)
      ledger%mass = mass/series%h**2
   end function new_ledger

   !> Works of all lanes over one part without transitions.
   pure subroutine add_part(self, series, push, paths, work)
      class(ledger_type), intent(in) :: self
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: push(:, :, 0:)      !! (lane, loaded dof, power) [m]
      type(joint_paths), intent(in) :: paths
      real(wp), intent(inout) :: work(:, :)       !! (lane, input viscous)
      real(wp) :: velocity(width, series%n_dof), sums(width), power(width)
      integer :: e, g, i, k, l

      associate (x => paths%x, layer => paths%layer)
         do i = 1, size(series%loaded)
            associate (dof => series%loaded(i), m => self%mass(series%loaded(i)))
               do k = 1, series%degree
                  work(:, 1) = work(:, 1) + m*x(:, dof, layer(k)) &
                               *(push(:, i, 0) + (real(k, wp)/(k + 1))*push(:, i, 1))
               end do
            end associate
         end do
         do g = 1, size(self%node)
            do i = 1, series%n_dof
               velocity(:, i) = series%degree*x(:, i, series%degree)
               do k = series%degree - 1, 1, -1
                  do l = 1, width
                     velocity(l, i) = velocity(l, i)*self%node(g) + k*x(l, i, layer(k))
                  end do
               end do
            end do
            power = 0.0_wp
            associate (damping => series%damping(0))
               do i = 1, series%n_dof
                  sums = 0.0_wp
                  do e = damping%start(i), damping%start(i + 1) - 1
                     do l = 1, width
                        sums(l) = sums(l) + damping%value(e)*velocity(l, damping%column(e))
                     end do
                  end do
                  power = power - (2.0_wp*self%mass(i))*velocity(:, i)*sums
               end do
            end associate
            work(:, 2) = work(:, 2) + self%weight(g)*power
         end do
      end associate
   end subroutine add_part

   !> Works of one sample over a piece of a part.
   pure subroutine add_piece(self, series, push, x, span, work)
      class(ledger_type), intent(in) :: self
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: push(:, 0:)      !! (loaded dof, power) now and its rise in a part [m]
      real(wp), intent(in) :: x(:, 0:)         !! (row, power) about the beginning of the piece
      real(wp), intent(in) :: span             !! [parts]
      real(wp), intent(inout) :: work(:)       !! input, viscous
      real(wp) :: velocity(series%n_dof)
      integer :: g, i, k

      do i = 1, size(series%loaded)
         do k = 1, series%degree
            work(1) = work(1) + self%mass(series%loaded(i))*x(series%loaded(i), k)*span**k &
                      *(push(i, 0) + (real(k, wp)/(k + 1))*span*push(i, 1))
         end do
      end do
      do g = 1, size(self%node)
         velocity = 0.0_wp
         do k = series%degree, 1, -1
            velocity = velocity*(self%node(g)*span) + k*x(:series%n_dof, k)
         end do
         do i = 1, series%n_dof
            work(2) = work(2) - 2.0_wp*span*self%weight(g)*self%mass(i)*velocity(i) &
                      *series%damping(0)%row_times(i, velocity)
         end do
      end do
   end subroutine add_piece

end module dynamics_exact_ledger
