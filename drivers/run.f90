!> `entroslip run`: solves the processes, marches the samples and writes the results file.
module driver_run
   use campaign_plan, only: add_audits, plan_type
   use campaign_results, only: block_result, memory_of_block
   use campaign_runner, only: block_width, prepare_runner, runner_type
   use campaign_sample, only: run_block
   use campaign_size, only: refuse_oversize
   use campaign_study, only: block_range, claim_type, draw_friction, name_sample, open_claims
   use config_scene, only: scene_type
   use core_error, only: error_type, exit_bad_input, exit_done, raise
   use core_kinds, only: long, wp
   use core_text, only: counted, duration, to_text
   use driver_campaign, only: load_plan, refuse_unsolved
   use driver_command_line, only: command_line
   use driver_deadline, only: end_if_requested, seconds_so_far, set_limit, start_watch, &
                              time_to_stop
   use driver_judge_results, only: add_samples, judge
   use driver_output, only: open_output, output_type
   use driver_processes, only: solve_processes
   use driver_results, only: write_results
   use driver_trial_runs, only: choose_setting, choose_spectrum_step
   use io_files, only: exists
   use io_progress, only: inform, progress_type, set_quiet
   use io_shards, only: write_shard
   use io_store, only: remove_store, shard_store
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: start_world, world_type
   use process_model, only: branch_note, process_model_type
   implicit none(type, external)
   private
   public :: run, march_campaign, prepare_march

contains

   !> Runs the command `run`. Collective.
   subroutine run(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(scene_type) :: scene
      type(plan_type) :: plan
      type(output_type) :: output
      type(runner_type) :: runner
      type(process_model_type), allocatable :: models(:)
      character(:), allocatable :: choice, errors
      type(error_type), allocatable :: error, ignored

      call start_watch()
      call start_world(world)
      call set_quiet(line%has('--quiet') .or. .not. world%is_root())
      call load_plan(line, scene, plan, error)
      if (.not. allocated(error)) call check_share(line, plan, error)
      if (.not. allocated(error)) call refuse_oversize(plan, error)
      call world%stop_on(error)
      call set_limit(plan%walltime)
      call choose_setting(world, scene, plan, choice)
      call add_audits(plan)
      call open_output(world, line, scene, plan, output)
      if (output%is_complete) then
         if (world%is_root()) then
            call inform(output%path//' is complete: nothing to do'//surplus_text(plan, output))
            call judge(output%path, plan, errors, error)
         end if
         call output%stop_on(error)
         call output%end_run(exit_done)
         return
      end if

      if (choice /= '') call inform(choice(:len(choice) - 1))
      call solve_processes(world, plan, models, output, error)
      call output%stop_on(error)
      call end_if_requested(output%world, .true., output%lock)
      call refuse_unsolved(plan, models, error)
      if (allocated(error) .and. world%is_root() .and. .not. output%is_shared) &
         call remove_store(output%store, ignored)   ! it has no samples
      call output%stop_on(error)
      call print_process_notes(models)
      if (plan%has_structure) then
         call prepare_march(world, plan, scene%force, runner, error)
         call output%stop_on(error)
         call march_until_met(models, runner, output)
         plan = runner%plan
         if (output%is_shared) then
            call end_shared_run(plan, output)
            return
         end if
      end if
      call write_results(plan, models, runner, output, error)
      call output%stop_on(error)
      if (world%is_root()) then
         call judge(output%path, plan, errors, error)
         call inform(summary(plan, output))
         call inform(duration(seconds_so_far())//errors)
         if (exists(output%store%folder)) &
            call inform('samples beyond these stay in '//output%store%folder)
      end if
      call output%stop_on(error)
      call output%end_run(exit_done)
   end subroutine run

   !> Text on samples in the results beyond those that the scene asks for, and on estimates that
   !> differ from those that the scene asks for; '' if there are none.
   pure function surplus_text(plan, output) result(text)
      type(plan_type), intent(in) :: plan
      type(output_type), intent(in) :: output
      character(:), allocatable :: text
      integer :: n_stored, n_wanted

      n_wanted = sum(plan%cases%n_samples, plan%cases%audits == 0)
      n_stored = sum(pack(output%n_stored(:size(plan%cases)), plan%cases%audits == 0))
      text = ''
      if (n_stored > n_wanted) text = '; it holds '//to_text(n_stored)// &
                                      ' samples, the scene asks for '//to_text(n_wanted)
      if (output%has_other_estimates) &
         text = text//'; its estimator or percentiles are not those of the scene: '// &
                'campaign%n_samples = '//to_text(maxval(output%n_stored))//' computes them again'
   end function surplus_text

   !> Refuses --share for a scene without samples or with sample_until_met.
   subroutine check_share(line, plan, error)
      type(command_line), intent(in) :: line
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error

      if (line%has('--share') .and. .not. plan%has_structure) &
         call raise(error, exit_bad_input, '--share: the scene has no samples to be shared')
      if (line%has('--share') .and. plan%accuracy%sample_until_met) &
         call raise(error, exit_bad_input, '--share: several runs cannot sample until a target '// &
                    'is met: leave out accuracy%sample_until_met')
   end subroutine check_share

   !> Ends a run with --share; a run without it merges the shards. Collective.
   subroutine end_shared_run(plan, output)
      type(plan_type), intent(in) :: plan
      type(output_type), intent(inout) :: output
      type(error_type), allocatable :: error
      integer :: n

      call output%update_finished(plan, error)
      call output%stop_on(error)
      if (output%world%is_root()) then
         n = sum(plan%cases%n_samples) - count(output%is_finished)
         if (n == 0) then
            call inform('every sample is there: run without --share to make '//output%path)
         else
            call inform('no sample is left for this run: other runs march or left '// &
                            counted(n, 'sample', 'samples')//'; at the end, run without --share')
         end if
      end if
      call output%end_run(exit_done)
   end subroutine end_shared_run

   !> Prepares the marcher, the force record and the layout of the spectra on every rank.
   !> Collective.
   subroutine prepare_march(world, plan, force, runner, error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(inout) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (0:n_steps, record) force file [N]; else size 0
      type(runner_type), intent(out) :: runner
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: folded_share(:, :)

      call choose_spectrum_step(world, plan, force, huge(1.0_wp), error, folded_share)
      if (.not. allocated(error)) call prepare_runner(plan, force, runner, error)
      call move_alloc(folded_share, runner%folded_share)
   end subroutine prepare_march

   !> Marches all samples of the plan, and more until its target is met. Ends the run on an error or
   !> a request to stop. Collective.
   subroutine march_until_met(models, runner, output)
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(inout) :: runner
      type(output_type), intent(inout) :: output
      type(error_type), allocatable :: error
      integer :: increment
      logical :: has_more

      increment = maxval(runner%plan%cases%n_samples)
      has_more = .true.
      do while (has_more)
         call march_campaign(models, runner, output, error)
         call output%stop_on(error)
         call end_if_requested(output%world, .true., output%lock)
         call add_samples(models, increment, runner%plan, output, has_more, error)
         call output%stop_on(error)
      end do
   end subroutine march_until_met

   !> Marches every sample that is not stored yet: ranks claim samples, march them and write shards.
   !> Returns when all are done, or early after a request to stop or an error. Collective.
   subroutine march_campaign(models, runner, output, error)
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(inout) :: runner
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error
      type(work_counter) :: counter
      type(progress_type) :: progress
      type(claim_type), allocatable :: claims(:)
      integer :: item

      claims = open_claims(runner%plan, output%is_finished, output%world%n_ranks, output%is_shared)
      call new_counter(output%world, size(claims), counter)
      call progress%start(sum(runner%plan%cases%n_samples), count(output%is_finished), 'samples')
      do
         item = counter%next(stops=time_to_stop() .or. allocated(error))
         if (item == 0) exit
         ! samples of earlier claims, except the last n_ranks, which may still be marched
         call progress%show(sum(claims(:max(item - output%world%n_ranks, 0))%n_samples()) &
                            + count(output%is_finished))
         associate (ranges => claims(item)%ranges)
            if (.not. output%claim(ranges(1))) cycle
            call march_claim(models, ranges, runner, output%store, error)
            if (.not. allocated(error)) call output%lock%check_ownership(error)
            call output%release(ranges(1))
         end associate
      end do
      call counter%close()
      call progress%finish()
   end subroutine march_campaign

   !> Marches the samples of a claim block by block: one range, or several ranges as one block.
   !> Writes shards at the end, after each minute, and when the finished blocks take much memory.
   subroutine march_claim(models, ranges, runner, store, error)
      type(process_model_type), intent(in) :: models(:)
      type(block_range), intent(in) :: ranges(:)
      type(runner_type), intent(inout) :: runner
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: longest = 60.0_wp        ! time between shards [s]
      integer(long), parameter :: most = 2_long**26   ! memory of finished blocks [bytes]
      type(block_result), allocatable :: finished(:)
      type(error_type), allocatable :: shard_error
      type(block_range) :: block(size(ranges))   ! part of each range
      real(wp), allocatable :: friction(:, :)
      real(wp) :: began   ! time of the last shard [s]
      integer :: n, width

      width = block_width(runner%plan)
      allocate (finished((ranges(1)%last - ranges(1)%first)/width + 1))
      began = seconds_so_far()
      n = 0
      block = ranges
      do while (block(1)%first <= ranges(1)%last)
         block%last = min(block%first + width - 1, ranges%last)
         call draw_friction(runner%plan, models, block, friction)
         call run_block(runner, block(1)%case_number, friction, block(1)%first, time_to_stop, &
                        finished(n + 1), error)
         if (allocated(error)) call name_sample(runner%plan, block, error)
         if (allocated(error) .or. finished(n + 1)%n_samples == 0) exit
         n = n + 1
         if (seconds_so_far() - began > longest .or. &
             sum(memory_of_block(finished(:n))) > most) then
            call write_blocks(store, ranges, finished(:n), error)
            if (allocated(error)) return
            began = seconds_so_far()
            n = 0
         end if
         block%first = block%last + 1
      end do
      if (n > 0) call write_blocks(store, ranges, finished(:n), shard_error)
      if (.not. allocated(error)) call move_alloc(shard_error, error)
   end subroutine march_claim

   !> Writes consecutive blocks of one range as one shard, or one block of several ranges as a shard
   !> for each range.
   subroutine write_blocks(store, ranges, blocks, error)
      type(shard_store), intent(in) :: store
      type(block_range), intent(in) :: ranges(:)
      type(block_result), intent(inout) :: blocks(:)
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(ranges)
         if (size(ranges) > 1) then
            blocks%case_number = ranges(i)%case_number
            blocks%first_sample = ranges(i)%first
            blocks%n_samples = ranges(i)%last - ranges(i)%first + 1
            blocks%before = sum(ranges(:i - 1)%last - ranges(:i - 1)%first + 1)
         end if
         call write_shard(store, blocks, error)
         if (allocated(error)) return
      end do
   end subroutine write_blocks

   !> Line on the numbers of processes, cases and samples in the results.
   pure function summary(plan, output) result(text)
      type(plan_type), intent(in) :: plan
      type(output_type), intent(in) :: output
      character(:), allocatable :: text
      logical :: is_own(size(plan%cases))   ! true if the case is not an audit

      is_own = plan%cases%audits == 0
      text = ''
      if (size(plan%processes) > 0) &
         text = ', '//counted(size(plan%processes), 'process', 'processes')
      if (any(is_own)) &
         text = text//', '//counted(count(is_own), 'case', 'cases')//', '// &
                counted(sum(plan%cases%n_samples, is_own), 'sample', 'samples')
      if (.not. all(is_own)) &
         text = text//', '//to_text(sum(plan%cases%n_samples, (.not. is_own)))//' repeated'
      text = text(3:)//' in '//output%path
   end function summary

   !> Prints the processes that have no solution, with the reason, and those with alternating K(m).
   subroutine print_process_notes(models)
      type(process_model_type), intent(in) :: models(:)
      integer :: i

      do i = 1, size(models)
         if (allocated(models(i)%reason)) then
            if (.not. models(i)%is_solved) &
               call inform('process '//to_text(i)//' has no solution: '//models(i)%reason)
         end if
         if (len(branch_note(models(i))) > 0) &
            call inform('process '//to_text(i)//': '//branch_note(models(i)))
      end do
   end subroutine print_process_notes

end module driver_run
