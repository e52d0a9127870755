!> Paths w.x of the joints of 32 samples over one part of a step, and the regimes of these joints.
!> Either form of the exact march fills them; transitions are found from them.
module dynamics_exact_joint_paths
   use core_alignment, only: aligned_memory
   use core_kinds, only: long, wp
   use dynamics_joint, only: enter_transition, slider_at, slip_direction
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: joint_paths, local_responses, n_spare, padded_rows, width
   public :: regime_slider, regime_reach, regime_side, regime_spring

   integer, parameter :: width = 32   !! lanes: samples marched side by side
   integer, parameter :: n_spare = 2   !! candidates of a joint that are listed without a branch
   !> Third index of a regime: z [m], reach mu N/k [m], direction of slip (0: stuck), and weight of
   !> the spring in the equation of the joint's row (0 without friction)
   integer, parameter :: regime_slider = 1, regime_reach = 2, regime_side = 3, regime_spring = 4
   real(wp), parameter :: unlimited = 1.0e150_wp   !! reach without friction or sample [m]

   !> Coefficients N_1 .. N_4 by which the dofs around a joint respond to its transitions (7):
   !> entries first(i) .. first(i + 1) - 1 are those of the dofs that respond to dof i.
   type :: local_responses
      logical, allocatable :: is_local(:)       !! (joint) True if (7) is accurate enough (8)
      !> (other, joint) longest time after a transition of the joint at which the other joint may
      !> switch undisturbed (9) [parts]
      real(wp), allocatable :: undisturbed_span(:, :)
      integer, allocatable :: first(:)          !! (dof + 1)
      integer, allocatable :: dof(:)            !! (entry)
      real(wp), allocatable :: value(:, :)      !! N_1 .. N_4 (1:4, entry)
      real(wp), allocatable :: own(:, :)        !! N_1 .. N_4 of the dof itself (1:4, row)
   end type local_responses

   !> Row r of x is a path x_0 + x_1 t + ... + x_P t^P, t from 0 to 1: power k is in layer layer(k),
   !> and x(1), x'(1), which the next part starts from, in layers finish(0:1).
   type :: joint_paths
      integer :: n_rows = 0, n_joints = 0, degree = 0
      integer :: n_padded = 0      !! rows of x, with padding
      integer :: n_samples = 0     !! lanes in use
      integer :: first_sample = 1  !! number in the block of the sample in lane 1
      integer, allocatable :: row(:)             !! (joint) row of its path
      !> (entry) joints and their rows, then n_joints + 1 and the rows without a joint
      integer, allocatable :: joint(:), joint_row(:)
      !> Candidates: joints whose guards may have a zero in the part, as 32 (joint - 1) + lane
      integer :: n_candidates = 0
      integer, allocatable :: candidate(:)
      integer(long), allocatable :: hits(:)   !! (entry) bit l - 1 is 1 if lane l is a candidate
      logical :: is_remarched(width) = .false.   !! True for samples marched through the part again
      logical, allocatable :: is_shared(:)       !! (joint) True if other joints are on its row
      type(local_responses) :: responses         !! in modes, no joint is local
      integer, allocatable :: layer(:)           !! (0:degree)
      integer :: finish(0:1) = 0, spare(0:1) = 0   !! layers of the ends; two more for march_again
      real(wp), pointer, contiguous :: x(:, :, :) => null()          !! (lane, row, layer)
      !> (lane, force, 0:1) value at the start of the part and rise over it [N]
      real(wp), pointer, contiguous :: force(:, :, :) => null()
      !> (lane, place): x and force as one array, rows of all layers first
      real(wp), pointer, contiguous :: places(:, :) => null()
      !> (lane, joint, regime_slider ..). Joint n_joints + 1 stands for rows without a joint: its
      !> reach is unlimited, so that it is never a candidate
      real(wp), pointer, contiguous :: regime(:, :, :) => null()
      !> Modes only: (joint of the transition) bound of the response of any guard over the joint's
      !> speed (M10), and (lane) bound of the guards of all joints without a transition
      real(wp), allocatable :: coupling(:)
      real(wp) :: least_guard(width) = unlimited
      real(wp), pointer, contiguous :: stiffness(:, :) => null()   !! (lane, row) with stuck joints
      real(wp), pointer, contiguous :: pull(:, :) => null()        !! (lane, row) force at x = 0
      real(wp), allocatable :: base(:)           !! (row) stiffness without joints
      real(wp), allocatable :: spring(:)         !! (joint) weight of its spring
      type(aligned_memory), private :: memory
   contains
      procedure :: initialize
      procedure :: exchange_ends
      procedure :: load_regimes
      procedure :: switch
   end type joint_paths

contains

   !> Allocates all arrays, with all lanes at rest. Units of base and spring are those of the
   !> equation of a row.
   subroutine initialize(self, degree, n_forces, base, row, spring)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: degree, n_forces
      real(wp), intent(in) :: base(:)     !! (row)
      integer, intent(in) :: row(:)       !! (joint) row of its path
      real(wp), intent(in) :: spring(:)   !! (joint)
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: j, r, rows

      self%degree = degree
      self%n_rows = size(base)
      self%n_joints = size(row)
      if (allocated(self%row)) deallocate (self%row, self%base, self%spring, self%candidate, &
                                           self%hits, self%layer)
      allocate (self%row, source=row)   ! an assignment would read undefined bounds (gfortran 12)
      allocate (self%base, source=base)
      allocate (self%spring, source=spring)
      allocate (self%candidate(width*self%n_joints + n_spare))
      if (.not. allocated(self%responses%is_local)) then
         allocate (self%responses%is_local(self%n_joints), source=.false.)
         allocate (self%responses%undisturbed_span(0, 0))
         allocate (self%responses%own(4, self%n_rows), source=0.0_wp)
      end if
      self%is_shared = [(count(row == row(j)) > 1, j=1, self%n_joints)]
      self%joint_row = [row, pack([(r, r=1, self%n_rows)], [(all(row /= r), r=1, self%n_rows)])]
      self%joint = [(min(j, self%n_joints + 1), j=1, size(self%joint_row))]
      allocate (self%hits(size(self%joint)))
      allocate (self%layer(0:degree), source=[(j, j=0, degree)])
      self%finish = [degree + 1, degree + 2]
      self%spare = [degree + 3, degree + 4]

      rows = padded_rows(self%n_rows)
      self%n_padded = rows
      call self%memory%reserve(int(width, long)*(rows*(degree + 7) + 2*n_forces &
                                                 + 4*(self%n_joints + 1)))
      call self%memory%assign_planes([width, rows*(degree + 5) + 2*n_forces, 1], planes)
      self%places => planes(:, :, 1)
      self%x(1:width, 1:rows, 0:degree + 4) => self%places(:, :rows*(degree + 5))
      self%force(1:width, 1:n_forces, 0:1) => self%places(:, rows*(degree + 5) + 1:)
      call self%memory%assign_planes([width, rows, 2], planes)
      self%stiffness => planes(:, :, 1)
      self%pull => planes(:, :, 2)
      call self%memory%assign_planes([width, self%n_joints + 1, 4], self%regime)
   end subroutine initialize

   !> Number of rows of a layer: an odd number of pairs, so that layers are not 4096 bytes apart.
   pure integer function padded_rows(n_rows)
      integer, intent(in) :: n_rows

      padded_rows = 4*((n_rows + 1)/4) + 2
   end function padded_rows

   !> Makes the end of a part the start of the next one, by an exchange of layers.
   pure subroutine exchange_ends(self)
      class(joint_paths), intent(inout) :: self
      integer :: before(0:1)

      before = self%layer(0:1)
      self%layer(0:1) = self%finish
      self%finish = before
   end subroutine exchange_ends

   !> Copies the regimes of samples first_sample, ... from the block. A joint without friction
   !> always slips: it has no spring and is never a candidate.
   pure subroutine load_regimes(self, joint_stiffness, state)
      class(joint_paths), intent(inout) :: self
      real(wp), intent(in) :: joint_stiffness(:)   !! (joint) k [N/m]
      type(block_state), intent(in) :: state
      integer :: j, l, r, w

      self%regime = 0.0_wp
      self%regime(:, :, regime_reach) = unlimited
      self%pull = 0.0_wp
      do r = 1, self%n_rows
         self%stiffness(:, r) = self%base(r)
      end do
      do l = 1, self%n_samples
         w = self%first_sample + l - 1
         do j = 1, self%n_joints
            if (.not. state%slip_limit(j, w) > 0.0_wp) cycle
            self%regime(l, j, regime_slider) = state%slider(j, w)
            self%regime(l, j, regime_reach) = min(state%slip_limit(j, w)/joint_stiffness(j), &
                                                  unlimited)
            self%regime(l, j, regime_side) = state%account(j, w)%direction
            self%regime(l, j, regime_spring) = self%spring(j)
            call add_joint(self, l, j)
         end do
      end do
   end subroutine load_regimes

   !> Switches a joint between stick and slip, in the regimes of its lane and in the state. Without
   !> branches, as slips start as often as they end.
   pure subroutine switch(self, lane, joint, time, place, velocity, state)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: lane, joint
      real(wp), intent(in) :: time       !! [s]
      real(wp), intent(in) :: place      !! w.x [m]
      real(wp), intent(in) :: velocity   !! w.v in any unit: its sign is the direction of a new slip
      type(block_state), intent(inout) :: state
      integer :: after, before   ! direction of the slip that starts and that ends; 0: none
      integer :: j, row, sample

      sample = self%first_sample + lane - 1
      before = state%account(joint, sample)%direction
      after = slip_direction(velocity)*(1 - abs(before))
      associate (slider => self%regime(lane, joint, regime_slider), &
                 reach => self%regime(lane, joint, regime_reach))
         slider = merge(slider, slider_at(place, before, reach), after /= 0)
      end associate
      self%regime(lane, joint, regime_side) = after
      call enter_transition(state, joint, sample, time, place, after)
      row = self%row(joint)
      self%stiffness(lane, row) = self%base(row)
      self%pull(lane, row) = 0.0_wp
      if (self%is_shared(joint)) then   ! summed again, so that rounding does not accumulate
         do j = 1, self%n_joints
            if (self%row(j) == row) call add_joint(self, lane, j)
         end do
      else
         call add_joint(self, lane, joint)
      end if
   end subroutine switch

   !> Adds a joint to the stiffness and the pull of its row.
   pure subroutine add_joint(self, lane, joint)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: lane, joint
      real(wp) :: moving, side, spring

      associate (row => self%row(joint), regime => self%regime)
         side = regime(lane, joint, regime_side)
         moving = abs(side)
         spring = regime(lane, joint, regime_spring)
         self%stiffness(lane, row) = self%stiffness(lane, row) &
                                     + merge(0.0_wp, spring, moving > 0.0_wp)
         self%pull(lane, row) = self%pull(lane, row) &
                                + spring*merge(-side*regime(lane, joint, regime_reach), &
                                               regime(lane, joint, regime_slider), moving > 0.0_wp)
      end associate
   end subroutine add_joint

end module dynamics_exact_joint_paths
