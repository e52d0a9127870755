!> Types of the results of samples, of the statistics of a case, and of its best estimates (those of
!> a regression, or plain ones). Index orders are Fortran's; Python reads results files with them
!> reversed.
module campaign_results
   use core_kinds, only: long, wp
   use dynamics_response, only: transition_list
   use statistics_estimates, only: statistic_type, student_factor, upward_error
   implicit none(type, external)
   private
   public :: block_result, case_estimates, case_statistics, memory_of_block, numbers_of, &
             spectrum_layout

   !> Quantities of a joint with statistics: slip fraction, slip distance, dissipation.
   integer, parameter, public :: n_quantities = 3

   !> Layout of the spectra of all samples of a campaign.
   type :: spectrum_layout
      integer :: every = 1                      !! steps between the values that are used
      integer :: segment_length = 0             !! number of used values of a segment
      integer :: overlap = 0                    !! number of values that neighbouring segments share
      integer :: n_segments = 0
      real(wp), allocatable :: frequency(:)     !! (frequency) [Hz], 0 to the kept Nyquist frequency
      logical :: follows_power = .false.        !! samples have a power_series
   end type spectrum_layout

   !> Results of consecutive samples of one case; a result that is not kept is not allocated.
   type :: block_result
      integer :: case_number = 0
      integer :: first_sample = 0
      integer :: n_samples = 0
      integer :: before = 0   !! number of samples of other cases before these in the arrays
      real(wp), allocatable :: friction(:, :)            !! (joint, sample) mu
      real(wp), allocatable :: slip_fraction(:, :)       !! (joint, sample) fraction of the time
      real(wp), allocatable :: slip_fraction_error(:, :)   !! (joint, sample) time-average error
      real(wp), allocatable :: slip_series(:, :, :)      !! (joint, span, sample) slip fractions
      real(wp), allocatable :: slip_starts(:, :)         !! (joint, sample) number of transitions
      real(wp), allocatable :: stick_starts(:, :)        !! (joint, sample) number of transitions
      real(wp), allocatable :: slip_distance(:, :)       !! (joint, sample) [m]
      real(wp), allocatable :: dissipation(:, :)         !! (joint, sample) mu N slip_distance [J]
      !> (joint, sample) largest |w_j.x| at the steps that enter the spectra [m]
      real(wp), allocatable :: joint_displacement_max(:, :)
      real(wp), allocatable :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) mean square displacement [m^2] in each batch of the march,
      !> within each range of frequencies of last_of_ranges; the batches of a range are neighbours
      real(wp), allocatable :: power_series(:, :, :)
      !> (dof, sample) fundamental under a sine [m], and its phase against the force [rad]
      real(wp), allocatable :: harmonic_amplitude(:, :), harmonic_phase(:, :)
      real(wp), allocatable :: steady_since(:)   !! (sample) [s]; not a number: not steady
      real(wp), allocatable :: steady(:)         !! (sample) 1: steady at the end
      !> (sample) [J]
      real(wp), allocatable :: energy_input(:), energy_viscous(:), energy_friction(:)
      real(wp), allocatable :: energy_stored(:), energy_defect(:)
      real(wp), allocatable :: displacement(:, :, :)     !! (dof, 0:n_steps, sample) [m]
      real(wp), allocatable :: velocity(:, :, :)         !! (dof, 0:n_steps, sample) [m/s]
      type(transition_list), allocatable :: transitions(:)   !! (sample)
   end type block_result

   !> Statistics over the samples of one case: the mean, then the percentiles.
   type :: case_statistics
      integer :: n_samples = 0, n_joints = 0
      !> (number as in numbers_of, statistic), the standard deviation last
      type(statistic_type), allocatable :: numbers(:, :)
      type(statistic_type), allocatable :: psd(:, :, :)   !! (dof, frequency, statistic) [m^2/Hz]
      !> (dof, statistic) integrals of psd over frequency, Eq. (46) [m^2]; the band ratio last, that
      !> of the last percentile to the first
      type(statistic_type), allocatable :: pseudo_variances(:, :)
      !> (dof, frequency) Student's degrees of freedom of the mean of psd
      real(wp), allocatable :: psd_mean_freedoms(:, :)
      real(wp), allocatable :: band_ratio_bias(:)         !! (dof) relative bias of plain sampling
      !> time-average errors of the mean slip fractions (joint) and, if all samples have one record,
      !> of pseudo_variances (dof, statistic)
      real(wp), allocatable :: slip_mean_time_error(:), pseudo_variance_time_error(:, :)
      !> (joint) standard deviation of slip fractions that is due to their time-average errors
      real(wp), allocatable :: slip_std_time_part(:)
   end type case_statistics

   !> Best estimates of one case, with their estimator.
   type :: case_estimates
      character(12) :: estimator = 'plain'      !! 'pooled', 'regression' or 'plain'
      character(:), allocatable :: reason       !! reason for plain estimates; '' for others
      integer, allocatable :: pooled_with(:)    !! other cases whose samples are used
      type(case_statistics) :: best
      integer, allocatable :: friction_points(:)   !! points of the process with sensitivities
      !> (friction point, joint) shares of the variance of the slip fraction
      type(statistic_type), allocatable :: sensitivity(:, :)
   contains
      procedure :: start
      procedure :: store_spectrum
   end type case_estimates

contains

   !> Memory of the results whose size depends on the number of steps [byte].
   elemental integer(long) function memory_of_block(block) result(bytes)
      type(block_result), intent(in) :: block
      integer(long), parameter :: real_bytes = 8, transition_bytes = 16   ! time, joint, kind

      bytes = real_bytes*(values_of(block%slip_series) + values_of(block%psd) &
                          + values_of(block%power_series) + values_of(block%displacement) &
                          + values_of(block%velocity))
      if (allocated(block%transitions)) bytes = bytes + transition_bytes*sum(block%transitions%n)
   end function memory_of_block

   !> Number of values; 0 for a result that is not kept.
   pure integer(long) function values_of(values)
      real(wp), intent(in), optional :: values(:, :, :)

      values_of = 0
      if (present(values)) values_of = size(values, kind=long)
   end function values_of

   !> Numbers of the samples that have statistics: of the joints slip fractions, slip distances [m]
   !> and dissipations [J], then of the dofs amplitudes [m].
   pure function numbers_of(samples) result(values)
      type(block_result), intent(in) :: samples
      real(wp), allocatable :: values(:, :)   !! (number, sample)
      integer :: n_dof

      n_dof = 0   ! number of dofs with an amplitude
      if (allocated(samples%harmonic_amplitude)) n_dof = size(samples%harmonic_amplitude, 1)
      associate (n => size(samples%slip_fraction, 1))
         allocate (values(n_quantities*n + n_dof, samples%n_samples))
         values(:n, :) = samples%slip_fraction
         values(n + 1:2*n, :) = samples%slip_distance
         values(2*n + 1:n_quantities*n, :) = samples%dissipation
         if (n_dof > 0) values(n_quantities*n + 1:, :) = samples%harmonic_amplitude
      end associate
   end function numbers_of

   !> Replaces plain estimates by zeros, to which the ranks add the estimates of a regression.
   pure subroutine start(self, friction_points)
      class(case_estimates), intent(inout) :: self   !! statistics with plain estimates
      integer, intent(in) :: friction_points(:)    !! points of the process, ascending
      type(statistic_type), parameter :: nothing = statistic_type(ratio=0.0_wp)

      self%friction_points = friction_points
      allocate (self%sensitivity(size(friction_points), self%best%n_joints), source=nothing)
      self%best%numbers = nothing
      if (.not. allocated(self%best%psd)) return
      deallocate (self%best%band_ratio_bias)
      self%best%psd = nothing
      self%best%pseudo_variances = nothing
   end subroutine start

   !> Stores the estimates of the spectra of a dof. At higher frequencies, which have no power, it
   !> stores the plain ones.
   pure subroutine store_spectrum(self, dof, plain, spectrum, integrals)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: dof
      type(case_statistics), intent(in) :: plain
      type(statistic_type), intent(in) :: spectrum(:, :)   !! (frequency, statistic)
      type(statistic_type), intent(in) :: integrals(:)     !! (statistic)
      integer :: n

      n = size(spectrum, 1)
      self%best%pseudo_variances(dof, :) = integrals
      self%best%psd(dof, :n, :) = spectrum
      self%best%psd(dof, n + 1:, :) = plain%psd(dof, n + 1:, :)
      associate (mean => self%best%psd(dof, n + 1:, 1))
         mean%error = upward_error(mean%value, mean%error &
                                   *student_factor(plain%psd_mean_freedoms(dof, n + 1:)))
      end associate
   end subroutine store_spectrum

end module campaign_results
