!> The output of a run: what an earlier run left of it, who may write it, and how it is let go.
module driver_output
   use, intrinsic :: iso_fortran_env, only: output_unit
   use config_scene, only: scene_type
   use core_error, only: error_type
   use core_text, only: to_text
   use driver_campaign, only: output_path
   use driver_command_line, only: command_line
   use driver_provenance, only: identity_of
   use ensemble_plan, only: plan_type
   use ensemble_runner, only: block_width
   use io_existing, only: extract_shards, inspect_results
   use io_files, only: exists, folder_of, make_folder, remove_file
   use io_gathering, only: finished_samples
   use io_lock, only: lock_type, take_lock
   use io_shards, only: list_shards, new_store, remove_covered, remove_leftovers, remove_store, &
                        shard_store, shard_type, verify_shard
   use parallel_world, only: world_type
   implicit none(type, external)
   private
   public :: output_type, open_output

   !> The results file of a run and the shards on the way to it.
   type :: output_type
      character(:), allocatable :: path
      type(shard_store) :: store
      logical :: is_quiet = .false.
      logical :: is_complete = .false.               !! an earlier run left nothing to do
      logical, allocatable :: is_finished(:, :)      !! (sample, case) by an earlier run
      type(lock_type), private :: lock
   contains
      procedure :: say
      procedure :: stop_on
      procedure :: release
   end type output_type

contains

   !> Locks the output and finds what is finished; ends the run where it may not be written. A
   !> replay, whose file has an ending of its own, starts anew. Collective.
   subroutine open_output(world, line, scene, plan, output, replay_ending)
      type(world_type), intent(in) :: world
      type(command_line), intent(in) :: line
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      type(output_type), intent(out) :: output
      character(*), intent(in), optional :: replay_ending
      type(error_type), allocatable :: error

      if (present(replay_ending)) then
         output%path = output_path(line, replay_ending)
      else
         output%path = output_path(line, '.h5')
      end if
      output%store = new_store(output%path, identity_of(scene))
      output%is_quiet = line%is_quiet .or. .not. world%is_root()
      allocate (output%is_finished(maxval([plan%cases%n_samples, 0]), size(plan%cases)), &
                source=.false.)
      if (world%is_root()) &
         call find_finished(line%is_fresh .or. present(replay_ending), plan, output, error)
      call output%stop_on(world, error)
      call world%broadcast(output%is_complete)
      call share_finished(world, output)
   end subroutine open_output

   !> Takes the lock, clears away what no run can use, and lists the samples that are there.
   subroutine find_finished(starts_anew, plan, output, error)
      logical, intent(in) :: starts_anew
      type(plan_type), intent(in) :: plan
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      integer :: c, i

      call make_folder(folder_of(output%path), error)
      if (.not. allocated(error)) call take_lock(output%path//'.lock', output%lock, error)
      if (allocated(error)) return
      if (starts_anew) then
         call remove_store(output%store, error)
         if (allocated(error)) return
         if (exists(output%path)) call remove_file(output%path, error)
      else
         call take_up_results(plan, output, error)
      end if
      if (allocated(error) .or. output%is_complete) return
      call remove_leftovers(output%store, error)
      if (.not. allocated(error)) call list_shards(output%store, shards, error)
      if (allocated(error)) return
      do i = 1, size(shards)
         call verify_shard(output%store, shards(i), error)
         if (allocated(error)) return
      end do
      do c = 1, size(plan%cases)
         associate (n => plan%cases(c)%n_samples)
            output%is_finished(:n, c) = finished_samples(shards, c, n)
         end associate
      end do
      if (any(output%is_finished)) &
         call output%say('continuing: '//to_text(count(output%is_finished))//' of '// &
                         to_text(sum(plan%cases%n_samples))//' samples are there')
   end subroutine find_finished

   !> A results file that is there already: complete, or with fewer samples than are wanted now,
   !> which go on as shards.
   subroutine take_up_results(plan, output, error)
      type(plan_type), intent(in) :: plan
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error
      integer, allocatable :: n_samples(:)

      call inspect_results(output%path, output%store%identity, n_samples, error)
      if (allocated(error) .or. .not. allocated(n_samples)) return
      output%is_complete = all(n_samples >= plan%cases%n_samples)
      if (output%is_complete) then
         call remove_covered(output%store, n_samples, error)
      else
         call extract_shards(output%path, n_samples, block_width(plan), output%store, error)
      end if
   end subroutine take_up_results

   !> What the root found becomes known to all; collective.
   subroutine share_finished(world, output)
      type(world_type), intent(in) :: world
      type(output_type), intent(inout) :: output
      integer, allocatable :: numbers(:)

      numbers = merge(1, 0, reshape(output%is_finished, [size(output%is_finished)]))
      call world%broadcast(numbers)
      output%is_finished = reshape(numbers == 1, shape(output%is_finished))
   end subroutine share_finished

   !> A line for the user, from the root and unless told to be quiet.
   subroutine say(self, text)
      class(output_type), intent(in) :: self
      character(*), intent(in) :: text

      if (self%is_quiet) return
      write (output_unit, '(a)') text
      flush (output_unit)
   end subroutine say

   !> Ends the run on an error of any rank, the output unlocked first; collective.
   subroutine stop_on(self, world, error)
      class(output_type), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(error_type), allocatable, intent(in) :: error

      if (world%any_true(allocated(error))) call self%release()
      call world%stop_on(error)
   end subroutine stop_on

   !> Gives the output back; what is finished stays.
   subroutine release(self)
      class(output_type), intent(inout) :: self
      type(error_type), allocatable :: ignored   ! a lock file that stays behind locks nobody out

      call self%lock%release(ignored)
   end subroutine release

end module driver_output
