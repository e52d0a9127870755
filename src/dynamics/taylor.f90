!> Taylor series of the chain's motion within one step, for eight samples side by side.
!>
!> Between transitions M u'' + C u' + K_s u = f with f linear in time, so the equation itself gives
!> every derivative. Time is counted in steps h: t = h tau, and x = sum_k x_k tau^k with (k+1)(k+2)
!> x_(k+2) = -(k+1) C^ x_(k+1) - K^ x_k + p_k,  C^ = h M^-1 C, K^ = h^2 M^-1 K_s. Every loop over
!> the lanes has constant length and is written for the vector unit.
module dynamics_taylor
   use core_kinds, only: wp
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: lanes, rows, taylor_type, new_taylor, fastest_rate, find_drag, order_for

   integer, parameter :: lanes = 8   !! samples side by side: one 64-byte vector
   integer, parameter :: rows = 5    !! masses whose sums are formed together
   integer, parameter :: max_order = 24

   !> The chain in units of one step, ready for the recursion.
   type :: taylor_type
      integer :: n = 0                              !! masses
      integer :: order = 0                          !! highest power of tau kept
      real(wp) :: h = 0.0_wp                        !! step [s]
      integer :: forced_dof = 0
      real(wp) :: force_scale = 0.0_wp              !! h^2/m of the forced mass [m/N]
      real(wp), allocatable :: damping(:, :, :)     !! C^ (row in block, dof, block)
      real(wp), allocatable :: coupling(:, :)       !! (-1:1, dof) K^ without the contact springs
      real(wp), allocatable :: contact(:)           !! (dof) h^2 k/m of the contact springs
   contains
      procedure :: expand
      procedure :: move
   end type taylor_type

contains

   !> The chain for steps of length h, with the order that keeps the tolerance.
   pure function new_taylor(chain, h, forced_dof, order) result(taylor)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      integer, intent(in) :: forced_dof, order
      type(taylor_type) :: taylor
      integer :: block, i, n

      n = chain%n_dof
      taylor%n = n
      taylor%order = order
      taylor%h = h
      taylor%forced_dof = forced_dof
      taylor%force_scale = h**2/chain%mass(forced_dof, forced_dof)
      taylor%contact = h**2*chain%joint_stiffness/chain%lumped_mass()
      allocate (taylor%damping(rows, n, (n + rows - 1)/rows), taylor%coupling(-1:1, n), &
                source=0.0_wp)
      do i = 1, n
         block = (i - 1)/rows
         taylor%damping(i - rows*block, :, block + 1) = h*chain%damping(i, :)/chain%mass(i, i)
         taylor%coupling(0, i) = h**2*chain%stiffness(i, i)/chain%mass(i, i)
         if (i > 1) taylor%coupling(-1, i) = h**2*chain%stiffness(i, i - 1)/chain%mass(i, i)
         if (i < n) taylor%coupling(1, i) = h**2*chain%stiffness(i, i + 1)/chain%mass(i, i)
      end do
   end function new_taylor

   !> A bound of |lambda| over the modes of every regime [rad/s]: |lambda|^2 <= 2 zeta omega
   !> |lambda| + omega^2 with the largest zeta and omega of the stuck chain, as a sliding mass only
   !> takes stiffness away.
   pure function fastest_rate(chain) result(rate)
      type(structure_type), intent(in) :: chain
      real(wp) :: rate
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      real(wp) :: zeta

      zeta = maxval(chain%damping_ratio)
      rate = two_pi*maxval(chain%frequencies_stuck)*(zeta + sqrt(1.0_wp + zeta**2))
   end function fastest_rate

   !> The lowest order at which the first power left out is below the tolerance, relative to the
   !> powers 2 that the load itself makes: 2 (rate h)^(P-1)/(P+1)!. (Relative to the amplitude it is
   !> smaller by (rate h)^2, but a heavy mass or a short history need not have that amplitude.)
   pure function order_for(rate_step, tolerance) result(order)
      real(wp), intent(in) :: rate_step   !! rate times h, at most about 1
      real(wp), intent(in) :: tolerance
      integer :: order
      integer, parameter :: least_order = 4
      real(wp) :: term

      term = 1.0_wp
      do order = 2, max_order
         term = term*rate_step/(order + 1)
         if (order >= least_order .and. term <= tolerance) return
      end do
      order = max_order
   end function order_for

   !> Fills x_2 .. x_P from the state x_0, x_1.
   pure subroutine expand(self, held, anchor, force, x)
      class(taylor_type), intent(in) :: self
      real(wp), intent(in) :: held(lanes, self%n)     !! 1: contact spring acts (stuck), 0: it slips
      real(wp), intent(in) :: anchor(lanes, self%n)   !! contact force over stiffness at x = 0 [m]
      real(wp), intent(in) :: force(lanes, 0:1)       !! value now and rise in one step [N]
      real(wp), intent(inout) :: x(lanes, 0:self%n + 1, 0:self%order)   !! zero at dof 0 and n+1
      integer :: k

      do k = 0, self%order - 2
         call next_power(self%n, k, self%damping, self%coupling, self%contact, held, x(1, 0, k), &
                         x(1, 0, k + 1), x(1, 0, k + 2))
         if (k == 0) call add_constant(self%n, self%contact, anchor, x(1, 0, 2))
         if (k <= 1) x(:, self%forced_dof, k + 2) = x(:, self%forced_dof, k + 2) + &
                                                    self%force_scale/((k + 1)*(k + 2))*force(:, k)
      end do
   end subroutine expand

   !> x_(k+2) from x_(k+1) and x_k, without the loads.
   pure subroutine next_power(n, k, damping, coupling, contact, held, x0, x1, x2)
      integer, intent(in) :: n, k
      real(wp), intent(in) :: damping(rows, n, *), coupling(-1:1, n), contact(n), held(lanes, n)
      real(wp), intent(in) :: x0(lanes, 0:n + 1), x1(lanes, 0:n + 1)
      real(wp), intent(inout) :: x2(lanes, 0:n + 1)
      real(wp) :: sums(lanes, rows)
      real(wp) :: by_velocity, by_displacement
      integer :: block, i, l

      by_displacement = -1.0_wp/((k + 1)*(k + 2))
      by_velocity = -1.0_wp/(k + 2)
      do block = 1, (n + rows - 1)/rows
         call find_drag(n, damping(1, 1, block), x1(1, 1), sums)
         do i = rows*(block - 1) + 1, min(n, rows*block)
            !$omp simd
            do l = 1, lanes
               x2(l, i) = by_velocity*sums(l, i - rows*(block - 1)) + by_displacement* &
                          (coupling(-1, i)*x0(l, i - 1) + coupling(1, i)*x0(l, i + 1) + &
                           (coupling(0, i) + contact(i)*held(l, i))*x0(l, i))
            end do
         end do
      end do
   end subroutine next_power

   !> C^ times velocities, for one block of its rows.
   pure subroutine find_drag(n, damping, velocity, drag)
      integer, intent(in) :: n
      real(wp), intent(in) :: damping(rows, n), velocity(lanes, n)
      real(wp), intent(out) :: drag(lanes, rows)
      real(wp) :: s1(lanes), s2(lanes), s3(lanes), s4(lanes), s5(lanes)
      integer :: j, l

      s1 = 0.0_wp
      s2 = 0.0_wp
      s3 = 0.0_wp
      s4 = 0.0_wp
      s5 = 0.0_wp
      do j = 1, n
         !$omp simd
         do l = 1, lanes
            s1(l) = s1(l) + damping(1, j)*velocity(l, j)
            s2(l) = s2(l) + damping(2, j)*velocity(l, j)
            s3(l) = s3(l) + damping(3, j)*velocity(l, j)
            s4(l) = s4(l) + damping(4, j)*velocity(l, j)
            s5(l) = s5(l) + damping(5, j)*velocity(l, j)
         end do
      end do
      !$omp simd
      do l = 1, lanes
         drag(l, 1) = s1(l)
         drag(l, 2) = s2(l)
         drag(l, 3) = s3(l)
         drag(l, 4) = s4(l)
         drag(l, 5) = s5(l)
      end do
   end subroutine find_drag

   !> The pull of stuck sliders and of sliding friction.
   pure subroutine add_constant(n, contact, anchor, x2)
      integer, intent(in) :: n
      real(wp), intent(in) :: contact(n), anchor(lanes, n)
      real(wp), intent(inout) :: x2(lanes, 0:n + 1)
      integer :: i, l

      do i = 1, n
         !$omp simd
         do l = 1, lanes
            x2(l, i) = x2(l, i) + 0.5_wp*contact(i)*anchor(l, i)
         end do
      end do
   end subroutine add_constant

   !> Moves the state x_0, x_1 on to time tau of each lane.
   pure subroutine move(self, tau, x)
      class(taylor_type), intent(in) :: self
      real(wp), intent(in) :: tau(lanes)
      real(wp), intent(inout) :: x(lanes, 0:self%n + 1, 0:self%order)
      real(wp) :: value(lanes), slope(lanes)
      integer :: i, k, l

      do i = 1, self%n
         value = x(:, i, self%order)
         slope = 0.0_wp
         do k = self%order - 1, 0, -1
            !$omp simd
            do l = 1, lanes
               slope(l) = slope(l)*tau(l) + value(l)
               value(l) = value(l)*tau(l) + x(l, i, k)
            end do
         end do
         x(:, i, 0) = value
         x(:, i, 1) = slope
      end do
   end subroutine move

end module dynamics_taylor
