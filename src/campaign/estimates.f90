!> The best estimates of a case: those of a regression where there is one, else plain sampling's.
module campaign_estimates
   use campaign_results, only: case_statistics, joint_statistics, of_slip
   use core_kinds, only: wp
   use statistics_scalars, only: scalar_type
   use statistics_spectra, only: spectrum_type
   implicit none(type, external)
   private
   public :: case_estimates

   !> Estimates of one case with how they came about.
   type :: case_estimates
      character(12) :: estimator = 'plain'      !! 'pooled', 'regression' or 'plain'
      character(:), allocatable :: reason       !! why plain; empty: it is not
      integer, allocatable :: pooled_with(:)    !! the other cases whose samples were used
      type(case_statistics) :: best
      !> standard errors of plain sampling over those of the estimates, by their names
      type(case_statistics) :: error_ratio
      integer, allocatable :: friction_points(:)         !! of the process, of the sensitivities
      real(wp), allocatable :: sensitivity(:, :)         !! (friction point, joint) of the variance
      real(wp), allocatable :: sensitivity_error(:, :)   !! (friction point, joint)
   contains
      procedure :: start
      procedure :: take_scalar
      procedure :: take_spectrum
      procedure :: take_plain
   end type case_estimates

contains

   !> Makes room for the estimates of a regression in the place of plain ones: zeros, so that ranks
   !> that take some each can add up all.
   pure subroutine start(self, plain, friction_points)
      class(case_estimates), intent(inout) :: self
      type(case_statistics), intent(in) :: plain   !! whose extents the estimates have
      integer, intent(in) :: friction_points(:)    !! of the process, ascending

      self%friction_points = friction_points
      allocate (self%sensitivity(size(friction_points), size(plain%numbers(of_slip)%mean)), &
                source=0.0_wp)
      allocate (self%sensitivity_error, source=self%sensitivity)
      associate (best => self%best, ratio => self%error_ratio)
         call start_numbers(plain%numbers, best%numbers, ratio%numbers)
         if (.not. allocated(plain%psd_mean)) return
         associate (n_dof => size(plain%psd_percentiles, 1), nf => size(plain%psd_percentiles, 2), &
                    np => size(plain%psd_percentiles, 3))
            allocate (ratio%psd_mean(n_dof, nf), ratio%psd_percentiles(n_dof, nf, np), &
                      ratio%pseudo_variance_mean(n_dof), ratio%band_ratio(n_dof), &
                      ratio%pseudo_variance_percentiles(n_dof, np), source=0.0_wp)
         end associate
         best%psd_mean = ratio%psd_mean
         best%psd_mean_error = ratio%psd_mean
         best%psd_percentiles = ratio%psd_percentiles
         best%psd_percentiles_low = ratio%psd_percentiles
         best%psd_percentiles_high = ratio%psd_percentiles
         best%pseudo_variance_mean = ratio%band_ratio
         best%pseudo_variance_mean_error = ratio%band_ratio
         best%pseudo_variance_percentiles = ratio%pseudo_variance_percentiles
         best%pseudo_variance_percentiles_error = ratio%pseudo_variance_percentiles
         best%band_ratio = ratio%band_ratio
         best%band_ratio_low = ratio%band_ratio
         best%band_ratio_high = ratio%band_ratio
      end associate
   end subroutine start

   elemental subroutine start_numbers(plain, best, ratio)
      type(joint_statistics), intent(in) :: plain
      type(joint_statistics), intent(inout) :: best, ratio

      if (.not. allocated(plain%mean)) return
      associate (n => size(plain%mean))
         allocate (ratio%mean(n), ratio%std(n), ratio%percentiles(n, size(plain%percentiles, 2)), &
                   source=0.0_wp)
      end associate
      best = ratio
      best%mean_error = ratio%mean
      best%std_error = ratio%mean
      best%low = ratio%percentiles
      best%high = ratio%percentiles
   end subroutine start_numbers

   !> Replaces the plain estimates of a number of a joint or dof.
   pure subroutine take_scalar(self, quantity, place, scalar)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: quantity   !! of_slip, of_distance, of_dissipation or of_amplitude
      integer, intent(in) :: place      !! joint or dof
      type(scalar_type), intent(in) :: scalar

      associate (best => self%best%numbers(quantity), ratio => self%error_ratio%numbers(quantity))
         best%mean(place) = scalar%mean
         best%mean_error(place) = scalar%mean_error
         best%std(place) = scalar%deviation
         best%std_error(place) = scalar%deviation_error
         best%percentiles(place, :) = scalar%percentile
         best%low(place, :) = scalar%low
         best%high(place, :) = scalar%high
         ratio%mean(place) = scalar%mean_ratio
         ratio%std(place) = scalar%deviation_ratio
         ratio%percentiles(place, :) = scalar%percentile_ratio
      end associate
      if (quantity /= of_slip) return
      self%sensitivity(:, place) = scalar%sensitivity
      self%sensitivity_error(:, place) = scalar%sensitivity_error
   end subroutine take_scalar

   !> Replaces the plain estimates of the spectra of a dof, as far as frequencies have power.
   pure subroutine take_spectrum(self, dof, spectrum)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: dof
      type(spectrum_type), intent(in) :: spectrum

      associate (best => self%best, ratio => self%error_ratio, n => size(spectrum%mean))
         best%psd_mean(dof, :n) = spectrum%mean
         best%psd_mean_error(dof, :n) = spectrum%mean_error
         best%psd_percentiles(dof, :n, :) = spectrum%percentile
         best%psd_percentiles_low(dof, :n, :) = spectrum%low
         best%psd_percentiles_high(dof, :n, :) = spectrum%high
         best%pseudo_variance_mean(dof) = spectrum%variance_mean
         best%pseudo_variance_mean_error(dof) = spectrum%variance_mean_error
         best%pseudo_variance_percentiles(dof, :) = spectrum%variance
         best%pseudo_variance_percentiles_error(dof, :) = spectrum%variance_error
         best%band_ratio(dof) = spectrum%ratio
         best%band_ratio_low(dof) = spectrum%ratio_low
         best%band_ratio_high(dof) = spectrum%ratio_high
         ratio%psd_mean(dof, :n) = spectrum%mean_ratio
         ratio%psd_percentiles(dof, :n, :) = spectrum%percentile_ratio
         ratio%pseudo_variance_mean(dof) = spectrum%variance_mean_ratio
         ratio%pseudo_variance_percentiles(dof, :) = spectrum%variance_ratio
         ratio%band_ratio(dof) = spectrum%ratio_ratio
      end associate
   end subroutine take_spectrum

   !> Takes plain sampling's estimates of densities at the frequencies that no rank has taken.
   pure subroutine take_plain(self, plain)
      class(case_estimates), intent(inout) :: self
      type(case_statistics), intent(in) :: plain

      if (.not. allocated(plain%psd_mean)) return
      associate (best => self%best, ratio => self%error_ratio)
         where (.not. ratio%psd_mean > 0.0_wp)
            best%psd_mean = plain%psd_mean
            best%psd_mean_error = plain%psd_mean_error
            ratio%psd_mean = 1.0_wp
         end where
         where (.not. ratio%psd_percentiles > 0.0_wp)
            best%psd_percentiles = plain%psd_percentiles
            best%psd_percentiles_low = plain%psd_percentiles_low
            best%psd_percentiles_high = plain%psd_percentiles_high
            ratio%psd_percentiles = 1.0_wp
         end where
      end associate
   end subroutine take_plain

end module campaign_estimates
