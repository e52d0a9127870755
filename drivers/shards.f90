!> The shards of an output, known to all ranks and verified by all.
module driver_shards
   use core_error, only: error_type
   use io_shards, only: named_shard, shard_type, verify_shard
   use io_store, only: shard_store
   use parallel_world, only: world_type
   implicit none(type, external)
   private
   public :: share_list, verify_shards

contains

   !> Broadcasts the root's list of shards: other machines may not see new files at once.
   !> Collective.
   subroutine share_list(world, store, shards)
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      type(shard_type), allocatable, intent(inout) :: shards(:)
      integer, allocatable :: cases(:), first(:), n(:)
      integer :: i

      if (.not. allocated(shards)) allocate (shards(0))
      cases = shards%case_number
      first = shards%first_sample
      n = shards%n_samples
      call world%broadcast(cases)
      call world%broadcast(first)
      call world%broadcast(n)
      if (world%is_root()) return
      deallocate (shards)
      allocate (shards(size(cases)))
      do i = 1, size(cases)
         shards(i) = named_shard(store, cases(i), first(i), n(i))
      end do
   end subroutine share_list

   !> Reads this rank's share of some shards whole; the first damaged one is an error of this rank.
   subroutine verify_shards(world, store, shards, error)
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! the same on all ranks
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      do i = 1 + world%rank, size(shards), world%n_ranks
         call verify_shard(store, shards(i), error)
         if (allocated(error)) return
      end do
   end subroutine verify_shards

end module driver_shards
