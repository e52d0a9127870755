!> Errors of the cases as a results file states them: targets are judged by what was written.
module io_error_results
   use campaign_results, only: case_statistics, of_slip
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
   subroutine read_errors(path, n_cases, errors, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_cases
      type(case_errors), allocatable, intent(out) :: errors(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer :: i

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      allocate (errors(n_cases))
      do i = 1, n_cases
         call read_case(file, case_group(i, n_cases), errors(i), error)
         if (.not. allocated(error)) &
            call read_audit(file, case_group(i + n_cases, n_cases), errors(i), error)
         if (allocated(error)) exit
      end do
      call file%abandon()
   end subroutine read_errors

   !> Reads what the statistics say of a case, and by what they were made.
   subroutine read_case(file, group, errors, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(case_errors), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: is_steady(:)

      associate (statistics => errors%statistics)
         call read_attribute(file, group, 'n_samples', statistics%n_samples, error)
         call read_row(file, group//'/slip_mean_error', statistics%numbers(of_slip)%mean_error, &
                       error)
         call read_row(file, group//'/slip_mean_time_error', statistics%slip_mean_time_error, error)
         call read_row(file, group//'/slip_std_time_part', statistics%slip_std_time_part, error)
      end associate
      call read_row(file, group//'/error_ratio/slip_mean', errors%ratio, error)
      call read_row(file, group//'/percentile', errors%percentiles, error)
      call read_row(file, group//'/steady', is_steady, error)
      if (allocated(error)) return
      if (.not. allocated(errors%ratio)) then
         allocate (errors%ratio(0))
         associate (slip => errors%statistics%numbers(of_slip))
            if (allocated(slip%mean_error)) errors%ratio = 0.0_wp*slip%mean_error + 1.0_wp
         end associate
      end if
      if (.not. allocated(errors%percentiles)) allocate (errors%percentiles(0))
      if (allocated(is_steady)) errors%n_unsteady = count(.not. is_steady > 0.0_wp)
      errors%estimator = ''
      if (has_attribute(file, group, 'estimator')) &
         call read_attribute(file, group, 'estimator', errors%estimator, error)
   end subroutine read_case

   !> Reads the errors that the audit of a case found; standard errors are zero where all samples
   !> of the case were audited.
   subroutine read_audit(file, group, errors, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(case_errors), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: slip(:), ratio(:)

      if (.not. file%has(group)) return
      call read_attribute(file, group, 'n_samples', errors%n_audited, error)
      if (.not. allocated(error)) &
         call read_attribute(file, group, 'slip_points', errors%slip_points, error)
      if (allocated(error)) return
      if (file%has(group//'/band_ratio_difference')) &
         call read_attribute(file, group, 'band_ratio', errors%band_ratio, error)
      call read_row(file, group//'/slip_rms_difference_error', slip, error)
      call read_row(file, group//'/band_ratio_difference_error', ratio, error)
      if (allocated(error)) return
      if (allocated(slip)) errors%slip_points_error = maxval(slip)
      if (allocated(ratio)) errors%band_ratio_error = maxval(ratio)
   end subroutine read_audit

   !> Reads a dataset of one axis, where it exists; does nothing after an error.
   subroutine read_row(file, path, values, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      real(wp), allocatable, intent(out) :: values(:)
      type(error_type), allocatable, intent(inout) :: error
      integer(long), allocatable :: n(:)

      if (allocated(error)) return
      if (.not. file%has(path)) return
      call read_extent(file, path, 1, n, error)
      if (allocated(error)) return
      allocate (values(n(1)))
      call read_dataset(file, path, values, error)
   end subroutine read_row

end module io_error_results
