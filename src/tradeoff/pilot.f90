!> Chooses k for spectra of every k-th step, from a short pilot march before the campaign.
!>
!> Spectra of every k-th step cost 1/k as much, and fold (alias) the power above their Nyquist
!> frequency. The pilot march measures that power on one sample with the mean friction, once for all
!> cases with the same mean friction and force.
module tradeoff_pilot
   use campaign_plan, only: have_same_force, plan_type
   use campaign_results, only: block_result
   use campaign_runner, only: prepare_runner, runner_type
   use campaign_sample, only: never
   use campaign_size, only: memory_of_pilot, most_pilot_memory, pilot_segments
   use campaign_study, only: block_range
   use core_error, only: error_type
   use core_kinds, only: wp
   use tradeoff_sample, only: assumed_transitions, level_type, march_level, only_slip_and_spectra
   use tradeoff_settings, only: expected_cost, own_setting, setting_type
   implicit none(type, external)
   private
   public :: choose_every

   !> Share of the variance that may be folded. It changes a frequency with a millionth of the
   !> variance by 1 % at most, where Welch's estimate scatters by 10 %.
   real(wp), parameter :: negligible = 1.0e-8_wp
   integer, parameter :: largest_every = 16        !! largest k
   integer, parameter :: fewest_values = 64        !! values of a segment

contains

   !> Chooses k unless the plan has it: the largest power of two that folds a negligible share of
   !> the variance at every dof of every case. Returns the shares that it folds. Leaves the plan as
   !> it is, and the shares unallocated, if the march is expected to take longer than most_seconds.
   subroutine choose_every(plan, file_force, most_seconds, folded_share, error)
      type(plan_type), intent(inout) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0
      real(wp), intent(in) :: most_seconds        !! processor time [s]
      real(wp), allocatable, intent(out) :: folded_share(:, :)   !! (dof, case) of the variance
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: short
      type(runner_type) :: runner
      type(setting_type) :: own
      real(wp), allocatable :: share(:, :, :)   ! (dof, march, k)
      integer, allocatable :: every(:), marched(:)
      integer :: c, first, i, k, n, together, twin(size(plan%cases))

      short = only_slip_and_spectra(plan)   ! the plan of the pilot march
      n = min(plan%integration%n_steps, (pilot_segments + 1)*plan%output%segment_length/2)
      short%integration%n_steps = n
      short%output%segment_length = min(plan%output%segment_length, n)
      short%output%spectrum_every = 1
      call prepare_runner(short, file_force(:min(n, ubound(file_force, 1)), :), runner, error)
      if (allocated(error)) return
      twin = [(first_alike(plan, c), c=1, size(plan%cases))]
      marched = pack([(c, c=1, size(plan%cases))], twin == [(c, c=1, size(plan%cases))])
      own = own_setting(plan)
      own%work = runner%marcher%work
      if (1.0e-9_wp*n*size(marched)*expected_cost(own, plan%structure%n_dof, size(marched), &
                                                  assumed_transitions) > most_seconds) return
      every = [max(1, plan%output%spectrum_every)]   ! the given one, or powers of two that divide
      k = 2                                          ! the segment and leave it fewest_values
      do while (plan%output%spectrum_every == 0 .and. k <= largest_every .and. &
                modulo(plan%output%segment_length, k) == 0 .and. &
                plan%output%segment_length/k >= fewest_values)
         every = [every, k]
         k = 2*k
      end do
      allocate (share(plan%structure%n_dof, size(marched), size(every)))
      together = max(1, min(size(marched), int(most_pilot_memory/memory_of_pilot(plan))))
      do first = 1, size(marched), together
         associate (last => min(first + together - 1, size(marched)))
            call march_cases(marched(first:last), runner, every, share(:, first:last, :), error)
         end associate
         if (allocated(error)) return
      end do
      i = max(1, count([(.not. any(share(:, :, i) > negligible), i=1, size(every))]))
      plan%output%spectrum_every = every(i)
      folded_share = share(:, [(findloc(marched, twin(c), dim=1), c=1, size(twin))], i)
   end subroutine choose_every

   !> Marches one sample of each of some cases as one block, each under the force of its case.
   !> Returns the shares of the power that spectra of every k-th step would fold.
   subroutine march_cases(cases, runner, every, share, error)
      integer, intent(in) :: cases(:)
      type(runner_type), intent(inout) :: runner   !! runner of all cases
      integer, intent(in) :: every(:)              !! (k)
      real(wp), intent(out) :: share(:, :, :)      !! (dof, case, k)
      type(error_type), allocatable, intent(out) :: error
      type(level_type) :: level
      type(block_result) :: result
      real(wp) :: nanoseconds
      integer :: i, kept

      level%samples = [(block_range(cases(i), 1, 1), i=1, size(cases))]
      associate (plan => runner%plan, n => runner%plan%structure%n_forces)
         allocate (level%friction(plan%structure%n_joints, size(cases)), &
                   level%force(0:plan%integration%n_steps, n*size(cases)))
         do i = 1, size(cases)
            level%friction(:, i) = mean_friction(plan, cases(i))
            call runner%force_of(cases(i), 1, level%force(:, n*(i - 1) + 1:n*i))
         end do
         call march_level(plan, level, own_setting(plan), never, result, nanoseconds, error, runner)
      end associate
      if (allocated(error)) return
      share = 0.0_wp
      do i = 1, size(every)
         kept = 1 + (size(result%psd, 2) - 1)/every(i)   ! to the Nyquist frequency of these steps
         where (sum(result%psd, 2) > 0.0_wp) &
            share(:, :, i) = sum(result%psd(:, kept + 1:, :), 2)/sum(result%psd, 2)
      end do
   end subroutine march_cases

   !> Number of the first case with the same force and mean friction as this one.
   pure integer function first_alike(plan, number)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      do first_alike = 1, number - 1
         if (have_same_force(plan%cases(first_alike), plan%cases(number)) .and. &
             .not. any(abs(mean_friction(plan, first_alike) &
                           - mean_friction(plan, number)) > 0.0_wp)) return
      end do
   end function first_alike

   !> Friction of the joints: the mean of the case's process, or the given values.
   pure function mean_friction(plan, number) result(friction)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number   !! number of the case
      real(wp) :: friction(plan%structure%n_joints)

      associate (process => plan%cases(number)%process)
         if (process == 0) then
            friction = plan%friction
         else
            friction = plan%processes(process)%mean
         end if
      end associate
   end function mean_friction

end module tradeoff_pilot
