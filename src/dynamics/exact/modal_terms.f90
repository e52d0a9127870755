!> Number of parts of a step (M7), and terms of the formulas (M8), that the modal form needs for a
!> tolerance. Numbers in brackets are formulas of docs/modal_march.md.
module dynamics_exact_modal_terms
   use core_alignment, only: lanes => register_width
   use core_kinds, only: two_pi, wp
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_modal_blocks, only: modal_blocks
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: choose_terms, parts_of_step, find_joint_properties, joint_properties, longest_in_parts
   public :: factorial, groups, lanes, modal_terms, n_markov, path_degree

   integer, parameter :: groups = width/lanes   !! groups of eight lanes
   integer, parameter :: path_degree = 6        !! degree of the paths of joints
   real(wp), parameter :: factorial(0:path_degree) = [1.0_wp, 1.0_wp, 2.0_wp, 6.0_wp, 24.0_wp, &
                                                      120.0_wp, 720.0_wp]
   integer, parameter :: n_markov = 3                !! Y_0, Y_1, Y_2 (M5)
   real(wp), parameter :: safety = 30.0_wp           !! factor of the error estimate (M7)
   real(wp), parameter :: term_safety = 10.0_wp      !! factor of the error estimates (M8)
   real(wp), parameter :: slide_safety = 3.0_wp      !! factor of sigma (M7), joints that slide on
   real(wp), parameter :: damper_safety = 3.0_wp     !! factor of (M7) for dampers at joints
   real(wp), parameter :: least_decay = 1.0_wp/2000.0_wp   !! of errors in a step (1)
   real(wp), parameter :: fit_gain = 20.0_wp         !! error of a cut over that of the fit (M7)
   real(wp), parameter :: quintic_error = 3.22e-6_wp  !! max t^2 (t - 1/2)^2 (t - 1)^2/6!

   !> Parts of a step, and terms that are kept.
   type :: modal_terms
      real(wp) :: h = 0.0_wp       !! length of a part [s]
      integer :: n_parts = 1       !! parts of a step, a power of two
      !> Last integral I_n of the sliders' motion: 2 or 5, as sums go by threes
      integer :: n_moments = 5
      !> First block whose p (1) and p' (2) at half the part matter (M8), or one behind the last
      integer :: first_midpoint(2) = 1
      real(wp) :: square = 0.0_wp   !! c: x'''' is taken as -c x'' in the blocks before these (M4)
      !> (power k of a path) lowest power of the sliders that adds to it; k - 1: none does
      integer :: first_power(3:path_degree) = 1
   end type modal_terms

   !> Properties of the joints of a structure (M7).
   type :: joint_properties
      real(wp), allocatable :: gain(:, :)        !! G (joint, mode)
      real(wp), allocatable :: compliance(:)     !! row sums of |W' M^-1 W| k (joint) [1/s^2]
      real(wp), allocatable :: decay(:)          !! w'M^-1 C M^-1 w/(w'M^-1 w) (joint) [1/s]
   end type joint_properties

contains

   !> Number of parts of a step, a power of two up to 2^30, that keeps the error of the paths within
   !> the tolerance (M7).
   pure integer function parts_of_step(structure, joints, dt, tolerance) result(n_parts)
      type(structure_type), intent(in) :: structure
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: dt, tolerance

      n_parts = 1
      do while (n_parts < 2**30)
         if (path_error(structure, joints, dt, n_parts) <= tolerance) return
         n_parts = 2*n_parts
      end do
   end function parts_of_step

   !> Longest step up to dt that n_parts parts march within the tolerance [s] (M7), by bisection.
   pure real(wp) function longest_in_parts(structure, n_parts, dt, tolerance) result(longest)
      type(structure_type), intent(in) :: structure
      integer, intent(in) :: n_parts
      real(wp), intent(in) :: dt, tolerance
      integer, parameter :: halvings = 100
      type(joint_properties) :: joints
      real(wp) :: step
      integer :: i

      call find_joint_properties(structure, joints)
      longest = 0.0_wp
      do i = 0, halvings
         step = longest + 0.5_wp**i*dt
         if (path_error(structure, joints, step, n_parts) <= tolerance) longest = step
         if (longest >= dt) return
      end do
   end function longest_in_parts

   !> Finds gain, compliance and decay of the joints.
   pure subroutine find_joint_properties(structure, joints)
      type(structure_type), intent(in) :: structure
      type(joint_properties), intent(out) :: joints
      real(wp), allocatable :: pushed(:, :)   ! M^-1 W

      joints%gain = matmul(transpose(structure%direction), structure%modes_stuck)
      joints%compliance = compliances(structure%joint_stiffness, joints%gain, &
                                      structure%frequencies_stuck, 0)
      pushed = matmul(structure%modes_stuck, transpose(joints%gain))
      joints%decay = sum(pushed*matmul(structure%damping, pushed), 1)/sum(joints%gain**2, 2)
   end subroutine find_joint_properties

   !> sigma (joint) of (M7): velocity to which the errors of a path add up while the joint slides
   !> on, over one error. Its spring adds kappa of the error in every part, until the motion decays
   !> or over the 2000 steps of (1).
   pure function accumulation(joints, dt, n_parts) result(sigma)
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: dt   !! [s]
      integer, intent(in) :: n_parts
      real(wp) :: sigma(size(joints%compliance))

      sigma = joints%compliance*(dt/n_parts)**2*slide_safety &
              *n_parts/max(joints%decay*dt, least_decay)
   end function accumulation

   !> Error of the paths of joints with n_parts parts a step, relative to the rms displacement (M7).
   !>
   !> The polynomial (M4) errs by 3.22e-6 rho^6 of the amplitude of a mode, rho = omega h. Responses
   !> to sliders, kappa = h^2 W' M^-1 W k, are cut off at kappa^3/5040 of the velocity; the fit of
   !> the kernel makes that 20 times less, except while a joint slides on. With a damper at the
   !> joint, gamma = c h, they are cut off at kappa (gamma^3 + 2 kappa gamma)/720.
   pure real(wp) function path_error(structure, joints, dt, n_parts)
      type(structure_type), intent(in) :: structure
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: dt   !! [s]
      integer, intent(in) :: n_parts
      real(wp), dimension(structure%n_joints) :: damper, kappa   ! gamma, kappa
      real(wp) :: rate(structure%n_dof)   ! omega dt (mode)

      path_error = 0.0_wp
      if (structure%n_joints == 0) return
      rate = two_pi*structure%frequencies_stuck*dt
      kappa = joints%compliance*(dt/n_parts)**2
      damper = joints%decay*(dt/n_parts)
      path_error = safety*(maxval(shares(joints%gain, rate) &
                                  *min(rate/n_parts, quintic_error*(rate/n_parts)**6)) &
                           + maxval(kappa)**3/(fit_gain*5040.0_wp)/n_parts) &
                   + damper_safety*maxval(kappa*(damper**3 + 2.0_wp*kappa*damper)) &
                   /(fit_gain*720.0_wp)/n_parts &
                   + maxval(kappa**3/5040.0_wp*accumulation(joints, dt, n_parts))
   end function path_error

   !> Share of each mode in the paths of joints, at most 1. Amplitudes are taken to fall with
   !> omega^-2 beyond omega dt = 1.
   pure function shares(gain, rate) result(share)
      real(wp), intent(in) :: gain(:, :), rate(:)
      real(wp) :: share(size(rate))
      integer :: r

      share = 0.0_wp
      if (size(gain, 1) == 0) return
      do r = 1, size(rate)
         share(r) = maxval(abs(gain(:, r))/max(maxval(abs(gain), 2), tiny(1.0_wp))) &
                    /max(1.0_wp, rate(r))**2
      end do
   end function shares

   !> Row sums of |G rate^power G'| k (joint), power = 0: those of |W' M^-1 W| k [1/s^2].
   pure function compliances(joint_stiffness, gain, rate, power) result(row_sum)
      real(wp), intent(in) :: joint_stiffness(:), gain(:, :), rate(:)
      integer, intent(in) :: power
      real(wp) :: row_sum(size(gain, 1))

      row_sum = matmul(abs(matmul(gain*spread(rate**power, 1, size(gain, 1)), &
                                  transpose(gain))), joint_stiffness)
   end function compliances

   !> Chooses the terms that the tolerance needs (M8): blocks that matter at half the part,
   !> integrals of the sliders' motion, terms of the responses.
   pure subroutine choose_terms(joint_stiffness, joints, rate, damping, blocks, tolerance, terms)
      real(wp), intent(in) :: joint_stiffness(:)
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: rate(:)          !! omega h (mode)
      real(wp), intent(in) :: damping(:, :)    !! C^ (mode, mode)
      type(modal_blocks), intent(in) :: blocks
      real(wp), intent(in) :: tolerance
      class(modal_terms), intent(inout) :: terms
      real(wp), parameter :: steps = 30.0_wp   ! steps over which errors of any sign add up
      real(wp), parameter :: negligible = 1.0e-100_wp
      real(wp), parameter :: mean_of_most = 8.0_wp/15.0_wp   ! mean over maximum of t^2 (1 - t)^2
      real(wp), parameter :: cubic_error = 2.6e-3_wp, quartic_error = 7.5e-5_wp   ! (M4)
      real(wp) :: response(0:n_markov - 1), kernel(0:2), memory, path(4), share(size(rate))
      real(wp) :: on   ! sigma/(share rho) (M8)
      real(wp) :: least, most   ! range of c (M8)
      real(wp), dimension(size(rate)) :: bend, slack, square   ! x''; |c - det A| at most; det A
      real(wp) :: gain(size(joints%gain, 1), blocks%ports*size(rate))
      integer :: d, k, r

      gain = blocks%outputs(joints%gain, .false.)
      do r = 1, size(rate)
         associate (ports => gain(:, blocks%ports*(r - 1) + 1:blocks%ports*r))
            ports(:, 1) = norm2(ports, 2)
         end associate
      end do
      share = shares(gain(:, ::blocks%ports), blocks%rate*terms%n_parts)
      do k = 1, 4
         path(k) = maxval(share*blocks%rate**k)   ! derivatives of the paths
      end do
      do k = 0, 2, 2
         kernel(k) = terms%h**2*max(0.0_wp, maxval(compliances(joint_stiffness, joints%gain, &
                                                               rate, k)))
      end do
      on = 0.0_wp
      if (path(1) > 0.0_wp) &
         on = maxval(accumulation(joints, terms%h*terms%n_parts, terms%n_parts))/path(1)
      associate (decay => maxval(sum(abs(damping), 1)))
         response = [kernel(0), kernel(0)*decay, kernel(2) + kernel(0)*decay**2]
      end associate
      square = blocks%block(1, 1, :)*blocks%block(2, 2, :) &
               - blocks%block(1, 2, :)*blocks%block(2, 1, :)
      slack = abs(blocks%block(1, 1, :) + blocks%block(2, 2, :))
      bend = blocks%rate*max(blocks%rate, sqrt(max(slack*terms%n_parts, least_decay))/terms%n_parts)
      slack = tolerance/(max(2.0_wp*term_safety, on*mean_of_most/slide_safety)*cubic_error &
                         *max(share*bend, negligible)) - slack*blocks%rate
      least = 0.0_wp
      most = 1.0_wp
      do r = 1, size(rate)
         least = max(least, square(r) - slack(r))
         most = min(most, square(r) + slack(r))
         if (least > most) exit
         terms%square = 0.5_wp*(least + most)
      end do
      d = findloc(max(2.0_wp*term_safety, on)*(quartic_error*share*blocks%rate**5) > tolerance, &
                  .true., 1)
      terms%first_midpoint = [r, merge(d, size(rate) + 1, d > 0)]
      memory = steps*terms%n_parts
      terms%n_moments = merge(2, 5, memory*kernel(2)*path(1)/720.0_wp <= 0.2_wp*tolerance)
      do k = 3, path_degree
         terms%first_power(k) = k - 1
         do d = 0, min(n_markov - 1, k - 3)
            if (max(20.0_wp*term_safety, on)*response(d)*path(k - 2 - d)/factorial(k) &
                > tolerance) &
               terms%first_power(k) = k - 2 - d
         end do
      end do
   end subroutine choose_terms

end module dynamics_exact_modal_terms
