!> Stretches of a few steps with transitions of different masses, many stretches side by side:
!> each transition is located on the path that its mass took, and what it changes for all masses is
!> added to the state that was reached as if it were not there.
!>
!> The path is the polynomial of degree 5 with the displacement, velocity and acceleration of both
!> ends of the stretch, which the equation of motion gives: it is off by (rate h)^6/46080 of the
!> amplitude, h the stretch. Where the force has a kink, the path of the forced mass has a known
!> third power more from there on, and those of its neighbours may be off (is_smooth). From the
!> transition on, the new regime differs from the old one by a force on that mass that is known, the
!> contact force it no longer feels (or feels again): phi(t) = +-(k/m) (x(t) - x(tau)) of the old
!> path. The answer at the end of the stretch is sum_m A^m b psi_m with psi_m the (m+1)-fold
!> integral of phi.
!>
!> The path of a mass that switches after another one bends where that one did only in its fourth
!> derivative, by damping, and is still that polynomial to the same accuracy.
module dynamics_crossing
   use core_kinds, only: wp
   use dynamics_chain, only: chain_type
   use dynamics_propagator, only: levels, stride_of, width
   use dynamics_schedule, only: book_size, of_level, of_place, of_position
   use dynamics_workspace, only: at_anchor, at_direction, at_reach, at_slider, at_state, sample_size
   implicit none(type, external)
   private
   public :: capacity, crossing_batch, kinks, kink_time
   public :: new_batch, path_error, is_smooth, read_masses, step_across

   integer, parameter :: capacity = 32          !! stretches side by side
   integer, parameter :: kinks = 3              !! of the force within a stretch, at its quarters
   real(wp), parameter :: kink_time(kinks) = [0.25_wp, 0.5_wp, 0.75_wp]   !! [stretches]

   !> Transitions to be located, one in each lane; arrays (lane).
   type :: crossing_batch
      integer :: n = 0             !! lanes in use
      integer :: terms = width     !! of the sum over A^m b psi_m
      real(wp) :: last_step = 0.0_wp   !! that the last iteration may be [stretches]
      real(wp) :: rate_step = 0.0_wp   !! rate times a step
      real(wp) :: tolerance = 0.0_wp   !! relative to the amplitude
      real(wp) :: drag = 0.0_wp        !! most that the forced mass's velocity pulls another, h C/m
      real(wp) :: coupling = 0.0_wp    !! and its displacement, h^2 K/m
      ! the mass before the stretch, after it, and its contact
      real(wp), dimension(capacity) :: x0 = 0.0_wp, u0 = 0.0_wp, pull0 = 0.0_wp
      real(wp), dimension(capacity) :: x1 = 0.0_wp, u1 = 0.0_wp, pull1 = 0.0_wp
      real(wp), dimension(capacity) :: slider = 0.0_wp, reach = 0.0_wp, direction = 0.0_wp
      real(wp), dimension(capacity) :: contact = 0.0_wp     !! h^2 k/m
      real(wp) :: bend(capacity, kinks) = 0.0_wp   !! of (t - kink_time)^3 that sets in on its path
      real(wp), dimension(capacity) :: span = 1.0_wp        !! length of the stretch [steps]
      ! what has been found
      real(wp), dimension(capacity) :: is_stick = 0.0_wp    !! 1: a slip ends, 0: one starts
      real(wp), dimension(capacity) :: sense = 1.0_wp       !! +1 or -1: way of the slip
      real(wp), dimension(capacity) :: is_located = 0.0_wp  !! 1: well, and it is the first one
      real(wp), dimension(capacity) :: is_clear = 0.0_wp    !! 1: the guard has no zero
      real(wp), dimension(capacity) :: tau = 0.0_wp         !! when [stretches]
      real(wp), dimension(capacity) :: x = 0.0_wp, u = 0.0_wp   !! there, velocity per stretch
      real(wp) :: psi(capacity, 0:width) = 0.0_wp   !! one more for displacements
   end type crossing_batch

contains

   !> Error that the path of degree 5 leaves in a displacement, relative to its amplitude.
   pure function path_error(rate_step) result(error)
      real(wp), intent(in) :: rate_step   !! rate times the length of the stretch
      real(wp) :: error

      error = rate_step**2*rate_step**6/46080.0_wp   ! the force that sets in carries (rate h)^2
   end function path_error

   !> An empty batch whose sums and iterations keep a tolerance, relative to the amplitude.
   pure function new_batch(chain, h, forced_dof, rate, longest, tolerance) result(batch)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: h           !! step [s]
      integer, intent(in) :: forced_dof
      real(wp), intent(in) :: rate        !! of the fastest mode [rad/s]
      integer, intent(in) :: longest      !! steps of the longest stretch
      real(wp), intent(in) :: tolerance
      type(crossing_batch) :: batch
      real(wp) :: rate_step, rest
      integer :: i, m

      batch%rate_step = rate*h
      batch%tolerance = tolerance
      do i = 1, chain%n_dof
         if (i == forced_dof) cycle
         associate (mass => chain%mass(i), c => chain%damping(i, forced_dof), &
                    k => chain%coupling(i, forced_dof))
            batch%drag = max(batch%drag, h*abs(c)/mass)
            batch%coupling = max(batch%coupling, h**2*abs(k)/mass)
         end associate
      end do
      rate_step = longest*rate*h
      rest = 0.5_wp*rate_step
      do m = 1, width - 1   ! what the sum leaves out: (rate h)^(m + 1)/(m + 2)!
         rest = rest*rate_step/(m + 2)
         if (rest <= tolerance) exit
      end do
      batch%terms = m
      ! an iteration leaves some (rate h)^2/6 times the cube of its step, and the force that sets in
      ! carries (rate h)^2 more
      batch%last_step = min(0.1_wp, 0.5_wp*(6.0_wp*tolerance/rate_step**4)**(1.0_wp/3.0_wp))
   end function new_batch

   !> Whether kinks of the force may be left out of the paths of other masses: there they bend the
   !> fourth derivative by damping, the fifth by the coupling, of which the polynomial takes all but
   !> a 4096th and a 20480th. The force that sets in carries (rate h)^2 of it.
   pure function is_smooth(batch, stride, bend, place, sample)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: stride, place
      real(wp), intent(in) :: bend   !! all kinks of the force, as sum_kinks has them
      real(wp), intent(in) :: sample(width, sample_size)
      logical :: is_smooth
      real(wp) :: left_out

      left_out = (stride*batch%drag/4096.0_wp + stride**2*batch%coupling/20480.0_wp)*bend
      is_smooth = (stride*batch%rate_step)**2*left_out <= &
                  batch%tolerance*maxval(abs(sample(:, at_state + 2*place)))
   end function is_smooth

   !> Reads one mass of each listed sample, one to a lane.
   pure subroutine read_masses(batch, n_listed, list, mass, n, contact, forced_dof, force_scale, &
                               n_forces, force, kink, pull, n_samples, book, sample)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n_listed, list(n_listed), mass(n_listed), n, forced_dof
      real(wp), intent(in) :: contact(n)    !! h^2 k/m
      real(wp), intent(in) :: force_scale   !! h^2/m of the forced mass [m/N]
      integer, intent(in) :: n_forces, n_samples
      real(wp), intent(in) :: force(0:n_forces - 1)   !! [N]
      real(wp), intent(in) :: kink(0:n_forces - 1)    !! find_kinks
      real(wp), intent(in) :: pull(width, 2, width)
      integer, intent(in) :: book(book_size, n_samples)
      real(wp), intent(in) :: sample(width, sample_size, n_samples)
      ! of the kinks at the quarters of a stretch: place, and share in the polynomial
      integer, parameter :: offset(kinks, levels) = reshape([0, 0, 0, 0, 1, 0, 1, 2, 3], &
                                                            [kinks, levels])
      real(wp), parameter :: share(kinks, levels) = reshape([0, 0, 0, 0, 8, 0, 64, 64, 64], &
                                                            [kinks, levels])/6.0_wp
      real(wp) :: back0(width), back1(width), is_forced
      integer :: i, j, k, l, level, p, stride, w, x0, x1

      batch%n = n_listed
      do l = 1, n_listed
         w = list(l)
         i = mass(l)
         p = book(of_position, w)
         level = book(of_level, w)
         stride = stride_of(level)
         x0 = at_state + 2*book(of_place, w)
         x1 = at_state + 2 - 2*book(of_place, w)
         is_forced = merge(1.0_wp, 0.0_wp, i == forced_dof)
         !$omp simd
         do j = 1, width
            back0(j) = pull(j, 1, i)*sample(j, x0, w) + pull(j, 2, i)*sample(j, x0 + 1, w)
            back1(j) = pull(j, 1, i)*sample(j, x1, w) + pull(j, 2, i)*sample(j, x1 + 1, w)
         end do
         batch%x0(l) = sample(i, x0, w)
         batch%u0(l) = sample(i, x0 + 1, w)
         batch%pull0(l) = is_forced*force_scale*force(p) + &
                          contact(i)*sample(i, at_anchor, w) - total(back0)
         batch%x1(l) = sample(i, x1, w)
         batch%u1(l) = sample(i, x1 + 1, w)
         batch%pull1(l) = is_forced*force_scale*force(p + stride) + &
                          contact(i)*sample(i, at_anchor, w) - total(back1)
         batch%slider(l) = sample(i, at_slider, w)
         batch%reach(l) = sample(i, at_reach, w)
         batch%direction(l) = sample(i, at_direction, w)
         batch%contact(l) = contact(i)
         !GCC$ unroll 3
         do k = 1, kinks
            batch%bend(l, k) = is_forced*share(k, level)*kink(p + offset(k, level))
         end do
         batch%span(l) = stride
      end do
   end subroutine read_masses

   !> The sum in pairs, none of which waits for another.
   pure function total(x)
      real(wp), intent(in) :: x(width)
      real(wp) :: total

      total = ((x(1) + x(2)) + (x(3) + x(4))) + ((x(5) + x(6)) + (x(7) + x(8)))
   end function total

   !> Adds the effect of the transition of a lane, of mass i, to the state that was reached without
   !> it.
   pure subroutine step_across(batch, l, i, kick, place, sample)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: l, i, place
      real(wp), intent(in) :: kick(width, 0:width - 1, width)     !! of the new pattern
      real(wp), intent(inout) :: sample(width, sample_size)
      integer :: j, m, x1

      x1 = at_state + 2 - 2*place
      !$omp simd
      do j = 1, width
         block
            real(wp) :: x_even, x_odd, u_even, u_odd
            x_even = sample(j, x1)
            u_even = sample(j, x1 + 1)
            x_odd = 0.0_wp
            u_odd = 0.0_wp
            !GCC$ unroll 4
            do m = 0, width - 1, 2   ! beyond batch%terms psi is 0
               u_even = u_even + batch%psi(l, m)*kick(j, m, i)
               x_even = x_even + batch%psi(l, m + 1)*kick(j, m, i)
               u_odd = u_odd + batch%psi(l, m + 1)*kick(j, m + 1, i)
               x_odd = x_odd + batch%psi(l, m + 2)*kick(j, m + 1, i)
            end do
            sample(j, x1) = x_even + x_odd
            sample(j, x1 + 1) = u_even + u_odd
         end block
      end do
   end subroutine step_across

end module dynamics_crossing
