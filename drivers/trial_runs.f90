!> Settings of a scene measured by all ranks together.
module driver_trial_runs
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use driver_deadline, only: time_to_stop
   use io_progress, only: progress_type
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: world_type
   use tradeoff_pilot, only: choose_every
   use tradeoff_tasks, only: new_tradeoff, scope_type, tradeoff_type
   implicit none(type, external)
   private
   public :: measure_settings

contains

   !> Marches what the scope names; every rank gets all numbers. Collective.
   subroutine measure_settings(world, plan, force, scope, is_quiet, tradeoff, values, is_stopped, &
                               error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      type(scope_type), intent(in) :: scope
      logical, intent(in) :: is_quiet
      type(tradeoff_type), intent(out) :: tradeoff
      real(wp), allocatable, intent(out) :: values(:, :)   !! (value, task), see run_task
      logical, intent(out) :: is_stopped     !! early, as asked: the values are incomplete
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: folded_share(:, :)
      integer :: every

      every = 1
      if (plan%output%spectrum .and. world%is_root()) &
         call choose_every(plan, force, every, folded_share, error)
      call world%stop_on(error)
      call world%broadcast(every)
      call new_tradeoff(plan, force, every, scope, time_to_stop, tradeoff, error)
      call world%stop_on(error)
      is_stopped = world%any_true(time_to_stop())
      if (is_stopped) return
      call share_tasks(world, tradeoff, is_quiet, values, error)
      is_stopped = world%any_true(time_to_stop())
   end subroutine measure_settings

   !> Ranks claim tasks; then all learn all numbers. Collective.
   subroutine share_tasks(world, tradeoff, is_quiet, values, error)
      type(world_type), intent(in) :: world
      type(tradeoff_type), intent(in) :: tradeoff
      logical, intent(in) :: is_quiet
      real(wp), allocatable, intent(out) :: values(:, :)   !! (value, task)
      type(error_type), allocatable, intent(out) :: error
      type(work_counter) :: counter
      type(progress_type) :: progress
      integer(long) :: owner(size(tradeoff%tasks))
      real(wp), allocatable :: column(:)
      logical :: is_abandoned
      integer :: i, n

      n = size(tradeoff%tasks)
      allocate (values(tradeoff%n_values, n), source=0.0_wp)
      owner = -1
      call new_counter(world, int(n, long), counter)
      if (.not. is_quiet) call progress%start(n, 0, 'marches')
      do
         i = int(counter%next())
         if (i == 0) exit
         call progress%show(max(i - world%n_ranks, 0))
         call tradeoff%run_task(i, time_to_stop, values(:, i), is_abandoned, error)
         owner(i) = world%rank
         if (allocated(error) .or. is_abandoned) call counter%request_stop()
      end do
      call counter%close()
      call progress%finish()
      do i = 1, n
         owner(i) = world%maximum(owner(i))
         if (owner(i) < 0) cycle
         column = values(:, i)
         call world%broadcast(column, from=int(owner(i)))
         values(:, i) = column
      end do
   end subroutine share_tasks

end module driver_trial_runs
