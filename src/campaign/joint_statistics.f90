!> Plain statistics of numbers of every sample, from samples that come in groups.
!>
!> Groups may be taken by different ranks: sums over the ranks of `sums` and
!> `percentiles%at_frequency`, which are zero where nothing was added, make a collector that has
!> all.
module campaign_joint_statistics
   use campaign_bands, only: band_collector, start_bands
   use campaign_results, only: joint_statistics
   use core_kinds, only: long, wp
   use numerics_statistics, only: moments_type, n_sums, sums_of
   implicit none(type, external)
   private
   public :: joint_collector, start_joints

   !> Collects numbers: quantities of the joints.
   type :: joint_collector
      real(wp), allocatable :: sums(:, :, :)   !! (sum, number, group) as sums_of has them
      type(band_collector) :: percentiles      !! as at a single frequency
   contains
      procedure :: add
      procedure :: finish
   end type joint_collector

contains

   !> Prepares a collector; needs two samples or more.
   subroutine start_joints(n_samples, n_numbers, percentiles, seed, collector)
      integer, intent(in) :: n_samples, n_numbers
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      type(joint_collector), intent(out) :: collector

      call start_bands(n_samples, n_numbers, [0.0_wp, 1.0_wp], percentiles, seed, 1, &
                       collector%percentiles, draws_again=.false.)
      allocate (collector%sums(n_sums, n_numbers, collector%percentiles%n_groups()), source=0.0_wp)
   end subroutine start_joints

   !> Takes a group of samples, as sample_groups has them.
   pure subroutine add(self, group, values)
      class(joint_collector), intent(inout) :: self
      integer, intent(in) :: group
      real(wp), intent(in) :: values(:, :)   !! (number, sample)
      integer :: i

      do i = 1, size(values, 1)
         self%sums(:, i, group) = sums_of(values(i, :))
      end do
      call self%percentiles%add(1, 1, group, reshape(values, [size(values, 1), 1, size(values, 2)]))
   end subroutine add

   !> Computes the statistics of numbers first..last, once all groups are added and the percentiles
   !> of all samples selected.
   pure subroutine finish(self, first, last, statistics)
      class(joint_collector), intent(in) :: self
      integer, intent(in) :: first, last
      type(joint_statistics), intent(out) :: statistics
      type(moments_type) :: moments(first:last)
      integer :: group, i

      do group = 1, size(self%sums, 3)
         do i = first, last
            call moments(i)%join(self%sums(:, i, group))
         end do
      end do
      statistics%mean = moments%mean
      statistics%std = moments%standard_deviation()
      statistics%mean_error = moments%error_of_mean()
      statistics%std_error = moments%error_of_deviation()
      call self%percentiles%percentiles_at(1, statistics%percentiles, statistics%low, &
                                           statistics%high)
      statistics%percentiles = statistics%percentiles(first:last, :)
      statistics%low = statistics%low(first:last, :)
      statistics%high = statistics%high(first:last, :)
   end subroutine finish

end module campaign_joint_statistics
