!> An earlier results file at the place of the new one: whose it is, its samples, so that a finished
!> campaign goes on to more of them, and the errors of its cases as it states them:
!> targets are judged by what was written.
module io_earlier_results
   use campaign_results, only: case_statistics
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_source, only: is_hdf5_file
   use io_contents, only: check_contents
   use io_files, only: exists
   use io_group, only: group_type
   use io_hdf5, only: hdf5_file, hdf5_object, open_hdf5
   use io_identity, only: identity_type, refuse_foreign, require_command, require_same
   use io_results, only: case_group
   use io_shards, only: finished_samples, shard_type
   implicit none(type, external)
   private
   public :: check_replaceable, inspect_results, stored_in_results
   public :: case_errors, read_errors

   !> Errors of one case. The statistics are those of mean slip fractions, where they are known.
   type :: case_errors
      type(case_statistics) :: statistics
      character(:), allocatable :: estimator   !! of the statistics; empty without statistics
      real(wp), allocatable :: percentiles(:)  !! [%] of the statistics; empty without statistics
      integer :: n_audited = 0
      integer :: n_unsteady = -1         !! samples under a sine that are not steady; -1: no sine
      real(wp) :: slip_points = 0.0_wp   !! numerical error found by the audit [points]
      real(wp) :: band_ratio = 0.0_wp    !! the same, relative
      !> largest standard errors of both over the dofs, as only a share of the samples was audited
      real(wp) :: slip_points_error = 0.0_wp, band_ratio_error = 0.0_wp
   end type case_errors

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
      if (.not. is_hdf5_file(path)) then
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

   !> Finds how many samples of each case, then of each audit, a results file holds. Reads the
   !> whole file: one of another scene or program, or a damaged one, is refused by name.
   subroutine inspect_results(path, identity, n_samples, error)
      character(*), intent(in) :: path
      type(identity_type), intent(in) :: identity
      !> (case and audit), twice as many as cases; not allocated: no file
      integer, allocatable, intent(out) :: n_samples(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_object) :: group
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
         group = hdf5_object(file, case_group(i, n_own))
         if (file%has(group%path)) call group%read('n_samples', n)
         call group%take_error(error)
         if (allocated(error)) exit
         found = [found, n]
      end do
      call file%abandon()
      if (.not. allocated(error)) call move_alloc(found, n_samples)
   end subroutine inspect_results

   !> The samples of a results file, but for those that have shards of their own.
   function stored_in_results(n_samples, together, shards) result(stored)
      integer, intent(in) :: n_samples(:)   !! (case and audit), as inspect_results found them
      integer, intent(in) :: together       !! samples that are read at once
      type(shard_type), intent(in) :: shards(:)
      type(shard_type), allocatable :: stored(:)
      logical, allocatable :: is_there(:, :)   ! (sample, case and audit) in a shard
      integer :: c, first, last, n

      is_there = finished_samples(shards, n_samples)
      allocate (stored(sum((n_samples + together - 1)/together)))
      n = 0
      do c = 1, size(n_samples)
         do first = 1, n_samples(c), together
            last = min(first + together - 1, n_samples(c))
            if (all(is_there(first:last, c))) cycle
            n = n + 1
            stored(n) = shard_type(c, first, last, case_group(c, size(n_samples)/2), first - 1)
         end do
      end do
      stored = stored(:n)
   end function stored_in_results

   !> Reads the errors that were written.
   subroutine read_errors(path, n_cases, errors, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_cases
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(group_type) :: group
      integer :: i

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      allocate (errors(n_cases))
      group%file = file
      do i = 1, n_cases
         group%path = case_group(i, n_cases)
         call read_case(group, errors(i))
         group%path = case_group(i + n_cases, n_cases)
         if (file%has(group%path)) call read_audit(group, errors(i))
      end do
      call group%take_error(error)
      call file%abandon()
   end subroutine read_errors

   !> Reads what the statistics say of a case, and by what they were made.
   subroutine read_case(group, errors)
      type(group_type), intent(inout) :: group
      type(case_errors), intent(inout) :: errors
      real(wp), allocatable :: is_steady(:), mean(:), mean_error(:), ratio(:)

      associate (statistics => errors%statistics)
         call group%read('n_samples', statistics%n_samples)
         call group%get('slip_mean', mean)
         call group%get('slip_mean_error', mean_error)
         call group%get('slip_mean_time_error', statistics%slip_mean_time_error)
         call group%get('slip_std_time_part', statistics%slip_std_time_part)
         call group%get('error_ratio/slip_mean', ratio)
         call group%get('percentile', errors%percentiles)
         call group%get('steady', is_steady)
         errors%estimator = ''
         if (group%has_attribute('estimator')) call group%read('estimator', errors%estimator)
         if (allocated(mean_error)) then
            statistics%n_joints = size(mean)
            allocate (statistics%numbers(size(mean), 1))
            statistics%numbers(:, 1)%value = mean
            statistics%numbers(:, 1)%error = mean_error
            if (allocated(ratio)) statistics%numbers(:, 1)%ratio = ratio
         end if
      end associate
      if (.not. allocated(errors%percentiles)) allocate (errors%percentiles(0))
      if (allocated(is_steady)) errors%n_unsteady = count(.not. is_steady > 0.0_wp)
   end subroutine read_case

   !> Reads the errors that the audit of a case found; standard errors are zero where all samples
   !> of the case were audited.
   subroutine read_audit(group, errors)
      type(group_type), intent(inout) :: group
      type(case_errors), intent(inout) :: errors
      real(wp), allocatable :: slip(:), ratio(:)

      call group%read('n_samples', errors%n_audited)
      call group%read('slip_points', errors%slip_points)
      if (group%has('band_ratio_difference')) call group%read('band_ratio', errors%band_ratio)
      call group%get('slip_rms_difference_error', slip)
      call group%get('band_ratio_difference_error', ratio)
      if (allocated(slip)) errors%slip_points_error = maxval(slip)
      if (allocated(ratio)) errors%band_ratio_error = maxval(ratio)
   end subroutine read_audit

end module io_earlier_results
