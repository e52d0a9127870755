!> Writes files that its arguments name, for check_disk_faults.py: shards or processes of a store,
!> 60 or until one fails, or the results file of a store. The message goes to standard error; the
!> exit code is the error's.
program disk_faults
   use, intrinsic :: iso_fortran_env, only: error_unit
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_terminal, only: end_program
   use io_campaign, only: ask_all, keep_block, made_block, made_identity, made_model, write_made_results, &
      write_made_shards
   use io_process_results, only: store_process, read_stored_processes
   use io_shards, only: list_shards, read_shard, shard_type
   use io_store, only: new_store, shard_store
   use process_model, only: process_model_type
   implicit none(type, external)
   character(1000) :: deed, output, results
   type(error_type), allocatable :: error

   call get_command_argument(1, deed)
   call get_command_argument(2, output)
   call get_command_argument(3, results)
   select case (deed)
   case ('fill')
      call fill(new_store(trim(output), made_identity()))
   case ('fill_processes')
      call fill_processes(new_store(trim(output), made_identity()))
   case ('verify')
      call verify(new_store(trim(output), made_identity()))
   case ('shards')
      call write_made_shards(new_store(trim(output), made_identity()), error)
   case ('results')
      call write_made_results(trim(results), new_store(trim(output), made_identity()), error)
   end select
   if (allocated(error)) then
      write (error_unit, '(a)') error%message
      call end_program(error%exit_code)
   end if

contains

   subroutine fill(store)
      type(shard_store), intent(in) :: store
      type(block_result) :: block
      integer :: first

      do first = 1, 120, 2
         block = made_block(2, first, first + 1)
         call keep_block(store, block, error)
         if (allocated(error)) return
      end do
   end subroutine fill

   subroutine fill_processes(store)
      type(shard_store), intent(in) :: store
      integer :: number

      do number = 1, 60
         call store_process(store, number, made_model(), error)
         if (allocated(error)) return
      end do
   end subroutine fill_processes

   !> Prints the number of shards and processes when all are sound.
   subroutine verify(store)
      type(shard_store), intent(in) :: store
      type(shard_type), allocatable :: shards(:)
      type(block_result) :: block
      type(process_model_type), allocatable :: models(:)
      logical :: is_kept(60)
      integer :: i

      allocate (models(60))
      call ask_all(models)
      call list_shards(store, shards, error)
      if (allocated(error)) return
      do i = 1, size(shards)
         call read_shard(store, shards(i), block, error)
         if (allocated(error)) return
      end do
      call read_stored_processes(store, models, is_kept, error)
      if (.not. allocated(error)) print '(i0)', size(shards) + count(is_kept)
   end subroutine verify

end program disk_faults
