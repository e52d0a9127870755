!> The best estimates of a case: those of a regression where there is one, else plain sampling's.
module campaign_estimates
   use campaign_results, only: case_statistics, joint_statistics
   use core_kinds, only: wp
   use statistics_scalars, only: scalar_type
   use statistics_spectra, only: spectrum_type
   implicit none(type, external)
   private
   public :: case_estimates, n_quantities

   integer, parameter :: n_quantities = 3   !! of a joint: slip fraction, slip distance, dissipation

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
      procedure :: take_amplitude
      procedure :: take_spectrum
   end type case_estimates

contains

   !> Room for the estimates of a regression in the place of plain ones.
   pure subroutine start(self, friction_points)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: friction_points(:)   !! of the process, ascending

      associate (best => self%best, ratio => self%error_ratio)
         self%friction_points = friction_points
         allocate (self%sensitivity(size(friction_points), size(best%slip%mean)))
         allocate (self%sensitivity_error, mold=self%sensitivity)
         ratio%slip = without_errors(best%slip)
         ratio%slip_distance = without_errors(best%slip_distance)
         ratio%dissipation = without_errors(best%dissipation)
         ratio%harmonic_amplitude = without_errors(best%harmonic_amplitude)
         if (.not. allocated(best%psd_mean)) return
         ratio%psd_mean = best%psd_mean
         ratio%psd_percentiles = best%psd_percentiles
         ratio%pseudo_variance_mean = best%pseudo_variance_mean
         ratio%pseudo_variance_percentiles = best%pseudo_variance_percentiles
         ratio%band_ratio = best%band_ratio
      end associate
   end subroutine start

   pure function without_errors(statistics) result(estimates)
      type(joint_statistics), intent(in) :: statistics
      type(joint_statistics) :: estimates

      if (.not. allocated(statistics%mean)) return
      estimates%mean = statistics%mean
      estimates%std = statistics%std
      estimates%percentiles = statistics%percentiles
   end function without_errors

   !> A quantity of a joint.
   pure subroutine take_scalar(self, quantity, joint, scalar)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: quantity   !! 1: slip fraction, 2: slip distance, 3: dissipation
      integer, intent(in) :: joint
      type(scalar_type), intent(in) :: scalar

      associate (best => self%best, ratio => self%error_ratio)
         select case (quantity)
         case (1)
            call replace(joint, scalar, best%slip, ratio%slip)
            self%sensitivity(:, joint) = scalar%sensitivity
            self%sensitivity_error(:, joint) = scalar%sensitivity_error
         case (2)
            call replace(joint, scalar, best%slip_distance, ratio%slip_distance)
         case (3)
            call replace(joint, scalar, best%dissipation, ratio%dissipation)
         end select
      end associate
   end subroutine take_scalar

   !> The amplitude of a dof under a sine.
   pure subroutine take_amplitude(self, dof, scalar)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: dof
      type(scalar_type), intent(in) :: scalar

      call replace(dof, scalar, self%best%harmonic_amplitude, self%error_ratio%harmonic_amplitude)
   end subroutine take_amplitude

   pure subroutine replace(joint, scalar, best, ratio)
      integer, intent(in) :: joint
      type(scalar_type), intent(in) :: scalar
      type(joint_statistics), intent(inout) :: best, ratio

      best%mean(joint) = scalar%mean
      best%mean_error(joint) = scalar%mean_error
      best%std(joint) = scalar%deviation
      best%std_error(joint) = scalar%deviation_error
      best%percentiles(joint, :) = scalar%percentile
      best%low(joint, :) = scalar%low
      best%high(joint, :) = scalar%high
      ratio%mean(joint) = scalar%mean_ratio
      ratio%std(joint) = scalar%deviation_ratio
      ratio%percentiles(joint, :) = scalar%percentile_ratio
   end subroutine replace

   !> Spectra of a dof.
   pure subroutine take_spectrum(self, dof, spectrum)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: dof
      type(spectrum_type), intent(in) :: spectrum

      associate (best => self%best, ratio => self%error_ratio)
         best%psd_mean(dof, :) = spectrum%mean
         best%psd_mean_error(dof, :) = spectrum%mean_error
         best%psd_percentiles(dof, :, :) = spectrum%percentile
         best%psd_percentiles_low(dof, :, :) = spectrum%low
         best%psd_percentiles_high(dof, :, :) = spectrum%high
         best%pseudo_variance_mean(dof) = spectrum%variance_mean
         best%pseudo_variance_mean_error(dof) = spectrum%variance_mean_error
         best%pseudo_variance_percentiles(dof, :) = spectrum%variance
         best%pseudo_variance_percentiles_error(dof, :) = spectrum%variance_error
         best%band_ratio(dof) = spectrum%ratio
         best%band_ratio_low(dof) = spectrum%ratio_low
         best%band_ratio_high(dof) = spectrum%ratio_high
         ratio%psd_mean(dof, :) = spectrum%mean_ratio
         ratio%psd_percentiles(dof, :, :) = spectrum%percentile_ratio
         ratio%pseudo_variance_mean(dof) = spectrum%variance_mean_ratio
         ratio%pseudo_variance_percentiles(dof, :) = spectrum%variance_ratio
         ratio%band_ratio(dof) = spectrum%ratio_ratio
      end associate
   end subroutine take_spectrum

end module campaign_estimates
