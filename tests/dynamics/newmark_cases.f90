!> Shared by the tests of Newmark's march: forces, chains, a march of one sample.
module newmark_cases
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use structure_chain, only: build_chain
   use structure_model, only: structure_type
   use dynamics_excitation, only: noise_force
   use dynamics_response, only: block_state, marcher_type, start_block
   implicit none(type, external)
   private
   public :: dt, march, noise, random_chain

   real(wp), parameter :: dt = 0.00843_wp
   integer(long), parameter :: seed = 20161121_long

contains

   !> Marches one sample from rest, with the same friction of all joints; if it is refused, x has
   !> huge values, which fail every test.
   subroutine march(marcher, chain, friction, force, nth, x)
      class(marcher_type), intent(inout) :: marcher
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: friction, force(0:, :)
      integer, intent(in) :: nth
      real(wp), intent(out) :: x(:, :, :)
      type(block_state) :: state
      type(error_type), allocatable :: error
      integer :: i

      call start_block(chain, reshape([(friction, i=1, chain%n_dof)], [chain%n_dof, 1]), state)
      call marcher%advance(state, force, nth, x, error=error)
      if (allocated(error)) x = huge(1.0_wp)
   end subroutine march

   !> Band-limited force of the given variance; the seed is fixed.
   function noise(n_steps, variance) result(force)
      integer, intent(in) :: n_steps
      real(wp), intent(in) :: variance
      real(wp) :: force(0:n_steps, 1)
      type(stream_type) :: stream

      stream = new_stream(seed, label_of('force'), 0)
      call noise_force([0.0_wp, 2.5_wp], dt, stream, force(:, 1))
      force = sqrt(variance)*force
   end function noise

   !> Chain whose properties differ by less than a factor of two from the paper's.
   subroutine random_chain(n, number, chain)
      integer, intent(in) :: n, number
      type(structure_type), intent(out) :: chain
      type(error_type), allocatable :: error
      type(stream_type) :: stream
      real(wp) :: u(5*n)

      stream = new_stream(seed, label_of('chain'), number)
      call stream%uniforms(u)
      u = 0.7_wp + 0.6_wp*u
      call build_chain(u(:n), 25*u(n + 1:2*n), 50*u(2*n + 1:3*n), 10*u(3*n + 1:4*n), &
                       0.005_wp*u(4*n + 1:), chain, error)
      if (allocated(error)) error stop 'random_chain: the chain was refused'
   end subroutine random_chain

end module newmark_cases
