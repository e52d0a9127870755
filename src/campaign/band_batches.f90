!> How far the bands of uncertainty are from those of an endless march: pseudo-variances, Eq. (46),
!> of the mean and of each percentile over samples, and the ratio of the outer ones, in consecutive
!> batches of the march, whose scatter gives their standard errors.
!>
!> The record that the samples share moves all of them, and more of them do not average it out. It
!> moves a percentile as it moves, on average, the samples that stand there; whatever more a single
!> one of them does is in the bootstrap over samples. So the density of a percentile in a batch is
!> that of the whole march, times the mean over the samples within the interval of its rank (95 %)
!> of the power of each in that batch, relative to its power in all, within a range of frequencies
!> about. Full spectra of every batch would say no more at eight times their size.
module campaign_band_batches
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use numerics_correlated, only: error_of_batches, n_batches
   implicit none(type, external)
   private
   public :: batch_collector, start_batches

   !> Ratio of two powers that vanish.
   real(wp), parameter, public :: not_a_number = transfer(int(z'7FF8000000000000', long), 0.0_wp)

   !> Collects one case. Ranges of frequencies may be taken by different ranks: sums over the ranks
   !> of `variance` make a collector that has all.
   type :: batch_collector
      !> (batch, mean (0) and percentiles (1..), dof, slice) pseudo-variances [m^2]
      real(wp), allocatable :: variance(:, :, :, :)
   contains
      procedure :: add
      procedure :: finish
   end type batch_collector

contains

   !> Prepares a collector.
   pure subroutine start_batches(n_percentiles, n_dof, n_slices, collector)
      integer, intent(in) :: n_percentiles, n_dof
      integer, intent(in) :: n_slices   !! in which the frequencies come
      type(batch_collector), intent(out) :: collector

      allocate (collector%variance(n_batches, 0:n_percentiles, n_dof, n_slices), source=0.0_wp)
   end subroutine start_batches

   !> Adds one frequency of one dof.
   pure subroutine add(self, slice, dof, density, ranking, power, at, low, high)
      class(batch_collector), intent(inout) :: self
      integer, intent(in) :: slice, dof
      real(wp), intent(in) :: density(:)         !! (sample) [m^2/Hz]
      integer, intent(in) :: ranking(:)            !! of the samples, ascending
      real(wp), intent(in) :: power(:, :)        !! (batch, sample) in the range of the frequency
      real(wp), intent(in) :: at(0:)             !! mean (0) and percentiles, times the step [m^2]
      real(wp), intent(in) :: low(:), high(:)    !! (percentile) ends of the interval of its rank
      real(wp) :: relative(n_batches, size(density)), weighted(n_batches)   ! 1 on average
      integer :: i, n, p

      n = size(density)
      relative = 1.0_wp
      weighted = 0.0_wp
      do i = 1, n
         if (sum(power(:, i)) > 0.0_wp) relative(:, i) = power(:, i)*(n_batches/sum(power(:, i)))
         weighted = weighted + density(i)*relative(:, i)
      end do
      associate (variance => self%variance(:, :, dof, slice))   ! (batch, from 1: mean, percentiles)
         if (sum(density) > 0.0_wp) variance(:, 1) = variance(:, 1) + at(0)*weighted/sum(density)
         do p = 1, size(low)
            associate (near => ranking(floor(low(p)):ceiling(high(p))))
               variance(:, p + 1) = variance(:, p + 1) + at(p)*sum(relative(:, near), 2)/size(near)
            end associate
         end do
      end associate
   end subroutine add

   !> Computes the time-average errors once all frequencies of all ranks are added and the band
   !> ratios known; NaN for the ratio of a dof that does not move in a batch.
   pure subroutine finish(self, statistics)
      class(batch_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp), allocatable :: variance(:, :)   ! (batch, percentile)
      integer :: dof, last, n_dof, p

      last = ubound(self%variance, 2)
      n_dof = size(self%variance, 3)
      allocate (statistics%pseudo_variance_mean_time_error(n_dof), &
                statistics%pseudo_variance_percentiles_time_error(n_dof, last))
      allocate (statistics%band_ratio_time_error(n_dof), source=not_a_number)
      do dof = 1, n_dof
         statistics%pseudo_variance_mean_time_error(dof) = &
            error_of_batches(sum(self%variance(:, 0, dof, :), 2))
         variance = sum(self%variance(:, 1:, dof, :), 3)
         statistics%pseudo_variance_percentiles_time_error(dof, :) = &
            [(error_of_batches(variance(:, p)), p=1, last)]
         if (minval(variance) > 0.0_wp) then
            statistics%band_ratio_time_error(dof) = &
               statistics%band_ratio(dof)*error_of_batches(log(variance(:, last)/variance(:, 1)))
         end if
      end do
   end subroutine finish

end module campaign_band_batches
