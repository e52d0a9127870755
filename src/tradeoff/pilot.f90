!> A short march before the campaign: which steps the spectra need.
!>
!> Spectra of every k-th step cost a k-th, and fold what lies above the new Nyquist frequency onto
!> what is kept. One sample of average friction under each excitation tells how much that is; cases
!> that have both in common share it.
module tradeoff_pilot
   use campaign_plan, only: have_same_force, plan_type
   use campaign_results, only: block_result
   use campaign_runner, only: prepare_runner, runner_type
   use campaign_sample, only: never
   use core_error, only: error_type
   use core_kinds, only: wp
   use tradeoff_sample, only: level_type, march_level, stripped
   use tradeoff_settings, only: own_setting
   implicit none(type, external)
   private
   public :: choose_every

   !> Share of the variance. Where a bin holds a millionth of it, folding then still changes the bin
   !> by 1 % at most, and Welch's estimate scatters by 10 %.
   real(wp), parameter :: negligible = 1.0e-8_wp
   integer, parameter :: sparsest = 16             !! every 16th step at most
   integer, parameter :: pilot_segments = 8        !! of the march
   real(wp), parameter :: most_memory = 256.0e6_wp !! [byte] of spectra that are made at once

contains

   !> Chooses the k of every k-th step, unless the plan has it: the largest power of two that folds
   !> a negligible share at every dof and excitation level; and finds the shares that k folds.
   subroutine choose_every(plan, file_force, folded_share, error)
      type(plan_type), intent(inout) :: plan
      real(wp), intent(in) :: file_force(0:, :)   !! (step, 1 or sample) [N]; else of size 0
      real(wp), allocatable, intent(out) :: folded_share(:, :)   !! (dof, case) of the variance
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: short
      type(runner_type) :: runner
      real(wp), allocatable :: psd(:, :, :)   ! (dof, frequency, march)
      integer, allocatable :: marched(:)
      integer :: c, first, n, together, twin(size(plan%cases))

      short = shortened(plan)
      n = short%integration%n_steps
      call prepare_runner(short, file_force(:min(n, ubound(file_force, 1)), :), runner, error)
      if (allocated(error)) return
      twin = [(first_alike(plan, c), c=1, size(plan%cases))]
      marched = pack([(c, c=1, size(plan%cases))], twin == [(c, c=1, size(plan%cases))])
      allocate (psd(plan%structure%n_dof, size(runner%layout%frequency), size(marched)))
      associate (memory => 12.0_wp*plan%structure%n_dof*short%output%segment_length)
         together = max(1, min(size(marched), int(most_memory/memory)))
      end associate
      do first = 1, size(marched), together
         associate (last => min(first + together - 1, size(marched)))
            call march_cases(marched(first:last), runner, psd(:, :, first:last), error)
         end associate
         if (allocated(error)) return
      end do
      associate (every => plan%output%spectrum_every)
         if (every == 0) every = sparsest_allowed(plan%output%segment_length, psd)
         folded_share = share_above(psd, every)
      end associate
      folded_share = folded_share(:, [(findloc(marched, twin(c), dim=1), c=1, size(twin))])
   end subroutine choose_every

   !> Marches one sample of each of some cases as one block, each under the force of its case.
   subroutine march_cases(cases, runner, psd, error)
      integer, intent(in) :: cases(:)
      type(runner_type), intent(in) :: runner      !! of all cases
      real(wp), intent(out) :: psd(:, :, :)        !! (dof, frequency, case)
      type(error_type), allocatable, intent(out) :: error
      type(level_type) :: level
      type(block_result) :: result
      real(wp) :: nanoseconds
      integer :: i

      level%sample = spread(1, 1, size(cases))
      associate (plan => runner%plan, n => runner%plan%structure%n_forces)
         allocate (level%friction(plan%structure%n_joints, size(cases)), &
                   level%force(0:plan%integration%n_steps, n*size(cases)))
         do i = 1, size(cases)
            level%friction(:, i) = average_friction(plan, cases(i))
            call runner%force_of(cases(i), 1, level%force(:, n*(i - 1) + 1:n*i), error)
            if (allocated(error)) return
         end do
         call march_level(plan, level, own_setting(plan), never, result, nanoseconds, error, runner)
      end associate
      if (.not. allocated(error)) psd(:, :, :) = result%psd
   end subroutine march_cases

   !> A stripped plan with a short march at the full rate.
   pure function shortened(plan) result(short)
      type(plan_type), intent(in) :: plan
      type(plan_type) :: short

      short = stripped(plan)
      associate (how => short%integration, output => short%output)
         how%n_steps = min(how%n_steps, (pilot_segments + 1)*output%segment_length/2)
         output%segment_length = min(output%segment_length, how%n_steps)
         output%spectrum_every = 1
      end associate
   end function shortened

   !> The first case with the same force and average friction: itself, where there is none before.
   pure integer function first_alike(plan, number)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      do first_alike = 1, number - 1
         if (have_same_force(plan%cases(first_alike), plan%cases(number)) .and. &
             .not. any(abs(average_friction(plan, first_alike) &
                           - average_friction(plan, number)) > 0.0_wp)) return
      end do
   end function first_alike

   !> One sample: the mean of the process that the friction is drawn from, or the friction given.
   pure function average_friction(plan, number) result(friction)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number   !! of the case
      real(wp) :: friction(plan%structure%n_joints)

      associate (process => plan%cases(number)%process)
         if (process == 0) then
            friction = plan%friction
         else
            friction = plan%processes(process)%mean
         end if
      end associate
   end function average_friction

   !> Share of the power above the Nyquist frequency that every k-th step leaves.
   pure function share_above(psd, every) result(share)
      real(wp), intent(in) :: psd(:, :, :)                 !! (dof, frequency, march)
      integer, intent(in) :: every
      real(wp) :: share(size(psd, 1), size(psd, 3))        !! (dof, march)
      integer :: kept

      kept = 1 + (size(psd, 2) - 1)/every
      share = 0.0_wp
      where (sum(psd, 2) > 0.0_wp) share = sum(psd(:, kept + 1:, :), 2)/sum(psd, 2)
   end function share_above

   !> Segments must stay whole, and be worth the name.
   pure function sparsest_allowed(segment_length, psd) result(every)
      integer, intent(in) :: segment_length
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, march)
      integer :: every
      integer, parameter :: shortest = 64

      every = 1
      do while (every < sparsest)
         if (modulo(segment_length, 2*every) /= 0 .or. segment_length/(2*every) < shortest) return
         if (any(share_above(psd, 2*every) > negligible)) return
         every = 2*every
      end do
   end function sparsest_allowed

end module tradeoff_pilot
