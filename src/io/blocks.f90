!> Datasets of the samples of a block, each said once: its name, unit, axes, meaning and place. A
!> shard, the results file and the way back from either walk this list: a visitor writes them into a
!> file of their own, reads them, or puts them among those of all samples.
module io_blocks
   use campaign_plan, only: plan_type
   use campaign_results, only: block_result
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_group, only: group_type
   use io_hdf5, only: hdf5_file
   implicit none(type, external)
   private
   public :: put_block, read_block, write_blocks

   integer, parameter :: writes = 1, reads = 2, puts = 3   !! what a visitor does

   !> Does one thing with each dataset that it visits.
   type :: dataset_visitor
      integer :: deed = writes
      type(group_type) :: group            !! where the datasets are or come to be
      integer :: before = 0                !! rows of the file before those concerned
      integer :: place = 0                 !! rows of the block before those concerned
      integer :: n = 0                     !! rows concerned: samples, at last transitions
      integer :: n_all = 0                 !! rows of what is made: in the block, in the file
      integer :: first_number = 0          !! samples before the first of the case
      integer :: rows = 0, n_rows = 0      !! transitions that are made already, and of all samples
   contains
      procedure :: visit
   end type dataset_visitor

contains

   !> Writes blocks to the root of an open file: consecutive samples of a case.
   subroutine write_blocks(file, blocks, error)
      type(hdf5_file), intent(in) :: file
      type(block_result), intent(inout) :: blocks(:)   !! left as they were
      type(error_type), allocatable, intent(out) :: error
      type(dataset_visitor) :: w
      integer :: i

      do i = 1, size(blocks)
         associate (block => blocks(i))
            if (allocated(block%transitions)) &
               w%n_rows = w%n_rows + sum(block%transitions(block%before + 1: &
                                                           block%before + block%n_samples)%n)
         end associate
      end do
      w%group = group_type(file=file, path='/')
      do i = 1, size(blocks)
         w%before = blocks(i)%first_sample - blocks(1)%first_sample
         w%place = blocks(i)%before
         w%n = blocks(i)%n_samples
         w%n_all = sum(blocks%n_samples)
         call visit_short(w, blocks(i))
         call visit_long(w, blocks(i))
      end do
      call w%group%take_error(error)
   end subroutine write_blocks

   !> Reads what a file has of its samples before + 1 to before + n, into samples place + 1 to
   !> place + n of a block; the caller fills the numbers of case and samples.
   subroutine read_block(file, group, block, before, place, n, is_short, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group   !! its path
      type(block_result), intent(inout) :: block
      integer, intent(in) :: before, place, n
      logical, intent(in) :: is_short     !! series, spectra, histories, transitions left out
      type(error_type), allocatable, intent(out) :: error
      type(dataset_visitor) :: w

      w%deed = reads
      w%group = group_type(file=file, path=group)
      w%before = before
      w%place = place
      w%n = n
      w%n_all = block%n_samples
      call visit_short(w, block)
      if (.not. is_short) call visit_long(w, block)
      call w%group%take_error(error)
   end subroutine read_block

   !> Puts the short datasets of a block among those of all samples of its case. Or, with `rows`,
   !> the long ones: series, spectra and histories, and its transitions below those of the samples
   !> before it.
   subroutine put_block(group, plan, block, rows, n_rows)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(block_result), intent(inout) :: block      !! left as it was
      integer, intent(inout), optional :: rows        !! transitions that are there
      integer, intent(in), optional :: n_rows         !! transitions of all samples
      type(dataset_visitor) :: w

      w%deed = puts
      w%group = group
      w%before = block%first_sample - 1
      w%n_all = plan%cases(block%case_number)%n_samples
      w%n = min(block%n_samples, w%n_all - w%before)
      if (present(rows)) then
         w%first_number = plan%cases(block%case_number)%first_sample - 1
         w%rows = rows
         w%n_rows = n_rows
         call visit_long(w, block)
         rows = w%rows
      else
         call visit_short(w, block)
      end if
      group = w%group
   end subroutine put_block

   !> Visits what is small whatever the length of the march.
   subroutine visit_short(w, block)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(inout) :: block
      character(*), parameter :: by_sample = 'sample', by_joint = 'sample joint', &
                                 by_dof = 'sample dof'

      call w%visit('friction', '1', by_joint, 'friction coefficient', block%friction)
      call w%visit('slip_fraction', '1', by_joint, 'fraction of time in slip', &
                   block%slip_fraction)
      call w%visit('slip_fraction_error', '1', by_joint, 'time-average error of slip_fraction', &
                   block%slip_fraction_error)
      call w%visit('slip_starts', '1', by_joint, 'number of transitions from stick to slip', &
                   block%slip_starts, 'long')
      call w%visit('stick_starts', '1', by_joint, 'number of transitions from slip to stick', &
                   block%stick_starts, 'long')
      call w%visit('slip_distance', 'm', by_joint, 'distance that the joint slips', &
                   block%slip_distance)
      call w%visit('dissipation', 'J', by_joint, 'work that the joint dissipates', &
                   block%dissipation)
      call w%visit('joint_displacement_max', 'm', by_joint, 'largest displacement between '// &
                   'the ends of the joint, at the steps that enter the spectra', &
                   block%joint_displacement_max)
      call w%visit('harmonic_amplitude', 'm', by_dof, &
                   'amplitude of the fundamental, last ten periods', block%harmonic_amplitude)
      call w%visit('harmonic_phase', 'rad', by_dof, &
                   'phase of the fundamental against the force, negative: behind', &
                   block%harmonic_phase)
      call w%visit('steady_since', 's', by_sample, 'time from which on the fundamentals of '// &
                   'ten periods agree to 1e-3; NaN: never', block%steady_since)
      call w%visit('steady', '1', by_sample, &
                   '1: the last two windows of ten periods agree to 1e-3', block%steady, &
                   'integer')
      call w%visit('energy_input', 'J', by_sample, 'work of the force since n_discard', &
                   block%energy_input)
      call w%visit('energy_viscous', 'J', by_sample, &
                   'work of the viscous damping since n_discard', block%energy_viscous)
      call w%visit('energy_friction', 'J', by_sample, 'work of the friction since n_discard', &
                   block%energy_friction)
      call w%visit('energy_stored', 'J', by_sample, &
                   'change of kinetic and strain energy since n_discard', block%energy_stored)
      call w%visit('energy_defect', 'J', by_sample, 'input - viscous - friction - stored', &
                   block%energy_defect)
   end subroutine visit_short

   !> Visits what grows with the march. Transitions are rows of their own: they come last.
   subroutine visit_long(w, block)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(inout) :: block

      call w%visit('slip_series', '1', 'sample span joint', &
                   'fraction of time in slip within each of equal spans of time', &
                   block%slip_series)
      call w%visit('psd', 'm^2/Hz', 'sample frequency kept', &
                   'power spectral density of the displacement, one-sided', block%psd)
      call w%visit('power_series', 'm^2', 'sample batch kept', 'mean square of the '// &
                   'displacement in consecutive batches of segments, within ranges of '// &
                   'frequencies; those of a range together', block%power_series)
      call w%visit('displacement', 'm', 'sample time kept', 'displacement', block%displacement)
      call w%visit('velocity', 'm/s', 'sample time kept', 'velocity', block%velocity)
      if (w%deed == reads) then
         call read_transitions(w, block)
      else if (allocated(block%transitions)) then
         call hand_on_transitions(w, block)
      end if
   end subroutine visit_long

   !> Visits the columns of a list of transitions.
   subroutine visit_columns(w, sample, time, joint, kind)
      type(dataset_visitor), intent(inout) :: w
      real(wp), allocatable, intent(inout) :: sample(:), time(:), joint(:), kind(:)
      character(*), parameter :: by_row = 'transition'

      call w%visit('transition_sample', '1', by_row, 'sample of the transition', sample, &
                   'integer')
      call w%visit('transition_time', 's', by_row, 'time of the transition', time)
      call w%visit('transition_joint', '1', by_row, 'joint of the transition', joint, 'integer')
      call w%visit('transition_kind', '1', by_row, &
                   '+1, -1: slip starts in that direction; 0: sticks', kind, 'integer')
   end subroutine visit_columns

   subroutine hand_on_transitions(w, block)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(in) :: block
      real(wp), allocatable :: sample(:), time(:), joint(:), kind(:)
      integer :: first, i, last, number

      associate (lists => block%transitions(w%place + 1:w%place + w%n))
         w%n = sum(lists%n)
         allocate (sample(w%n), time(w%n), joint(w%n), kind(w%n))
         number = w%first_number + block%first_sample
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
      w%place = 0
      w%before = w%rows
      w%n_all = w%n_rows
      w%rows = w%rows + w%n
      call visit_columns(w, sample, time, joint, kind)
   end subroutine hand_on_transitions

   !> Reads those of the samples of the block, out of all that the file has.
   subroutine read_transitions(w, block)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(inout) :: block
      integer(long), allocatable :: n(:)
      real(wp), allocatable :: sample(:), time(:), joint(:), kind(:)
      integer :: i

      if (allocated(w%group%error)) return
      if (.not. w%group%has('transition_time')) return
      call w%group%read_shape('transition_time', n, 1)
      if (allocated(w%group%error)) return
      w%before = 0
      w%place = 0
      w%n = int(n(1))
      w%n_all = w%n
      allocate (sample(0), time(0), joint(0), kind(0))   ! as allocate_for wants them
      deallocate (sample, time, joint, kind)
      call visit_columns(w, sample, time, joint, kind)
      if (allocated(w%group%error)) return
      allocate (block%transitions(block%n_samples))
      do i = 1, block%n_samples
         associate (list => block%transitions(i), &
                    is_its => nint(sample) == block%first_sample + i - 1)
            list%time = pack(time, is_its)
            list%joint = nint(pack(joint, is_its))
            list%kind = nint(pack(kind, is_its))
            list%n = size(list%time)
         end associate
      end do
   end subroutine read_transitions

   !> Does the deed on the rows concerned. What is not there is passed by. A dataset that is made in
   !> a block's own file has no axes, and spectra are cut into ranges of frequencies, which is how
   !> statistics read them. A chunk has the samples of one block: more would not fit into HDF5's
   !> cache of 1 MB.
   subroutine visit(self, name, units, axes, about, values, kind)
      class(dataset_visitor), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, about   !! axes in Python's order
      real(wp), allocatable, intent(inout) :: values(..)
      character(*), intent(in), optional :: kind   !! as `make` has it
      character(:), allocatable :: own_axes
      integer :: extents(rank(values))
      integer, allocatable :: chunk(:)

      if (allocated(self%group%error)) return
      if (self%deed == reads) then
         if (.not. self%group%has(name)) return
         call self%group%allocate_for(name, values, self%n_all)
      else if (.not. allocated(values)) then
         return
      else if (.not. self%group%has(name)) then
         extents = shape(values)
         own_axes = ''
         if (self%deed == puts) then
            own_axes = self%group%axes_named(axes)
         else if (name == 'psd') then
            chunk = [extents(1), frequencies_together(extents(1), extents(2)), &
                     min(extents(3), self%n_all)]
         end if
         call self%group%make(name, int([extents(:size(extents) - 1), self%n_all], long), units, &
                              about, own_axes, kind, chunk)
      end if
      if (.not. allocated(self%group%error)) &
         call self%group%move_rows(name, self%before, values, self%place, self%n, &
                                   self%deed /= reads)
   end subroutine visit

end module io_blocks
