!> Paths of the joints of 32 samples over one part of a step, side by side, and the regimes of these
!> joints: what every base system of the exact march fills, and what transitions are found from.
module dynamics_exact_joint_paths
   use core_kinds, only: long, wp
   use dynamics_joint, only: slider_at
   use dynamics_alignment, only: aligned_memory
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: joint_paths, local_answers, padded_rows, width
   public :: layer_slider, layer_reach, layer_side, layer_spring

   integer, parameter :: width = 32   !! samples side by side
   integer, parameter :: layer_slider = 1, layer_reach = 2, layer_side = 3, layer_spring = 4
   !> Reach of a joint that is never watched, as it has no friction or its lane no sample [m]
   real(wp), parameter :: boundless = 1.0e150_wp

   !> Answers of the dofs around a joint to its transitions, by sums over the series of its own dof
   !> (7).
   type :: local_answers
      logical, allocatable :: is_local(:)       !! (joint) answered by its own row (8)
      !> (other, joint): joints that switch more parts than this after one are moved too much (9)
      real(wp), allocatable :: free_span(:, :)
      integer, allocatable :: first(:)          !! (dof + 1)
      integer, allocatable :: dof(:)            !! (entry)
      real(wp), allocatable :: value(:, :)      !! N_1 .. N_4 (1:4, entry)
      real(wp), allocatable :: own(:, :)        !! (1:4, row) the same of the dof itself
   end type local_answers

   !> Row r of x holds a path, x_0 + x_1 t + ... + x_P t^P with t from 0 to 1: power k in layer
   !> layer(k). Its end x(1), x'(1) goes to the layers finish(0:1), which the next part starts from.
   type :: joint_paths
      integer :: n_rows = 0, n_joints = 0, degree = 0
      integer :: top = 0           !! rows of x, with padding
      integer :: n_samples = 0     !! of the lanes in use
      integer :: first_sample = 1  !! of the block; it marches in lane 1
      integer, allocatable :: row(:)            !! (joint)
      !> (entry) what finish_part goes through: joints and their rows, and rows without a joint
      integer, allocatable :: joint(:), joint_row(:)
      !> Joints whose guards may have a zero in the part, as 32 (joint - 1) + lane
      integer :: n_suspects = 0
      integer, allocatable :: suspect(:)
      logical :: is_involved(width) = .false.   !! samples marched through the part again
      logical, allocatable :: is_shared(:)      !! (joint) other joints are on its row
      type(local_answers) :: answers            !! without is_local no joint is answered locally
      integer, allocatable :: layer(:)          !! (0:degree)
      integer :: finish(0:1) = 0, spare(0:1) = 0   !! spare: room for other ends
      real(wp), pointer, contiguous :: x(:, :, :) => null()          !! (lane, row, layer)
      real(wp), pointer, contiguous :: force(:, :, :) => null()      !! (lane, force, 0:1) [N]
      !> (lane, place): the rows of all layers of x, then value and rise of the forces in the part
      real(wp), pointer, contiguous :: places(:, :) => null()
      !> (lane, joint, layer): z, mu N/k [m]; direction of slip, 0 stuck; weight of the spring in
      !> its row's equation, 0 without friction. The last joint is none: it is never suspect
      real(wp), pointer, contiguous :: regime(:, :, :) => null()
      !> (joint) where joints are coupled: bound of what a transition changes in the guards of
      !> others, over the speed of the joint. A transition is local where it is plain, the only one
      !> of its sample in the part, and leaves those guards above zero; `least` bounds them (lane)
      real(wp), allocatable :: coupling(:)
      real(wp) :: least(width) = boundless
      real(wp), pointer, contiguous :: stiffness(:, :) => null()     !! (lane, row) of stuck joints
      real(wp), pointer, contiguous :: pull(:, :) => null()          !! (lane, row) force at x = 0
      real(wp), allocatable :: base(:)          !! (row) stiffness without joints
      real(wp), allocatable :: spring(:)        !! (joint) weight of its spring
      type(aligned_memory), private :: memory
   contains
      procedure :: start
      procedure :: exchange_ends
      procedure :: take_in
      procedure :: hand_back
      procedure :: switch
   end type joint_paths

contains

   !> Starts with all lanes at rest. base and spring may have any unit that their equation has.
   subroutine start(self, degree, n_forces, base, row, spring)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: degree, n_forces
      real(wp), intent(in) :: base(:)     !! (row)
      integer, intent(in) :: row(:)       !! (joint) of its path
      real(wp), intent(in) :: spring(:)   !! (joint)
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: j, r, rows

      self%degree = degree
      self%n_rows = size(base)
      self%n_joints = size(row)
      if (allocated(self%row)) deallocate (self%row, self%base, self%spring, self%suspect, &
                                           self%layer)
      allocate (self%row, source=row)   ! assigned, gfortran 12 reads bounds that are not there yet
      allocate (self%base, source=base)
      allocate (self%spring, source=spring)
      allocate (self%suspect(width*self%n_joints))
      if (.not. allocated(self%answers%is_local)) then
         allocate (self%answers%is_local(self%n_joints), source=.false.)
         allocate (self%answers%free_span(0, 0))
         allocate (self%answers%own(4, self%n_rows), source=0.0_wp)
      end if
      self%is_shared = [(count(row == row(j)) > 1, j=1, self%n_joints)]
      self%joint_row = [row, pack([(r, r=1, self%n_rows)], [(all(row /= r), r=1, self%n_rows)])]
      self%joint = [(min(j, self%n_joints + 1), j=1, size(self%joint_row))]
      allocate (self%layer(0:degree))
      self%layer = [(j, j=0, degree)]
      self%finish = [degree + 1, degree + 2]
      self%spare = [degree + 3, degree + 4]

      rows = padded_rows(self%n_rows)
      self%top = rows
      call self%memory%start(int(width, long)*(rows*(degree + 7) + 2*n_forces &
                                               + 4*(self%n_joints + 1)))
      call self%memory%take([width, rows*(degree + 5) + 2*n_forces, 1], planes)
      self%places => planes(:, :, 1)
      self%x(1:width, 1:rows, 0:degree + 4) => self%places(:, :rows*(degree + 5))
      self%force(1:width, 1:n_forces, 0:1) => self%places(:, rows*(degree + 5) + 1:)
      call self%memory%take([width, rows, 2], planes)
      self%stiffness => planes(:, :, 1)
      self%pull => planes(:, :, 2)
      call self%memory%take([width, self%n_joints + 1, 4], self%regime)
   end subroutine start

   !> Rows of a layer: whole pairs, an odd number of them, so that layers are not 4096 bytes apart.
   pure integer function padded_rows(n_rows)
      integer, intent(in) :: n_rows

      padded_rows = 4*((n_rows + 1)/4) + 2
   end function padded_rows

   !> Makes the end of a part the start of the next one.
   pure subroutine exchange_ends(self)
      class(joint_paths), intent(inout) :: self
      integer :: before(0:1)

      before = self%layer(0:1)
      self%layer(0:1) = self%finish
      self%finish = before
   end subroutine exchange_ends

   !> Takes the regimes of samples first_sample, ... from the block. A joint without friction slips
   !> for ever: it has no spring and is not watched.
   pure subroutine take_in(self, joint_stiffness, state)
      class(joint_paths), intent(inout) :: self
      real(wp), intent(in) :: joint_stiffness(:)   !! (joint) k [N/m]
      type(block_state), intent(in) :: state
      integer :: j, l, r, w

      self%regime = 0.0_wp
      self%regime(:, :, layer_reach) = boundless
      do l = 1, self%n_samples
         w = self%first_sample + l - 1
         do j = 1, self%n_joints
            if (.not. state%slip_limit(j, w) > 0.0_wp) cycle
            self%regime(l, j, layer_slider) = state%slider(j, w)
            self%regime(l, j, layer_reach) = min(state%slip_limit(j, w)/joint_stiffness(j), &
                                                 boundless)
            self%regime(l, j, layer_side) = state%direction(j, w)
            self%regime(l, j, layer_spring) = self%spring(j)
         end do
      end do
      self%pull = 0.0_wp
      do r = 1, self%n_rows
         self%stiffness(:, r) = self%base(r)
      end do
      do j = 1, self%n_joints
         do l = 1, self%n_samples
            call add_joint(self, l, j)
         end do
      end do
   end subroutine take_in

   !> Gives the sliders back; that of a slipping joint has followed w.x.
   pure subroutine hand_back(self, direction, state)
      class(joint_paths), intent(in) :: self
      real(wp), intent(in) :: direction(:, :)   !! w (dof, joint)
      type(block_state), intent(inout) :: state
      real(wp) :: reach
      integer :: j, l, w

      do l = 1, self%n_samples
         w = self%first_sample + l - 1
         do j = 1, self%n_joints
            if (state%direction(j, w) == 0) then
               state%slider(j, w) = self%regime(l, j, layer_slider)
            else
               reach = 0.0_wp
               if (state%slip_limit(j, w) > 0.0_wp) reach = self%regime(l, j, layer_reach)
               state%slider(j, w) = slider_at(dot_product(direction(:, j), &
                                                          state%displacement(:, w)), &
                                              state%direction(j, w), reach)
            end if
         end do
      end do
   end subroutine hand_back

   !> Changes the regime of a joint: it slips towards `direction`, or sticks after such a slip.
   !> Without branches, as slips start as often as they end.
   pure subroutine switch(self, lane, joint, direction, place)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: lane, joint
      integer, intent(in) :: direction   !! +1 or -1
      real(wp), intent(in) :: place      !! w.x at the transition [m]
      real(wp) :: reach, side   ! of the slip from now on
      integer :: j, row

      associate (regime => self%regime)
         side = direction*(1.0_wp - abs(regime(lane, joint, layer_side)))
         reach = regime(lane, joint, layer_reach)
         regime(lane, joint, layer_slider) = merge(regime(lane, joint, layer_slider), &
                                                   slider_at(place, direction, reach), &
                                                   abs(side) > 0.0_wp)
         regime(lane, joint, layer_side) = side
      end associate
      row = self%row(joint)
      self%stiffness(lane, row) = self%base(row)
      self%pull(lane, row) = 0.0_wp
      if (self%is_shared(joint)) then   ! anew, so that no rounding gathers
         do j = 1, self%n_joints
            if (self%row(j) == row) call add_joint(self, lane, j)
         end do
      else
         call add_joint(self, lane, joint)
      end if
   end subroutine switch

   !> Adds a joint to the sums of its row.
   pure subroutine add_joint(self, lane, joint)
      class(joint_paths), intent(inout) :: self
      integer, intent(in) :: lane, joint
      real(wp) :: moving, side, spring

      associate (row => self%row(joint), regime => self%regime)
         side = regime(lane, joint, layer_side)
         moving = abs(side)
         spring = regime(lane, joint, layer_spring)
         self%stiffness(lane, row) = self%stiffness(lane, row) &
                                     + merge(0.0_wp, spring, moving > 0.0_wp)
         self%pull(lane, row) = self%pull(lane, row) &
                                + spring*merge(-side*regime(lane, joint, layer_reach), &
                                               regime(lane, joint, layer_slider), moving > 0.0_wp)
      end associate
   end subroutine add_joint

end module dynamics_exact_joint_paths
