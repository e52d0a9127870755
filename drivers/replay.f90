!> `entroslip replay`: repeats one sample of a campaign and keeps all its results.
module driver_replay
   use campaign_plan, only: plan_type
   use campaign_runner, only: runner_type
   use campaign_size, only: refuse_oversize
   use config_scene, only: scene_type
   use core_error, only: error_type, exit_bad_input, exit_done, raise
   use core_text, only: counted, shell_word, to_text
   use driver_campaign, only: load_plan, refuse_unsolved
   use driver_command_line, only: command_line
   use driver_deadline, only: end_if_requested, start_watch
   use driver_output, only: open_new_output, output_type
   use driver_processes, only: solve_processes
   use driver_results, only: write_results
   use driver_run, only: march_campaign, prepare_march
   use driver_trial_runs, only: choose_setting
   use io_progress, only: inform, set_quiet
   use io_store, only: remove_store
   use parallel_world, only: start_world, world_type
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: replay

contains

   !> Runs the command `replay`, if the campaign has the case and the sample: one rank marches; all
   !> ranks share a long search for the process. Collective.
   subroutine replay(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(scene_type) :: scene
      type(plan_type) :: plan
      type(output_type) :: output
      type(runner_type) :: runner
      type(process_model_type), allocatable :: models(:)
      character(:), allocatable :: choice
      character(64) :: ending   ! of the default name of the output: '_c007_s0042.h5'
      type(error_type), allocatable :: error, ignored
      integer :: p

      call start_watch()
      call start_world(world)
      call set_quiet(line%has('--quiet') .or. .not. world%is_root())
      call load_plan(line, scene, plan, error)
      if (.not. allocated(error)) then
         if (line%case_number > size(plan%cases)) then
            call raise(error, exit_bad_input, '--case '//to_text(line%case_number)// &
                       ': the scene has '//counted(size(plan%cases), 'case', 'cases'))
         else if (line%sample > plan%cases(line%case_number)%n_samples .and. &
                  .not. plan%accuracy%sample_until_met) then   ! which may have any sample
            call raise(error, exit_bad_input, '--sample '//to_text(line%sample)//': case '// &
                       to_text(line%case_number)//' has '// &
                       counted(plan%cases(line%case_number)%n_samples, 'sample', 'samples'))
         end if
      end if
      if (.not. allocated(error)) call refuse_oversize(plan, error)
      call world%stop_on(error)
      call choose_setting(world, scene, plan, choice)
      write (ending, '(a, i0.3, a, i0.4, a)') '_c', line%case_number, '_s', line%sample, '.h5'
      call open_new_output(world, line, scene, trim(ending), output)
      plan%output%history = .true.
      plan%output%transitions = .true.
      plan%output%energy = .true.
      plan%n_realizations = 0
      call prepare_march(world, plan, scene%force, runner, error)
      call output%stop_on(error)
      call solve_processes(world, plan, models, &
                           wanted=[(p == plan%cases(line%case_number)%process, &
                                    p=1, size(plan%processes))])
      call refuse_unsolved(plan, models, error)
      call output%stop_on(error)
      call end_if_requested(world, .false., output%lock)
      runner%plan%cases%n_samples = 0   ! but the wanted one
      runner%plan%cases(line%case_number)%n_samples = 1
      runner%plan%cases(line%case_number)%first_sample = line%sample
      call output%update_finished(runner%plan, error)
      call output%stop_on(error)
      call march_campaign(models, runner, output, error)
      if (allocated(error)) call remove_store(output%store, ignored)   ! a replay does not resume
      call output%stop_on(error)
      call end_if_requested(world, .false., output%lock)
      call write_results(runner%plan, models, runner, output, error)
      if (allocated(error)) call remove_store(output%store, ignored)
      call output%stop_on(error)
      call inform(output%path//': its history, transitions and energies. Draw it: '// &
                      'python -m entroslip '//shell_word(output%path)//' --out figures')
      call output%end_run(exit_done)
   end subroutine replay

end module driver_replay
