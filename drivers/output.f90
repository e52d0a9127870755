!> The output of a run: its lock, the finished samples that an earlier run left, and its end.
module driver_output
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use campaign_plan, only: add_audits, plan_type
   use campaign_pooling, only: estimators_of, find_pools
   use campaign_results, only: block_result
   use campaign_runner, only: block_width
   use campaign_samples_needed, only: needs_more_samples, slip_error_of
   use campaign_size, only: refuse_long_lists
   use campaign_study, only: block_range
   use config_fingerprint, only: canonical_text, fingerprint
   use config_plan, only: scene_name
   use config_scene, only: scene_type
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_source, only: is_folder
   use core_text, only: counted, to_text
   use driver_build_info, only: architecture, compiler_flags, git_commit, version
   use driver_command_line, only: command_line
   use io_earlier_results, only: case_errors, count_stored_samples, has_realizations, read_errors, &
                                 refuse_replacement, stored_in_results
   use io_files, only: exists, follow_links, remove_file
   use io_hdf5, only: hdf5_file, hdf5_object
   use io_lock, only: lock_type, take_lock
   use io_progress, only: inform
   use io_shards, only: finished_samples, list_shards, sort_shards, shard_path, read_shard, &
                        remove_merged_shards, shard_type, stored_samples
   use io_store, only: create_unfinished, discard_file, identity_type, new_store, &
                       remove_leftovers, remove_store, shard_store
   use parallel_world, only: stop_world, world_type
   implicit none(type, external)
   private
   public :: output_type, open_new_output, open_output

   !> A results file, its shards and its lock.
   type :: output_type
      type(world_type) :: world                   !! the ranks of this run
      character(:), allocatable :: scene          !! text of the scene
      character(:), allocatable :: overrides      !! --set options, one a line
      character(:), allocatable :: path
      type(shard_store) :: store
      logical :: is_shared = .false.              !! true for --share: no run merges the shards
      logical :: is_complete = .false.            !! true if an earlier run left nothing to do
      !> True on the root if the file has more samples than the scene, and other estimates of them
      logical :: has_other_estimates = .false.
      integer, allocatable :: n_stored(:)         !! (case and audit) samples in a results file
      logical, allocatable :: is_finished(:, :)   !! (sample, case) true if it is stored
      type(lock_type) :: lock
   contains
      procedure :: claim
      procedure :: release
      procedure :: update_finished
      procedure :: list_stored
      procedure :: verify
      procedure :: begin_file
      procedure :: stop_on
      procedure :: end_run
   end type output_type

contains

   !> Locks the output of a command that does not resume; ends the run if the output may not be
   !> written. An earlier file stays until the new one is complete. Collective.
   subroutine open_new_output(world, line, scene, ending, output)
      type(world_type), intent(in) :: world
      type(command_line), intent(in) :: line
      type(scene_type), intent(in) :: scene
      character(*), intent(in) :: ending   !! end of the default name, such as '_c007_s0042.h5'
      type(output_type), intent(out) :: output
      type(error_type), allocatable :: error

      call name_output(world, line, scene, ending, output)
      output%n_stored = [integer ::]
      if (world%is_root()) call lock_and_clear(output, error)
      call output%stop_on(error)
   end subroutine open_new_output

   !> Sets path and identity of the output. The path is --output, else the name of the scene with an
   !> ending, in the current folder; a symbolic link is followed. Collective.
   subroutine name_output(world, line, scene, ending, output)
      type(world_type), intent(in) :: world
      type(command_line), intent(in) :: line
      type(scene_type), intent(in) :: scene
      character(*), intent(in) :: ending
      type(output_type), intent(inout) :: output
      type(identity_type) :: identity
      type(error_type), allocatable :: error

      output%path = scene_name(line%scene)//ending
      if (allocated(line%output)) output%path = line%output
      call follow_links(output%path, error)
      if (is_folder(output%path)) &
         call raise(error, exit_file, output%path//': is a folder: give --output a file')
      call world%stop_on(error)
      output%world = world
      output%scene = scene%text
      output%overrides = line%overrides
      identity%settings = canonical_text(scene)
      identity%fingerprint = fingerprint(scene)
      identity%version = version//' ('//git_commit//')'
      identity%architecture = architecture//', '//compiler_version()
      identity%command = line%command
      output%store = new_store(output%path, identity)
   end subroutine name_output

   !> Takes the lock, and removes the shards that an earlier run left.
   subroutine lock_and_clear(output, error)
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error

      call take_lock(output%path, output%lock, error)
      if (allocated(error)) return
      call refuse_replacement(output%path, output%store%identity%command, error)
      if (.not. allocated(error)) call remove_store(output%store, error)
   end subroutine lock_and_clear

   !> Locks the output of a run and finds the finished samples; ends the run if the output may not
   !> be written. Collective.
   subroutine open_output(world, line, scene, plan, output)
      type(world_type), intent(in) :: world
      type(command_line), intent(in) :: line
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      type(output_type), intent(out) :: output
      type(stored_samples) :: stored
      type(error_type), allocatable :: error

      call name_output(world, line, scene, '.h5', output)
      call refuse_long_lists(plan, error)
      call world%stop_on(error)
      output%is_shared = line%has('--share')
      if (world%is_root()) call lock_and_resume(line%has('--fresh'), plan, output, error)
      call output%stop_on(error)
      if (output%is_shared .and. .not. world%is_root()) &
         call take_lock(output%path, output%lock, error, is_shared=.true.)
      call output%stop_on(error)
      output%is_complete = world%any_true(output%is_complete)   ! set on the root
      call world%broadcast(output%n_stored)
      if (output%is_complete) return
      call output%list_stored(plan, stored, error)
      if (.not. allocated(error)) call output%verify(stored, error)
      call output%stop_on(error)
      output%is_finished = finished_samples(stored%shards, plan%cases%n_samples)
      if (any(output%is_finished)) &
         call inform('continuing: '//to_text(count(output%is_finished))//' of '// &
                         to_text(sum(plan%cases%n_samples))//' samples are there')
   end subroutine open_output

   !> Takes the lock and finds the results of an earlier run. Finds whether they are complete;
   !> checks that a run can extend them if not, and removes shards that they contain if they are. A
   !> run that shares the output with others removes no files.
   subroutine lock_and_resume(is_fresh, plan, output, error)
      logical, intent(in) :: is_fresh   !! true for --fresh: earlier results are removed
      type(plan_type), intent(in) :: plan
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error

      if (is_fresh) then
         call lock_and_clear(output, error)
         if (.not. allocated(error)) call remove_file(output%path, error)
      else
         call take_lock(output%path, output%lock, error, output%is_shared)
         if (.not. allocated(error)) &
            call count_stored_samples(output%path, output%store%identity, output%n_stored, error)
         if (allocated(output%n_stored)) then
            output%is_complete = all(output%n_stored(:size(plan%cases)) >= plan%cases%n_samples)
            if (output%is_complete .and. plan%n_realizations > 0) output%is_complete = &
               has_realizations(output%path, plan%n_points, plan%n_realizations)
            if (output%is_complete .and. plan%has_structure .and. .not. output%is_shared) &
               call mark_incomplete(plan, output, error)
            if (.not. (allocated(error) .or. output%is_complete)) then
               call refuse_loss(plan, output%n_stored, output%path, error)
            else if (.not. (allocated(error) .or. output%is_shared)) then
               call remove_merged_shards(output%store, output%lock, output%n_stored, error)
            end if
         end if
      end if
      if (.not. allocated(output%n_stored)) output%n_stored = spread(0, 1, size(plan%cases))
      if (.not. (allocated(error) .or. output%is_complete .or. output%is_shared)) &
         call remove_leftovers(output%store, error)
   end subroutine lock_and_resume

   !> Refuses to make results anew without the spectra of their samples, or with fewer samples or
   !> audited samples, for instance for a larger audit. With accuracy%sample_until_met the run
   !> continues to the samples that they hold.
   pure subroutine refuse_loss(plan, n_samples, path, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_samples(:)   !! (case and audit) samples in the file
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: final
      character(:), allocatable :: noun, remedy
      integer :: c, wanted(size(n_samples))

      if (all(n_samples == 0)) return
      if (plan%output%spectrum .and. .not. plan%output%keeps_spectra(maxval(n_samples))) then
         call raise(error, exit_file, path//': has no spectra of its samples (output%samples = '// &
                    '.false.), so that nothing can be added: choose another --output, or '// &
                    'discard it with --fresh')
         return
      end if
      final = plan
      if (plan%accuracy%sample_until_met) then
         final%cases%n_samples = max(final%cases%n_samples, n_samples(:size(final%cases)))
         call add_audits(final)
      end if
      wanted = 0
      wanted(:size(final%cases)) = final%cases%n_samples
      if (all(n_samples <= wanted)) return
      c = maxloc(n_samples - wanted, 1)
      noun = 'sample'
      remedy = 'campaign%n_samples = '//to_text(n_samples(c))
      if (c > size(n_samples)/2) then
         noun = 'audited sample'
         remedy = 'a larger accuracy%audit'
      end if
      call raise(error, exit_file, path//' holds '//counted(n_samples(c), noun, noun//'s')// &
                 ' of a case, the scene asks for '//to_text(wanted(c))// &
                 ' and for results that it lacks: '//remedy//' keeps them; or choose another '// &
                 '--output')
   end subroutine refuse_loss

   !> Marks a results file as incomplete if a case needs more samples for the scene's target, or has
   !> estimates of another kind or other percentiles than the scene asks for. A case with more
   !> samples than the scene asks for keeps its samples and estimates.
   subroutine mark_incomplete(plan, output, error)
      type(plan_type), intent(in) :: plan
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error
      type(case_errors), allocatable :: errors(:)
      type(plan_type) :: stored
      character(12) :: wanted(size(plan%cases))
      integer :: i
      logical :: is_same

      call read_errors(output%path, count(plan%cases%audits == 0), errors, error)
      if (allocated(error)) return
      stored = plan
      stored%cases%n_samples = output%n_stored(:size(plan%cases))
      wanted = estimators_of(find_pools(stored), size(wanted))
      do i = 1, size(errors)
         if (plan%accuracy%sample_until_met .and. &
             needs_more_samples(slip_error_of(errors(i)%statistics, 0, .false.), &
                                plan%accuracy%target_statistical)) output%is_complete = .false.
         if (errors(i)%estimator == '') cycle
         is_same = errors(i)%estimator == wanted(i) .and. &
                   size(errors(i)%percentiles) == size(plan%output%percentiles)
         if (is_same) is_same = all(abs(errors(i)%percentiles - plan%output%percentiles) <= 0.0_wp)
         if (is_same) cycle
         if (output%n_stored(i) == plan%cases(i)%n_samples) then
            output%is_complete = .false.
         else
            output%has_other_estimates = .true.
         end if
      end do
   end subroutine mark_incomplete

   !> Updates the finished samples after the plan has grown or other runs have worked. Collective.
   subroutine update_finished(self, plan, error)
      class(output_type), intent(inout) :: self
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(stored_samples) :: stored

      call self%list_stored(plan, stored, error)
      self%is_finished = finished_samples(stored%shards, plan%cases%n_samples)
   end subroutine update_finished

   !> Lists the samples in the shards and in an earlier results file. The root lists the shards for
   !> all ranks, as other machines may see new files late; an error is set on the root. Collective.
   subroutine list_stored(self, plan, stored, error)
      class(output_type), intent(in) :: self
      type(plan_type), intent(in) :: plan
      type(stored_samples), intent(out) :: stored
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      real(wp), allocatable :: numbers(:, :)   ! (shard; case, first and last sample)
      integer :: i

      if (self%world%is_root()) call list_shards(self%store, shards, error)
      if (.not. allocated(shards)) allocate (shards(0))
      numbers = reshape(real([shards%case_number, shards%first, shards%last], wp), &
                        [size(shards), 3])
      call self%world%broadcast(numbers)
      shards = [(shard_type(nint(numbers(i, 1)), nint(numbers(i, 2)), nint(numbers(i, 3))), &
                 i=1, size(numbers, 1))]
      call sort_shards(self%store, [shards, stored_in_results(self%n_stored, block_width(plan), &
                                                              shards)], stored)
   end subroutine list_stored

   !> Checks the shards by reading them, each on one rank; an error of this rank is its first
   !> damaged shard. With --share reads one shard: the run that merges them reads all.
   subroutine verify(self, stored, error)
      class(output_type), intent(in) :: self
      type(stored_samples), intent(in) :: stored   !! equal on all ranks
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: block
      integer :: i

      do i = 1 + self%world%rank, min(size(stored%shards), merge(1, huge(1), self%is_shared)), &
         self%world%n_ranks
         if (stored%shards(i)%group /= '') cycle   ! in a results file, which was checked before
         call read_shard(stored%store, stored%shards(i), block, error)
         if (allocated(error)) return
      end do
   end subroutine verify

   !> Creates the results file and writes its provenance as attributes. Nothing else in a results
   !> file differs between two equal runs.
   subroutine begin_file(self, plan, file, error)
      class(output_type), intent(in) :: self
      type(plan_type), intent(in) :: plan
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

      call create_unfinished(self%path, self%store%identity, file, error)
      if (allocated(error)) return
      root = hdf5_object(file, '/')
      call root%attribute('seed', plan%seed)
      call root%attribute('n_ranks', self%world%n_ranks)
      call root%attribute('title', plan%title)
      call root%attribute('scene', self%scene)
      call root%attribute('overrides', self%overrides(:len(self%overrides) - 1))
      call root%attribute('git_commit', git_commit)
      call root%attribute('compiler', compiler_version())
      call root%attribute('flags', compiler_flags)
      call root%attribute('created', now())
      call root%take_error(error)
      if (allocated(error)) call discard_file(file)
   end subroutine begin_file

   !> Date and time with the offset from UTC (ISO 8601).
   function now() result(text)
      character(:), allocatable :: text
      character(5) :: zone
      character(8) :: date
      character(10) :: time

      call date_and_time(date, time, zone)
      text = date(1:4)//'-'//date(5:6)//'-'//date(7:8)//'T'//time(1:2)//':'//time(3:4)//':'// &
             time(5:6)//zone(1:3)//':'//zone(4:5)
   end function now

   !> True if this rank is to march a block: with --share, if no other run has claimed or stored it.
   logical function claim(self, block) result(is_ours)
      class(output_type), intent(in) :: self
      type(block_range), intent(in) :: block

      is_ours = .true.
      if (.not. self%is_shared) return
      is_ours = self%lock%claim(lock_number(block))
      if (.not. is_ours) return
      ! another run may have stored it before this claim
      is_ours = .not. exists(shard_path(self%store, shard_type(block_range=block)))
      if (.not. is_ours) call self%lock%release_claim(lock_number(block))
   end function claim

   !> Releases a claimed block.
   subroutine release(self, block)
      class(output_type), intent(in) :: self
      type(block_range), intent(in) :: block

      if (self%is_shared) call self%lock%release_claim(lock_number(block))
   end subroutine release

   !> Number of a block in the lock, equal for every run.
   pure integer(long) function lock_number(block) result(number)
      type(block_range), intent(in) :: block

      number = block%case_number*2_long**32 + block%first
   end function lock_number

   !> Unlocks the output, removes an empty store and ends the run if any rank has an error. If
   !> another run has taken the output, reports that as the cause. Collective.
   subroutine stop_on(self, error)
      class(output_type), intent(inout) :: self
      type(error_type), allocatable, intent(in) :: error
      type(error_type), allocatable :: ignored, reason

      if (.not. self%world%any_true(allocated(error))) return
      call self%lock%check_ownership(reason)
      if (self%lock%is_held() .and. .not. (allocated(reason) .or. self%is_shared)) &
         call remove_file(self%store%folder, ignored)   ! unless it has files
      if (allocated(error) .and. .not. allocated(reason)) reason = error
      call self%lock%release(ignored)
      call self%world%stop_on(reason)
   end subroutine stop_on

   !> Unlocks the output and ends the program; finished shards stay. Collective.
   subroutine end_run(self, exit_code)
      class(output_type), intent(inout) :: self
      integer, intent(in) :: exit_code
      type(error_type), allocatable :: ignored   ! a remaining lock file is not a lock

      call self%lock%release(ignored)
      call stop_world(exit_code)
   end subroutine end_run

end module driver_output
