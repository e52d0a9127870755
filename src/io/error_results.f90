!> Errors of the cases as a results file states them: targets are judged by what was written.
module io_error_results
   use campaign_results, only: case_statistics, of_slip
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_group, only: group_of, group_type
   use io_hdf5, only: hdf5_file, open_hdf5
   use io_results, only: case_group
   implicit none(type, external)
   private
   public :: case_errors, read_errors

   !> Errors of one case. The statistics hold only errors of slip fractions, where they are known.
   type :: case_errors
      type(case_statistics) :: statistics
      character(:), allocatable :: estimator   !! of the statistics; empty without statistics
      real(wp), allocatable :: ratio(:)        !! (joint) plain sampling's errors over them
      real(wp), allocatable :: percentiles(:)  !! [%] of the statistics; empty without statistics
      integer :: n_audited = 0
      integer :: n_unsteady = -1         !! samples under a sine that are not steady; -1: no sine
      real(wp) :: slip_points = 0.0_wp   !! numerical error found by the audit [points]
      real(wp) :: band_ratio = 0.0_wp    !! the same, relative
      !> largest standard errors of both over the dofs, as only a share of the samples was audited
      real(wp) :: slip_points_error = 0.0_wp, band_ratio_error = 0.0_wp
   end type case_errors

contains

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
      real(wp), allocatable :: is_steady(:)

      associate (statistics => errors%statistics, slip => errors%statistics%numbers(of_slip))
         call group%read('n_samples', statistics%n_samples)
         call group%get('slip_mean_error', slip%mean_error)
         call group%get('slip_mean_time_error', statistics%slip_mean_time_error)
         call group%get('slip_std_time_part', statistics%slip_std_time_part)
         call group%get('error_ratio/slip_mean', errors%ratio)
         call group%get('percentile', errors%percentiles)
         call group%get('steady', is_steady)
         errors%estimator = ''
         if (group%has_attribute('estimator')) call group%read('estimator', errors%estimator)
         if (.not. allocated(errors%ratio)) then
            allocate (errors%ratio(0))
            if (allocated(slip%mean_error)) errors%ratio = 0.0_wp*slip%mean_error + 1.0_wp
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

end module io_error_results
