!> The shards of an output, known to all ranks and verified by all.
module driver_shards
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_gathering, only: order_shards, stored_samples
   use io_shards, only: list_shards, named_shard, shard_type, verify_shard
   use io_store, only: shard_store
   use parallel_world, only: world_type
   implicit none(type, external)
   private
   public :: list_stored, verify_shards

contains

   !> Finds the shards of a store, for all ranks as the root lists them: other machines may not see
   !> new files at once. An error is the root's. Collective.
   subroutine list_stored(world, store, stored, error)
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      type(stored_samples), intent(out) :: stored
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      real(wp), allocatable :: numbers(:, :)   ! (shard; case, first sample, samples)
      integer :: i

      if (world%is_root()) call list_shards(store, shards, error)
      if (.not. allocated(shards)) allocate (shards(0))
      numbers = reshape(real([shards%case_number, shards%first_sample, shards%n_samples], wp), &
                        [size(shards), 3])
      call world%broadcast(numbers)
      deallocate (shards)
      allocate (shards(size(numbers, 1)))
      do i = 1, size(shards)
         shards(i) = named_shard(store, nint(numbers(i, 1)), nint(numbers(i, 2)), &
                                 nint(numbers(i, 3)))
      end do
      call order_shards(store, shards, stored)
   end subroutine list_stored

   !> Reads this rank's share of all shards whole; the first damaged one is an error of this rank.
   subroutine verify_shards(world, stored, error)
      type(world_type), intent(in) :: world
      type(stored_samples), intent(in) :: stored   !! the same on all ranks
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      do i = 1 + world%rank, size(stored%shards), world%n_ranks
         call verify_shard(stored%store, stored%shards(i), error)
         if (allocated(error)) return
      end do
   end subroutine verify_shards

end module driver_shards
