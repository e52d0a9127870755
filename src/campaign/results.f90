!> Results of samples, and statistics of a case. Index orders are Fortran's; the results file, read
!> from Python, has them reversed.
module campaign_results
   use core_kinds, only: long, wp
   use dynamics_response, only: transition_list
   implicit none(type, external)
   private
   public :: block_result, case_statistics, joint_statistics, memory_of_block, spectrum_layout

   !> Numbers of a sample that have statistics: of its joints, and of its dofs under a sine.
   integer, parameter, public :: of_slip = 1, of_distance = 2, of_dissipation = 3, of_amplitude = 4
   integer, parameter, public :: n_quantities = 3   !! of a joint: the first ones

   !> How spectra were formed; the same for every sample of a campaign.
   type :: spectrum_layout
      integer :: every = 1                      !! every k-th step was used
      integer :: segment_length = 0             !! values of a segment, after thinning
      integer :: overlap = 0                    !! values shared by neighbouring segments
      integer :: n_segments = 0
      real(wp), allocatable :: frequency(:)     !! (frequency) [Hz], 0 to the kept Nyquist
      logical :: follows_power = .false.        !! as block_result%power_series has it
   end type spectrum_layout

   !> Results of consecutive samples of one case; what was not asked for is not allocated.
   type :: block_result
      integer :: case_number = 0
      integer :: first_sample = 0
      integer :: n_samples = 0
      real(wp), allocatable :: friction(:, :)            !! (joint, sample) mu
      real(wp), allocatable :: slip_fraction(:, :)       !! (joint, sample) of the time
      real(wp), allocatable :: slip_fraction_error(:, :)   !! (joint, sample) of a finite march
      real(wp), allocatable :: slip_series(:, :, :)      !! (joint, span, sample) of a span's time
      integer(long), allocatable :: slip_starts(:, :)    !! (joint, sample)
      integer(long), allocatable :: stick_starts(:, :)   !! (joint, sample)
      real(wp), allocatable :: slip_distance(:, :)       !! (joint, sample) [m]
      real(wp), allocatable :: dissipation(:, :)         !! (joint, sample) mu N times it [J]
      !> (joint, sample) largest abs(w_j.x) at the steps that enter the spectra [m]
      real(wp), allocatable :: joint_displacement_max(:, :)
      real(wp), allocatable :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) mean square [m^2] in consecutive batches of the march,
      !> within the ranges of frequencies of last_of_ranges; those of a range together
      real(wp), allocatable :: power_series(:, :, :)
      !> (dof, sample) fundamental under a sine [m], and its phase against the force [rad]
      real(wp), allocatable :: harmonic_amplitude(:, :), harmonic_phase(:, :)
      real(wp), allocatable :: steady_since(:)   !! (sample) [s]; not a number: not steady
      integer, allocatable :: steady(:)          !! (sample) 1: steady at the end
      real(wp), allocatable :: energy_input(:), energy_viscous(:), energy_friction(:)   !! [J]
      real(wp), allocatable :: energy_stored(:), energy_defect(:)                       !! (sample)
      real(wp), allocatable :: displacement(:, :, :)     !! (dof, 0:n_steps, sample) [m]
      real(wp), allocatable :: velocity(:, :, :)         !! (dof, 0:n_steps, sample) [m/s]
      type(transition_list), allocatable :: transitions(:)   !! (sample)
   end type block_result

   !> Statistics of one number per sample and joint or dof, with standard errors and 95 % intervals.
   type :: joint_statistics
      real(wp), allocatable :: mean(:), std(:)               !! (joint)
      real(wp), allocatable :: mean_error(:), std_error(:)   !! (joint)
      real(wp), allocatable :: percentiles(:, :)             !! (joint, percentile)
      real(wp), allocatable :: low(:, :), high(:, :)         !! ends of the intervals
   end type joint_statistics

   !> Statistics over the samples of one case. Errors are standard errors, intervals are of 95 %.
   type :: case_statistics
      integer :: n_samples = 0
      !> of slip fractions, slip distances [m], dissipations [J]; of amplitudes [m] of dofs
      type(joint_statistics) :: numbers(of_slip:of_amplitude)
      !> (joint) of what the samples have in common, for a march of finite length
      real(wp), allocatable :: slip_mean_time_error(:)
      real(wp), allocatable :: slip_std_time_part(:)     !! (joint) standard deviation it adds
      real(wp), allocatable :: psd_mean(:, :)                     !! (dof, frequency) [m^2/Hz]
      real(wp), allocatable :: psd_mean_error(:, :)               !! (dof, frequency)
      real(wp), allocatable :: psd_percentiles(:, :, :)           !! (dof, frequency, percentile)
      real(wp), allocatable :: psd_percentiles_low(:, :, :)       !! lower end of the interval
      real(wp), allocatable :: psd_percentiles_high(:, :, :)      !! upper end
      real(wp), allocatable :: pseudo_variance_mean(:)            !! (dof), Eq. (46) [m^2]
      real(wp), allocatable :: pseudo_variance_mean_error(:)      !! (dof)
      real(wp), allocatable :: pseudo_variance_percentiles(:, :)  !! (dof, percentile) [m^2]
      real(wp), allocatable :: pseudo_variance_percentiles_error(:, :)
      !> for a march of finite length, under a record that the samples have in common
      real(wp), allocatable :: pseudo_variance_mean_time_error(:)
      real(wp), allocatable :: pseudo_variance_percentiles_time_error(:, :)
      real(wp), allocatable :: band_ratio(:)             !! (dof) last over first percentile
      real(wp), allocatable :: band_ratio_low(:), band_ratio_high(:)
      real(wp), allocatable :: band_ratio_bias(:)        !! relative, estimated by bootstrap
      real(wp), allocatable :: band_ratio_time_error(:)  !! (dof)
   end type case_statistics

contains

   !> Memory [byte] of what grows with the march.
   elemental function memory_of_block(block) result(bytes)
      type(block_result), intent(in) :: block
      integer(long) :: bytes
      integer(long), parameter :: of_real = 8, of_transition = 16   ! time, joint, kind

      bytes = of_real*(values_of(block%slip_series) + values_of(block%psd) &
                       + values_of(block%power_series) + values_of(block%displacement) &
                       + values_of(block%velocity))
      if (allocated(block%transitions)) bytes = bytes + of_transition*sum(block%transitions%n)
   end function memory_of_block

   !> Number of values; 0 of what was not asked for.
   pure integer(long) function values_of(values)
      real(wp), intent(in), optional :: values(:, :, :)

      values_of = 0
      if (present(values)) values_of = size(values, kind=long)
   end function values_of

end module campaign_results
