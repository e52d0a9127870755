!> Steps that several commands share: they read the plan, and refuse one without a solution.
module driver_campaign
   use campaign_plan, only: plan_type
   use config_force_file, only: check_force, force_label
   use config_plan, only: build_plan
   use config_scene, only: complaint_list, read_scene, scene_type
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_text, only: line_feed, to_text
   use driver_command_line, only: command_line
   use io_force, only: read_force_hdf5
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: load_plan, refuse_unsolved

contains

   !> Reads the scene and its files, and makes the plan. All complaints become one error.
   subroutine load_plan(line, scene, plan, error)
      type(command_line), intent(in) :: line
      type(scene_type), intent(out) :: scene   !! its force has size 0 without a force file
      type(plan_type), intent(out) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(complaint_list) :: complaints

      call read_scene(line%scene, line%overrides, scene, complaints)
      if (complaints%n == 0 .and. scene%force_is_hdf5) then
         call read_force_hdf5(scene%force_path, scene%integration%dt, scene%force, error)
         if (allocated(error)) then
            call complaints%add_general(error%message)
         else   ! it is checked as one in text form
            scene%n_force_values = size(scene%force, 1)
            scene%force_label = force_label(scene%force)
            call check_force(scene%force_path, scene%force, scene%integration%n_steps, &
                             scene%n_forces(), merge(max(scene%campaign%n_samples, 1), 0, &
                                                     scene%excitation%per_sample), complaints)
         end if
      end if
      if (complaints%n == 0) call build_plan(scene, plan, complaints)
      if (complaints%n > 0) call raise(error, exit_bad_input, complaints%text)
      if (.not. allocated(scene%force)) allocate (scene%force(0:0, 0))
   end subroutine load_plan

   !> Refuses a plan with motion if any process has no solution, and one without if none has.
   subroutine refuse_unsolved(plan, models, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: reasons
      integer :: i, n

      n = 0
      reasons = ''
      do i = 1, size(models)
         if (models(i)%is_solved .or. .not. allocated(models(i)%reason)) cycle
         n = n + 1
         if (n > 1) reasons = reasons//line_feed
         reasons = reasons//'process '//to_text(i)//': '//models(i)%reason
      end do
      if (n == 0) return
      if (plan%has_structure .or. n == size(models)) call raise(error, exit_no_solution, reasons)
   end subroutine refuse_unsolved

end module driver_campaign
