!> Datasets of the samples of a block, each said once: its name, unit, axes, meaning and place. A
!> shard, the results file and the way back from either walk this list.
module io_blocks
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_group, only: group_of, group_type
   use io_hdf5, only: hdf5_file, read_extent
   use io_dataset_visitor, only: dataset_type, dataset_visitor, puts, reads
   implicit none(type, external)
   private
   public :: kept_axis, put_long, put_short, read_block, write_blocks

contains

   !> Writes blocks to the root of an open file: consecutive samples of a case.
   subroutine write_blocks(file, blocks, error)
      type(hdf5_file), intent(in) :: file
      type(block_result), intent(inout) :: blocks(:)   !! left as they were
      type(error_type), allocatable, intent(out) :: error
      type(dataset_visitor) :: w
      integer :: i, n_rows, rows

      n_rows = 0
      do i = 1, size(blocks)
         associate (block => blocks(i))
            if (allocated(block%transitions)) &
               n_rows = n_rows + sum(block%transitions(block%before + 1: &
                                                       block%before + block%n_samples)%n)
         end associate
      end do
      rows = 0
      w%group = group_of(file, '/')
      do i = 1, size(blocks)
         w%before = blocks(i)%first_sample - blocks(1)%first_sample
         w%place = blocks(i)%before
         w%n = blocks(i)%n_samples
         w%n_all = sum(blocks%n_samples)
         call visit_short(w, blocks(i))
         call visit_long(w, blocks(i), rows=rows, n_rows=n_rows)
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
      w%group = group_of(file, group)
      w%before = before
      w%place = place
      w%n = n
      w%n_all = block%n_samples
      call visit_short(w, block)
      if (.not. is_short) call visit_long(w, block)
      call w%group%take_error(error)
   end subroutine read_block

   !> Puts the short datasets of a block among those of all samples of its case.
   subroutine put_short(group, plan, block)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(block_result), intent(inout) :: block   !! left as it was
      type(dataset_visitor) :: w

      call start_putting(group, plan, block, w)
      call visit_short(w, block)
      group = w%group
   end subroutine put_short

   !> Puts its series, spectra and histories there, and its transitions below those of the samples
   !> before it.
   subroutine put_long(group, plan, block, rows, n_rows)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(block_result), intent(inout) :: block   !! left as it was
      integer, intent(inout) :: rows               !! transitions that are there
      integer, intent(in) :: n_rows                !! transitions of all samples
      type(dataset_visitor) :: w

      call start_putting(group, plan, block, w)
      call visit_long(w, block, plan%cases(block%case_number)%first_sample - 1, rows, n_rows)
      group = w%group
   end subroutine put_long

   subroutine start_putting(group, plan, block, w)
      type(group_type), intent(in) :: group
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: block
      type(dataset_visitor), intent(inout) :: w

      w%deed = puts
      w%group = group
      w%dof = kept_axis(plan)
      w%before = block%first_sample - 1
      w%n_all = plan%cases(block%case_number)%n_samples
      w%n = min(block%n_samples, w%n_all - w%before)
   end subroutine start_putting

   !> Visits what is small whatever the length of the march.
   subroutine visit_short(w, block)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(inout) :: block
      character(*), parameter :: by_sample = 'sample', by_joint = 'sample joint', &
                                 by_dof = 'sample dof'

      call w%visit(dataset_type('friction', '1', by_joint, 'friction coefficient'), block%friction)
      call w%visit(dataset_type('slip_fraction', '1', by_joint, 'fraction of time in slip'), &
                   block%slip_fraction)
      call w%visit(dataset_type('slip_fraction_error', '1', by_joint, &
                                'time-average error of slip_fraction'), &
                   block%slip_fraction_error)
      call w%visit(dataset_type('slip_starts', '1', by_joint, &
                                'number of transitions from stick to slip', 'long'), &
                   block%slip_starts)
      call w%visit(dataset_type('stick_starts', '1', by_joint, &
                                'number of transitions from slip to stick', 'long'), &
                   block%stick_starts)
      call w%visit(dataset_type('slip_distance', 'm', by_joint, &
                                'distance that the joint slips'), block%slip_distance)
      call w%visit(dataset_type('dissipation', 'J', by_joint, 'work that the joint dissipates'), &
                   block%dissipation)
      call w%visit(dataset_type('joint_displacement_max', 'm', by_joint, &
                                'largest displacement between the ends of the joint, at the '// &
                                'steps that enter the spectra'), block%joint_displacement_max)
      call w%visit(dataset_type('harmonic_amplitude', 'm', by_dof, &
                                'amplitude of the fundamental, last ten periods'), &
                   block%harmonic_amplitude)
      call w%visit(dataset_type('harmonic_phase', 'rad', by_dof, &
                                'phase of the fundamental against the force, negative: behind'), &
                   block%harmonic_phase)
      call w%visit(dataset_type('steady_since', 's', by_sample, 'time from which on the '// &
                                'fundamentals of ten periods agree to 1e-3; NaN: never'), &
                   block%steady_since)
      call w%visit(dataset_type('steady', '1', by_sample, &
                                '1: the last two windows of ten periods agree to 1e-3', &
                                'integer'), &
                   block%steady)
      call w%visit(dataset_type('energy_input', 'J', by_sample, &
                                'work of the force since n_discard'), &
                   block%energy_input)
      call w%visit(dataset_type('energy_viscous', 'J', by_sample, &
                                'work of the viscous damping since n_discard'), &
                   block%energy_viscous)
      call w%visit(dataset_type('energy_friction', 'J', by_sample, &
                                'work of the friction since n_discard'), &
                   block%energy_friction)
      call w%visit(dataset_type('energy_stored', 'J', by_sample, &
                                'change of kinetic and strain energy since n_discard'), &
                   block%energy_stored)
      call w%visit(dataset_type('energy_defect', 'J', by_sample, &
                                'input - viscous - friction - stored'), block%energy_defect)
   end subroutine visit_short

   !> Visits what grows with the march. Transitions are rows of their own: they come last.
   subroutine visit_long(w, block, first_number, rows, n_rows)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(inout) :: block
      integer, intent(in), optional :: first_number   !! samples before the first of the case
      integer, intent(inout), optional :: rows        !! where they are put: transitions there
      integer, intent(in), optional :: n_rows         !! of all samples

      call w%visit(dataset_type('slip_series', '1', 'sample span joint', &
                                'fraction of time in slip within each of equal spans of time'), &
                   block%slip_series)
      call w%visit(dataset_type('psd', 'm^2/Hz', 'sample frequency kept', &
                                'power spectral density of the displacement, one-sided'), block%psd)
      call w%visit(dataset_type('power_series', 'm^2', 'sample batch kept', &
                                'mean square of the displacement in consecutive batches of '// &
                                'segments, within ranges of frequencies; those of a range '// &
                                'together'), &
                   block%power_series)
      call w%visit(dataset_type('displacement', 'm', 'sample time kept', 'displacement'), &
                   block%displacement)
      call w%visit(dataset_type('velocity', 'm/s', 'sample time kept', 'velocity'), block%velocity)
      if (w%deed == reads) then
         call read_transitions(w, block)
      else if (allocated(block%transitions)) then
         call hand_on_transitions(w, block, first_number, rows, n_rows)
      end if
   end subroutine visit_long

   !> Visits the columns of a list of transitions.
   subroutine visit_columns(w, sample, time, joint, kind)
      type(dataset_visitor), intent(inout) :: w
      real(wp), allocatable, intent(inout) :: sample(:), time(:), joint(:), kind(:)
      character(*), parameter :: by_row = 'transition'

      call w%visit(dataset_type('transition_sample', '1', by_row, 'sample of the transition', &
                                'integer'), sample)
      call w%visit(dataset_type('transition_time', 's', by_row, 'time of the transition'), time)
      call w%visit(dataset_type('transition_joint', '1', by_row, 'joint of the transition', &
                                'integer'), joint)
      call w%visit(dataset_type('transition_kind', '1', by_row, &
                                '+1, -1: slip starts in that direction; 0: sticks', 'integer'), &
                   kind)
   end subroutine visit_columns

   subroutine hand_on_transitions(w, block, first_number, rows, n_rows)
      type(dataset_visitor), intent(inout) :: w
      type(block_result), intent(in) :: block
      integer, intent(in), optional :: first_number, n_rows
      integer, intent(inout), optional :: rows
      real(wp), allocatable :: sample(:), time(:), joint(:), kind(:)
      integer :: first, i, last, number

      associate (lists => block%transitions(w%place + 1:w%place + w%n))
         w%n = sum(lists%n)
         allocate (sample(w%n), time(w%n), joint(w%n), kind(w%n))
         number = block%first_sample
         if (present(first_number)) number = number + first_number
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
      w%n_all = w%n
      if (present(rows)) then
         w%before = rows
         w%n_all = n_rows
         rows = rows + w%n
      end if
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
      call read_extent(w%group%file, w%group%at('transition_time'), 1, n, w%group%error)
      if (allocated(w%group%error)) return
      w%before = 0
      w%place = 0
      w%n = int(n(1))
      w%n_all = w%n
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

   !> The axis of the dofs whose spectra and histories are kept.
   pure function kept_axis(plan) result(name)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: name

      name = 'dof'
      if (size(kept_dofs(plan)) < plan%structure%n_dof) name = 'kept_dof'
   end function kept_axis

end module io_blocks
