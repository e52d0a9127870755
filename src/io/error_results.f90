!> Errors of the cases as a results file states them: targets are judged by what was written.
module io_error_results
   use campaign_results, only: case_statistics
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_case_results, only: case_group
   use io_hdf5, only: has_attribute, hdf5_file, open_hdf5, read_attribute, read_dataset, read_extent
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
   subroutine read_errors(path, n_cases, n_joints, errors, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_cases, n_joints
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer :: i

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      allocate (errors(n_cases))
      do i = 1, n_cases
         call read_statistics(file, case_group(i, n_cases), n_joints, errors(i)%statistics, error)
         if (.not. allocated(error)) call read_estimator(file, case_group(i, n_cases), n_joints, &
                                                         errors(i), error)
         if (.not. allocated(error)) &
            call read_steady(file, case_group(i, n_cases), errors(i), error)
         if (.not. allocated(error)) &
            call read_audit(file, case_group(i + n_cases, n_cases), errors(i), error)
         if (allocated(error)) exit
      end do
      call file%abandon()
   end subroutine read_errors

   subroutine read_statistics(file, group, n_joints, statistics, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      integer, intent(in) :: n_joints
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(out) :: error

      call read_attribute(file, group, 'n_samples', statistics%n_samples, error)
      if (allocated(error)) return
      if (file%has(group//'/slip_mean_error')) then
         allocate (statistics%slip%mean_error(n_joints))
         call read_dataset(file, group//'/slip_mean_error', statistics%slip%mean_error, error)
      end if
      if (allocated(error)) return
      if (.not. file%has(group//'/slip_mean_time_error')) return
      allocate (statistics%slip_mean_time_error(n_joints))
      call read_dataset(file, group//'/slip_mean_time_error', statistics%slip_mean_time_error, &
                        error)
      if (allocated(error)) return
      if (.not. file%has(group//'/slip_std_time_part')) return
      allocate (statistics%slip_std_time_part(n_joints))
      call read_dataset(file, group//'/slip_std_time_part', statistics%slip_std_time_part, error)
   end subroutine read_statistics

   !> By what the statistics were made: estimator and percentiles.
   subroutine read_estimator(file, group, n_joints, errors, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      integer, intent(in) :: n_joints
      type(case_errors), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      integer(long), allocatable :: n(:)

      errors%estimator = ''
      allocate (errors%ratio(n_joints), source=1.0_wp)
      if (has_attribute(file, group, 'estimator')) &
         call read_attribute(file, group, 'estimator', errors%estimator, error)
      if (allocated(error)) return
      if (file%has(group//'/error_ratio')) &
         call read_dataset(file, group//'/error_ratio/slip_mean', errors%ratio, error)
      if (allocated(error)) return
      n = [0_long]
      if (file%has(group//'/percentile')) &
         call read_extent(file, group//'/percentile', 1, n, error)
      if (allocated(error)) return
      allocate (errors%percentiles(n(1)))
      if (n(1) > 0) call read_dataset(file, group//'/percentile', errors%percentiles, error)
   end subroutine read_estimator

   subroutine read_steady(file, group, errors, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(case_errors), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      integer :: steady(errors%statistics%n_samples)

      if (.not. file%has(group//'/steady')) return
      call read_dataset(file, group//'/steady', steady, error)
      if (.not. allocated(error)) errors%n_unsteady = count(steady == 0)
   end subroutine read_steady

   subroutine read_audit(file, group, errors, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(case_errors), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error

      if (.not. file%has(group)) return
      call read_attribute(file, group, 'n_samples', errors%n_audited, error)
      if (.not. allocated(error)) &
         call read_attribute(file, group, 'slip_points', errors%slip_points, error)
      if (.not. allocated(error)) &
         call read_largest('slip_rms_difference_error', errors%slip_points_error)
      if (allocated(error)) return
      if (.not. file%has(group//'/band_ratio_difference')) return
      call read_attribute(file, group, 'band_ratio', errors%band_ratio, error)
      if (.not. allocated(error)) &
         call read_largest('band_ratio_difference_error', errors%band_ratio_error)

   contains

      !> Zero where the dataset is not there: all samples of the case were audited.
      subroutine read_largest(name, largest)
         character(*), intent(in) :: name
         real(wp), intent(inout) :: largest
         real(wp), allocatable :: values(:)
         integer(long), allocatable :: n(:)   ! all dofs, or those whose spectra are kept

         if (.not. file%has(group//'/'//name)) return
         call read_extent(file, group//'/'//name, 1, n, error)
         if (allocated(error)) return
         allocate (values(n(1)))
         call read_dataset(file, group//'/'//name, values, error)
         if (.not. allocated(error)) largest = maxval(values)
      end subroutine read_largest

   end subroutine read_audit

end module io_error_results
