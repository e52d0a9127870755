!> Compares the errors of results with the accuracy targets of the scene, and adds samples until the
!> targets are met.
module driver_judge_results
   use campaign_plan, only: add_audits, plan_type
   use campaign_pooling, only: fewest_samples, sharing_cases
   use campaign_results, only: case_estimates, case_statistics
   use campaign_samples_needed, only: find_need, is_mostly_time_average, needs_more_samples, &
                                      slip_error, slip_error_of, statistical_error, with_own_records
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: brief, counted, line_feed, numbers_text, to_text
   use driver_output, only: output_type
   use driver_regression, only: find_estimates
   use driver_statistics, only: find_statistics
   use io_earlier_results, only: case_errors, read_errors
   use io_shards, only: stored_samples
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: judge, need_words, add_samples

   !> Largest cost of a sample with its own record, which it draws, over that of one without.
   real(wp), parameter :: cost_of_own_record = 1.5_wp

contains

   !> Writes a text on the errors of a results file. Refuses one that misses a target; the message
   !> names all missed targets and what would meet them.
   subroutine judge(path, plan, text, error)
      character(*), intent(in) :: path
      type(plan_type), intent(in) :: plan
      character(:), allocatable, intent(out) :: text
      type(error_type), allocatable, intent(out) :: error
      type(case_errors), allocatable :: errors(:)
      character(:), allocatable :: failures
      integer :: i, n_cases(size(plan%cases)), n_own

      text = ''
      if (.not. plan%has_structure) return
      n_own = count(plan%cases%audits == 0)
      call read_errors(path, n_own, errors, error)
      if (allocated(error)) return
      text = errors_text(plan, errors)
      failures = ''
      n_cases = sharing_cases(plan)
      do i = 1, n_own
         failures = failures//missed_targets(plan, i, errors(i), n_cases(i))
      end do
      if (failures /= '') call raise(error, exit_no_solution, path//' is written, and not as '// &
                                     'accurate as wanted'//failures)
   end subroutine judge

   !> Text on the errors of the mean times in slip, on cases where no joint slips and on samples
   !> that are not steady: parts that begin with '; '.
   function errors_text(plan, errors) result(text)
      type(plan_type), intent(in) :: plan
      type(case_errors), intent(in) :: errors(:)   !! (case)
      character(:), allocatable :: slip, text
      real(wp), parameter :: rounding = 1.0e-9_wp   ! [points], of joints that always slip
      type(slip_error) :: case_error, largest
      logical :: is_stuck(size(errors))   ! (case) no joint slips in any sample
      integer :: i

      text = ''
      largest = slip_error(samples=[0.0_wp], record=[0.0_wp])
      is_stuck = .false.
      do i = 1, size(errors)
         if (.not. allocated(errors(i)%statistics%numbers)) cycle
         is_stuck(i) = .not. any(errors(i)%statistics%numbers%value > 0.0_wp)
         case_error = slip_error_of(errors(i)%statistics, 0, .false.)
         if (statistical_error(case_error) > statistical_error(largest)) largest = case_error
      end do
      slip = ''
      if (statistical_error(largest) >= huge(1.0_wp)) then
         slip = 'the march is too short for a standard error'
      else if (statistical_error(largest) > rounding) then
         slip = 'standard error at most '//brief(statistical_error(largest))//' points'
         if (is_mostly_time_average(largest)) slip = slip// &
            ' (most of it time-average error: more steps lower it, more samples do not)'
      end if
      if (.not. plan%output%slip) slip = ''
      if (any(errors%n_audited > 0)) then
         if (slip /= '') slip = slip//', '
         slip = slip//'numerical error '//brief(maxval(errors%slip_points))//' points'
      end if
      if (slip /= '') text = text//'; mean time in slip: '//slip
      if (any(is_stuck)) &
         text = text//'; no joint slips in '//numbers_text('c', is_stuck, 'cases')
      if (all(errors%n_unsteady == 0)) then
         text = text//'; all samples are steady'
      else if (any(errors%n_unsteady > 0)) then
         text = text//'; '//counted(sum(errors%n_unsteady), 'sample is', 'samples are')// &
                ' not steady in '//numbers_text('c', errors%n_unsteady > 0, 'cases')// &
                ': integration%n_steps is too short there, or the motion does not repeat'
      end if
   end function errors_text

   !> Lines on the targets that a case misses: numerical errors by more than twice the standard
   !> error that an audit of a share of the samples leaves; the standard error of the mean time in
   !> slip, with what would meet the target.
   function missed_targets(plan, number, errors, n_cases) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number, n_cases   !! case number; n_cases as in slip_error
      type(case_errors), intent(in) :: errors
      character(:), allocatable :: text
      type(slip_error) :: error

      text = ''
      associate (wanted => plan%accuracy)
         call check_audit('target_slip_points', wanted%target_slip_points, errors%slip_points, &
                          errors%slip_points_error, ' points')
         call check_audit('target_band_ratio', wanted%target_band_ratio, errors%band_ratio, &
                          errors%band_ratio_error, '')
         if (errors%statistics%n_samples < 2 .or. .not. wanted%target_statistical > 0.0_wp) return
         error = slip_error_of(errors%statistics, n_cases, plan%excitation%per_sample)
         if (statistical_error(error) <= wanted%target_statistical) return
         call add('target_statistical', wanted%target_statistical, &
                  brief(statistical_error(error))//' points; '//need_words(plan, error, ''))
      end associate

   contains

      !> Adds a line if the audit shows that an error exceeds its target.
      subroutine check_audit(name, wanted, found, standard_error, unit)
         character(*), intent(in) :: name, unit
         real(wp), intent(in) :: wanted   !! target; 0: none
         real(wp), intent(in) :: found, standard_error

         if (errors%n_audited > 0 .and. wanted > 0.0_wp .and. found - 2*standard_error > wanted) &
            call add(name, wanted, 'a numerical error of '//brief(found)//unit//' in '// &
                     counted(errors%n_audited, 'audited sample', 'audited samples'))
      end subroutine check_audit

      !> Adds a line on a missed target.
      subroutine add(name, wanted, found)
         character(*), intent(in) :: name, found
         real(wp), intent(in) :: wanted

         text = text//line_feed//'accuracy%'//name//' = '//brief(wanted)//': case '// &
                to_text(number)//' has '//found
      end subroutine add

   end function missed_targets

   !> Text on the samples and steps that bring an error to the target, and on samples that each have
   !> their own record of noise if these cost less.
   pure function need_words(plan, error, costs) result(text)
      type(plan_type), intent(in) :: plan
      type(slip_error), intent(in) :: error      !! known
      character(*), intent(in) :: costs          !! text on their time and size; may be empty
      character(:), allocatable :: text
      integer(long) :: n_own, n_samples, n_steps, unused

      associate (wanted => plan%accuracy%target_statistical, how => plan%integration)
         call find_need(error, wanted, how%n_steps - how%n_discard, n_samples, n_steps)
         text = 'about '//to_text(n_samples)//' samples and '//to_text(n_steps + how%n_discard)// &
                ' steps would meet the target'//costs
         if (error%n_cases > 0 .and. error%n_samples < fewest_samples) text = text// &
            ' (a regression needs fewer, from '//to_text(fewest_samples)//' samples on)'
         if (allocated(plan%values)) then
            if (n_samples > size(plan%values, 2)) text = text//' (process%values has '// &
                                                         to_text(size(plan%values, 2))//')'
         end if
         if (error%has_own_records) return
         if (all(plan%excitation%kind /= ['band_limited', 'psd         '])) return
         call find_need(with_own_records(error), wanted, how%n_steps - how%n_discard, n_own, unused)
         if (cost_of_own_record*n_own*how%n_steps &
             < real(n_samples, wp)*real(n_steps + how%n_discard, wp)) &
            text = text//', or '//to_text(n_own)//' samples with excitation%per_sample = .true.'
      end associate
   end function need_words

   !> Adds multiples of `increment` samples to the cases that miss target_statistical and can meet
   !> it by more samples, if the scene has sample_until_met. The number depends only on the samples
   !> so far: it is the same at any time and on any number of ranks. Collective.
   subroutine add_samples(models, increment, plan, output, has_more, error)
      type(process_model_type), intent(in) :: models(:)
      integer, intent(in) :: increment   !! number of samples
      type(plan_type), intent(inout) :: plan
      type(output_type), intent(inout) :: output
      logical, intent(out) :: has_more
      type(error_type), allocatable, intent(out) :: error
      type(stored_samples) :: stored
      type(case_statistics) :: statistics(size(plan%cases))
      type(case_estimates) :: estimates(size(plan%cases))   ! on the root
      type(slip_error) :: stated
      integer, allocatable :: n_samples(:)
      integer(long) :: n, n_steps
      integer :: i, k, n_cases(size(plan%cases))   ! k: number of increments

      has_more = .false.
      if (.not. plan%accuracy%sample_until_met) return
      call output%list_stored(plan, stored, error)
      if (output%world%any_true(allocated(error))) return
      call find_statistics(output%world, plan, stored, statistics, error)
      if (output%world%any_true(allocated(error))) return
      call find_estimates(output%world, plan, models, stored, [real(wp) ::], statistics, &
                          estimates, error)
      if (output%world%any_true(allocated(error))) return
      n_samples = plan%cases%n_samples
      n_cases = sharing_cases(plan)
      do i = 1, merge(size(plan%cases), 0, output%world%is_root())
         if (plan%cases(i)%audits > 0 .or. plan%cases(i)%process == 0) cycle
         stated = slip_error_of(estimates(i)%best, n_cases(i), plan%excitation%per_sample)
         if (.not. needs_more_samples(stated, plan%accuracy%target_statistical)) cycle
         call find_need(stated, plan%accuracy%target_statistical, plan%integration%n_steps, n, &
                        n_steps)
         if (n_cases(i) > 0 .and. n_samples(i) < fewest_samples) n = min(n, 2_long*fewest_samples)
         ! half of the samples needed: if the error is stated too large, no samples are wasted
         k = n_samples(i)/increment
         k = max(k + 1, int(min((n/2 - 1)/increment + 1, 10_long*k)))
         n_samples(i) = k*increment
      end do
      call output%world%broadcast(n_samples)
      has_more = any(n_samples > plan%cases%n_samples)
      if (.not. has_more) return
      plan%cases%n_samples = n_samples
      call add_audits(plan)
      call output%update_finished(plan, error)
   end subroutine add_samples

end module driver_judge_results
