!> Results of samples, and statistics of a case. Index orders are Fortran's; the results file, read
!> from Python, has them reversed.
module campaign_results
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use core_kinds, only: long, wp
   use dynamics_response, only: transition_list
   implicit none(type, external)
   private
   public :: block_result, case_statistics, joint_statistics, memory_of_block, spectrum_layout, &
             list_statistics, list_time_errors, listed_statistic, numbers_of

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
      integer :: before = 0   !! samples of other cases in the arrays, marched with these
      real(wp), allocatable :: friction(:, :)            !! (joint, sample) mu
      real(wp), allocatable :: slip_fraction(:, :)       !! (joint, sample) of the time
      real(wp), allocatable :: slip_fraction_error(:, :)   !! (joint, sample) of a finite march
      real(wp), allocatable :: slip_series(:, :, :)      !! (joint, span, sample) of a span's time
      real(wp), allocatable :: slip_starts(:, :)         !! (joint, sample) transitions, counted
      real(wp), allocatable :: stick_starts(:, :)        !! (joint, sample)
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
      real(wp), allocatable :: steady(:)         !! (sample) 1: steady at the end
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
      real(wp), allocatable :: freedoms(:)                   !! (joint) Student's, of the mean
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
      real(wp), allocatable :: psd_mean_freedoms(:, :)            !! (dof, frequency) Student's
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

   !> A statistic, its values where a case_statistics has them.
   type :: listed_statistic
      character(40) :: name = ''
      character(8) :: units = ''
      character(32) :: axes = ''      !! Python's order; 'kept': of the dofs whose spectra are kept
      character(128) :: about = ''
      integer :: n_axes = 1
      real(wp), pointer, contiguous :: values(:, :, :) => null()   !! of extent 1 behind its axes
   end type listed_statistic

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

   !> Numbers of samples that have statistics, those of a quantity together: that of quantity q, of
   !> joint or dof i, is number i + (q - 1) n_joints.
   pure function numbers_of(samples) result(values)
      type(block_result), intent(in) :: samples
      real(wp), allocatable :: values(:, :)   !! (number, sample)
      integer :: n_dof

      n_dof = 0   ! with an amplitude
      if (allocated(samples%harmonic_amplitude)) n_dof = size(samples%harmonic_amplitude, 1)
      associate (n => size(samples%slip_fraction, 1))
         allocate (values(n_quantities*n + n_dof, samples%n_samples))
         values((of_slip - 1)*n + 1:of_slip*n, :) = samples%slip_fraction
         values((of_distance - 1)*n + 1:of_distance*n, :) = samples%slip_distance
         values((of_dissipation - 1)*n + 1:of_dissipation*n, :) = samples%dissipation
         if (n_dof > 0) values(n_quantities*n + 1:, :) = samples%harmonic_amplitude
      end associate
   end function numbers_of

   !> Lists what the samples of a case tell of all: quantities of joints, amplitudes, bands; each
   !> statistic that is there, as it is said once.
   function list_statistics(statistics) result(list)
      type(case_statistics), intent(in), target :: statistics
      type(listed_statistic), allocatable :: list(:)
      character(*), parameter :: by_dof = 'kept', by_percentile = 'percentile kept', &
                                 by_frequency = 'frequency kept', &
                                 by_both = 'percentile frequency kept'

      allocate (list(0))
      associate (s => statistics)
         call add_numbers('slip', '1', 'slip_fraction', 'joint', s%numbers(of_slip))
         call add_numbers('slip_distance', 'm', 'slip_distance', 'joint', &
                          s%numbers(of_distance))
         call add_numbers('dissipation', 'J', 'dissipation', 'joint', s%numbers(of_dissipation))
         call add_numbers('harmonic_amplitude', 'm', 'harmonic_amplitude', 'dof', &
                          s%numbers(of_amplitude))
         call add(list, 'psd_mean', 'm^2/Hz', by_frequency, 'mean of psd', s%psd_mean)
         call add(list, 'psd_mean_error', 'm^2/Hz', by_frequency, 'standard error of psd_mean', &
                  s%psd_mean_error)
         call add(list, 'psd_percentiles', 'm^2/Hz', by_both, 'percentiles of psd', &
                  s%psd_percentiles)
         call add(list, 'psd_percentiles_low', 'm^2/Hz', by_both, &
                  'lower end of the 95 % interval', s%psd_percentiles_low)
         call add(list, 'psd_percentiles_high', 'm^2/Hz', by_both, &
                  'upper end of the 95 % interval', s%psd_percentiles_high)
         call add(list, 'pseudo_variance_mean', 'm^2', by_dof, &
                  'integral of psd_mean over frequency, Eq. (46)', s%pseudo_variance_mean)
         call add(list, 'pseudo_variance_mean_error', 'm^2', by_dof, &
                  'standard error of pseudo_variance_mean', s%pseudo_variance_mean_error)
         call add(list, 'pseudo_variance_percentiles', 'm^2', by_percentile, &
                  'integral of each percentile, Eq. (46)', s%pseudo_variance_percentiles)
         call add(list, 'pseudo_variance_percentiles_error', 'm^2', by_percentile, &
                  'standard error of pseudo_variance_percentiles', &
                  s%pseudo_variance_percentiles_error)
         call add(list, 'band_ratio', '1', by_dof, &
                  'pseudo-variance of the last over the first percentile', s%band_ratio)
         call add(list, 'band_ratio_low', '1', by_dof, &
                  'lower end of the 95 % interval of band_ratio', s%band_ratio_low)
         call add(list, 'band_ratio_high', '1', by_dof, &
                  'upper end of the 95 % interval of band_ratio', s%band_ratio_high)
         call add(list, 'band_ratio_bias', '1', by_dof, &
                  'relative bias of band_ratio, by bootstrap', s%band_ratio_bias)
      end associate

   contains

      !> Adds the statistics of a quantity of the joints or dofs with their errors.
      subroutine add_numbers(name, units, quantity, axis, of)
         character(*), intent(in) :: name, units
         character(*), intent(in) :: quantity   !! dataset of the samples
         character(*), intent(in) :: axis       !! 'joint' or 'dof'
         type(joint_statistics), intent(in) :: of

         call add(list, name//'_mean', units, axis, 'mean of '//quantity, of%mean)
         call add(list, name//'_mean_error', units, axis, 'standard error of '//name//'_mean', &
                  of%mean_error)
         call add(list, name//'_std', units, axis, 'standard deviation of '//quantity, of%std)
         call add(list, name//'_std_error', units, axis, 'standard error of '//name//'_std', &
                  of%std_error)
         call add(list, name//'_percentiles', units, 'percentile '//axis, &
                  'percentiles of '//quantity, of%percentiles)
         call add(list, name//'_percentiles_low', units, 'percentile '//axis, &
                  'lower end of the 95 % interval', of%low)
         call add(list, name//'_percentiles_high', units, 'percentile '//axis, &
                  'upper end of the 95 % interval', of%high)
      end subroutine add_numbers

   end function list_statistics

   !> Lists the errors that the finite length of the march adds, whatever the estimator.
   function list_time_errors(statistics) result(list)
      type(case_statistics), intent(in), target :: statistics
      type(listed_statistic), allocatable :: list(:)
      character(*), parameter :: of_time = 'time-average error, the same for any number of '// &
                                 'samples, of '

      allocate (list(0))
      associate (s => statistics)
         call add(list, 'slip_mean_time_error', '1', 'joint', &
                  of_time//'slip_mean', s%slip_mean_time_error)
         call add(list, 'slip_std_time_part', '1', 'joint', &
                  'part of slip_std that the time average adds', s%slip_std_time_part)
         call add(list, 'pseudo_variance_mean_time_error', 'm^2', 'kept', &
                  of_time//'pseudo_variance_mean', &
                  s%pseudo_variance_mean_time_error)
         call add(list, 'pseudo_variance_percentiles_time_error', 'm^2', 'percentile kept', &
                  of_time//'pseudo_variance_percentiles', &
                  s%pseudo_variance_percentiles_time_error)
         call add(list, 'band_ratio_time_error', '1', 'kept', &
                  of_time//'band_ratio', s%band_ratio_time_error)
      end associate
   end function list_time_errors

   !> Adds a statistic to a list, where it is there.
   subroutine add(list, name, units, axes, about, values)
      type(listed_statistic), allocatable, intent(inout) :: list(:)
      character(*), intent(in) :: name, units, axes, about
      real(wp), intent(in), allocatable, target :: values(..)
      type(listed_statistic) :: one

      if (.not. allocated(values)) return
      one = listed_statistic(name, units, axes, about, rank(values))
      call c_f_pointer(c_loc(values), one%values, [shape(values), spread(1, 1, 3 - rank(values))])
      list = [list, one]
   end subroutine add

end module campaign_results
