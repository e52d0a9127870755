!> What the commands that march have in common: scene and plan, processes solved, friction drawn.
module driver_campaign
   use config_force_file, only: read_force_file
   use config_plan, only: build_plan
   use config_scene, only: read_scene, scene_type
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use driver_command_line, only: command_line
   use ensemble_plan, only: plan_type
   use parallel_signals, only: stop_requested
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: world_type
   use process_fit, only: fit_process
   use process_model, only: process_model_type
   use process_packing, only: pack_model, unpack_model
   implicit none(type, external)
   private
   public :: solve_processes

contains

   !> Each process once, spread over the ranks, the longest first; all ranks get all models; collective.
   !> Stopped early, the rest stays unsolved without a reason.
   subroutine solve_processes(world, plan, models)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(process_model_type), allocatable, intent(out) :: models(:)
      type(work_counter) :: counter
      real(wp), allocatable :: numbers(:)
      integer(long) :: owner(size(plan%processes))
      integer :: order(size(plan%processes)), i, item

      allocate (models(size(plan%processes)))
      if (size(models) == 0) return
      models%request = plan%processes
      order = sort_order(-real(plan%processes%order, wp))
      owner = -1
      call new_counter(world, size(models, kind=long), counter)
      do
         if (stop_requested()) call counter%request_stop()
         item = int(counter%next())
         if (item == 0) exit
         i = order(item)
         call fit_process(plan%processes(i), plan%seed, models(i))
         owner(i) = world%rank
      end do
      call counter%close()
      do i = 1, size(models)
         owner(i) = world%maximum(owner(i))
         if (owner(i) < 0) cycle
         if (owner(i) == world%rank) numbers = pack_model(models(i))
         call world%broadcast(numbers, from=int(owner(i)))
         call unpack_model(numbers, models(i))
      end do
   end subroutine solve_processes

end module driver_campaign
