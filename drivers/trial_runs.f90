!> Settings of a scene measured by all ranks together.
module driver_trial_runs
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_terminal, only: say
   use core_text, only: counted, duration, to_text
   use driver_deadline, only: time_to_stop
   use io_progress, only: progress_type
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: world_type
   use tradeoff_marches, only: run_task
   use tradeoff_pilot, only: choose_every
   use tradeoff_task_results, only: published_numbers, task_result
   use tradeoff_tasks, only: new_tradeoff, scope_type, tradeoff_type
   implicit none(type, external)
   private
   public :: measure_settings

contains

   !> Marches what the scope names; every rank gets all results. Collective.
   subroutine measure_settings(world, plan, force, scope, is_quiet, tradeoff, is_stopped, error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      type(scope_type), intent(in) :: scope
      logical, intent(in) :: is_quiet
      type(tradeoff_type), intent(out) :: tradeoff
      logical, intent(out) :: is_stopped     !! early, as asked: results are missing
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
      if (.not. is_quiet) &
         call say(to_text(size(tradeoff%tasks))//' trial marches, '// &
                  duration(tradeoff%seconds/world%n_ranks)//' on '// &
                  counted(world%n_ranks, 'rank', 'ranks'))
      call share_tasks(world, tradeoff, is_quiet, error)
      is_stopped = world%any_true(time_to_stop())
   end subroutine measure_settings

   !> Shares out the tasks among the ranks; then all have all results. Collective.
   subroutine share_tasks(world, tradeoff, is_quiet, error)
      type(world_type), intent(in) :: world
      type(tradeoff_type), intent(inout) :: tradeoff
      logical, intent(in) :: is_quiet
      type(error_type), allocatable, intent(out) :: error
      type(work_counter) :: counter
      type(progress_type) :: progress
      integer :: owner(size(tradeoff%tasks))
      logical :: is_abandoned
      integer :: i, n

      n = size(tradeoff%tasks)
      owner = -1
      call new_counter(world, n, counter)
      if (.not. is_quiet) call progress%start(n, 0, 'marches')
      is_abandoned = .false.
      do
         i = counter%next(stops=allocated(error) .or. is_abandoned)
         if (i == 0) exit
         call progress%show(max(i - world%n_ranks, 0))
         call run_task(tradeoff, i, time_to_stop, is_abandoned, error)
         owner(i) = world%rank
      end do
      call counter%close()
      call progress%finish()
      do i = 1, n
         owner(i) = world%maximum(owner(i))
         if (owner(i) >= 0) call share_result(world, owner(i), tradeoff%found(i))
      end do
   end subroutine share_tasks

   !> Hands a result of one rank to all; collective.
   subroutine share_result(world, owner, found)
      type(world_type), intent(in) :: world
      integer, intent(in) :: owner
      type(task_result), intent(inout) :: found

      call world%broadcast(found%cost, owner)
      call world%broadcast(found%n_samples, owner)
      associate (errors => found%errors)
         call world%broadcast(errors%slip, owner)
         call world%broadcast(errors%slip_error, owner)
         call world%broadcast(errors%slip_mean, owner)
         call world%broadcast(errors%slip_std, owner)
         call world%broadcast(errors%psd_mean, owner)
         call world%broadcast(errors%psd_percentiles, owner)
         call world%broadcast(errors%band_ratio, owner)
         call world%broadcast(errors%band_ratio_error, owner)
      end associate
      call share_published(found%value)
      call share_published(found%plain_error)
      call share_published(found%gain)
      call world%broadcast(found%slip_fraction, owner)
      call world%broadcast(found%ratio_without, owner)

   contains

      subroutine share_published(of)
         type(published_numbers), intent(inout) :: of

         call world%broadcast(of%slip, owner)
         call world%broadcast(of%slip_std, owner)
         call world%broadcast(of%band_ratio, owner)
         call world%broadcast(of%psd_mean, owner)
         call world%broadcast(of%psd_percentiles, owner)
      end subroutine share_published

   end subroutine share_result

end module driver_trial_runs
