!> Cost of shards: CPU time to write, verify and read them, and to claim work, for scheduling.py.
program storage
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_gathering, only: read_band, read_samples
   use io_identity, only: identity_type
   use io_shards, only: list_shards, shard_type, verify_shard, write_shard
   use io_store, only: new_store, remove_store, shard_store
   implicit none(type, external)
   integer, parameter :: n_shards = 40, n_samples = 32, n_dof = 5, n_band = 61
   integer, parameter :: n_frequencies = 1025   !! segments of 8192 steps, every 4th step
   type(shard_store) :: store
   type(shard_type), allocatable :: shards(:)
   type(block_result) :: block
   type(error_type), allocatable :: error
   real(wp), allocatable :: psd(:, :, :)
   real(wp) :: began
   integer :: i

   store = new_store('bench_storage.h5', identity_type('0', '0', '0', 'run', ''))
   call make_block()

   call cpu_time(began)
   do i = 1, n_shards
      block%first_sample = 1 + (i - 1)*n_samples
      call write_shard(store, block, error)
      call check()
   end do
   call tell('write_shard', began, n_shards)

   call list_shards(store, shards, error)
   call check()
   call cpu_time(began)
   do i = 1, n_shards
      call verify_shard(store, shards(i), error)
      call check()
   end do
   call tell('verify_shard', began, n_shards)

   call cpu_time(began)
   call read_samples(store, shards, 1, 1, n_shards*n_samples, block, error)
   call check()
   call tell('read_samples', began, n_shards)

   allocate (psd(n_dof, n_band, n_shards*n_samples))
   call cpu_time(began)
   call read_band(store, shards, 1, 'psd', 1, 1, psd, error)
   call check()
   call tell('read_band', began, n_shards)
   call remove_store(store, error)
   call check()

contains

   subroutine make_block()
      block%case_number = 1
      block%n_samples = n_samples
   allocate (block%friction(n_dof, n_samples), block%slip_fraction(n_dof, n_samples), source=0.1_wp)
      allocate (block%slip_starts(n_dof, n_samples), block%stick_starts(n_dof, n_samples), &
                source=1_long)
      allocate (block%psd(n_dof, n_frequencies, n_samples))
      call random_number(block%psd)
   end subroutine make_block

   !> Milliseconds of one of n times of some work.
   subroutine tell(work, began, n)
      character(*), intent(in) :: work
      real(wp), intent(in) :: began
      integer, intent(in) :: n
      real(wp) :: now

      call cpu_time(now)
      print '(a, t16, f8.3, a)', work, 1.0e3_wp*(now - began)/n, ' ms a shard'
   end subroutine tell

   subroutine check()
      if (allocated(error)) error stop error%message
   end subroutine check

end program storage
