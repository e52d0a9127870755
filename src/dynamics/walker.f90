!> One sample on its way through the march by tables: where it is and what it watches.
module dynamics_walker
   use core_kinds, only: wp
   use structure_model, only: structure_type
   use dynamics_propagator, only: width
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: walker_type, take_in, hand_back, set_anchors

   !> Whole cache lines; vectors over the masses, those beyond the last one at rest and unwatched.
   type :: walker_type
      sequence
      real(wp) :: x(width, 0:1)      !! [m], in two places, one in use
      real(wp) :: u(width, 0:1)      !! h v [m]
      real(wp) :: slider(width)      !! [m]; kept for stuck masses
      real(wp) :: reach(width)       !! mu N/k: extension at which the contact slips [m]
      real(wp) :: direction(width)   !! 0: stuck, +1 or -1: slipping that way
      real(wp) :: anchor(width)      !! contact force over its stiffness, at x = 0 [m]
      real(wp) :: start(width, 2)    !! what masses beyond the fifth add to x and u in a stride
      integer :: pattern             !! of stuck masses; bit i-1: mass i
      integer :: place               !! 0 or 1: where its state is; the other takes the next one
      integer :: position            !! of the next step in the force (course_type)
      integer :: first, last         !! positions before the first step and after the last one
      integer :: due                 !! position of the next record; -1: none
      integer :: phase               !! strides begin a multiple of them after this position
      integer :: level               !! of the stretch that was not quiet
      integer :: suspects            !! bit i-1: the guard of mass i may have been crossed in it
      integer :: switched            !! bit i-1: mass i has been found to change its regime in it
      integer :: n_records           !! made
      integer :: spare(5)
   end type walker_type

contains

   !> From the block. A mass without friction slips for ever: it watches nothing, as a stuck one
   !> with boundless reach, but its contact is not in the pattern.
   pure subroutine take_in(chain, h, state, w, walker)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      type(walker_type), intent(inout) :: walker
      logical :: has_friction(chain%n_dof)
      integer :: i

      associate (n => chain%n_dof, place => walker%place)
         walker%x(:n, place) = state%displacement(:, w)
         walker%u(:n, place) = h*state%velocity(:, w)
         has_friction = state%slip_limit(:, w) > 0.0_wp
         walker%slider(:n) = merge(state%slider(:, w), 0.0_wp, has_friction)
         walker%direction(:n) = merge(state%direction(:, w), 0, has_friction)
         walker%reach(:n) = merge(state%slip_limit(:, w)/chain%joint_stiffness, &
                                  huge(1.0_wp), has_friction)
         walker%pattern = 0
         do i = 1, n
            if (state%direction(i, w) == 0) walker%pattern = ibset(walker%pattern, i - 1)
         end do
      end associate
      call set_anchors(walker)
   end subroutine take_in

   !> And back; the slider of a slipping mass has followed it.
   pure subroutine hand_back(chain, h, walker, w, state)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      type(walker_type), intent(in) :: walker
      integer, intent(in) :: w
      type(block_state), intent(inout) :: state

      associate (n => chain%n_dof)
         state%displacement(:, w) = walker%x(:n, walker%place)
         state%velocity(:, w) = walker%u(:n, walker%place)/h
         where (state%slip_limit(:, w) > 0.0_wp)
            state%direction(:, w) = nint(walker%direction(:n))
         end where
         state%slider(:, w) = merge(walker%slider(:n), state%displacement(:, w) - &
                                    state%direction(:, w)*state%slip_limit(:, w)/ &
                                    chain%joint_stiffness, state%direction(:, w) == 0)
      end associate
   end subroutine hand_back

   !> After a change of its regimes.
   pure subroutine set_anchors(walker)
      type(walker_type), intent(inout) :: walker
      integer :: i

      !$omp simd
      do i = 1, width
         walker%anchor(i) = merge(-walker%direction(i)*walker%reach(i), walker%slider(i), &
                                  abs(walker%direction(i)) > 0.5_wp)
      end do
   end subroutine set_anchors

end module dynamics_walker
