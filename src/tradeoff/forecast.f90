!> Forecasts the time of a scene: the cost of a sample-step is measured, that of the statistics and
!> of writing the results is computed from counts.
!>
!> The measurement marches samples of all cases for some steps as the campaign will: blocks of the
!> same width, the same kept results, spectra of the same steps. The friction values are
!> independent, with the mean and standard deviation of their process: no process is fitted for it.
!>
!> The counts are those of samples, friction values, frequencies and cases. Times of one count were
!> measured on the paper's chain, with 25 to 10,000 samples a case, on chains of 1 to 500 masses
!> and on a ring of blades, while all cores were busy.
module tradeoff_forecast
   use campaign_plan, only: add_audits, kept_dofs, kept_of, plan_type, reference_for
   use campaign_pooling, only: case_pool, find_input_points, find_pools, plan_draws
   use campaign_results, only: block_result, n_quantities
   use campaign_runner, only: prepare_runner, runner_type
   use campaign_sample, only: never
   use campaign_size, only: n_frequencies, results_size
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_model, only: process_model_type
   use statistics_kernel_choice, only: most_chosen
   use statistics_law, only: count_polynomials, most_kept_draws, n_points
   use statistics_spectra, only: last_powerful, n_choosing
   use statistics_surrogate, only: most_landmarks, n_ratios
   use tradeoff_sample, only: assumed_transitions, choose_levels, draw_level, history_memory, &
                              level_type, march_level
   use tradeoff_settings, only: expected_cost, own_setting, setting_type
   implicit none(type, external)
   private
   public :: cost_type, end_seconds, measure_cost

   real(wp), parameter :: budget = 0.4_wp             !! expected processor time of the marches [s]
   integer, parameter :: fewest_steps = 1200          !! unless they take most_seconds
   real(wp), parameter :: least_steps = 64.0_wp       !! however long they take

   !> Measured processor time, a mean over all samples. Includes spectra and other kept results.
   type :: cost_type
      real(wp) :: nanoseconds = 0.0_wp         !! time of a sample-step [ns]
      real(wp) :: audit_nanoseconds = 0.0_wp   !! time of a sample-step of an audit; 0: no audit
      real(wp) :: transitions = 0.0_wp         !! transitions of a sample in a step, all joints
      real(wp) :: share_powerful = 0.0_wp      !! share of the frequencies that have the power
      integer :: n_steps = 0                   !! steps that were marched; 0: nothing was measured
      character(:), allocatable :: form        !! form of the exact march, in words
   end type cost_type

contains

   !> Marches a block at every force level and measures its cost: as many steps as the budget and
   !> the memory of histories allow, or fewest_steps within most_seconds.
   subroutine measure_cost(plan, file_force, most_seconds, cost, error)
      type(plan_type), intent(in) :: plan          !! plan without audits
      real(wp), intent(in) :: file_force(0:, :)    !! (step, 1 or sample) [N]; else of size 0
      real(wp), intent(in) :: most_seconds         !! processor time of each march [s]
      type(cost_type), intent(out) :: cost
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: short
      type(runner_type) :: runner, shortest
      type(level_type), allocatable :: levels(:)
      type(setting_type) :: own
      real(wp) :: fewest, most, step_time   ! steps; [ns]
      integer, allocatable :: n(:)          ! (level) samples
      integer :: k

      call choose_levels(plan, levels)
      short = plan
      call add_audits(short)
      short%integration%n_steps = min(plan%integration%n_steps, fewest_steps)
      short%integration%n_discard = 0
      call prepare_runner(short, file_force, shortest, error)
      if (allocated(error)) return
      cost%form = shortest%form_of_march()
      own = own_setting(plan)
      own%work = shortest%marcher%work
      n = [(size(levels(k)%samples), k=1, size(levels))]
      step_time = sum(n*expected_cost(own, plan%structure%n_dof, n, assumed_transitions))
      most = 1.0e9_wp*budget/step_time
      fewest = min(1.0_wp*fewest_steps, max(1.0e9_wp*most_seconds/step_time, least_steps, &
                                            2.0_wp*plan%output%spectrum_every))
      if (plan%output%history) &
         most = min(most, history_memory/(16.0_wp*size(kept_dofs(plan))*sum(n)))
      cost%n_steps = min(plan%integration%n_steps, int(min(max(fewest, most), 1.0e9_wp)))
      call limit_steps(cost%n_steps, short)
      call prepare_runner(short, file_force(:min(cost%n_steps, ubound(file_force, 1)), :), runner, &
                          error, prepared=shortest)
      if (allocated(error)) return
      do k = 1, size(levels)
         call draw_level(short, runner, cost%n_steps, levels(k))
         call time_level(short, runner, levels(k), real(levels(k)%n_all, wp)/sum(levels%n_all), &
                         most_seconds, cost, error)
         if (allocated(error)) return
      end do
   end subroutine measure_cost

   !> Limits a march to n_steps, and its segments to the records of them.
   pure subroutine limit_steps(n_steps, plan)
      integer, intent(in) :: n_steps
      type(plan_type), intent(inout) :: plan

      plan%integration%n_steps = n_steps
      associate (every => max(1, plan%output%spectrum_every), output => plan%output)
         output%segment_length = min(output%segment_length, every*(n_steps/every))
      end associate
   end subroutine limit_steps

   !> Times the march of one force level by the scene's method and by that of audits, whose blocks
   !> are narrower. Adds its share of the cost.
   subroutine time_level(plan, prepared, level, share, most_seconds, cost, error)
      type(plan_type), intent(in) :: plan     !! plan of the short march
      type(runner_type), intent(inout) :: prepared   !! runner whose marchers are used
      type(level_type), intent(in) :: level
      real(wp), intent(in) :: share           !! share of all samples that is at this level
      real(wp), intent(in) :: most_seconds
      type(cost_type), intent(inout) :: cost
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: audit
      type(runner_type) :: audit_runner
      type(level_type) :: audited
      type(block_result) :: result
      type(setting_type) :: own
      real(wp) :: n_steps, nanoseconds
      integer :: dof, n

      call time_march(plan, prepared, level, result, nanoseconds, error)
      if (allocated(error)) return
      cost%nanoseconds = cost%nanoseconds + share*nanoseconds
      cost%transitions = cost%transitions + share*sum(result%slip_starts + result%stick_starts) &
                         /(real(plan%integration%n_steps, wp)*size(level%samples))
      if (allocated(result%psd)) cost%share_powerful = max( &
         cost%share_powerful, maxval([(last_powerful(sum(result%psd(dof, :, :), 2)), &
                                       dof=1, size(result%psd, 1))])/real(size(result%psd, 2), wp))
      if (.not. allocated(prepared%reference)) return
      n = min(size(level%samples), maxval(plan%cases%n_samples, mask=plan%cases%audits > 0))
      audited = level
      audited%samples = level%samples(:n)
      audited%friction = level%friction(:, :n)
      audit = plan
      audit%integration = reference_for(plan%integration)
      audit%output = kept_of(plan, size(plan%cases))
      own = own_setting(audit)
      own%work = prepared%reference%work
      n_steps = 1.0e9_wp*most_seconds/(n*expected_cost(own, plan%structure%n_dof, n, &
                                                       assumed_transitions))
      call limit_steps(int(min(max(n_steps, least_steps), 1.0_wp*plan%integration%n_steps)), audit)
      call move_alloc(prepared%reference, audit_runner%marcher)
      call time_march(audit, audit_runner, audited, result, nanoseconds, error)
      call move_alloc(audit_runner%marcher, prepared%reference)
      cost%audit_nanoseconds = cost%audit_nanoseconds + share*nanoseconds
   end subroutine time_level

   !> Times a march, a short one twice, and keeps the shorter time.
   subroutine time_march(plan, prepared, level, result, nanoseconds, error)
      type(plan_type), intent(in) :: plan
      type(runner_type), intent(inout) :: prepared
      type(level_type), intent(in) :: level
      type(block_result), intent(out) :: result
      real(wp), intent(out) :: nanoseconds   !! processor time of a sample-step
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: again

      call march_level(plan, level, own_setting(plan), never, result, nanoseconds, error, prepared)
      if (allocated(error)) return
      if (1.0e-9_wp*nanoseconds*plan%integration%n_steps*size(level%samples) > budget) return
      call march_level(plan, level, own_setting(plan), never, result, again, error, prepared)
      nanoseconds = min(nanoseconds, again)
   end subroutine time_march

   !> Time from the end of the last march to the complete results file [s]. All ranks draw from the
   !> laws and share the statistics; one writes the file.
   pure real(wp) function end_seconds(plan, models, cost, n_ranks)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)   !! as in results_size
      type(cost_type), intent(in) :: cost
      integer, intent(in) :: n_ranks
      real(wp), parameter :: sample_time = 1.6e-4_wp   ! measured [s]: to read a sample,
      real(wp), parameter :: plain_time = 1.8e-7_wp    ! for plain statistics of a density of it,
      real(wp), parameter :: byte_time = 8.0e-9_wp     ! to write a byte and read it back,
      real(wp), parameter :: value_time = 5.5e-8_wp    ! to draw a value from a law,
      real(wp), parameter :: exact_time = 1.5e-4_wp    ! or a window by 'exact', at L0 = 1,
      real(wp), parameter :: polynomial_time = 2.0e-9_wp   ! for a polynomial of a draw
      type(case_pool), allocatable :: pools(:)
      real(wp) :: draws_seconds   ! which every rank takes once
      real(wp) :: n_densities     ! of a sample
      integer, allocatable :: joints(:), points(:)
      integer :: i, n_draws, p, stride

      n_densities = 0.0_wp
      if (plan%output%spectrum) n_densities = real(n_frequencies(plan), wp)*size(kept_dofs(plan))
      pools = find_pools(plan)
      call find_input_points(plan%structure, points, joints)
      draws_seconds = 0.0_wp
      do i = 1, size(plan%processes)
         if (.not. any([(any(plan%cases(pools(p)%cases)%process == i), p=1, size(pools))])) cycle
         associate (request => plan%processes(i), last => points(size(points)))
            call plan_draws(last, request%sampler == 'exact', request%correlation_length, n_draws, &
                            stride)
            draws_seconds = draws_seconds + n_draws &
                            *(merge(exact_time, value_time*max(stride, last), &
                                    request%sampler == 'exact') &
                              + polynomial_time*count_polynomials(size(points)))
         end associate
      end do
      end_seconds = (sum(plan%cases%n_samples)*(sample_time + plain_time*n_densities) &
                     + regression_seconds(plan, pools, cost%share_powerful))/n_ranks &
                    + draws_seconds + byte_time*results_size(plan, cost%transitions, models)
   end function end_seconds

   !> Processor time of the regressions of all pools [s], from the operations of src/statistics.
   pure real(wp) function regression_seconds(plan, pools, share_powerful)
      type(plan_type), intent(in) :: plan
      type(case_pool), intent(in) :: pools(:)
      real(wp), intent(in) :: share_powerful   !! share of the frequencies that are fitted
      real(wp), parameter :: n_tries = 5.0_wp          ! kernels that are tried, 4 to 7
      ! measured times [ns]
      real(wp), parameter :: pair_time = 10.0_wp       ! kernel of a pair of vectors,
      real(wp), parameter :: input_time = 1.3_wp       ! and for each input
      real(wp), parameter :: eigen_time = 0.05_wp      ! eigenvectors of n rows, over n**3
      real(wp), parameter :: product_time = 0.15_wp    ! multiplication and addition
      real(wp), parameter :: draw_time = 110.0_wp      ! choice of points: per kept draw
      real(wp), parameter :: sample_time = 900.0_wp    ! per sample and output
      real(wp), parameter :: value_time = 11.0_wp      ! per point, output and statistic
      integer, allocatable :: joints(:), points(:)
      real(wp) :: common   ! time of a joint or a dof besides its outputs [ns]
      real(wp) :: at_points, m, n, n_landmarks, n_polynomials, n_numbers, n_statistics
      integer :: p

      call find_input_points(plan%structure, points, joints)
      n_polynomials = count_polynomials(size(points))
      n_statistics = 1 + size(plan%output%percentiles)
      n_numbers = plan%structure%n_joints
      if (plan%excitation%kind == 'sine') n_numbers = n_numbers + plan%structure%n_dof
      regression_seconds = 0.0_wp
      do p = 1, size(pools)
         n = sum(pools(p)%n_fitted)
         n_landmarks = min(n, real(most_landmarks, wp))
         m = min(n, real(most_chosen, wp))
         at_points = real(n_points, wp)*size(pools(p)%cases)
         common = (pair_time + input_time*size(points)) &
                  *(2*n_tries*m**2 + n_landmarks*(n_landmarks + n + at_points)) &
                  + eigen_time*(n_tries*m**3 + n_landmarks**3) &
                  + draw_time*most_kept_draws*size(pools(p)%cases) &
                  + product_time*2.5_wp*at_points*n_polynomials**2
         if (n > n_landmarks) &
            common = common + (eigen_time*n_landmarks + product_time*3*n)*n_landmarks**2
         regression_seconds = regression_seconds + 1.0e-9_wp*n_numbers &
                              *(common + of_outputs(2.0_wp*n_quantities) &   ! and sensitivities:
                                + product_time*at_points*3*size(points) &
                                *(n_landmarks + 3*size(points)))
         if (plan%output%spectrum) &
            regression_seconds = regression_seconds + 1.0e-9_wp*size(kept_dofs(plan)) &
                                 *(common + of_outputs(share_powerful*n_frequencies(plan)))
      end do

   contains

      !> Time for a number of outputs of a joint or a dof [ns].
      pure real(wp) function of_outputs(n_outputs)
         real(wp), intent(in) :: n_outputs

         of_outputs = product_time*n_tries*2*n_ratios*m**2*min(n_outputs, real(n_choosing, wp)) &
                      + n_outputs*(n*(sample_time + product_time*4*n_landmarks) &
                                   + at_points*(n_statistics*(value_time + product_time*1.5_wp &
                                                              *n_polynomials) &
                                                + product_time*1.25_wp*n_landmarks))
      end function of_outputs

   end function regression_seconds

end module tradeoff_forecast
