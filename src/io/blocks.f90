!> A block of samples as datasets of one HDF5 file, whole or without what is long.
module io_blocks
   use campaign_results, only: block_result
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use io_checksum, only: checksum_type
   use io_hdf5, only: hdf5_file, label_type, read_dataset, read_extent, write_dataset
   implicit none(type, external)
   private
   public :: find_checksum, frequencies_together, read_block, sample_label, write_block

   integer, parameter :: writes = 1, reads = 2, checks = 3

   !> Walks through the components of a block; one list of them serves all that is done with it.
   type :: walker
      integer :: deed = writes
      logical :: skips_long = .false.   !! series, spectra, histories and transitions left out
      type(hdf5_file) :: file
      character(:), allocatable :: group   !! with its last slash
      type(checksum_type) :: checksum
      type(error_type), allocatable :: error
   contains
      generic :: pass => pass_vector, pass_matrix, pass_counts, pass_cube
      procedure, private :: pass_vector, pass_matrix, pass_counts, pass_cube
   end type walker

   !> The deed itself, on a component that is there.
   interface treat
      module procedure treat_reals, treat_longs
   end interface treat

contains

   !> Writes a block to the root of an open file.
   subroutine write_block(file, block, error)
      type(hdf5_file), intent(in) :: file
      type(block_result), intent(inout) :: block   !! left as it was
      type(error_type), allocatable, intent(out) :: error
      type(walker) :: w

      w%file = file
      w%group = '/'
      call walk(w, block)
      if (allocated(w%error)) call move_alloc(w%error, error)
   end subroutine write_block

   !> Reads the parts of a block that the file has; the caller fills the numbers of case and
   !> samples.
   subroutine read_block(file, group, block, error, skips_long)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group   !! with its last slash
      type(block_result), intent(inout) :: block
      type(error_type), allocatable, intent(out) :: error
      logical, intent(in), optional :: skips_long   !! as in walker
      type(walker) :: w

      w%deed = reads
      if (present(skips_long)) w%skips_long = skips_long
      w%file = file
      w%group = group
      call walk(w, block)
      if (allocated(w%error)) call move_alloc(w%error, error)
   end subroutine read_block

   !> Checksum of every value of a block and of its place in the campaign.
   subroutine find_checksum(block, checksum)
      type(block_result), intent(inout) :: block   !! left as it was
      integer(long), intent(out) :: checksum
      type(walker) :: w

      w%deed = checks
      call w%checksum%add([block%case_number, block%first_sample, block%n_samples])
      call walk(w, block)
      checksum = w%checksum%value()
   end subroutine find_checksum

   subroutine walk(w, block)
      type(walker), intent(inout) :: w
      type(block_result), intent(inout) :: block
      real(wp), allocatable :: rows(:, :)
      integer(long), allocatable :: counts(:, :)

      call w%pass('friction', block%friction)
      call w%pass('slip_fraction', block%slip_fraction)
      call w%pass('slip_starts', block%slip_starts)
      call w%pass('stick_starts', block%stick_starts)
      call w%pass('slip_distance', block%slip_distance)
      call w%pass('dissipation', block%dissipation)
      call w%pass('joint_displacement_max', block%joint_displacement_max)
      call w%pass('energy', block%energy)
      call w%pass('harmonic_amplitude', block%harmonic_amplitude)
      call w%pass('harmonic_phase', block%harmonic_phase)
      call w%pass('steady_since', block%steady_since)
      if (w%skips_long) return
      call w%pass('slip_series', block%slip_series)
      call w%pass('psd', block%psd)
      call w%pass('power_series', block%power_series)
      call w%pass('displacement', block%displacement)
      call w%pass('velocity', block%velocity)
      if (w%deed /= reads) call lay_out_transitions(block, counts, rows)
      call w%pass('transition_count', counts)
      call w%pass('transitions', rows)
      if (w%deed /= reads .or. .not. (allocated(counts) .and. allocated(rows))) return
      if (are_transitions(counts, rows)) then
         call take_up_transitions(counts, rows, block)
      else
         call raise(w%error, exit_file, w%file%path//': '//w%group// &
                    'transitions: not a list of transitions')
      end if
   end subroutine walk

   subroutine pass_vector(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)
      integer(long), allocatable :: n(:)
      integer :: status

      call look(self, name, allocated(values), 1, n)
      if (.not. allocated(n)) return
      status = 0
      if (self%deed == reads) allocate (values(n(1)), stat=status)
      if (status /= 0) call refuse_size(self, name, n)
      if (.not. allocated(self%error)) call treat(self, name, values)
   end subroutine pass_vector

   subroutine pass_matrix(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer(long), allocatable :: n(:)
      integer :: status

      call look(self, name, allocated(values), 2, n)
      if (.not. allocated(n)) return
      status = 0
      if (self%deed == reads) allocate (values(n(1), n(2)), stat=status)
      if (status /= 0) call refuse_size(self, name, n)
      if (.not. allocated(self%error)) call treat(self, name, values)
   end subroutine pass_matrix

   subroutine pass_cube(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:, :, :)
      integer(long), allocatable :: n(:)
      integer :: status

      call look(self, name, allocated(values), 3, n)
      if (.not. allocated(n)) return
      status = 0
      if (self%deed == reads) allocate (values(n(1), n(2), n(3)), stat=status)
      if (status /= 0) call refuse_size(self, name, n)
      if (.not. allocated(self%error)) call treat(self, name, values)
   end subroutine pass_cube

   subroutine pass_counts(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      integer(long), allocatable, intent(inout) :: values(:, :)
      integer(long), allocatable :: n(:)
      integer :: status

      call look(self, name, allocated(values), 2, n)
      if (.not. allocated(n)) return
      status = 0
      if (self%deed == reads) allocate (values(n(1), n(2)), stat=status)
      if (status /= 0) call refuse_size(self, name, n)
      if (.not. allocated(self%error)) call treat(self, name, values)
   end subroutine pass_counts

   !> Extents of a component that there is something to do with: of the file when reading, else 0.
   subroutine look(self, name, is_there, n_axes, extents)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      logical, intent(in) :: is_there
      integer, intent(in) :: n_axes
      integer(long), allocatable, intent(out) :: extents(:)

      if (allocated(self%error)) return
      if (self%deed /= reads) then
         if (is_there) allocate (extents(n_axes), source=0_long)
      else if (self%file%has(self%group//name)) then
         call read_extent(self%file, self%group//name, n_axes, extents, self%error)
         if (allocated(self%error)) deallocate (extents)
      end if
   end subroutine look

   !> An error for a component that the memory cannot hold: a damaged file names any extent.
   subroutine refuse_size(self, name, extents)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      integer(long), intent(in) :: extents(:)

      call raise(self%error, exit_file, self%file%path//': '//self%group//name// &
                 ' does not fit into memory: '//to_text(product(extents))//' values')
   end subroutine refuse_size

   subroutine treat_reals(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(inout), contiguous :: values(..)

      select case (self%deed)
      case (writes)
         call write_dataset(self%file, self%group//name, values, bare_label(name, shape(values)), &
                            self%error)
      case (reads)
         call read_dataset(self%file, self%group//name, values, self%error)
      case (checks)
         call self%checksum%add(name)
         call self%checksum%add(values)
      end select
   end subroutine treat_reals

   subroutine treat_longs(self, name, values)
      class(walker), intent(inout) :: self
      character(*), intent(in) :: name
      integer(long), intent(inout), contiguous :: values(..)

      select case (self%deed)
      case (writes)
         call write_dataset(self%file, self%group//name, values, bare_label(name, shape(values)), &
                            self%error)
      case (reads)
         call read_dataset(self%file, self%group//name, values, self%error)
      case (checks)
         call self%checksum%add(name)
         call self%checksum%add(values)
      end select
   end subroutine treat_longs

   !> The lists of all samples one below the other.
   subroutine lay_out_transitions(block, counts, rows)
      type(block_result), intent(in) :: block
      integer(long), allocatable, intent(out) :: counts(:, :)   !! (1, sample)
      real(wp), allocatable, intent(out) :: rows(:, :)          !! (time dof kind, row)
      integer :: first, i

      if (.not. allocated(block%transitions)) return
      counts = reshape(int(block%transitions%n, long), [1, size(block%transitions)])
      allocate (rows(3, sum(block%transitions%n)))
      first = 1
      do i = 1, size(block%transitions)
         associate (list => block%transitions(i), last => first + block%transitions(i)%n - 1)
            if (list%n == 0) cycle
            rows(1, first:last) = list%time(:list%n)
            rows(2, first:last) = list%joint(:list%n)
            rows(3, first:last) = list%kind(:list%n)
         end associate
         first = first + block%transitions(i)%n
      end do
   end subroutine lay_out_transitions

   !> True if the rows are as many as counted, each of a joint and a kind: damage goes no further.
   pure logical function are_transitions(counts, rows)
      integer(long), intent(in) :: counts(:, :)   !! (1, sample)
      real(wp), intent(in) :: rows(:, :)          !! (time dof kind, row)

      are_transitions = all(counts >= 0 .and. counts <= size(rows, 2)) &
                        .and. all(is_within(rows(2, :), 1.0_wp, real(huge(1), wp))) &
                        .and. all(is_within(rows(3, :), -1.0_wp, 1.0_wp))
      if (are_transitions) are_transitions = sum(counts) == size(rows, 2)
   end function are_transitions

   !> Also of a NaN, which would trap in an ordering.
   elemental logical function is_within(x, low, high)
      real(wp), intent(in) :: x, low, high

      is_within = x == x
      if (is_within) is_within = x >= low .and. x <= high
   end function is_within

   subroutine take_up_transitions(counts, rows, block)
      integer(long), intent(in) :: counts(:, :)   !! (1, sample)
      real(wp), intent(in) :: rows(:, :)          !! (time dof kind, row)
      type(block_result), intent(inout) :: block
      integer :: first, i, last

      allocate (block%transitions(size(counts, 2)))
      first = 1
      do i = 1, size(counts, 2)
         last = first + int(counts(1, i)) - 1
         block%transitions(i)%n = int(counts(1, i))
         block%transitions(i)%time = rows(1, first:last)
         block%transitions(i)%joint = nint(rows(2, first:last))
         block%transitions(i)%kind = nint(rows(3, first:last))
         first = last + 1
      end do
   end subroutine take_up_transitions

   !> Label of a dataset in a block's own file: without axes, and with spectra cut into ranges of
   !> frequencies, which is how statistics read them.
   pure function bare_label(name, extents) result(label)
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)
      type(label_type) :: label

      label = sample_label(name)
      label%axes = ''
      if (name == 'psd') then
         label%chunk = [extents(1), frequencies_together(extents(1), extents(2)), extents(3)]
      end if
   end function bare_label

   !> Neighbouring frequencies that a shard keeps together and that are best read together: ranges
   !> of equal length, with some 320 values for each sample.
   pure function frequencies_together(n_dof, n_frequencies) result(n)
      integer, intent(in) :: n_dof, n_frequencies
      integer :: n
      integer, parameter :: values_together = 320

      n = (n_frequencies - 1)/max(values_together/n_dof, 1) + 1   ! ranges
      n = (n_frequencies - 1)/n + 1
   end function frequencies_together

   !> Units, meaning and axes of what a sample hands back.
   pure function sample_label(name) result(label)
      character(*), intent(in) :: name
      type(label_type) :: label

      select case (name)
      case ('friction')
         label = label_type('1', 'friction coefficient', 'sample joint')
      case ('slip_fraction')
         label = label_type('1', 'fraction of time in slip', 'sample joint')
      case ('slip_series')
         label = label_type('1', 'fraction of time in slip within each of equal spans of time', &
                            'sample span joint')
      case ('slip_starts')
         label = label_type('1', 'number of transitions from stick to slip', 'sample joint')
      case ('stick_starts')
         label = label_type('1', 'number of transitions from slip to stick', 'sample joint')
      case ('slip_distance')
         label = label_type('m', 'way of the joint while it slips', 'sample joint')
      case ('dissipation')
         label = label_type('J', 'work that the joint dissipates', 'sample joint')
      case ('joint_displacement_max')
         label = label_type('m', 'largest displacement between the ends of the joint, at the '// &
                            'steps that enter the spectra', 'sample joint')
      case ('energy')
         label = label_type('J', 'work (input, viscous, friction), energy stored, defect', &
                            'sample term')
      case ('harmonic_amplitude')
         label = label_type('m', 'amplitude of the fundamental, last ten periods', 'sample dof')
      case ('harmonic_phase')
         label = label_type('rad', 'phase of the fundamental against the force, negative: behind', &
                            'sample dof')
      case ('steady_since')
         label = label_type('s', 'time from which on the fundamentals of ten periods agree to '// &
                            '1e-3; not a number: never', 'sample')
      case ('psd')
         label = label_type('m^2/Hz', 'power spectral density of the displacement, one-sided', &
                            'sample frequency dof')
      case ('power_series')
         label = label_type('m^2', 'mean square of the displacement in consecutive batches of '// &
                            'segments, within ranges of frequencies; those of a range together', &
                            'sample batch dof')
      case ('displacement')
         label = label_type('m', 'displacement', 'sample time dof')
      case ('velocity')
         label = label_type('m/s', 'velocity', 'sample time dof')
      case ('transitions')
         label = label_type('1', 'time [s], joint and kind of each transition', &
                            'transition column')
      case ('transition_count')
         label = label_type('1', 'number of transitions', 'sample one')
      case default
         error stop 'io_blocks: sample_label of an unknown name'
      end select
   end function sample_label

end module io_blocks
