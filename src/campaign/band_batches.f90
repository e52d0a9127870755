!> Time-average errors of the bands of uncertainty, from consecutive batches of the march: of the
!> pseudo-variances, Eq. (46), of the mean and of each percentile over samples, and of the band
!> ratio.
!>
!> The force record that the samples share changes the response of all of them, and more samples do
!> not average that out. A percentile changes as the samples near its rank do on average; the
!> deviations of single samples from that are in the Monte Carlo errors. So the density of a
!> percentile in a batch is estimated as that of the whole march times the mean, over the samples in
!> the 95 % interval of its rank, of the power of a sample in this batch over its mean power in all
!> batches, within a range of frequencies. Full spectra of every batch would take eight times the
!> memory.
module campaign_band_batches
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use numerics_correlated, only: error_of_batches, n_batches
   implicit none(type, external)
   private
   public :: batch_collector, start_batches

   !> Quiet NaN: ratio of two powers that are zero.
   real(wp), parameter, public :: not_a_number = transfer(int(z'7FF8000000000000', long), 0.0_wp)

   !> Sums of one case. Ranks may add different frequencies: `variance` is then summed over the
   !> ranks.
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
      integer, intent(in) :: n_slices   !! number of slices that are added
      type(batch_collector), intent(out) :: collector

      allocate (collector%variance(n_batches, n_percentiles + 1, n_dof, n_slices), source=0.0_wp)
   end subroutine start_batches

   !> Adds one frequency of one dof of one slice.
   pure subroutine add(self, slice, dof, density, ranking, power, curve, low, high)
      class(batch_collector), intent(inout) :: self
      integer, intent(in) :: slice, dof
      real(wp), intent(in) :: density(:)         !! (sample) [m^2/Hz]
      integer, intent(in) :: ranking(:)          !! samples in ascending order of density
      real(wp), intent(in) :: power(:, :)        !! (batch, sample) in the range of the frequency
      real(wp), intent(in) :: curve(:)           !! mean and percentiles times frequency step [m^2]
      real(wp), intent(in) :: low(:), high(:)    !! (percentile) ends of the interval of its rank
      ! relative: power of a sample over its mean of all batches
      real(wp) :: relative(n_batches, size(density)), weighted(n_batches)
      integer :: i, n, p

      n = size(density)
      relative = 1.0_wp
      weighted = 0.0_wp
      do i = 1, n
         if (sum(power(:, i)) > 0.0_wp) relative(:, i) = power(:, i)*(n_batches/sum(power(:, i)))
         weighted = weighted + density(i)*relative(:, i)
      end do
      associate (variance => self%variance(:, :, dof, slice))
         if (sum(density) > 0.0_wp) variance(:, 1) = variance(:, 1) + curve(1)*weighted/sum(density)
         do p = 1, size(low)
            associate (near => ranking(floor(low(p)):ceiling(high(p))))
               variance(:, p + 1) = variance(:, p + 1) &
                                    + curve(p + 1)*sum(relative(:, near), 2)/size(near)
            end associate
         end do
      end associate
   end subroutine add

   !> Computes the time-average errors after all frequencies of all ranks are added. Uses the band
   !> ratios in `statistics`. The error of the band ratio of a dof that does not move in a batch is
   !> NaN.
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
