!> Number of parts of a step (M7), and terms of the formulas (M8), that the modal form needs for a
!> tolerance. Numbers in brackets are formulas of docs/modal_march.md.
module dynamics_exact_modal_terms
   use core_alignment, only: lanes => register_width
   use core_error, only: error_type
   use core_kinds, only: two_pi, wp
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_modal_blocks, only: modal_blocks, new_modal_blocks
   use numerics_exponential, only: exponential_type, find_exponential
   use numerics_lapack, only: unit_matrix
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: choose_terms, find_joint_properties, joint_properties, longest_in_parts, parts_of_step
   public :: factorial, groups, lanes, modal_terms, n_markov, path_degree

   integer, parameter :: groups = width/lanes   !! groups of eight lanes
   integer, parameter :: path_degree = 6        !! degree of the paths of joints
   real(wp), parameter :: factorial(0:path_degree) = [1.0_wp, 1.0_wp, 2.0_wp, 6.0_wp, 24.0_wp, &
                                                      120.0_wp, 720.0_wp]
   integer, parameter :: n_markov = 3                !! Y_0, Y_1, Y_2 (M5)
   real(wp), parameter :: safety = 30.0_wp           !! factor of the error estimate (M7)
   real(wp), parameter :: term_safety = 10.0_wp      !! factor of the error estimates (M8)
   real(wp), parameter :: slide_safety = 10.0_wp     !! factor of sigma (M7), joints that slide on
   real(wp), parameter :: least_decay = 1.0_wp/2000.0_wp   !! of errors in a step (1)
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

   !> Properties of the joints and modes of a structure.
   type :: joint_properties
      real(wp), allocatable :: stiffness(:)      !! k (joint) [N/m]
      real(wp), allocatable :: gain(:, :)        !! G (joint, mode)
      real(wp), allocatable :: compliance(:)     !! row sums of |W' M^-1 W| k (joint) [1/s^2]
      real(wp), allocatable :: damping(:, :)     !! Phi' C Phi (mode, mode) [1/s]
   end type joint_properties

contains

   !> Number of parts of a step, a power of two up to 2^30, that keeps the error of the paths within
   !> the tolerance (M7).
   pure integer function parts_of_step(joints, blocks, dt, tolerance) result(n_parts)
      type(joint_properties), intent(in) :: joints
      type(modal_blocks), intent(in) :: blocks   !! those of a step
      real(wp), intent(in) :: dt, tolerance
      real(wp) :: amplitude(size(blocks%rate))

      amplitude = oscillations(joints, blocks, dt)
      n_parts = 1
      do while (n_parts < 2**30)
         if (path_error(joints, blocks, amplitude, dt, n_parts) <= tolerance) return
         n_parts = 2*n_parts
      end do
   end function parts_of_step

   !> Finds the longest step up to dt that n_parts parts march within the tolerance [s] (M7), by
   !> bisection.
   subroutine longest_in_parts(structure, n_parts, dt, tolerance, longest, error)
      type(structure_type), intent(in) :: structure
      integer, intent(in) :: n_parts
      real(wp), intent(in) :: dt, tolerance
      real(wp), intent(out) :: longest
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: halvings = 100
      type(joint_properties) :: joints
      type(modal_blocks) :: blocks, shorter
      real(wp) :: share   ! of dt
      integer :: i

      longest = 0.0_wp
      call find_joint_properties(structure, joints)
      call new_modal_blocks(dt*(two_pi*structure%frequencies_stuck), dt*joints%damping, blocks, &
                            error)
      if (allocated(error)) return
      do i = 0, halvings
         share = longest/dt + 0.5_wp**i
         shorter = blocks%scaled(share)
         if (path_error(joints, shorter, oscillations(joints, shorter, share*dt), share*dt, &
                        n_parts) <= tolerance) longest = share*dt
         if (longest >= dt) return
      end do
   end subroutine longest_in_parts

   !> Finds the properties of joints and modes.
   pure subroutine find_joint_properties(structure, joints)
      type(structure_type), intent(in) :: structure
      type(joint_properties), intent(out) :: joints
      integer :: r

      allocate (joints%stiffness, source=structure%joint_stiffness)
      joints%gain = matmul(transpose(structure%direction), structure%modes_stuck)
      associate (rate => two_pi*structure%frequencies_stuck)
         joints%compliance = compliances(joints, rate, 0)
         if (size(structure%damping_ratio) == 0) then
            joints%damping = matmul(transpose(structure%modes_stuck), &
                                    matmul(structure%damping, structure%modes_stuck))
            return
         end if
         allocate (joints%damping(size(rate), size(rate)), source=0.0_wp)
         do r = 1, size(rate)
            joints%damping(r, r) = 2.0_wp*structure%damping_ratio(r)*rate(r)
         end do
      end associate
   end subroutine find_joint_properties

   !> sigma (joint) of (M7): velocity to which the errors of a path add up while the joint slides
   !> on, over one error. Its spring adds kappa of the error in every part, until the modes fade, or
   !> over the 2000 steps of (1).
   pure function accumulation(joints, h, n_parts) result(sigma)
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: h   !! length of a part [s]
      integer, intent(in) :: n_parts
      real(wp) :: sigma(size(joints%compliance))
      real(wp) :: memory(size(joints%gain, 2))   ! parts until a mode has faded
      integer :: r

      memory = [(1.0_wp/max(joints%damping(r, r)*h, least_decay/n_parts), r=1, size(memory))]
      sigma = slide_safety*joints%compliance*h**2 &
              *matmul(joints%gain**2, memory)/sum(joints%gain**2, 2)
   end function accumulation

   !> Error of the paths of joints with n_parts parts a step, relative to the rms displacement (M7):
   !> that of the polynomial (M4), 3.22e-6 rho^6 of the amplitude of a block, and that of the
   !> responses to sliders, also in joints that slide on.
   pure real(wp) function path_error(joints, step_blocks, amplitude, dt, n_parts)
      type(joint_properties), intent(in) :: joints
      type(modal_blocks), intent(in) :: step_blocks   !! those of a step
      real(wp), intent(in) :: amplitude(:)            !! (block) of oscillations
      real(wp), intent(in) :: dt                      !! [s]
      integer, intent(in) :: n_parts
      type(modal_blocks) :: blocks
      real(wp) :: missed(size(joints%gain, 1))

      path_error = 0.0_wp
      if (size(missed) == 0) return
      blocks = step_blocks%scaled(1.0_wp/n_parts)
      missed = missed_responses(joints, blocks, dt/n_parts)
      path_error = safety*(maxval(amplitude*min(blocks%rate, quintic_error*blocks%rate**6)) &
                           + maxval(missed)/n_parts) &
                   + maxval(missed*accumulation(joints, dt/n_parts, n_parts))
   end function path_error

   !> Error of the path of each joint (joint) at the end of a part in which all sliders move with
   !> velocity 1, by the fit of H: sum |R| of (M7), less its rounding.
   pure function missed_responses(joints, blocks, h) result(missed)
      type(joint_properties), intent(in) :: joints
      type(modal_blocks), intent(in) :: blocks   !! those of a part
      real(wp), intent(in) :: h                  !! length of a part [s]
      real(wp) :: missed(size(joints%gain, 1))
      !> 1 - 7.5 s + 15 s^2 - 8.75 s^3 is orthogonal to s, s^2 and s^3 on [0, 1]
      real(wp), parameter :: factor(0:3) = [1.0_wp, -7.5_wp, 15.0_wp, -8.75_wp], &
                             rounding = 1.0e-14_wp
      type(exponential_type) :: half, full
      real(wp) :: a(2, 2), both(2, 2), kernel(blocks%ports, blocks%ports)
      real(wp), dimension(size(missed), blocks%ports*size(blocks%rate)) :: gain, push
      real(wp) :: response(size(missed), size(missed)), scale   ! scale of the second variable
      integer :: b, i, k

      gain = blocks%outputs(joints%gain, .false.)
      push = transpose(blocks%inputs(transpose(joints%gain)))
      both = unit_matrix(2)
      response = 0.0_wp
      associate (ports => blocks%ports)
         do b = 1, size(blocks%rate)
            a = blocks%block(:, :, b)
            scale = blocks%balance(b)
            a(1, 2) = a(1, 2)*scale
            a(2, 1) = a(2, 1)/scale
            call find_exponential(a, both(:, 3 - ports:), ubound(factor, 1), half, full)
            kernel = 0.0_wp
            do k = 0, ubound(factor, 1)
               kernel = kernel + factor(k)*full%moment(:ports, :, k)
            end do
            kernel(:, ports) = kernel(:, ports)/scale
            if (ports == 2) kernel(2, :) = kernel(2, :)*scale
            associate (rows => [(ports*(b - 1) + i, i=1, ports)])
               response = response + matmul(gain(:, rows), matmul(kernel, &
                                                                  transpose(push(:, rows))))
            end associate
         end do
      end associate
      missed = h**2*max(0.0_wp, matmul(abs(response), joints%stiffness) &
                        - rounding*joints%compliance)
   end function missed_responses

   !> Share of each block in the paths of joints, at most 1. Amplitudes are taken to fall with
   !> omega^-2 beyond omega dt = 1.
   pure function shares(gain, blocks, n_parts) result(share)
      real(wp), intent(in) :: gain(:, :)         !! G (joint, mode)
      type(modal_blocks), intent(in) :: blocks   !! those of a part
      integer, intent(in) :: n_parts
      real(wp) :: share(size(blocks%rate))
      real(wp) :: outputs(size(gain, 1), size(share))

      share = 0.0_wp
      if (size(gain, 1) == 0) return
      outputs = norms(blocks%outputs(gain, .false.), blocks%ports)
      share = maxval(outputs/spread(max(maxval(outputs, 2), tiny(1.0_wp)), 2, size(share)), 1) &
              /max(1.0_wp, blocks%rate*n_parts)**2
   end function shares

   !> Amplitude with which each block (block) oscillates in the paths of joints, over the rms
   !> displacement, at most its share (M7). Beyond omega dt = 1 only kinks excite it: those of the
   !> force between steps, which add up until it has faded, and those of sliders.
   pure function oscillations(joints, blocks, dt) result(amplitude)
      type(joint_properties), intent(in) :: joints
      type(modal_blocks), intent(in) :: blocks   !! those of a step
      real(wp), intent(in) :: dt                 !! [s]
      real(wp) :: amplitude(size(blocks%rate))
      real(wp), dimension(size(joints%gain, 1), size(amplitude)) :: inputs, outputs
      real(wp), parameter :: no_decay = 1.0e-30_wp
      real(wp), dimension(size(amplitude)) :: decay, kink, rate   ! decay, rate of a step

      amplitude = shares(joints%gain, blocks, 1)
      if (size(inputs, 1) == 0) return
      inputs = dt**2*norms(transpose(blocks%inputs(transpose(joints%gain))), blocks%ports)
      outputs = norms(blocks%outputs(joints%gain, .false.), blocks%ports)
      rate = max(1.0_wp, blocks%rate)
      decay = -0.5_wp*(blocks%block(1, 1, :) + blocks%block(2, 2, :))
      kink = maxval(outputs, 1)*matmul(joints%stiffness, inputs)/rate**(4 - blocks%ports)
      amplitude = amplitude*min(1.0_wp, max(1.0_wp, minval(blocks%rate))**2 &
                                *(1.0_wp + 1.0_wp/max(decay, no_decay))/rate &
                                + kink/max(amplitude, tiny(1.0_wp)))
   end function oscillations

   !> Bend x'' of each block (block) during a blow, over the amplitude that the path of a joint has
   !> afterwards: the largest of all joints and forces (M8).
   pure function jump_shares(gain, load, blocks) result(jump)
      real(wp), intent(in) :: gain(:, :)         !! G (joint, mode)
      real(wp), intent(in) :: load(:, :)         !! load on the modes (mode, force)
      type(modal_blocks), intent(in) :: blocks   !! those of a part
      real(wp) :: jump(size(blocks%rate))
      real(wp), parameter :: least_rate = 0.01_wp   ! motion grows over 100 parts at most
      real(wp) :: amplitude(size(jump)), inputs(size(load, 2), size(jump)), &
                  outputs(size(gain, 1), size(jump))
      integer :: f, j

      outputs = norms(blocks%outputs(gain, .false.), blocks%ports)
      inputs = norms(transpose(blocks%inputs(load)), blocks%ports)
      jump = 0.0_wp
      do f = 1, size(inputs, 1)
         do j = 1, size(outputs, 1)
            amplitude = outputs(j, :)*inputs(f, :)
            if (blocks%ports == 1) amplitude = amplitude/max(blocks%rate, least_rate)
            if (any(amplitude > 0.0_wp)) &
               jump = max(jump, blocks%rate*amplitude/norm2(amplitude))
         end do
      end do
   end function jump_shares

   !> Norms over the ports of each block (row, block).
   pure function norms(factors, ports)
      real(wp), intent(in) :: factors(:, :)   !! (row, port)
      integer, intent(in) :: ports            !! ports of a block
      real(wp) :: norms(size(factors, 1), size(factors, 2)/ports)
      integer :: b

      do b = 1, size(norms, 2)
         norms(:, b) = norm2(factors(:, ports*(b - 1) + 1:ports*b), 2)
      end do
   end function norms

   !> Row sums of |G rate^power G'| k (joint), power = 0: those of |W' M^-1 W| k [1/s^2].
   pure function compliances(joints, rate, power) result(row_sum)
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: rate(:)   !! (mode)
      integer, intent(in) :: power
      real(wp) :: row_sum(size(joints%gain, 1))

      associate (gain => joints%gain)
         row_sum = matmul(abs(matmul(gain*spread(rate**power, 1, size(gain, 1)), &
                                     transpose(gain))), joints%stiffness)
      end associate
   end function compliances

   !> Chooses the terms that the tolerance needs (M8): blocks that matter at half the part,
   !> integrals of the sliders' motion, terms of the responses.
   pure subroutine choose_terms(joints, load, rate, damping, blocks, tolerance, terms)
      type(joint_properties), intent(in) :: joints
      real(wp), intent(in) :: load(:, :)       !! load on the modes (mode, force)
      real(wp), intent(in) :: rate(:)          !! omega h (mode)
      real(wp), intent(in) :: damping(:, :)    !! C^ (mode, mode)
      type(modal_blocks), intent(in) :: blocks
      real(wp), intent(in) :: tolerance
      class(modal_terms), intent(inout) :: terms
      real(wp), parameter :: steps = 30.0_wp   ! steps over which errors of any sign add up
      real(wp), parameter :: negligible = 1.0e-100_wp
      real(wp), parameter :: mean_of_most = 8.0_wp/15.0_wp   ! mean over maximum of t^2 (1 - t)^2
      real(wp), parameter :: cubic_error = 2.6e-3_wp, quartic_error = 7.5e-5_wp   ! (M4)
      real(wp) :: response(0:n_markov - 1), kernel(0:2), path(4)
      real(wp) :: on   ! sigma/(share rho) (M8)
      real(wp) :: least, most   ! range of c (M8)
      real(wp), dimension(size(rate)) :: bend, jump   ! x'' over the amplitude: often; once
      real(wp), dimension(size(rate)) :: share, slack, square   ! |c - det A| at most; det A
      real(wp) :: memory, most_jump
      integer :: d, k, r

      share = shares(joints%gain, blocks, terms%n_parts)
      jump = term_safety*jump_shares(joints%gain, load, blocks)
      most_jump = maxval(jump)
      do k = 1, 4
         path(k) = maxval(share*blocks%rate**k)   ! derivatives of the paths
      end do
      do k = 0, 2, 2
         kernel(k) = terms%h**2*maxval([compliances(joints, rate, k), 0.0_wp])
      end do
      on = 0.0_wp
      if (path(1) > 0.0_wp) &
         on = maxval(accumulation(joints, terms%h, terms%n_parts))/path(1)
      associate (decay => maxval(sum(abs(damping), 1)))
         response = [kernel(0), kernel(0)*decay, kernel(2) + kernel(0)*decay**2]
      end associate
      square = blocks%block(1, 1, :)*blocks%block(2, 2, :) &
               - blocks%block(1, 2, :)*blocks%block(2, 1, :)
      slack = abs(blocks%block(1, 1, :) + blocks%block(2, 2, :))
      bend = share*blocks%rate*max(blocks%rate, sqrt(max(slack*terms%n_parts, least_decay)) &
                                   /terms%n_parts)
      slack = tolerance/(cubic_error &
                         *max(max(2.0_wp*term_safety, on*mean_of_most/slide_safety)*bend, jump, &
                              negligible)) - slack*blocks%rate
      least = 0.0_wp
      most = 1.0_wp
      do r = 1, size(rate)
         least = max(least, square(r) - slack(r))
         most = min(most, square(r) + slack(r))
         if (least > most) exit
         terms%square = 0.5_wp*(least + most)
      end do
      d = findloc(quartic_error*blocks%rate**3*max(max(2.0_wp*term_safety, on)*share &
                                                   *blocks%rate**2, jump) > tolerance, .true., 1)
      terms%first_midpoint = [r, merge(d, size(rate) + 1, d > 0)]
      memory = steps*terms%n_parts
      terms%n_moments = merge(2, 5, memory*kernel(2)*path(1)/720.0_wp <= 0.2_wp*tolerance)
      do k = 3, path_degree
         terms%first_power(k) = k - 1
         do d = 0, min(n_markov - 1, k - 3)
            if (response(d)/factorial(k)*max(max(20.0_wp*term_safety, on)*path(k - 2 - d), &
                                             most_jump) > tolerance) &
               terms%first_power(k) = k - 2 - d
         end do
      end do
   end subroutine choose_terms

end module dynamics_exact_modal_terms
