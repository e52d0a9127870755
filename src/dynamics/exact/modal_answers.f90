!> Answers to the only transition of a sample in a part of a step, in the modal form: what it
!> changes at the end.
!>
!> The slider of the joint moves otherwise from then on: by what it slips, or back by what it would
!> have slipped. The paths of all joints and the motion of the other sliders that slip follow from
!> integrals of that motion, as H is a polynomial (M5), (M10).
module dynamics_exact_modal_answers
   use core_kinds, only: wp
   use dynamics_alignment, only: lanes => register_width
   use dynamics_exact_modal_terms, only: n_markov, path_degree
   use dynamics_exact_transitions, only: fall, last_integral
   implicit none(type, external)
   private
   public :: find_answers

   !> k!/(k + s)!, s first
   real(wp), parameter :: share_of(0:last_integral, path_degree) = transpose(fall(:path_degree, :))

contains

   !> Finds the answers to a transition of the first joint. The sliders of the others follow them.
   pure subroutine find_answers(markov, joints, path, starts, left, moments, ends)
      real(wp), intent(in), contiguous :: markov(:, :, 0:)   !! see modal_operators
      integer, intent(in) :: joints(:)
      real(wp), intent(in) :: path(path_degree)   !! of the first joint, from the transition on
      logical, intent(in) :: starts            !! its slip; else it ends
      real(wp), intent(in) :: left             !! of the part
      real(wp), intent(out) :: moments(0:last_integral, size(joints))   !! added to I_s (s, joint)
      real(wp), intent(out) :: ends(size(markov, 1), 0:1)   !! added to paths, velocities at the end
      real(wp) :: part(0:last_integral + n_markov + 1, size(joints), 0:2)   ! moments by order
      real(wp), dimension(0:last_integral) :: power, total
      real(wp) :: place(lanes), share, velocity(lanes)
      integer :: c, d, f, first, k, l, many, order, s

      many = size(joints)
      part = 0.0_wp
      power(0) = 1.0_wp
      do s = 1, last_integral
         power(s) = power(s - 1)*left
      end do
      share = merge(1.0_wp, -1.0_wp, starts)
      total = 0.0_wp
      do k = 1, path_degree
         share = share*left
         do s = 0, last_integral
            total(s) = total(s) + share*path(k)*share_of(s, k)
         end do
      end do
      part(:last_integral, 1, 0) = power*total
      do order = 1, 2   ! sliders that follow answer to it, and by Y_0 to each other
         do f = merge(1, 2, starts), many
            total = 0.0_wp
            do c = 1, merge(1, many, order == 1)
               do d = 0, merge(n_markov - 1, 0, order == 1)
                  do s = 0, last_integral
                     total(s) = total(s) &
                                + markov(joints(f), joints(c), d)*part(s + d + 2, c, order - 1)
                  end do
               end do
            end do
            part(:last_integral, f, order) = total
         end do
      end do
      moments = part(:last_integral, :, 0) + (part(:last_integral, :, 1) &
                                              + part(:last_integral, :, 2))
      ! the integral of H(1 - s) zeta(s) is Y_0 I_2 + Y_1 I_3 + Y_2 I_4, that of H' likewise
      do first = 0, size(ends, 1) - lanes, lanes
         place = 0.0_wp
         velocity = 0.0_wp
         do c = 1, many
            do d = 0, n_markov - 1
               do l = 1, lanes
                  place(l) = place(l) + moments(d + 2, c)*markov(first + l, joints(c), d)
                  velocity(l) = velocity(l) + moments(d + 1, c)*markov(first + l, joints(c), d)
               end do
            end do
         end do
         ends(first + 1:first + lanes, 0) = place
         ends(first + 1:first + lanes, 1) = velocity
      end do
   end subroutine find_answers

end module dynamics_exact_modal_answers
