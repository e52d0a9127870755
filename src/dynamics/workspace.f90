!> The work space of the march by tables: all numbers of a sample side by side, each a vector of the
!> masses, filled from the block and emptied into it.
module dynamics_workspace
   use core_kinds, only: wp
   use dynamics_chain, only: chain_type
   use dynamics_propagator, only: width
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: take_in, hand_back, pattern_of, set_anchors, set_shift, unfold
   public :: sample_size, at_state, at_shift, at_slider, at_reach, at_direction, at_anchor
   public :: at_start

   !> Columns of sample(mass, :).
   integer, parameter :: at_state = 1       !! to 4: x and u = h v, in two places, one in use
   integer, parameter :: at_slider = 5      !! [m]; kept for stuck masses
   integer, parameter :: at_reach = 6       !! mu N/k: extension at which the contact slips [m]
   integer, parameter :: at_direction = 7   !! 0: stuck, +1 or -1: slipping that way
   integer, parameter :: at_anchor = 8      !! contact force over its stiffness, at x = 0 [m]
   integer, parameter :: at_shift = 9      !! and next: what the anchors add in the longest stride
   integer, parameter :: at_start = 11      !! and next: the same in a shorter one, or more
   integer, parameter :: sample_size = 12

contains

   !> From the block to the work space. A mass without friction slips for ever: it watches nothing,
   !> as a stuck one with boundless reach, but its contact is not in the pattern.
   pure subroutine take_in(chain, h, state, w, place, sample)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      type(block_state), intent(in) :: state
      integer, intent(in) :: w, place
      real(wp), intent(inout) :: sample(width, sample_size)
      logical :: has_friction(chain%n_dof)

      associate (n => chain%n_dof, x0 => at_state + 2*place)
         sample(:n, x0) = state%displacement(:, w)
         sample(:n, x0 + 1) = h*state%velocity(:, w)
         has_friction = state%slip_limit(:, w) > 0.0_wp
         sample(:n, at_slider) = merge(state%slider(:, w), 0.0_wp, has_friction)
         sample(:n, at_direction) = merge(state%direction(:, w), 0, has_friction)
         sample(:n, at_reach) = merge(state%slip_limit(:, w)/chain%contact_stiffness, &
                                      huge(1.0_wp), has_friction)
      end associate
   end subroutine take_in

   !> And back; the slider of a slipping mass has followed it.
   pure subroutine hand_back(chain, h, sample, place, w, state)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: h   !! [s]
      real(wp), intent(in) :: sample(width, sample_size)
      integer, intent(in) :: place, w
      type(block_state), intent(inout) :: state

      associate (n => chain%n_dof, x0 => at_state + 2*place)
         state%displacement(:, w) = sample(:n, x0)
         state%velocity(:, w) = sample(:n, x0 + 1)/h
         where (state%slip_limit(:, w) > 0.0_wp)
            state%direction(:, w) = nint(sample(:n, at_direction))
         end where
         state%slider(:, w) = merge(sample(:n, at_slider), state%displacement(:, w) - &
                                    state%direction(:, w)*state%slip_limit(:, w)/ &
                                    chain%contact_stiffness, state%direction(:, w) == 0)
      end associate
   end subroutine hand_back

   !> Bit i-1: mass i is stuck.
   pure integer function pattern_of(direction) result(pattern)
      integer, intent(in) :: direction(:)
      integer :: i

      pattern = 0
      do i = 1, size(direction)
         if (direction(i) == 0) pattern = ibset(pattern, i - 1)
      end do
   end function pattern_of

   !> The anchors of a sample.
   pure subroutine set_anchors(sample)
      real(wp), intent(inout) :: sample(width, sample_size)
      integer :: i

      !$omp simd
      do i = 1, width
         sample(i, at_anchor) = merge(-sample(i, at_direction)*sample(i, at_reach), &
                                      sample(i, at_slider), abs(sample(i, at_direction)) > 0.5_wp)
      end do
   end subroutine set_anchors

   !> What its anchors add to every stretch while the pattern lasts, into two columns from `at`.
   pure subroutine set_shift(n, load, at, sample)
      integer, intent(in) :: n, at
      real(wp), intent(in) :: load(width, 2, width)
      real(wp), intent(inout) :: sample(width, sample_size)
      real(wp) :: shift(width, 2)
      integer :: i, j

      shift = 0.0_wp
      do j = 1, n
         !$omp simd
         do i = 1, width
            shift(i, 1) = shift(i, 1) + load(i, 1, j)*sample(j, at_anchor)
            shift(i, 2) = shift(i, 2) + load(i, 2, j)*sample(j, at_anchor)
         end do
      end do
      sample(:, at:at + 1) = shift
   end subroutine set_shift

   !> From traces (mass, record, sample) to histories, of which the records from `first` on are set.
   pure subroutine unfold(n, n_records, trace, scale, first, history)
      integer, intent(in) :: n, n_records, first
      real(wp), intent(in) :: trace(:, :, :), scale
      real(wp), intent(inout) :: history(:, :, :)   !! (record, dof, sample)
      integer :: i, w

      do w = 1, size(trace, 3)
         do i = 1, n
            history(first:first + n_records - 1, i, w) = scale*trace(i, :n_records, w)
         end do
      end do
   end subroutine unfold

end module dynamics_workspace
