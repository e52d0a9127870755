!> How far the bands of uncertainty are from those of an endless march: pseudo-variances, Eq. (46),
!> of the mean and of each percentile over samples, and the ratio of the outer ones, in consecutive
!> batches of the march, whose scatter gives their standard errors.
!>
!> The record that the samples share moves all of them, and more of them do not average it out. It
!> moves a percentile as it moves, on average, the samples that stand there; whatever more a single
!> one of them does is in the errors over samples. So the density of a percentile in a batch is
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
      !> (batch, mean or percentile, dof, slice) pseudo-variances [m^2]
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

      allocate (collector%variance(n_batches, n_percentiles + 1, n_dof, n_slices), source=0.0_wp)
   end subroutine start_batches

   !> Adds one frequency of one dof.
   pure subroutine add(self, slice, dof, density, ranking, power, at, low, high)
      class(batch_collector), intent(inout) :: self
      integer, intent(in) :: slice, dof
      real(wp), intent(in) :: density(:)         !! (sample) [m^2/Hz]
      integer, intent(in) :: ranking(:)            !! of the samples, ascending
      real(wp), intent(in) :: power(:, :)        !! (batch, sample) in the range of the frequency
      real(wp), intent(in) :: at(:)              !! mean and percentiles, times the step [m^2]
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
      associate (variance => self%variance(:, :, dof, slice))
         if (sum(density) > 0.0_wp) variance(:, 1) = variance(:, 1) + at(1)*weighted/sum(density)
         do p = 1, size(low)
            associate (near => ranking(floor(low(p)):ceiling(high(p))))
               variance(:, p + 1) = variance(:, p + 1) &
                                    + at(p + 1)*sum(relative(:, near), 2)/size(near)
            end associate
         end do
      end associate
   end subroutine add

   !> Computes the time-average errors once all frequencies of all ranks are added and the band
   !> ratios known; NaN for the ratio of a dof that does not move in a batch.
   pure subroutine finish(self, statistics)
      class(batch_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: variance(n_batches, size(self%variance, 2))   ! (batch; mean, percentiles)
      integer :: dof, last, s

      last = size(variance, 2)
      allocate (statistics%pseudo_variance_time_error(size(self%variance, 3), last + 1))
      do dof = 1, size(self%variance, 3)
         variance = sum(self%variance(:, :, dof, :), 3)
         associate (error => statistics%pseudo_variance_time_error(dof, :))
            error(:last) = [(error_of_batches(variance(:, s)), s=1, last)]
            error(last + 1) = not_a_number
            if (minval(variance(:, 2:)) > 0.0_wp) &
               error(last + 1) = statistics%pseudo_variances(dof, last + 1)%value &
                                 *error_of_batches(log(variance(:, last)/variance(:, 2)))
         end associate
      end do
   end subroutine finish

end module campaign_band_batches
