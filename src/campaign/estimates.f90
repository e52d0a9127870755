!> The best estimates of a case: those of a regression where there is one, else plain sampling's.
module campaign_estimates
   use campaign_results, only: case_statistics, list_statistics, listed_statistic, of_slip
   use core_kinds, only: wp
   use statistics_estimates, only: student_factor, upward_error
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
   subroutine start(self, plain, friction_points)
      class(case_estimates), intent(inout), target :: self
      type(case_statistics), intent(in) :: plain   !! whose extents the estimates have
      integer, intent(in) :: friction_points(:)    !! of the process, ascending
      type(listed_statistic), allocatable :: list(:)
      integer :: i, q

      self%friction_points = friction_points
      allocate (self%sensitivity(size(friction_points), size(plain%numbers(of_slip)%mean)), &
                source=0.0_wp)
      allocate (self%sensitivity_error, source=self%sensitivity)
      self%best = plain
      list = list_statistics(self%best)
      do i = 1, size(list)
         list(i)%values = 0.0_wp
      end do
      associate (best => self%best, ratio => self%error_ratio)
         do q = 1, size(best%numbers)
            if (.not. allocated(best%numbers(q)%mean)) cycle
            ratio%numbers(q)%mean = best%numbers(q)%mean
            ratio%numbers(q)%std = best%numbers(q)%std
            ratio%numbers(q)%percentiles = best%numbers(q)%percentiles
         end do
         if (.not. allocated(best%psd_mean)) return
         ratio%psd_mean = best%psd_mean
         ratio%psd_percentiles = best%psd_percentiles
         ratio%pseudo_variance_mean = best%pseudo_variance_mean
         ratio%pseudo_variance_percentiles = best%pseudo_variance_percentiles
         ratio%band_ratio = best%band_ratio
      end associate
   end subroutine start

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

   !> Takes plain sampling's estimates where no rank has others: densities at frequencies without
   !> power, and the bias of plain band ratios.
   pure subroutine take_plain(self, plain)
      class(case_estimates), intent(inout) :: self
      type(case_statistics), intent(in) :: plain

      if (.not. allocated(plain%psd_mean)) return
      associate (best => self%best, ratio => self%error_ratio)
         best%band_ratio_bias = plain%band_ratio_bias
         where (.not. ratio%psd_mean > 0.0_wp)
            best%psd_mean = plain%psd_mean
            best%psd_mean_error = upward_error(plain%psd_mean, plain%psd_mean_error &
                                               *student_factor(plain%psd_mean_freedoms))
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
