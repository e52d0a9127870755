!> An earlier results file at the place of the new one: whose it is, and its samples as shards, so
!> that a finished campaign goes on to more of them.
module io_earlier_results
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_blocks, only: read_block
   use io_case_results, only: case_group
   use io_case_samples, only: energy_terms
   use io_contents, only: check_contents
   use io_files, only: exists
   use io_gathering, only: finished_samples
   use io_hdf5, only: has_hdf5_signature, hdf5_file, open_hdf5, read_attribute, read_dataset, &
      read_extent, read_part
   use io_identity, only: identity_type, refuse_foreign, require_command, require_same
   use io_shards, only: list_shards, shard_type, write_shard
   use io_store, only: shard_store
   implicit none(type, external)
   private
   public :: check_replaceable, extract_shards, inspect_results

contains

   !> Fails unless the same command wrote what stands at the place of an output: the results of
   !> another command, a record of the force and the scene itself are not thrown away.
   subroutine check_replaceable(path, command, takes_damaged, error)
      character(*), intent(in) :: path
      character(*), intent(in) :: command        !! run, replay, tradeoff
      logical, intent(in) :: takes_damaged       !! also an HDF5 file that cannot be opened
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      if (.not. exists(path)) return
      if (.not. has_hdf5_signature(path)) then
         call refuse_foreign(path, error)
         return
      end if
      call open_hdf5(path, file, error)
      if (.not. allocated(error)) then
         call require_command(file, command, error)
         call file%abandon()
      else if (takes_damaged) then
         deallocate (error)
      end if
   end subroutine check_replaceable

   !> Samples of each case that a results file holds, then of the audit of each; none where there
   !> is no file. A file of another scene or program, or one that is not whole, is an error that
   !> names it: all of it is read.
   subroutine inspect_results(path, identity, n_samples, error)
      character(*), intent(in) :: path
      type(identity_type), intent(in) :: identity
      !> (case and audit), twice as many as cases; not allocated: no file
      integer, allocatable, intent(out) :: n_samples(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer, allocatable :: found(:)
      integer :: i, n, n_own

      if (.not. exists(path)) return
      call open_hdf5(path, file, error)
      if (allocated(error)) return
      call require_same(file, identity, error)
      if (.not. allocated(error)) then
         call check_contents(file, error)
         if (allocated(error)) error%message = error%message//': put a sound copy in its '// &
                                'place, or discard it with --fresh and compute its samples again'
      end if
      n_own = 0
      do while (.not. allocated(error))
         if (.not. file%has(case_group(n_own + 1, huge(1)))) exit
         n_own = n_own + 1
      end do
      allocate (found(0))
      do i = 1, 2*n_own
         n = 0
         if (file%has(case_group(i, n_own))) &
            call read_attribute(file, case_group(i, n_own), 'n_samples', n, error)
         if (allocated(error)) exit
         found = [found, n]
      end do
      call file%abandon()
      if (.not. allocated(error)) call move_alloc(found, n_samples)
   end subroutine inspect_results

   !> Writes the samples of a results file as shards, but for those that the store has already.
   subroutine extract_shards(path, n_samples, samples_per_shard, store, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_samples(:)   !! (case and audit), as inspect_results found them
      integer, intent(in) :: samples_per_shard
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      type(hdf5_file) :: file
      integer :: case_number

      call list_shards(store, shards, error)
      if (allocated(error)) return
      call open_hdf5(path, file, error)
      if (allocated(error)) return
      do case_number = 1, size(n_samples)
         call extract_case(file, case_group(case_number, size(n_samples)/2)//'/', case_number, &
                           samples_per_shard, store, &
                           finished_samples(shards, case_number, n_samples(case_number)), error)
         if (allocated(error)) exit
      end do
      call file%abandon()
   end subroutine extract_shards

   subroutine extract_case(file, group, case_number, samples_per_shard, store, is_stored, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group   !! with its last slash
      integer, intent(in) :: case_number, samples_per_shard
      type(shard_store), intent(in) :: store
      logical, intent(in) :: is_stored(:)   !! (sample)
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: all_samples, block
      integer :: first, last, n

      n = size(is_stored)
      if (all(is_stored)) return
      call read_block(file, group, all_samples, error, skips_long=.true.)
      if (allocated(error)) return
      call read_energy(file, group, n, all_samples%energy, error)
      if (allocated(error)) return
      do first = 1, n, samples_per_shard
         last = min(first + samples_per_shard - 1, n)
         if (all(is_stored(first:last))) cycle
         block = piece_of(all_samples, first, last)
         block%case_number = case_number
         call read_long_part(file, group, block, error)
         if (allocated(error)) return
         call write_shard(store, block, error)
         if (allocated(error)) return
      end do
   end subroutine extract_case

   !> The terms lie apart in a results file.
   subroutine read_energy(file, group, n_samples, energy, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      integer, intent(in) :: n_samples
      real(wp), allocatable, intent(inout) :: energy(:, :)   !! (term, sample)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: term(n_samples)
      integer :: i

      if (.not. file%has(group//trim(energy_terms(1)))) return
      allocate (energy(size(energy_terms), n_samples))
      do i = 1, size(energy_terms)
         call read_dataset(file, group//trim(energy_terms(i)), term, error)
         if (allocated(error)) return
         energy(i, :) = term
      end do
   end subroutine read_energy

   !> Small data of samples first..last.
   pure function piece_of(all_samples, first, last) result(block)
      type(block_result), intent(in) :: all_samples
      integer, intent(in) :: first, last
      type(block_result) :: block

      block%first_sample = first
      block%n_samples = last - first + 1
      if (allocated(all_samples%friction)) block%friction = all_samples%friction(:, first:last)
      if (allocated(all_samples%slip_fraction)) then
         block%slip_fraction = all_samples%slip_fraction(:, first:last)
      end if
      if (allocated(all_samples%slip_starts)) then
         block%slip_starts = all_samples%slip_starts(:, first:last)
      end if
      if (allocated(all_samples%stick_starts)) then
         block%stick_starts = all_samples%stick_starts(:, first:last)
      end if
      if (allocated(all_samples%slip_distance)) then
         block%slip_distance = all_samples%slip_distance(:, first:last)
         block%dissipation = all_samples%dissipation(:, first:last)
      end if
      if (allocated(all_samples%joint_displacement_max)) &
         block%joint_displacement_max = all_samples%joint_displacement_max(:, first:last)
      if (allocated(all_samples%energy)) block%energy = all_samples%energy(:, first:last)
      if (allocated(all_samples%steady_since)) then
         block%harmonic_amplitude = all_samples%harmonic_amplitude(:, first:last)
         block%harmonic_phase = all_samples%harmonic_phase(:, first:last)
         block%steady_since = all_samples%steady_since(first:last)
      end if
   end function piece_of

   !> Spectra, histories and transitions of a block whose samples are known.
   subroutine read_long_part(file, group, block, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(block_result), intent(inout) :: block
      type(error_type), allocatable, intent(out) :: error

      call read_cube('slip_series', block%slip_series)
      call read_cube('psd', block%psd)
      call read_cube('power_series', block%power_series)
      call read_cube('displacement', block%displacement)
      call read_cube('velocity', block%velocity)
      if (allocated(error)) return
      if (file%has(group//'transition_time')) call read_transitions(file, group, block, error)

   contains

      subroutine read_cube(name, values)
         character(*), intent(in) :: name
         real(wp), allocatable, intent(inout) :: values(:, :, :)
         integer(long), allocatable :: n(:)

         if (allocated(error)) return
         if (.not. file%has(group//name)) return
         call read_extent(file, group//name, 3, n, error)
         if (allocated(error)) return
         allocate (values(n(1), n(2), block%n_samples))
         call read_part(file, group//name, [1, 1, block%first_sample], values, error)
      end subroutine read_cube

   end subroutine read_long_part

   subroutine read_transitions(file, group, block, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(block_result), intent(inout) :: block
      type(error_type), allocatable, intent(out) :: error
      integer(long), allocatable :: n(:)
      integer, allocatable :: joint(:), kind(:), sample(:)
      real(wp), allocatable :: time(:)
      integer :: i

      call read_extent(file, group//'transition_time', 1, n, error)
      if (allocated(error)) return
      allocate (joint(n(1)), kind(n(1)), sample(n(1)), time(n(1)))
      call read_dataset(file, group//'transition_sample', sample, error)
      if (.not. allocated(error)) call read_dataset(file, group//'transition_time', time, error)
      if (.not. allocated(error)) call read_dataset(file, group//'transition_joint', joint, error)
      if (.not. allocated(error)) call read_dataset(file, group//'transition_kind', kind, error)
      if (allocated(error)) return
      allocate (block%transitions(block%n_samples))
      do i = 1, block%n_samples
         associate (list => block%transitions(i), is_its => sample == block%first_sample + i - 1)
            list%time = pack(time, is_its)
            list%joint = pack(joint, is_its)
            list%kind = pack(kind, is_its)
            list%n = size(list%time)
         end associate
      end do
   end subroutine read_transitions

end module io_earlier_results
