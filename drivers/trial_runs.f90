!> Measures settings in trial marches on all ranks, and chooses for the targets of numerical error
!> the setting with the least work.
!>
!> The step stays that of the scene. A larger one would be another force, as `dt` is the distance of
!> its values; a smaller one would serve Newmark's scheme alone, and costs more than the settings
!> with the scene's step (bench/targets.py, docs/accuracy.md).
!>
!> The choice depends on measured errors and on counted work, not on times: it is the same on any
!> number of ranks and in any repetition. It becomes the setting of the scene, and so part of the
!> fingerprint of shards and results.
module driver_trial_runs
   use campaign_plan, only: plan_type
   use config_scene, only: scene_type
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: brief, counted, duration, labelled, line_feed, to_text
   use driver_deadline, only: end_if_requested, time_to_stop
   use io_progress, only: inform, progress_type
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: world_type
   use tradeoff_front, only: meets_targets, nearest_to_targets, setting_row, setting_rows_of
   use tradeoff_marches, only: run_task
   use tradeoff_pilot, only: choose_every
   use tradeoff_settings, only: reference_setting, setting_dt, setting_type, use_setting
   use tradeoff_task_results, only: band_ratio, slip
   use tradeoff_tasks, only: new_tradeoff, samples_of_block, trial_scope, tradeoff_type
   implicit none(type, external)
   private
   public :: choose_setting, choose_spectrum_step, measure_settings, setting_text

   real(wp), parameter :: budget = 3.0_wp   !! expected processor time of the trial marches [s]

contains

   !> Runs the trial marches of a scope, or none if they exceed scope%most_seconds: then no tasks
   !> are allocated. Every rank gets all results; after a request to stop some are missing.
   !> Collective.
   subroutine measure_settings(world, plan, force, scope, tradeoff, error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      type(trial_scope), intent(in) :: scope
      type(tradeoff_type), intent(out) :: tradeoff
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: thinned
      type(work_counter) :: counter
      type(progress_type) :: progress
      real(wp), allocatable :: cost(:)
      integer, allocatable :: owner(:)   ! (task) rank that has the result, else -1
      integer :: done, i, n

      thinned = plan
      call choose_spectrum_step(world, thinned, force, scope%most_seconds, error)
      call world%stop_on(error)
      call new_tradeoff(thinned, force, scope, time_to_stop, tradeoff, error)
      call world%stop_on(error)
      if (world%any_true(time_to_stop())) return
      if (.not. allocated(tradeoff%tasks)) return
      n = size(tradeoff%tasks)
      call inform(to_text(n)//' trial marches, '// &
                  duration(sum(tradeoff%seconds)/world%n_ranks)//' on '// &
                  counted(world%n_ranks, 'rank', 'ranks'))
      owner = spread(-1, 1, n)
      call new_counter(world, n, counter)
      call progress%start(n, 0, 'marches')
      do
         i = counter%next(stops=time_to_stop() .or. allocated(error))
         if (i == 0) exit
         done = max(i - world%n_ranks, 0)
         call progress%show(done, sum(tradeoff%seconds(:done))/sum(tradeoff%seconds))
         call run_task(tradeoff, i, time_to_stop, error)
         owner(i) = world%rank
      end do
      call counter%close()
      call progress%finish()
      cost = tradeoff%results%cost   ! zero, as the samples are, where another rank has the task
      call world%add_up(n, cost)
      tradeoff%results%cost = cost
      do i = 1, n
         owner(i) = world%maximum(owner(i))
         if (owner(i) < 0) cycle
         associate (found => tradeoff%results(i))
            found%n_samples = world%maximum(found%n_samples)
            call world%broadcast(found%errors, owner(i))
            call world%broadcast(found%value, owner(i))
            call world%broadcast(found%plain_error, owner(i))
            call world%broadcast(found%gain, owner(i))
            call world%broadcast(found%slip_fraction, owner(i))
            call world%broadcast(found%ratio_without, owner(i))
         end associate
      end do
   end subroutine measure_settings

   !> Chooses output%spectrum_every of a plan with spectra, the same on every rank; leaves it 0 if
   !> the pilot march is expected to take longer than most_seconds. Collective.
   subroutine choose_spectrum_step(world, plan, force, most_seconds, error, folded_share)
      type(world_type), intent(in) :: world
      type(plan_type), intent(inout) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      real(wp), intent(in) :: most_seconds   !! processor time [s]
      type(error_type), allocatable, intent(out) :: error
      !> (dof, case) share of the variance that is folded
      real(wp), allocatable, intent(out), optional :: folded_share(:, :)
      real(wp), allocatable :: share(:, :)

      if (.not. (plan%has_structure .and. plan%output%spectrum)) return
      if (plan%output%spectrum_every > 0 .and. .not. present(folded_share)) return
      if (world%is_root()) call choose_every(plan, force, most_seconds, share, error)
      plan%output%spectrum_every = world%maximum(plan%output%spectrum_every)   ! chosen from 0
      if (.not. present(folded_share)) return
      call world%broadcast(share)
      call move_alloc(share, folded_share)
   end subroutine choose_spectrum_step

   !> Replaces the scene's setting if the scene has a target of numerical error. Ends the run if no
   !> setting keeps it, or if it is asked to stop. The choice does not depend on campaign%n_samples,
   !> so that a campaign can be extended. Chooses nothing, and says so, if the marches are expected
   !> to take longer than most_seconds. Collective.
   subroutine choose_setting(world, scene, plan, choice, most_seconds)
      type(world_type), intent(in) :: world
      type(scene_type), intent(inout) :: scene
      type(plan_type), intent(inout) :: plan
      character(:), allocatable, intent(out) :: choice   !! lines on the choice; '' without target
      real(wp), intent(in), optional :: most_seconds   !! processor time [s]
      type(plan_type) :: trial   ! plan with at least a block of samples
      type(trial_scope) :: scope
      type(tradeoff_type) :: measured
      type(setting_row), allocatable :: rows(:)
      type(setting_row) :: nearest
      character(:), allocatable :: reached, target
      type(error_type), allocatable :: error
      integer :: chosen

      choice = ''
      associate (points => plan%accuracy%target_slip_points, &
                 ratio => plan%accuracy%target_band_ratio)
         if (.not. (plan%has_structure .and. max(points, ratio) > 0.0_wp)) return
         call inform('comparing settings for the targets of &accuracy')
         trial = plan
         where (trial%cases%process > 0) &
            trial%cases%n_samples = max(trial%cases%n_samples, samples_of_block(plan, scene%force))
         scope = trial_scope(budget=budget)
         if (present(most_seconds)) scope%most_seconds = most_seconds
         call measure_settings(world, trial, scene%force, scope, measured, error)
         call world%stop_on(error)
         call end_if_requested(world, .false.)
         if (.not. allocated(measured%tasks)) then
            choice = labelled('accuracy', 'the setting for the targets is left to run: its '// &
                              'trial marches take long')
            return
         end if
         rows = setting_rows_of(measured)
         chosen = minloc(rows%work, 1, mask=meets_targets(rows, points, ratio))
         if (chosen == 0) then
            nearest = rows(nearest_to_targets(rows, points, ratio))
            target = 'accuracy%target_band_ratio = '//to_text(ratio)
            reached = brief(nearest%error_bound(band_ratio))
            if (.not. meets_targets(nearest, points, 0.0_wp)) then
               target = 'accuracy%target_slip_points = '//to_text(points)
               reached = brief(nearest%error_bound(slip))//' points'
            end if
            call raise(error, exit_no_solution, target//': no setting keeps it; the nearest is '// &
                       setting_text(nearest%setting, plan%integration%dt)//' with '//reached// &
                       ' against '//setting_text(reference_setting, plan%integration%dt)// &
                       ', twice its standard error included')
         end if
         call world%stop_on(error)
      end associate
      call use_setting(rows(chosen)%setting, scene%integration)
      call use_setting(rows(chosen)%setting, plan%integration)
      choice = reason(rows(chosen), plan)
      scene%text = scene%text//line_feed//'! accuracy: '//choice//line_feed
      choice = labelled('accuracy', choice)
   end subroutine choose_setting

   !> Text on a choice, as "event, tolerance 1e-3: the least work at the scene's dt that keeps slip
   !> to 0.1 points (measured 2.2e-9)".
   pure function reason(row, plan) result(text)
      type(setting_row), intent(in) :: row
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      text = setting_text(row%setting, plan%integration%dt)// &
             ': the least work at the scene''s dt that keeps '
      associate (points => plan%accuracy%target_slip_points, &
                 ratio => plan%accuracy%target_band_ratio)
         if (points > 0.0_wp) text = text//'slip to '//brief(points)//' points (measured '// &
                                     brief(row%error(slip))//')'
         if (points > 0.0_wp .and. ratio > 0.0_wp) text = text//' and '
         if (ratio > 0.0_wp) text = text//'band ratios to '//brief(100*ratio)//' % (measured '// &
                                    brief(100*row%error(band_ratio))//')'
      end associate
   end function reason

   !> Text on a setting, as "event, tolerance 1e-3" or "newmark, dt 0.0042, 4 halvings".
   pure function setting_text(setting, dt) result(text)
      type(setting_type), intent(in) :: setting
      real(wp), intent(in) :: dt   !! step of the scene [s]
      character(:), allocatable :: text

      text = trim(setting%method)
      if (setting%parts /= setting%stride) text = text//', dt '//brief(setting_dt(setting, dt))
      if (setting%method == 'newmark') then
         text = text//', '//counted(setting%max_halvings, 'halving', 'halvings')
      else
         text = text//', tolerance '//brief(setting%tolerance)
      end if
   end function setting_text

end module driver_trial_runs
