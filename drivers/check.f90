!> `entroslip check`: a scene read and checked, and what running it would mean. Writes nothing.
module driver_check
   use, intrinsic :: iso_fortran_env, only: output_unit
   use config_scene, only: scene_type
   use config_summary, only: summary_text
   use core_error, only: error_type, exit_done
   use core_kinds, only: wp
   use driver_campaign, only: load_plan, refuse_unsolved
   use driver_command_line, only: command_line
   use driver_foresight, only: foresee_need
   use driver_target, only: keep_targets
   use ensemble_forecast, only: measure_cost
   use ensemble_pilot, only: choose_every
   use ensemble_plan, only: plan_type
   use ensemble_runner, only: block_width
   use parallel_world, only: start_world, stop_world, world_type
   use process_fit, only: foresee_process
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: check

contains

   !> The command: collective.
   subroutine check(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(scene_type) :: scene
      type(plan_type) :: plan
      type(process_model_type), allocatable :: models(:)
      character(:), allocatable :: choice, need
      real(wp), allocatable :: force(:, :)
      real(wp) :: audit_nanoseconds, nanoseconds
      type(error_type), allocatable :: error

      call start_world(world)
      call load_plan(line, scene, plan, force, error)
      call world%stop_on(error)
      call keep_targets(world, force, scene, plan, choice)
      nanoseconds = 0.0_wp
      audit_nanoseconds = 0.0_wp
      if (plan%has_chain .and. world%is_root()) &
         call measure(plan, force, nanoseconds, audit_nanoseconds, error)
      call world%stop_on(error)
      call foresee_need(world, plan, force, nanoseconds, need)
      if (world%is_root()) then
         call foresee_processes(plan, models)
         write (output_unit, '(a)') summary_text(scene, plan, nanoseconds, world%n_ranks, &
                                                 block_width(plan), models, audit_nanoseconds)
         if (choice /= '') write (output_unit, '(a)') choice
         if (need /= '') write (output_unit, '(a)') need
         call refuse_unsolved(plan, models, error)
      end if
      call world%stop_on(error)
      call stop_world(exit_done)
   end subroutine check

   !> What a sample-step costs, spectra of as many steps as they will have [ns].
   subroutine measure(plan, force, nanoseconds, audit_nanoseconds, error)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)
      real(wp), intent(out) :: nanoseconds, audit_nanoseconds
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: folded_share(:, :)
      integer :: every

      every = 1
      if (plan%output%spectrum) call choose_every(plan, force, every, folded_share, error)
      if (.not. allocated(error)) &
         call measure_cost(plan, force, every, nanoseconds, audit_nanoseconds, error)
   end subroutine measure

   !> Which processes have a solution, as far as it is known before they are fitted.
   subroutine foresee_processes(plan, models)
      type(plan_type), intent(in) :: plan
      type(process_model_type), allocatable, intent(out) :: models(:)
      type(error_type), allocatable :: error
      integer :: i

      allocate (models(size(plan%processes)))
      do i = 1, size(models)
         models(i)%request = plan%processes(i)
         call foresee_process(plan%processes(i), plan%seed, error)
         models(i)%is_solved = .not. allocated(error)
         if (allocated(error)) models(i)%reason = error%message
      end do
   end subroutine foresee_processes

end module driver_check
