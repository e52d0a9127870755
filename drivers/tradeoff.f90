!> `entroslip tradeoff`: measures on a small part of a scene what accuracy costs.
module driver_tradeoff
   use campaign_plan, only: plan_type
   use config_scene, only: scene_type
   use core_error, only: error_type, exit_bad_input, exit_done, raise
   use core_kinds, only: wp
   use core_text, only: counted
   use driver_campaign, only: load_plan, refuse_unsolved
   use driver_command_line, only: command_line
   use driver_deadline, only: end_if_requested, seconds_so_far, set_limit, start_watch, &
                              time_to_stop
   use driver_output, only: open_new_output, output_type
   use driver_processes, only: solve_processes
   use driver_tradeoff_text, only: tradeoff_text
   use driver_trial_runs, only: measure_settings
   use io_hdf5, only: hdf5_file
   use io_progress, only: inform, set_quiet
   use io_results, only: finish_results
   use io_tradeoff_results, only: tradeoff_findings, write_tradeoff
   use parallel_world, only: start_world, world_type
   use process_model, only: process_model_type
   use tradeoff_effects, only: variant_rows_of
   use tradeoff_front, only: components_of, setting_rows_of, size_rows_of, spectrum_rows_of
   use tradeoff_tasks, only: trial_scope
   use tradeoff_variants, only: compare_orders, list_variants
   implicit none(type, external)
   private
   public :: tradeoff

   !> Expected processor time of the comparison of settings [s]. Batches and spectra take the same,
   !> variants a third.
   real(wp), parameter :: budget = 15.0_wp

contains

   !> Runs the command `tradeoff`. Collective.
   subroutine tradeoff(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(scene_type) :: scene
      type(plan_type) :: plan
      type(tradeoff_findings) :: found
      type(process_model_type), allocatable :: models(:)
      type(output_type) :: output
      type(hdf5_file) :: file
      type(error_type), allocatable :: error

      call start_watch()
      call start_world(world)
      call set_quiet(line%has('--quiet') .or. .not. world%is_root())
      call load_plan(line, scene, plan, error)
      if (.not. allocated(error) .and. plan%output%harmonic) &
         call raise(error, exit_bad_input, 'entroslip tradeoff needs noise or a force file: '// &
                    "excitation%kind = 'sine' has no spectra to compare")
      call world%stop_on(error)
      call set_limit(plan%walltime)
      call open_new_output(world, line, scene, '_tradeoff.h5', output)
      call solve_processes(world, plan, models)
      call refuse_unsolved(plan, models, error)
      call output%stop_on(error)
      call end_if_requested(world, .false., output%lock)
      if (plan%has_structure) &
         call measure_march(world, plan, scene%force, models, found, error)
      call output%stop_on(error)
      call end_if_requested(world, .false., output%lock)
      if (world%is_root()) then
         found%plan = plan
         found%n_ranks = world%n_ranks
         call compare_orders(plan, found%orders)
         call inform(tradeoff_text(found, models)//output%path)
         call output%begin_file(plan, file, error)
         if (.not. allocated(error)) then
            call write_tradeoff(file, found, error)
            call finish_results(file, output%lock, seconds_so_far(), error)
         end if
      end if
      call output%stop_on(error)
      call output%end_run(exit_done)
   end subroutine tradeoff

   !> Measures settings, spectra and the components of the error, unless it is requested to stop.
   !> Collective.
   subroutine measure_march(world, plan, force, models, found, error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      type(process_model_type), intent(in) :: models(:)
      type(tradeoff_findings), intent(inout) :: found
      type(error_type), allocatable, intent(out) :: error
      type(trial_scope) :: scope
      type(plan_type) :: varied   ! plan with other orders and other lengths of the fit

      scope = trial_scope(budget=budget, for_table=.true., is_statistical=.true., models=models)
      call list_variants(plan, models, scope%variants)
      if (size(scope%variants) > 0) &
         call inform('fitting '//counted(size(scope%variants), 'variant', 'variants')// &
                  ' of processes')
      varied = plan
      varied%processes = scope%variants%request
      call solve_processes(world, varied, scope%variant_models)
      associate (found_ones => scope%variant_models)   ! a lower order is another variant
         found_ones%is_solved = found_ones%is_solved .and. &
                                found_ones%order == varied%processes%order
      end associate
      if (world%any_true(time_to_stop())) return
      call measure_settings(world, plan, force, scope, found%tradeoff, error)
      if (world%any_true(time_to_stop())) return
      if (allocated(error)) return
      found%settings = setting_rows_of(found%tradeoff)
      found%spectra = spectrum_rows_of(found%tradeoff)
      found%errors = components_of(found%tradeoff, found%settings(found%tradeoff%own), &
                                   plan%integration%n_steps - plan%integration%n_discard)
      found%sizes = size_rows_of(plan, found%tradeoff, found%settings(found%tradeoff%own), &
                                 found%errors)
      found%variants = variant_rows_of(found%tradeoff)
   end subroutine measure_march

end module driver_tradeoff
