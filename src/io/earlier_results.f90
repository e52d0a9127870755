!> Results file of an earlier run at the path of the output: the command that wrote it, its samples,
!> to which a larger campaign adds others, and the stated errors of its cases, which are compared
!> with the scene's targets.
module io_earlier_results
   use campaign_plan, only: case_type, plan_type
   use campaign_results, only: case_statistics
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_source, only: is_hdf5_file
   use core_text, only: numbered
   use io_contents, only: check_contents
   use io_files, only: exists, is_readable
   use io_hdf5, only: hdf5_file, hdf5_group, hdf5_object, open_hdf5
   use io_results, only: case_group
   use io_shards, only: finished_samples, shard_type
   use io_store, only: identity_type, refuse_foreign, require_command, require_same
   implicit none(type, external)
   private
   public :: count_stored_samples, refuse_replacement, stored_in_results
   public :: case_errors, has_realizations, read_campaign, read_errors

   !> End of an error of a damaged file.
   character(*), parameter :: advice = ': put a sound copy in its place, or remove it to have '// &
                              'its samples computed again'

   !> Stated errors of one case. The statistics are those of mean slip fractions, if the file has
   !> them.
   type :: case_errors
      type(case_statistics) :: statistics
      character(:), allocatable :: estimator   !! estimator of the statistics; '' without statistics
      real(wp), allocatable :: percentiles(:)  !! percentiles [%] that the statistics have
      integer :: n_audited = 0                 !! samples that the audit repeated
      integer :: n_unsteady = -1               !! samples not steady under a sine; -1: no sine
      real(wp) :: slip_points = 0.0_wp         !! numerical error of slip fractions [points]
      real(wp) :: band_ratio = 0.0_wp          !! relative numerical error of band ratios
      !> largest standard errors of the two numerical errors; zero if all samples were audited
      real(wp) :: slip_points_error = 0.0_wp, band_ratio_error = 0.0_wp
   end type case_errors

contains

   !> Refuses to replace a file that the same command did not write: the results of another command,
   !> a force record, the scene itself.
   subroutine refuse_replacement(path, command, error)
      character(*), intent(in) :: path
      character(*), intent(in) :: command   !! 'run', 'replay' or 'tradeoff'
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      if (.not. exists(path)) return
      call open_results(path, file, error)
      if (.not. allocated(error)) call require_command(file, command, advice, error)
      call file%abandon()
   end subroutine refuse_replacement

   !> Opens a results file; refuses a truncated one, a file of another format, and one that this
   !> process may not read.
   subroutine open_results(path, file, error)
      character(*), intent(in) :: path
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error

      call open_hdf5(path, file, error)
      if (.not. allocated(error)) return
      if (is_hdf5_file(path)) then
         error%message = error%message//advice
      else if (is_readable(path)) then
         call refuse_foreign(path, error)
      end if
   end subroutine open_results

   !> Reads from the results of a run what estimates of other laws need: the text of its scene, its
   !> --set options, one a line, its cases, joints and spectra, and stated errors. Checks the whole
   !> file.
   subroutine read_campaign(path, scene, overrides, plan, frequency, errors, error)
      character(*), intent(in) :: path
      character(:), allocatable, intent(out) :: scene, overrides
      type(plan_type), intent(out) :: plan   !! with cases, joints, dofs and percentiles alone
      real(wp), allocatable, intent(out) :: frequency(:)   !! [Hz]; empty without spectra of samples
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_group) :: group

      if (.not. exists(path)) then
         call raise(error, exit_bad_input, path//': no such file')
         return
      end if
      call open_results(path, file, error)
      if (.not. allocated(error)) call require_command(file, 'run', advice, error)
      if (.not. allocated(error)) call check_contents(file, error)
      if (.not. allocated(error)) then
         group = hdf5_group(file=file, path='/')
         call group%read('scene', scene)
         call group%read('overrides', overrides)
         allocate (frequency(0), plan%cases(0))
         if (file%has('/structure')) call read_plan(group, plan, frequency)
         call read_cases(group, size(plan%cases), errors)
         call group%take_error(error)
      end if
      call file%abandon()
      if (.not. allocated(error)) return
      if (is_readable(path)) error%message = path//': cannot be read as results of entroslip run'
   end subroutine read_campaign

   !> Reads cases, joints, dofs and percentiles, and the frequencies of the spectra if all samples
   !> with drawn friction have theirs.
   subroutine read_plan(group, plan, frequency)
      type(hdf5_group), intent(inout) :: group   !! of an open file; its path is changed
      type(plan_type), intent(inout) :: plan
      real(wp), allocatable, intent(inout) :: frequency(:)
      type(case_type) :: case
      character(:), allocatable :: process
      character(9), parameter :: strengths(*) = [character(9) :: 'amplitude', 'factor', 'variance']
      real(wp), allocatable :: points(:), dofs(:), kept(:)
      integer :: i

      group%path = '/structure'
      call group%get('friction_point', points)
      call group%get('frequencies_stuck', dofs)
      if (allocated(group%error)) return
      plan%structure%friction_point = nint(points)
      plan%structure%n_points = maxval(plan%structure%friction_point)
      plan%structure%n_joints = size(points)
      plan%structure%n_dof = size(dofs)
      plan%output%spectrum = .true.
      do
         group%path = case_group(size(plan%cases) + 1, huge(1))
         if (.not. group%file%has(group%path)) exit
         call group%read('n_samples', case%n_samples)
         call group%read('process', process)
         if (allocated(group%error)) return
         case%process = 0
         if (process /= 'none') read (process(2:), *) case%process
         if (case%process > 0) then
            if (.not. group%has('psd')) plan%output%spectrum = .false.
         end if
         do i = 1, size(strengths)
            if (group%has_attribute(trim(strengths(i)))) exit
         end do
         call group%read(trim(strengths(min(i, size(strengths)))), case%strength)
         if (group%has_attribute('frequency')) call group%read('frequency', case%frequency)
         plan%cases = [plan%cases, case]
      end do
      group%path = case_group(max(1, findloc(plan%cases%process > 0, .true., dim=1)), huge(1))
      call group%get('percentile', plan%output%percentiles)
      call group%get('kept_dof', kept)
      if (allocated(kept)) plan%output%dofs = nint(kept)
      if (.not. group%has('frequency')) plan%output%spectrum = .false.
      if (.not. plan%output%spectrum) return
      deallocate (frequency)
      call group%get('frequency', frequency)
   end subroutine read_plan

   !> Finds the numbers of samples of the cases, then of their audits, in a results file. Reads the
   !> whole file; refuses one of another scene or program, and a damaged one.
   subroutine count_stored_samples(path, identity, n_samples, error)
      character(*), intent(in) :: path
      type(identity_type), intent(in) :: identity
      !> (cases, then their audits); unallocated if there is no file
      integer, allocatable, intent(out) :: n_samples(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_object) :: group
      integer, allocatable :: found(:)
      integer :: i, n, n_cases

      if (.not. exists(path)) return
      call open_results(path, file, error)
      if (allocated(error)) return
      call require_same(file, identity, advice, error)
      if (.not. allocated(error)) then
         call check_contents(file, error)
         if (allocated(error)) error%message = error%message//advice
      end if
      n_cases = 0
      do while (.not. allocated(error))
         if (.not. file%has(case_group(n_cases + 1, huge(1)))) exit
         n_cases = n_cases + 1
      end do
      allocate (found(0))
      do i = 1, 2*n_cases
         n = 0
         group%file = file
         group%path = case_group(i, n_cases)
         if (file%has(group%path)) call group%read('n_samples', n)
         call group%take_error(error)
         if (allocated(error)) exit
         found = [found, n]
      end do
      call file%abandon()
      if (.not. allocated(error)) call move_alloc(found, n_samples)
   end subroutine count_stored_samples

   !> True if every solved process of a results file has so many realizations of so many points.
   !> False with an error.
   logical function has_realizations(path, n_points, n_realizations) result(has_all)
      character(*), intent(in) :: path
      integer, intent(in) :: n_points, n_realizations
      type(error_type), allocatable :: error
      type(hdf5_group) :: group
      character(:), allocatable :: law, status
      integer(long), allocatable :: extents(:)
      integer :: i

      call open_hdf5(path, group%file, error)
      has_all = .not. allocated(error)
      i = 1
      do while (has_all)
         group%path = '/process/'//numbered('p', i)
         if (.not. group%file%has(group%path)) exit
         call group%read('status', status)
         i = i + 1
         if (status /= 'solved') cycle
         call group%read('law', law)
         if (law == 'given values') cycle   ! no law to draw from
         has_all = group%has('realizations')
         if (has_all) call group%read_shape('realizations', extents, 2)
         if (has_all) has_all = all(extents == [n_points, n_realizations])
      end do
      has_all = has_all .and. .not. allocated(group%error)
      call group%file%abandon()
   end function has_realizations

   !> Ranges of samples of a results file, except those that shards have whole.
   function stored_in_results(n_samples, together, shards) result(stored)
      integer, intent(in) :: n_samples(:)   !! (cases, then their audits), see count_stored_samples
      integer, intent(in) :: together       !! largest number of samples in a range
      type(shard_type), intent(in) :: shards(:)
      type(shard_type), allocatable :: stored(:)
      logical, allocatable :: has_shard(:, :)   ! (sample, cases and audits)
      integer :: c, first, last, n

      has_shard = finished_samples(shards, n_samples)
      allocate (stored(sum((n_samples + together - 1)/together)))
      n = 0
      do c = 1, size(n_samples)
         do first = 1, n_samples(c), together
            last = min(first + together - 1, n_samples(c))
            if (all(has_shard(first:last, c))) cycle
            n = n + 1
            stored(n) = shard_type(c, first, last, case_group(c, size(n_samples)/2), first - 1)
         end do
      end do
      stored = stored(:n)
   end function stored_in_results

   !> Reads the stated errors of all cases of a file.
   subroutine read_errors(path, n_cases, errors, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_cases
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_group) :: group

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      group%file = file
      call read_cases(group, n_cases, errors)
      call group%take_error(error)
      call file%abandon()
   end subroutine read_errors

   !> Reads the stated errors of all cases.
   subroutine read_cases(group, n_cases, errors)
      type(hdf5_group), intent(inout) :: group   !! of an open file; its path is changed
      integer, intent(in) :: n_cases
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      integer :: i

      allocate (errors(n_cases))
      do i = 1, n_cases
         call read_case(group, i, n_cases, errors(i))
      end do
   end subroutine read_cases

   !> Reads the statistics of a case and their estimator, and the numerical errors that its audit
   !> found.
   subroutine read_case(group, number, n_cases, errors)
      type(hdf5_group), intent(inout) :: group
      integer, intent(in) :: number, n_cases
      type(case_errors), intent(inout) :: errors
      real(wp), allocatable :: is_steady(:), mean(:), mean_error(:), ratio(:)
      real(wp), allocatable :: ratio_error(:), slip_error(:)

      group%path = case_group(number, n_cases)
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
      group%path = case_group(number + n_cases, n_cases)
      if (.not. group%file%has(group%path)) return
      call group%read('n_samples', errors%n_audited)
      call group%read('slip_points', errors%slip_points)
      if (group%has('band_ratio_difference')) call group%read('band_ratio', errors%band_ratio)
      call group%get('slip_rms_difference_error', slip_error)
      call group%get('band_ratio_difference_error', ratio_error)
      if (allocated(slip_error)) errors%slip_points_error = maxval(slip_error)
      if (allocated(ratio_error)) errors%band_ratio_error = maxval(ratio_error)
   end subroutine read_case

end module io_earlier_results
