!> Plain statistics of numbers of every sample, from samples that come in groups.
!>
!> Groups may be taken by different ranks: sums over the ranks of `sums` and
!> `percentiles%at`, which are zero where nothing was added, make a collector that has
!> all.
module campaign_joint_statistics
   use campaign_group_percentiles, only: high, low, middle, percentile_collector, &
      start_percentiles
   use campaign_results, only: joint_statistics
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: moments_type, n_sums, sums_of
   implicit none(type, external)
   private
   public :: joint_collector, start_joints

   !> Collects numbers: quantities of the joints.
   type :: joint_collector
      real(wp), allocatable :: sums(:, :, :)   !! (sum, number, group) as sums_of has them
      type(percentile_collector) :: percentiles   !! (number)
   contains
      procedure :: add
      procedure :: finish
   end type joint_collector

contains

   !> Prepares a collector; needs two samples or more.
   pure subroutine start_joints(n_samples, n_numbers, percentiles, collector)
      integer, intent(in) :: n_samples, n_numbers
      real(wp), intent(in) :: percentiles(:)    !! [%]
      type(joint_collector), intent(out) :: collector

      call start_percentiles(n_samples, n_numbers, percentiles, collector%percentiles)
      allocate (collector%sums(n_sums, n_numbers, collector%percentiles%n_groups()), source=0.0_wp)
   end subroutine start_joints

   !> Takes a group of samples, as sample_groups has them.
   pure subroutine add(self, group, values)
      class(joint_collector), intent(inout) :: self
      integer, intent(in) :: group
      real(wp), intent(in) :: values(:, :)   !! (number, sample)
      real(wp) :: rank(self%percentiles%n_percentiles(), 3)
      integer :: i

      rank = self%percentiles%ranks_in_group(size(values, 2))
      do i = 1, size(values, 1)
         self%sums(:, i, group) = sums_of(values(i, :))
         call self%percentiles%add(i, values(i, sort_order(values(i, :))), rank)
      end do
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
      associate (at => self%percentiles%at)
         statistics%percentiles = at(first:last, :, middle)
         statistics%low = at(first:last, :, low)
         statistics%high = at(first:last, :, high)
      end associate
   end subroutine finish

end module campaign_joint_statistics
