!> Datasets of the samples of a block: name, unit, axes and meaning of each, listed once.
!>
!> `visit_short` and `visit_long` are the list. A `dataset_visitor` goes through it to write a block
!> to a shard, to read one from a shard or a results file, or to write it to the group of its case
!> in a results file.
module io_blocks
   use campaign_plan, only: plan_type
   use campaign_results, only: block_result
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_hdf5, only: hdf5_file, hdf5_group
   implicit none(type, external)
   private
   public :: write_block, read_block, transitions_before, write_blocks

   integer, parameter :: to_shard = 1, from_file = 2, to_results = 3   !! directions of the data

   !> Moves the same rows (samples or transitions) of each dataset that it visits.
   type :: dataset_visitor
      integer :: direction = to_shard
      type(hdf5_group) :: group            !! group of the datasets
      integer :: file_offset = 0           !! rows of the dataset before those that move
      integer :: block_offset = 0          !! rows of the block before those that move
      integer :: n_rows = 0                !! rows that move
      integer :: n_all = 0                 !! rows of a dataset or an array that is made
      integer :: number_offset = 0         !! number of the sample before the case's first one
      integer :: n_written = 0             !! transitions in the file
      integer :: n_transitions = 0         !! transitions of all samples of the file
   contains
      procedure :: visit
   end type dataset_visitor

contains

   !> Writes blocks of consecutive samples of a case to the root of an open file.
   subroutine write_blocks(file, blocks, error)
      type(hdf5_file), intent(in) :: file
      type(block_result), intent(inout) :: blocks(:)   !! left as they were
      type(error_type), allocatable, intent(out) :: error
      type(dataset_visitor) :: v
      integer :: i

      do i = 1, size(blocks)
         associate (block => blocks(i))
            if (allocated(block%transitions)) &
               v%n_transitions = v%n_transitions + sum(block%transitions(block%before + 1: &
                                                           block%before + block%n_samples)%n)
         end associate
      end do
      v%group = hdf5_group(file=file, path='/')
      do i = 1, size(blocks)
         v%file_offset = blocks(i)%first_sample - blocks(1)%first_sample
         v%block_offset = blocks(i)%before
         v%n_rows = blocks(i)%n_samples
         v%n_all = sum(blocks%n_samples)
         call visit_short(v, blocks(i))
         call visit_long(v, blocks(i))
      end do
      call v%group%take_error(error)
   end subroutine write_blocks

   !> Reads the datasets that a file has of n samples into a block. The caller sets the block's
   !> numbers of case and samples.
   subroutine read_block(file, group, block, file_offset, block_offset, n, is_short, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group              !! path of the group of the samples
      type(block_result), intent(inout) :: block
      integer, intent(in) :: file_offset, block_offset   !! samples before them in file and block
      integer, intent(in) :: n
      logical, intent(in) :: is_short                !! true: no datasets of visit_long
      type(error_type), allocatable, intent(out) :: error
      type(dataset_visitor) :: v

      v%direction = from_file
      v%group = hdf5_group(file=file, path=group)
      v%file_offset = file_offset
      v%block_offset = block_offset
      v%n_rows = n
      v%n_all = block%n_samples
      call visit_short(v, block)
      if (.not. is_short) call visit_long(v, block)
      call v%group%take_error(error)
   end subroutine read_block

   !> Writes a block to the group of its case in a results file: its short datasets, or, with the
   !> numbers of transitions, its long ones.
   subroutine write_block(group, plan, block, n_written, n_transitions)
      type(hdf5_group), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(block_result), intent(inout) :: block      !! left as it was
      integer, intent(inout), optional :: n_written   !! transitions in the file
      integer, intent(in), optional :: n_transitions  !! transitions of all samples of the case
      type(dataset_visitor) :: v

      v%direction = to_results
      v%group = group
      v%file_offset = block%first_sample - 1
      v%n_all = plan%cases(block%case_number)%n_samples
      v%n_rows = min(block%n_samples, v%n_all - v%file_offset)
      if (present(n_written)) then
         v%number_offset = plan%cases(block%case_number)%first_sample - 1
         v%n_written = n_written
         v%n_transitions = n_transitions
         call visit_long(v, block)
         n_written = v%n_written
      else
         call visit_short(v, block)
      end if
      group = v%group
   end subroutine write_block

   !> Visits the datasets whose size does not depend on the number of steps.
   subroutine visit_short(v, block)
      type(dataset_visitor), intent(inout) :: v
      type(block_result), intent(inout) :: block
      character(*), parameter :: by_sample = 'sample', by_joint = 'sample joint', &
                                 by_dof = 'sample dof'

      call v%visit('friction', '1', by_joint, 'friction coefficient', block%friction)
      call v%visit('slip_fraction', '1', by_joint, 'fraction of time in slip', &
                   block%slip_fraction)
      call v%visit('slip_fraction_error', '1', by_joint, 'time-average error of slip_fraction', &
                   block%slip_fraction_error)
      call v%visit('slip_starts', '1', by_joint, 'number of transitions from stick to slip '// &
                   'since n_discard', block%slip_starts, 'long')
      call v%visit('stick_starts', '1', by_joint, 'number of transitions from slip to stick '// &
                   'since n_discard', block%stick_starts, 'long')
      call v%visit('slip_distance', 'm', by_joint, 'distance that the joint slips since '// &
                   'n_discard', block%slip_distance)
      call v%visit('dissipation', 'J', by_joint, 'work that the joint dissipates since '// &
                   'n_discard', block%dissipation)
      call v%visit('joint_displacement_max', 'm', by_joint, 'largest displacement between '// &
                   'the ends of the joint, at the steps that enter the spectra', &
                   block%joint_displacement_max)
      call v%visit('harmonic_amplitude', 'm', by_dof, &
                   'amplitude of the fundamental, last ten periods', block%harmonic_amplitude)
      call v%visit('harmonic_phase', 'rad', by_dof, &
                   'phase of the fundamental against the force, negative: behind', &
                   block%harmonic_phase)
      call v%visit('steady_since', 's', by_sample, 'time from which on the fundamentals of '// &
                   'ten periods agree to 1e-3; NaN: never', block%steady_since)
      call v%visit('steady', '1', by_sample, &
                   '1: the last two windows of ten periods agree to 1e-3', block%steady, &
                   'integer')
      call v%visit('energy_input', 'J', by_sample, 'work of the force since n_discard', &
                   block%energy_input)
      call v%visit('energy_viscous', 'J', by_sample, &
                   'work of the viscous damping since n_discard', block%energy_viscous)
      call v%visit('energy_friction', 'J', by_sample, 'work of the friction since n_discard', &
                   block%energy_friction)
      call v%visit('energy_stored', 'J', by_sample, &
                   'change of kinetic and strain energy since n_discard', block%energy_stored)
      call v%visit('energy_defect', 'J', by_sample, 'input - viscous - friction - stored', &
                   block%energy_defect)
   end subroutine visit_short

   !> Visits the datasets that grow with the number of steps. Transitions come last, because the
   !> visitor's rows are then transitions instead of samples.
   subroutine visit_long(v, block)
      type(dataset_visitor), intent(inout) :: v
      type(block_result), intent(inout) :: block

      call v%visit('slip_series', '1', 'sample span joint', &
                   'fraction of time in slip within each of equal spans of time', &
                   block%slip_series)
      call v%visit('psd', 'm^2/Hz', 'sample frequency kept', &
                   'power spectral density of the displacement, one-sided', block%psd)
      call v%visit('power_series', 'm^2', 'sample batch kept', 'mean square of the '// &
                   'displacement in consecutive batches of segments, within ranges of '// &
                   'frequencies; those of a range together', block%power_series)
      call v%visit('displacement', 'm', 'sample time kept', &
                   'displacement, also before n_discard', block%displacement)
      call v%visit('velocity', 'm/s', 'sample time kept', 'velocity, also before n_discard', &
                   block%velocity)
      if (v%direction == from_file) then
         call read_transitions(v%group, block)
      else if (allocated(block%transitions)) then
         call write_transitions(v, block)
      end if
   end subroutine visit_long

   !> Writes the transitions of the block's samples below those that the file has.
   subroutine write_transitions(v, block)
      type(dataset_visitor), intent(inout) :: v
      type(block_result), intent(in) :: block
      character(*), parameter :: axis = 'transition'
      real(wp), allocatable :: sample(:), time(:), joint(:), kind(:)
      integer :: first, i, last, number

      associate (lists => block%transitions(v%block_offset + 1:v%block_offset + v%n_rows))
         v%n_rows = sum(lists%n)
         allocate (sample(v%n_rows), time(v%n_rows), joint(v%n_rows), kind(v%n_rows))
         number = v%number_offset + block%first_sample
         last = 0
         do i = 1, size(lists)
            first = last + 1
            last = last + lists(i)%n
            if (last < first) cycle
            sample(first:last) = number + i - 1
            time(first:last) = lists(i)%time(:lists(i)%n)
            joint(first:last) = lists(i)%joint(:lists(i)%n)
            kind(first:last) = lists(i)%kind(:lists(i)%n)
         end do
      end associate
      v%block_offset = 0
      v%file_offset = v%n_written
      v%n_all = v%n_transitions
      v%n_written = v%n_written + v%n_rows
      call v%visit('transition_sample', '1', axis, 'sample of the transition', sample, 'integer')
      call v%visit('transition_time', 's', axis, 'time of the transition, also before '// &
                   'n_discard', time)
      call v%visit('transition_joint', '1', axis, 'joint of the transition', joint, 'integer')
      call v%visit('transition_kind', '1', axis, &
                   '+1, -1: slip starts in that direction; 0: sticks', kind, 'integer')
   end subroutine write_transitions

   !> Reads the transitions of the block's samples. Those of a file stand in the order of samples.
   subroutine read_transitions(group, block)
      type(hdf5_group), intent(inout) :: group
      type(block_result), intent(inout) :: block
      real(wp), allocatable :: sample(:), time(:), joint(:), kind(:)
      integer :: first, i, last, n, n_before

      if (allocated(group%error)) return
      if (.not. group%has('transition_sample')) return
      n_before = transitions_before(group, block%first_sample)
      n = transitions_before(group, block%first_sample + block%n_samples) - n_before
      if (allocated(group%error)) return
      allocate (sample(n), time(n), joint(n), kind(n))
      call group%read_part('transition_sample', [n_before + 1], sample)
      call group%read_part('transition_time', [n_before + 1], time)
      call group%read_part('transition_joint', [n_before + 1], joint)
      call group%read_part('transition_kind', [n_before + 1], kind)
      if (allocated(group%error)) return
      allocate (block%transitions(block%n_samples))
      last = 0
      do i = 1, block%n_samples
         first = last + 1
         do while (last < n)
            if (nint(sample(last + 1)) >= block%first_sample + i) exit
            last = last + 1
         end do
         associate (list => block%transitions(i))
            list%time = time(first:last)
            list%joint = nint(joint(first:last))
            list%kind = nint(kind(first:last))
            list%n = last - first + 1
         end associate
      end do
   end subroutine read_transitions

   !> Number of transitions of a file before those of a sample, found by bisection.
   integer function transitions_before(group, sample) result(n)
      type(hdf5_group), intent(inout) :: group
      integer, intent(in) :: sample
      integer(long), allocatable :: extents(:)
      integer :: last, middle
      real(wp) :: number(1)

      n = 0
      if (.not. allocated(group%error)) call group%read_shape('transition_sample', extents, 1)
      if (allocated(group%error)) return
      last = int(extents(1))
      do while (n < last)
         middle = n + (last - n)/2
         call group%read_part('transition_sample', [middle + 1], number)
         if (allocated(group%error)) return
         if (nint(number(1)) < sample) then
            n = middle + 1
         else
            last = middle
         end if
      end do
   end function transitions_before

   !> Moves rows of one dataset, or nothing if their source lacks it. Datasets of a shard have no
   !> axes. Chunks of its spectra are ranges of frequencies, as the statistics read them, of the
   !> samples of one block: more would not fit into HDF5's cache of 1 MB.
   subroutine visit(self, name, units, axes, long_name, values, kind)
      class(dataset_visitor), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name   !! axes in Python's order
      real(wp), allocatable, intent(inout) :: values(..)
      character(*), intent(in), optional :: kind   !! kind of whole numbers: see `make`
      character(:), allocatable :: own_axes
      integer :: extents(rank(values))
      integer, allocatable :: chunk(:)

      if (allocated(self%group%error)) return
      if (self%direction == from_file) then
         if (.not. self%group%has(name)) return
         call self%group%allocate_for(name, values, self%n_all)
      else if (.not. allocated(values)) then
         return
      else if (.not. self%group%has(name)) then
         extents = shape(values)
         own_axes = ''
         if (self%direction == to_results) then
            own_axes = self%group%axes_named(axes)
         else if (name == 'psd') then
            chunk = [extents(1), frequencies_together(extents(1), extents(2)), &
                     min(extents(3), self%n_all)]
         end if
         call self%group%make(name, int([extents(:size(extents) - 1), self%n_all], long), units, &
                              long_name, own_axes, kind, chunk)
      end if
      if (.not. allocated(self%group%error)) &
         call self%group%move_rows(name, self%file_offset, values, self%block_offset, self%n_rows, &
                                   self%direction /= from_file)
   end subroutine visit

end module io_blocks
