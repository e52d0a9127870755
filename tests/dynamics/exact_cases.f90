!> Shared by the tests of the exact march: the paper's chain, a march of one block; and by those of
!> both marches: random friction, random and rough forces.
module exact_cases
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use structure_model, only: structure_type
   use dynamics_exact_march, only: exact_march, fewest_parts, new_exact_march
   use dynamics_exact_series_form, only: new_series_form, series_form
   use dynamics_joint, only: count_open_slips
   use dynamics_response, only: block_state, start_block
   use reference_case, only: paper_chain
   implicit none(type, external)
   private
   public :: five_masses, march, paper_dt, random_force, random_friction, refined, rough_forces
   public :: use_fewest_parts

   real(wp), parameter :: paper_dt = 0.00843_wp

contains

   !> Marches one block from rest; if the marcher refuses, the history has huge values, which fail
   !> every test.
   subroutine march(chain, dt, tolerance, dof, friction, force, spacing, state, history, &
                    in_fewest_parts)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: dt, tolerance, friction(:, :), force(0:, :)
      integer, intent(in) :: dof, spacing
      type(block_state), intent(inout) :: state
      real(wp), allocatable, intent(out) :: history(:, :, :)
      logical, intent(in), optional :: in_fewest_parts   !! given: see use_fewest_parts
      type(structure_type) :: structure
      type(exact_march) :: marcher
      type(error_type), allocatable :: error

      structure = chain
      structure%load = 0.0_wp
      structure%load(dof, 1) = 1.0_wp
      allocate (history(ubound(force, 1)/spacing, chain%n_dof, size(friction, 2)))
      call start_block(chain, friction, state)
      call new_exact_march(structure, dt, tolerance, marcher, error)
      if (.not. allocated(error) .and. present(in_fewest_parts)) call use_fewest_parts(marcher)
      if (.not. allocated(error)) call marcher%advance(state, force, spacing, history, error=error)
      if (allocated(error)) history = huge(1.0_wp)
      call count_open_slips(structure, state%step*dt, state)
   end subroutine march

   !> Makes a march use power series in the fewest parts of a step, even if that is more work.
   subroutine use_fewest_parts(marcher)
      type(exact_march), intent(inout) :: marcher
      type(series_form), allocatable :: form

      marcher%parts = fewest_parts(marcher%structure, marcher%dt)
      allocate (form)
      call new_series_form(marcher%structure, marcher%dt, marcher%parts, marcher%tolerance, form)
      marcher%form = 'power series'
      deallocate (marcher%base)
      call move_alloc(form, marcher%base)
   end subroutine use_fewest_parts

   !> The paper's chain.
   function five_masses() result(chain)
      type(structure_type) :: chain

      call paper_chain(1.0_wp, 25.0_wp, 50.0_wp, 10.0_wp, 0.005_wp, 5, chain)
   end function five_masses

   !> Smooth random force: a sum of harmonics with random phases up to 2.5 Hz, unit variance.
   function random_force(seed, n_steps, dt) result(force)
      integer, intent(in) :: seed, n_steps
      real(wp), intent(in) :: dt
      real(wp) :: force(0:n_steps, 1)
      integer, parameter :: harmonics = 40
      real(wp) :: phase(harmonics), frequency(harmonics)
      type(stream_type) :: stream
      integer :: i, k

      stream = new_stream(int(seed, long), label_of('test force'), 0)
      call stream%uniforms(phase)
      frequency = 2.5_wp*([(real(i, wp), i=1, harmonics)] - phase)/harmonics
      do k = 0, n_steps
         force(k, 1) = sum(sin(6.283185307_wp*(phase + k*dt*frequency)))
      end do
      force = force*sqrt(2.0_wp/harmonics)
   end function random_force

   !> An impulse (one value), a square wave (jumps between two values), a pair of opposite impulses.
   function rough_forces(n_steps) result(force)
      integer, intent(in) :: n_steps
      real(wp) :: force(0:n_steps, 3)
      integer :: k

      force = 0.0_wp
      force(20, 1) = 2.0e3_wp
      force(:, 2) = [(merge(8.0_wp, -8.0_wp, modulo(k, 100) < 50), k=0, n_steps)]
      force(3:4, 3) = [-1.0e3_wp, 1.0e3_wp]
   end function rough_forces

   !> Forces, linear between their values, at shorter steps.
   function refined(force, finer) result(fine)
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: finer
      real(wp) :: fine(0:finer*(size(force, 1) - 1), size(force, 2))
      integer :: i, k

      do k = 0, ubound(fine, 1)
         i = min(k/finer, ubound(force, 1) - 1)
         fine(k, :) = force(i, :) + (force(i + 1, :) - force(i, :))*(k - i*finer)/finer
      end do
   end function refined

   !> Friction as a campaign draws it: mean 0.2, standard deviation 0.067.
   function random_friction(seed, n, n_samples) result(friction)
      integer, intent(in) :: seed, n, n_samples
      real(wp) :: friction(n, n_samples)
      real(wp) :: z(n*n_samples)
      type(stream_type) :: stream

      stream = new_stream(int(seed, long), label_of('test friction'), 0)
      call stream%normals(z)
      friction = max(0.02_wp, 0.2_wp + 0.067_wp*reshape(z, [n, n_samples]))
   end function random_friction

end module exact_cases
