!> Work and precision of the marches, and what a step costs in longer chains and when nothing
!> happens.
!>
!> Each setting marches 32 samples of the paper's chain, a campaign's block; sample 1 is one of the
!> reference histories of tests/reference/dynamics, whose errors are given, the others differ in
!> friction. Errors of displacement and slip fraction are the largest over the dofs. That of the
!> spectrum is the rms of its relative deviation over 0.1 to 3 Hz, of the worst dof, from the event
!> march at 1e-12 (the references have too few records). CPU time, the best of several of each
!> thousand steps: another process on the same core makes some of them half as fast again. Run from
!> the root of the repository:
!> build/release/bin/bench_dynamics [folder [settings | chains | dense | newmark | idle]]
program bench_dynamics
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: to_text
   use dynamics_exact_march, only: exact_march, new_exact_march
   use dynamics_joint, only: count_open_slips
   use dynamics_newmark_march, only: new_newmark, newmark_marcher
   use dynamics_response, only: block_state, marcher_type, start_block
   use numerics_spectrum, only: welch_type
   use structure_chain, only: build_chain
   use structure_model, only: build_structure, damping_type, part_names, structure_type
   implicit none(type, external)
   integer, parameter :: n_samples = 32, repetitions = 5, stride = 100, records_per_piece = 10
   integer, parameter :: thinning = 4, segment = 1024   !! defaults of the program for spectra
   real(wp), parameter :: dt = 0.00843_wp
   real(wp) :: exact_psd(0:segment/2, 5)
   character(:), allocatable :: folder
   character(200) :: argument

   folder = 'tests/reference/dynamics/'
   if (command_argument_count() > 0) then
      call get_command_argument(1, argument)
      folder = trim(argument)//'/'
   end if
   if (is_wanted('settings')) then
      print '(a)', '# case setting ns_per_sample_step error_rms_x error_slip_fraction '// &
         'error_spectrum missed'
      call compare('p1_low')
      call compare('p2_high')
   end if
   if (is_wanted('chains')) then
      print '(a)', '# event method at 1e-6: dofs ns_per_sample_step transitions_per_sample_step'
      call lengthen('event', [1, 2, 3, 5, 8, 9, 10, 20, 50, 100, 200, 1000])
   end if
   if (is_wanted('dense')) then
      print '(a)', '# event method at 1e-6, mass matrix not diagonal: dofs joints damping '// &
         'ns_per_sample_step transitions_per_sample_step ns_with_ledger'
      call march_dense(50, 20, 600, 'modal')
      call march_dense(200, 50, 200, 'modal')
      call march_dense(50, 20, 600, 'rayleigh')
      call march_dense(200, 50, 200, 'rayleigh')
   end if
   if (is_wanted('newmark')) then
      print '(a)', '# newmark, 15 halvings: dofs ns_per_sample_step transitions_per_sample_step'
      print '(a)', '# each of some 26 tries per transition is a product: up to 8 dofs by the map'
      print '(a)', '# of the pattern; beyond, by what counts of that of the stuck chain'
      call lengthen('newmark', [1, 2, 3, 5, 8, 9, 10, 20, 50, 100, 200])
   end if
   if (is_wanted('idle')) then
      print '(a)', '# when nothing happens: motion setting ns_per_sample_step'
      call idle()
   end if

contains

   !> True if a part of the comparison is asked for, or none is.
   logical function is_wanted(part)
      character(*), intent(in) :: part

      is_wanted = .true.
      if (command_argument_count() < 2) return
      call get_command_argument(2, argument)
      is_wanted = argument == part
   end function is_wanted

   !> Measures chains that cannot slip (a force a thousand times smaller), and that always slip
   !> (without friction): the cost is that of the linear step.
   subroutine idle()
      type(exact_march) :: event
      type(newmark_marcher) :: newmark
      type(error_type), allocatable :: error
      type(block_state) :: state
      type(structure_type) :: chain
      real(wp), allocatable :: force(:, :), x(:, :)
      real(wp) :: nanoseconds

      call read_force('p1_low', 1, force)
      chain = equal_chain(5)
      call new_exact_march(chain, dt, 1.0e-6_wp, event, error)
      call new_newmark(chain, dt, 15, 0.25_wp, 0.5_wp, newmark, error)
      call time_march(newmark, chain, 1.0e-3_wp*force, stride, state, x, nanoseconds)
      print '(a, f8.1)', 'stuck    newmark halvings 15', nanoseconds
      chain%normal_load = 0.0_wp
      call new_exact_march(chain, dt, 1.0e-6_wp, event, error)
      call time_march(event, chain, force, stride, state, x, nanoseconds)
      print '(a, f8.1)', 'slipping event 1e-6         ', nanoseconds
      chain = equal_chain(5)
      call new_exact_march(chain, dt, 1.0e-6_wp, event, error)
      call time_march(event, chain, 1.0e-3_wp*force, stride, state, x, nanoseconds)
      print '(a, f8.1)', 'stuck    event 1e-6         ', nanoseconds
      print '(a, f8.1)', '# multiplications with addition per ns on this core', 0.5_wp*peak_rate()
   end subroutine idle

   !> Multiplications and additions per ns on numbers that stay in registers.
   function peak_rate() result(rate)
      real(wp) :: rate
      integer, parameter :: chains = 96, rounds = 2000000
      real(wp) :: begin, best, end, x(chains)
      integer :: i, k, repetition

      best = huge(1.0_wp)
      do repetition = 1, repetitions
         x = [(1.0_wp/i, i=1, chains)]
         call cpu_time(begin)
         do k = 1, rounds
            !$omp simd
            do i = 1, chains
               x(i) = x(i)*0.999_wp + 0.001_wp
            end do
         end do
         call cpu_time(end)
         if (sum(x) > 0.0_wp) best = min(best, end - begin)
      end do
      rate = 2.0_wp*chains*real(rounds, wp)/(1.0e9_wp*best)
   end function peak_rate

   !> Compares all settings on one reference history.
   subroutine compare(case)
      character(*), intent(in) :: case
      type(exact_march) :: event
      type(newmark_marcher) :: newmark
      type(error_type), allocatable :: error
      type(structure_type) :: chain
      real(wp), allocatable :: force(:, :)
      integer, parameter :: halvings(8) = [0, 1, 2, 3, 5, 10, 15, 20]
      integer :: finer, k

      chain = equal_chain(5)
      call read_force(case, 1, force)
      call new_exact_march(chain, dt, 1.0e-12_wp, event, error)
      exact_psd = spectrum_of_first(event, chain, force, 1)
      do k = 3, 12
         call new_exact_march(chain, dt, 10.0_wp**(-k), event, error)
         call read_force(case, 1, force)
         call report(case, 'event 1e-'//to_text(k), event, force, 1, chain)
      end do
      do k = 1, size(halvings)
         call new_newmark(chain, dt, halvings(k), 0.25_wp, 0.5_wp, newmark, error)
         call report(case, 'newmark halvings '//to_text(halvings(k)), newmark, force, 1, chain)
      end do
      do k = 1, 4
         finer = 2**k
         call new_newmark(chain, dt/finer, 15, 0.25_wp, 0.5_wp, newmark, error)
         call read_force(case, finer, force)
         call report(case, 'newmark dt/'//to_text(finer), newmark, force, finer, chain)
      end do
   end subroutine compare

   !> Prints one line: a step is always dt, however finely it is divided.
   subroutine report(case, setting, marcher, force, finer, chain)
      character(*), intent(in) :: case, setting
      class(marcher_type), intent(inout) :: marcher
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: finer
      type(structure_type), intent(in) :: chain
      type(block_state) :: state
      real(wp), allocatable :: x(:, :), exact(:, :), slip(:)
      real(wp) :: nanoseconds, error_x
      integer :: i, missed, starts(5), stops(5)

      call time_march(marcher, chain, force, stride*finer, state, x, nanoseconds)
      call count_open_slips(chain, marcher%dt*ubound(force, 1), state)
      nanoseconds = nanoseconds*finer
      call read_reference(case, exact, slip, starts, stops)
      error_x = 0.0_wp
      do i = 1, 5
         error_x = max(error_x, sqrt(sum((x(:, i) - exact(i, :))**2)/sum(exact(i, :)**2)))
      end do
      missed = sum(starts) + sum(stops) - &
               int(sum(state%account(:, 1)%slip_starts + state%account(:, 1)%stick_starts))
      print '(a, 2x, a20, f9.1, 3es11.2, i7)', case, setting, nanoseconds, error_x, &
         maxval(abs(state%account(:, 1)%slip_time/(marcher%dt*ubound(force, 1)) - slip)), &
         error_of_spectrum(spectrum_of_first(marcher, chain, force, finer)), missed
   end subroutine report

   !> Power spectral densities of the displacements of sample 1 (frequency, dof).
   function spectrum_of_first(marcher, chain, force, finer) result(psd)
      class(marcher_type), intent(inout) :: marcher
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: finer
      real(wp) :: psd(0:segment/2, 5)
      type(welch_type) :: welch
      type(block_state) :: state
      type(error_type), allocatable :: error
      real(wp), allocatable :: x(:, :, :)

      allocate (x(ubound(force, 1)/(thinning*finer), 5, 1))
      call start_block(chain, reshape(spread(0.2_wp, 1, 5), [5, 1]), state)
      call marcher%advance(state, force, thinning*finer, x, error=error)
      if (allocated(error)) error stop error%message
      call welch%start(5, segment, segment/2, thinning*dt)
      call welch%add(x(:, :, 1))
      call welch%finish(psd)
   end function spectrum_of_first

   real(wp) function error_of_spectrum(psd)
      real(wp), intent(in) :: psd(0:, :)
      integer :: first, last

      first = ceiling(0.1_wp*segment*thinning*dt)
      last = floor(3.0_wp*segment*thinning*dt)
      associate (change => psd(first:last, :)/exact_psd(first:last, :) - 1.0_wp)
         error_of_spectrum = sqrt(maxval(sum(change**2, 1))/(last - first + 1))
      end associate
   end function error_of_spectrum

   !> Measures the cost of longer chains of equal oscillators, with the forces of the second case on
   !> the last one.
   subroutine lengthen(method, sizes)
      character(*), intent(in) :: method
      integer, intent(in) :: sizes(:)
      type(exact_march) :: event
      type(newmark_marcher) :: newmark
      type(structure_type) :: chain
      type(error_type), allocatable :: error
      type(block_state) :: state
      real(wp), allocatable :: force(:, :), x(:, :)
      real(wp) :: nanoseconds, events
      integer :: k, n_steps

      call read_force('p2_high', 1, force)
      do k = 1, size(sizes)
         n_steps = merge(20000, 2000, sizes(k) <= 10)
         if (sizes(k) > 50) n_steps = 500
         if (sizes(k) > 500) n_steps = 100
         chain = equal_chain(sizes(k))
         if (method == 'event') then
            call new_exact_march(chain, dt, 1.0e-6_wp, event, error)
            call time_march(event, chain, force(:n_steps, :), stride, state, x, nanoseconds)
         else
            call new_newmark(chain, dt, 15, 0.25_wp, 0.5_wp, newmark, error)
            call time_march(newmark, chain, force(:n_steps, :), stride, state, x, nanoseconds)
         end if
         events = real(sum(state%account%slip_starts + state%account%stick_starts), wp)/ &
                  (real(n_steps, wp)*n_samples)
         print '(i5, f10.1, f9.4)', sizes(k), nanoseconds, events
      end do
   end subroutine lengthen

   !> Measures the cost of a chain in general coordinates, x = T y with T close to one: M and K are
   !> dense, joints act in general directions. Forces are those of the second case. Modal damping
   !> decouples the modes, Rayleigh damping does not.
   subroutine march_dense(n, m, n_steps, kind)
      integer, intent(in) :: n, m, n_steps
      character(*), intent(in) :: kind   !! 'modal' or 'rayleigh' damping
      type(exact_march) :: event
      type(structure_type) :: chain, structure
      type(damping_type) :: damping
      type(part_names) :: names
      type(error_type), allocatable :: error
      type(block_state) :: state
      type(stream_type) :: stream
      real(wp), allocatable :: force(:, :), x(:, :)
      real(wp) :: nanoseconds, normal(n*n), t(n, n), with_ledger
      integer :: i

      stream = new_stream(7_long, label_of('dense'), 0)
      call stream%normals(normal)
      t = 0.1_wp/sqrt(real(n, wp))*reshape(normal, [n, n])
      do i = 1, n
         t(i, i) = t(i, i) + 1.0_wp
      end do
      chain = equal_chain(n)
      structure%mass = symmetric(matmul(transpose(t), matmul(chain%mass, t)))
      structure%stiffness = symmetric(matmul(transpose(t), matmul(chain%stiffness, t)))
      structure%load = matmul(transpose(t), chain%load)
      associate (held => [(n - nint((i - 1)*real(n, wp)/m), i=1, m)])
         structure%direction = transpose(t(held, :))
         structure%joint_stiffness = chain%joint_stiffness(held)
         structure%normal_load = chain%normal_load(held)
      end associate
      structure%joint_friction = spread(0.2_wp, 1, m)
      structure%friction_point = [(i, i=1, m)]
      damping%ratio = [0.005_wp]
      if (kind == 'rayleigh') damping%rayleigh = [0.01_wp, 1.0e-3_wp]
      names%mass = 'M'
      names%stiffness = 'K'
      names%damping = 'C'
      call build_structure(damping, names, structure, error)
      if (allocated(error)) error stop error%message
      call new_exact_march(structure, dt, 1.0e-6_wp, event, error)
      if (allocated(error)) error stop error%message
      call read_force('p2_high', 1, force)
      call time_march(event, structure, force(:n_steps, :), stride, state, x, nanoseconds)
      state%keeps_ledger = .true.
      call time_march(event, structure, force(:n_steps, :), stride, state, x, with_ledger)
      print '(2i5, a10, f10.1, f9.4, f10.1)', n, m, kind, nanoseconds, &
         real(sum(state%account%slip_starts + state%account%stick_starts), wp) &
         /(real(n_steps, wp)*n_samples), &
         with_ledger
   end subroutine march_dense

   pure function symmetric(a) result(b)
      real(wp), intent(in) :: a(:, :)
      real(wp) :: b(size(a, 1), size(a, 2))

      b = 0.5_wp*(a + transpose(a))
   end function symmetric

   !> Finds the CPU time per sample-step, and the history of sample 1 (record, dof).
   subroutine time_march(marcher, chain, force, every, state, x, nanoseconds)
      class(marcher_type), intent(inout) :: marcher
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      type(block_state), intent(inout) :: state
      real(wp), allocatable, intent(out) :: x(:, :)
      real(wp), intent(out) :: nanoseconds
      type(error_type), allocatable :: error
      real(wp), allocatable :: records(:, :, :), friction(:, :)
      real(wp), allocatable :: best(:)   ! (piece) [s]
      real(wp) :: begin, end
      integer :: done, first, last, piece, repetition

      allocate (x(ubound(force, 1)/every, chain%n_dof), friction(chain%n_joints, n_samples))
      allocate (records(records_per_piece, chain%n_dof, n_samples))
      call draw_friction(friction)
      allocate (best(0:(ubound(force, 1) - 1)/(records_per_piece*every)), source=huge(1.0_wp))
      do repetition = 1, repetitions
         call start_block(chain, friction, state)
         done = 0
         do piece = 0, ubound(best, 1)
            first = piece*records_per_piece*every
            last = min(first + records_per_piece*every, ubound(force, 1))
            call cpu_time(begin)
            associate (n => (last - first)/every)
               call marcher%advance(state, force(first:last, :), every, records(:n, :, :), &
                                    error=error)
               if (allocated(error)) error stop error%message
               x(done + 1:done + n, :) = records(:n, :, 1)
               done = done + n
            end associate
            call cpu_time(end)
            best(piece) = min(best(piece), end - begin)
         end do
      end do
      nanoseconds = 1.0e9_wp*sum(best)/(real(ubound(force, 1), wp)*n_samples)
   end subroutine time_march

   !> Draws friction: the reference's 0.2 for sample 1, mean 0.2 and standard deviation 0.067 for
   !> the others.
   subroutine draw_friction(friction)
      real(wp), intent(out) :: friction(:, :)
      real(wp) :: normal(size(friction))
      type(stream_type) :: stream

      stream = new_stream(2016_long, label_of('bench'), 0)
      call stream%normals(normal)
      friction = max(0.01_wp, 0.2_wp + 0.067_wp*reshape(normal, shape(friction)))
      friction(:, 1) = 0.2_wp
   end subroutine draw_friction

   function equal_chain(n) result(chain)
      integer, intent(in) :: n
      type(structure_type) :: chain
      type(error_type), allocatable :: error

      call build_chain(spread(1.0_wp, 1, n), spread(25.0_wp, 1, n), spread(50.0_wp, 1, n), &
                       spread(10.0_wp, 1, n), spread(0.005_wp, 1, n), chain, error)
      if (allocated(error)) error stop error%message
   end function equal_chain

   !> Reads the force of a case, and interpolates it linearly between its values.
   subroutine read_force(case, finer, force)
      character(*), intent(in) :: case
      integer, intent(in) :: finer
      real(wp), allocatable, intent(out) :: force(:, :)
      integer, parameter :: n_steps = 20000
      real(wp), allocatable :: coarse(:)
      integer :: i, k, unit

      open (newunit=unit, file=folder//case//'_force.txt', status='old', action='read')
      read (unit, *)
      allocate (coarse(0:n_steps))
      read (unit, *) coarse
      close (unit)
      allocate (force(0:n_steps*finer, 1))
      do k = 0, n_steps - 1
         do i = 0, finer - 1
            force(k*finer + i, 1) = coarse(k) + (coarse(k + 1) - coarse(k))*i/finer
         end do
      end do
      force(n_steps*finer, 1) = coarse(n_steps)
   end subroutine read_force

   subroutine read_reference(case, exact, slip, starts, stops)
      character(*), intent(in) :: case
      real(wp), allocatable, intent(out) :: exact(:, :), slip(:)   !! (dof, record); (dof)
      integer, intent(out) :: starts(5), stops(5)
      real(wp) :: rows(6, 0:200)
      integer :: line, unit

      open (newunit=unit, file=folder//case//'_x.txt', status='old', action='read')
      read (unit, *)
      read (unit, *) rows
      close (unit)
      exact = rows(2:, 1:)
      allocate (slip(5))
      open (newunit=unit, file=folder//case//'_reference.txt', status='old', action='read')
      do line = 1, 8
         read (unit, *)
      end do
      read (unit, *) slip
      read (unit, *)
      read (unit, *) starts
      read (unit, *)
      read (unit, *) stops
      close (unit)
   end subroutine read_reference

end program bench_dynamics
