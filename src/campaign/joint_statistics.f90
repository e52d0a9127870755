!> Plain statistics of one number per sample and joint, from samples that come in groups.
module campaign_joint_statistics
   use campaign_bands, only: band_collector, start_bands
   use campaign_results, only: joint_statistics
   use campaign_selection, only: selection_type
   use core_kinds, only: long, wp
   use numerics_statistics, only: moments_type
   implicit none(type, external)
   private
   public :: joint_collector, start_joints

   !> Collects one quantity of all joints.
   type :: joint_collector
      type(moments_type), allocatable, private :: moments(:)   !! (joint)
      type(band_collector), private :: percentiles             !! as at a single frequency
      type(selection_type), private :: selection               !! of many samples' percentiles
   contains
      procedure :: add
      procedure :: finish
      procedure :: select_again
      procedure :: start_selection
      procedure :: take_selected
   end type joint_collector

contains

   !> Prepares a collector; needs two samples or more.
   subroutine start_joints(n_samples, n_joints, percentiles, seed, collector)
      integer, intent(in) :: n_samples, n_joints
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      type(joint_collector), intent(out) :: collector

      allocate (collector%moments(n_joints))
      call start_bands(n_samples, n_joints, [0.0_wp, 1.0_wp], percentiles, seed, 1, &
                       collector%percentiles, draws_again=.false.)
   end subroutine start_joints

   !> Takes the next group of samples, as sample_groups has them.
   pure subroutine add(self, group, values)
      class(joint_collector), intent(inout) :: self
      integer, intent(in) :: group
      real(wp), intent(in) :: values(:, :)   !! (joint, sample)
      integer :: joint

      do joint = 1, size(values, 1)
         call self%moments(joint)%add(values(joint, :))
      end do
      call self%percentiles%add(1, 1, group, reshape(values, [size(values, 1), 1, size(values, 2)]))
   end subroutine add

   !> After the last group, where there are several: all groups come again, in any order, to be
   !> selected from.
   pure subroutine start_selection(self)
      class(joint_collector), intent(inout) :: self

      call self%percentiles%open_selection(1, 1, self%selection)
   end subroutine start_selection

   pure subroutine select_again(self, values)
      class(joint_collector), intent(inout) :: self
      real(wp), intent(in) :: values(:, :)   !! (joint, sample)
      integer :: joint

      do joint = 1, size(values, 1)
         call self%selection%add(joint, values(joint, :))
      end do
   end subroutine select_again

   !> Takes the percentiles of all samples, unless all groups have to come once more.
   pure subroutine take_selected(self, is_done)
      class(joint_collector), intent(inout) :: self
      logical, intent(out) :: is_done

      call self%selection%check(self%selection%count_values(), is_done)
      if (.not. is_done) return
      do while (.not. self%selection%is_done())
         call self%selection%halve(self%selection%count_to_middle())
      end do
      call self%percentiles%take_selection(1, 1, self%selection)
   end subroutine take_selected

   !> The statistics, after the last group.
   pure subroutine finish(self, statistics)
      class(joint_collector), intent(in) :: self
      type(joint_statistics), intent(out) :: statistics

      statistics%mean = self%moments%mean
      statistics%std = self%moments%standard_deviation()
      statistics%mean_error = self%moments%error_of_mean()
      statistics%std_error = self%moments%error_of_deviation()
      call self%percentiles%percentiles_at(1, statistics%percentiles, statistics%low, &
                                           statistics%high)
   end subroutine finish

end module campaign_joint_statistics
