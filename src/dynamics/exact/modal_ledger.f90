!> Work of the force and of the dampers over a part of a step, in modes that C^ does not couple.
!>
!> The dampers' work in free motion is an exact quadratic form of where a mode starts and of its
!> load. What moving sliders add grows as t^2 in a velocity and as t^3 in a displacement. Numbers in
!> brackets are formulas of docs/exact_march.md.
module dynamics_exact_modal_ledger
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   implicit none(type, external)
   private
   public :: modal_ledger, new_modal_ledger

   !> Works are in J.
   type :: modal_ledger
      real(wp) :: scale = 0.0_wp              !! 1/h^2 [1/s^2]
      real(wp), allocatable :: damping(:)     !! (mode) C^_rr
      !> (entry, mode) integral of C^ q'^2: of q q, q q', q' q', q f, q' f, f f, q g, q' g, f g,
      !> g g, f the load at the start and g its rise (M9)
      real(wp), allocatable :: loss(:, :)
   contains
      procedure :: add_part
   end type modal_ledger

contains

   !> Quadratic forms of all modes.
   pure function new_modal_ledger(h, rate, damping) result(ledger)
      real(wp), intent(in) :: h                    !! of a part [s]
      real(wp), intent(in) :: rate(:), damping(:)  !! Omega, C^ (mode)
      type(modal_ledger) :: ledger
      real(wp) :: w(4, 4)
      integer :: r

      ledger%scale = 1.0_wp/h**2
      ledger%damping = damping
      allocate (ledger%loss(10, size(rate)))
      do r = 1, size(rate)
         w = find_loss(rate(r), damping(r))
         ledger%loss(:, r) = [w(1, 1), 2.0_wp*w(1, 2), w(2, 2), 2.0_wp*w(1, 3), 2.0_wp*w(2, 3), &
                              w(3, 3), 2.0_wp*w(1, 4), 2.0_wp*w(2, 4), 2.0_wp*w(3, 4), w(4, 4)]
      end do
   end function new_modal_ledger

   !> W = integral of exp(A't) Q exp(A t) over a part, by its power series over 2^-s of it, doubled:
   !> W(2t) = W(t) + exp(A't) W(t) exp(A t).
   pure function find_loss(rate, damping) result(w)
      real(wp), intent(in) :: rate, damping
      real(wp) :: w(4, 4)
      integer, parameter :: n_terms = 16
      real(wp), dimension(4, 4) :: a, change, q, term
      real(wp) :: t
      integer :: i, k, n_doublings

      a = 0.0_wp   ! q, q', f, g
      a(1, 2) = 1.0_wp
      a(2, :3) = [-rate**2, -damping, 1.0_wp]
      a(3, 4) = 1.0_wp
      n_doublings = max(0, exponent(4.0_wp*maxval(sum(abs(a), 2))))
      t = 0.5_wp**n_doublings
      q = 0.0_wp
      q(2, 2) = damping
      term = 0.0_wp
      do i = 1, 4
         term(i, i) = 1.0_wp
      end do
      change = term
      w = 0.0_wp
      do k = 1, n_terms
         q = q*(t/k)
         w = w + q
         q = matmul(transpose(a), q) + matmul(q, a)
         term = matmul(a, term)*(t/k)
         change = change + term
      end do
      do k = 1, n_doublings
         w = w + matmul(transpose(change), matmul(w, change))
         change = matmul(change, change)
      end do
   end function find_loss

   !> Works of all lanes over one part: input, of all forces, is by parts F(1) X(1) - F(0) X(0) - F'
   !> times the integral of X, the displacement where the force acts.
   pure subroutine add_part(self, load, weight, force, now, ahead, pushed, taken, work)
      class(modal_ledger), intent(in) :: self
      real(wp), intent(in) :: load(:, :)           !! (mode, force) h^2 Phi' b
      real(wp), intent(in) :: weight(0:, :, :)     !! (moment, q or q', mode)
      real(wp), intent(in) :: force(:, :, 0:)      !! (lane, force, value and rise) [N]
      real(wp), intent(in) :: now(:, :, :)         !! (lane, mode, 1:2) q, q' at the start
      real(wp), intent(in) :: ahead(:, :, :)       !! (.., 1:4) free motion: q, q' at 1, at 1/2
      real(wp), intent(in) :: pushed(:, :)         !! S z at the start
      real(wp), intent(in) :: taken(:, :, 0:)      !! (.., moment) of sliders
      real(wp), intent(inout) :: work(width, 2)    !! input, viscous
      real(wp), dimension(width) :: area, f, g, more, speed   ! more, speed: by sliders, at 1
      real(wp) :: c(10)
      integer :: i, k, r

      do r = 1, size(self%damping)
         c = self%scale*self%loss(:, r)
         f = 0.0_wp
         g = 0.0_wp
         do i = 1, size(load, 2)
            f = f + load(r, i)*force(:, i, 0)
            g = g + load(r, i)*force(:, i, 1)
         end do
         more = 0.0_wp
         speed = 0.0_wp
         do k = 0, ubound(weight, 1)
            more = more + weight(k, 1, r)*taken(:, r, k)
            speed = speed + weight(k, 2, r)*taken(:, r, k)
         end do
         associate (q => now(:, r, 1), v => now(:, r, 2))
            area = (7.0_wp*(q + ahead(:, r, 1)) + 16.0_wp*ahead(:, r, 3))/30.0_wp &
                   + (v - ahead(:, r, 2))/60.0_wp + 0.25_wp*more
            work(:, 1) = work(:, 1) + self%scale*((f + g)*(ahead(:, r, 1) + more) - f*q - g*area)
            f = f + pushed(:, r)
            work(:, 2) = work(:, 2) + (q*(c(1)*q + c(2)*v + c(4)*f + c(7)*g) &
                                       + v*(c(3)*v + c(5)*f + c(8)*g) &
                                       + f*(c(6)*f + c(9)*g) + c(10)*g**2)
         end associate
         work(:, 2) = work(:, 2) + (self%scale*self%damping(r))*speed* &
                      ((ahead(:, r, 4) + ahead(:, r, 2))/3.0_wp + 0.2_wp*speed)
      end do
   end subroutine add_part

end module dynamics_exact_modal_ledger
