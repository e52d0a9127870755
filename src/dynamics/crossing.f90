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
   use structure_model, only: structure_type
   use dynamics_course, only: course_type
   use dynamics_propagator, only: levels, propagator_type, stride_of, width
   use dynamics_walker, only: walker_type
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
      type(structure_type), intent(in) :: chain
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
         associate (mass => chain%mass(i, i), c => chain%damping(i, forced_dof), &
                    k => chain%stiffness(i, forced_dof))
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
   pure function is_smooth(batch, bend, walker)
      type(crossing_batch), intent(in) :: batch
      real(wp), intent(in) :: bend   !! all kinks of the force in the stretch (course_type)
      type(walker_type), intent(in) :: walker
      logical :: is_smooth
      real(wp) :: left_out
      integer :: i, stride

      stride = stride_of(walker%level)
      left_out = (stride*batch%rate_step)**2* &
                 (stride*batch%drag/4096.0_wp + stride**2*batch%coupling/20480.0_wp)*bend
      do i = 1, width
         is_smooth = left_out <= batch%tolerance*abs(walker%x(i, walker%place))
         if (is_smooth) return
      end do
   end function is_smooth

   !> Reads one mass of each listed sample, one to a lane.
   pure subroutine read_masses(n_listed, list, mass, tables, pull, course, n_samples, walker, batch)
      integer, intent(in) :: n_listed, list(n_listed), mass(n_listed), n_samples
      type(propagator_type), intent(in) :: tables
      real(wp), intent(in) :: pull(width, 2, width)   !! of these tables
      type(course_type), intent(in) :: course
      type(walker_type), intent(in) :: walker(n_samples)
      type(crossing_batch), intent(inout) :: batch
      ! of the kinks at the quarters of a stretch: place, and share in the polynomial
      integer, parameter :: offset(kinks, levels) = reshape([0, 0, 0, 0, 1, 0, 1, 2, 3], &
                                                            [kinks, levels])
      real(wp), parameter :: share(kinks, levels) = reshape([0, 0, 0, 0, 8, 0, 64, 64, 64], &
                                                            [kinks, levels])/6.0_wp
      real(wp) :: back0(width), back1(width), held, is_forced
      integer :: i, j, k, l, now, p, stride, w

      batch%n = n_listed
      do l = 1, n_listed
         w = list(l)
         i = mass(l)
         p = walker(w)%position
         now = walker(w)%place
         stride = stride_of(walker(w)%level)
         is_forced = merge(1.0_wp, 0.0_wp, i == tables%forced_dof)
         held = tables%contact(i)*walker(w)%anchor(i)
         !$omp simd
         do j = 1, width
            back0(j) = pull(j, 1, i)*walker(w)%x(j, now) + pull(j, 2, i)*walker(w)%u(j, now)
            back1(j) = pull(j, 1, i)*walker(w)%x(j, 1 - now) + pull(j, 2, i)*walker(w)%u(j, 1 - now)
         end do
         batch%x0(l) = walker(w)%x(i, now)
         batch%u0(l) = walker(w)%u(i, now)
         batch%pull0(l) = is_forced*tables%force_scale*course%force(p) + held - total(back0)
         batch%x1(l) = walker(w)%x(i, 1 - now)
         batch%u1(l) = walker(w)%u(i, 1 - now)
         batch%pull1(l) = is_forced*tables%force_scale*course%force(p + stride) + held - &
                          total(back1)
         batch%slider(l) = walker(w)%slider(i)
         batch%reach(l) = walker(w)%reach(i)
         batch%direction(l) = walker(w)%direction(i)
         batch%contact(l) = tables%contact(i)
         !GCC$ unroll 3
         do k = 1, kinks
            batch%bend(l, k) = is_forced*share(k, walker(w)%level)* &
                               course%kink(p + offset(k, walker(w)%level))
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
   pure subroutine step_across(batch, l, i, kick, walker)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: l, i
      real(wp), intent(in) :: kick(width, 0:width - 1, width)     !! of the new pattern
      type(walker_type), intent(inout) :: walker
      integer :: j, m, next

      next = 1 - walker%place
      !$omp simd
      do j = 1, width
         block
            real(wp) :: x_even, x_odd, u_even, u_odd
            x_even = walker%x(j, next)
            u_even = walker%u(j, next)
            x_odd = 0.0_wp
            u_odd = 0.0_wp
            !GCC$ unroll 4
            do m = 0, width - 1, 2   ! beyond batch%terms psi is 0
               u_even = u_even + batch%psi(l, m)*kick(j, m, i)
               x_even = x_even + batch%psi(l, m + 1)*kick(j, m, i)
               u_odd = u_odd + batch%psi(l, m + 1)*kick(j, m + 1, i)
               x_odd = x_odd + batch%psi(l, m + 2)*kick(j, m + 1, i)
            end do
            walker%x(j, next) = x_even + x_odd
            walker%u(j, next) = u_even + u_odd
         end block
      end do
   end subroutine step_across

end module dynamics_crossing
