!> Best estimates of the statistics of all cases, by regressions over pools of cases. A task is one
!> joint or dof of a pool; the ranks share the tasks.
module driver_regression
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_pooling, only: case_pool, draw_law, estimators_of, find_input_points, find_pools, &
                               reason_for_plain
   use campaign_results, only: block_result, case_estimates, case_statistics, n_quantities, &
                               numbers_of
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_shards, only: stored_samples
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: attend_to_others, world_type
   use process_model, only: process_model_type
   use statistics_estimates, only: numbers_of_statistic, statistic_type
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars
   use statistics_spectra, only: estimate_spectrum, last_powerful
   implicit none(type, external)
   private
   public :: find_estimates

   !> Input and results of the tasks, and the pool that is loaded.
   type :: regression_state
      type(case_pool), allocatable :: pools(:)
      type(case_statistics), pointer :: plain(:)      !! (case) plain estimates
      type(case_estimates), pointer :: estimates(:)   !! (case) results of this rank, else zeros
      integer :: n_joints = 0
      integer, allocatable :: points(:)           !! friction points of the process, ascending
      integer, allocatable :: joint_of_point(:)   !! (point) the first joint that has its friction
      integer, allocatable :: dofs(:)             !! dofs with spectra
      real(wp) :: step = 0.0_wp                   !! between frequencies [Hz]
      real(wp), allocatable :: share_below(:)     !! (percentile) percentile/100
      integer :: current = 0                      !! number of the loaded pool; 0: none
      type(pool_type) :: pool                     !! friction samples of it, and draws of their laws
      integer, allocatable :: drawn(:, :)         !! (process and n_fitted, case) in `pool`
      real(wp), allocatable :: numbers(:, :)      !! (sample, number) in the order of numbers_of
   end type regression_state

contains

   !> Computes the best estimates of every case: by regression, else the plain ones. With given
   !> pools estimates the laws of their cases without samples alone. Collective.
   subroutine find_estimates(world, plan, models, stored, frequency, statistics, estimates, error, &
                             pools)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      real(wp), intent(in) :: frequency(:)   !! [Hz]; empty without spectra
      type(case_statistics), intent(in), target :: statistics(:)   !! (case) plain estimates
      type(case_estimates), intent(out), target :: estimates(:)    !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(case_pool), intent(in), optional :: pools(:)            !! absent: those of the plan
      type(regression_state) :: state
      type(work_counter) :: counter
      integer :: c, n_tasks, p, task

      if (present(pools)) then
         state%pools = pools
      else
         state%pools = find_pools(plan)
      end if
      estimates%estimator = estimators_of(state%pools, size(estimates))
      do c = 1, size(estimates)
         estimates(c)%best = statistics(c)
         estimates(c)%reason = reason_for_plain(plan, c)
      end do
      if (size(state%pools) == 0) return
      state%plain => statistics
      state%estimates => estimates
      state%share_below = plan%output%percentiles/100.0_wp
      state%n_joints = plan%structure%n_joints
      call find_input_points(plan%structure, state%points, state%joint_of_point)
      allocate (state%dofs(0), state%drawn(2, 0))
      if (size(frequency) > 1) then
         state%dofs = kept_dofs(plan)
         state%step = frequency(2) - frequency(1)
      end if
      do p = 1, size(state%pools)
         associate (cases => state%pools(p)%cases)
            do c = 1, size(cases)
               call estimates(cases(c))%start(state%points)
               estimates(cases(c))%pooled_with = pack(cases, cases /= cases(c))
            end do
         end associate
      end do
      n_tasks = state%n_joints + size(state%dofs)
      if (plan%excitation%kind == 'sine') n_tasks = n_tasks + plan%structure%n_dof
      call new_counter(world, n_tasks*size(state%pools), counter)
      do
         task = counter%next(stops=allocated(error))
         if (task == 0) exit
         call attend_to_others()
         call run_task(plan, models, stored, (task - 1)/n_tasks + 1, &
                       n_tasks - modulo(task - 1, n_tasks), state, error)   ! dofs take longest
      end do
      call counter%close()
      if (world%any_true(allocated(error))) return
      do c = 1, size(estimates)
         if (estimates(c)%estimator == 'plain') cycle
         call add_table(estimates(c)%sensitivity)   ! each rank has some joints and dofs
         call add_table(estimates(c)%best%numbers)
         call add_table(estimates(c)%best%psd)
         call add_table(estimates(c)%best%pseudo_variances)
      end do

   contains

      !> Adds up one table over the ranks.
      subroutine add_table(table)
         type(statistic_type), intent(inout), target, contiguous, optional :: table(..)
         real(wp), pointer :: numbers(:)

         if (.not. present(table)) return
         call c_f_pointer(c_loc(table), numbers, [size(table)*numbers_of_statistic])
         call world%add_up(size(numbers), numbers)
      end subroutine add_table

   end subroutine find_estimates

   !> Estimates all quantities of a joint, or the spectra or the amplitude of a dof, for all cases
   !> of a pool.
   subroutine run_task(plan, models, stored, number, part, state, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number   !! number of the pool
      integer, intent(in) :: part     !! 1..: the joints, then dofs with spectra, then amplitudes
      type(regression_state), intent(inout) :: state
      type(error_type), allocatable, intent(inout) :: error
      integer :: i

      if (state%current /= number) then
         call load_pool(plan, models, stored, number, state, error)
         if (allocated(error)) return
      end if
      associate (dof => part - state%n_joints, n_spectra => size(state%dofs))
         if (dof <= 0) then
            call estimate_numbers(state, [(part + i*state%n_joints, i=0, n_quantities - 1)], &
                                  error)
         else if (dof <= n_spectra) then
            call estimate_spectra(stored, dof, state, error)
         else
            call estimate_numbers(state, [dof - n_spectra + n_quantities*state%n_joints], &
                                  error)
         end if
      end associate
   end subroutine run_task

   !> Reads the samples of a pool, and draws values of each case's law. Keeps those of the pool
   !> before if it has the same processes under another force: the friction values are the same.
   subroutine load_pool(plan, models, stored, number, state, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number   !! number of the pool
      type(regression_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: friction(:, :), draws(:, :), values(:, :)
      real(wp) :: n_independent
      type(block_result) :: samples
      integer, allocatable :: first(:), n_samples(:), wanted(:, :)   ! as state%drawn
      integer :: i

      associate (members => state%pools(number))
         first = [1, (1 + sum(members%n_fitted(:i)), i=1, size(members%cases))]
         wanted = reshape([plan%cases(members%cases)%process, members%n_fitted], &
                          [2, size(members%cases)], order=[2, 1])
         if (allocated(state%numbers)) deallocate (state%numbers)
         allocate (friction(first(size(first)) - 1, size(state%points)))
         do i = 1, size(members%cases)
            if (members%n_fitted(i) == 0) cycle
            call stored%read(members%cases(i), 1, members%n_fitted(i), samples, error)
            if (allocated(error)) return
            friction(first(i):first(i + 1) - 1, :) = &
               transpose(samples%friction(state%joint_of_point, :))
            values = numbers_of(samples)
            if (.not. allocated(state%numbers)) &
               allocate (state%numbers(size(friction, 1), size(values, 1)))
            state%numbers(first(i):first(i + 1) - 1, :) = transpose(values)
         end do
         state%current = number
         n_samples = plan%cases(members%cases)%n_samples
         if (size(state%drawn) == size(wanted)) then
            if (all(state%drawn == wanted)) then
               where (state%pool%has_samples) state%pool%n_samples = n_samples
               return
            end if
         end if
         call new_pool(friction, first, n_samples, state%pool)
         do i = 1, size(members%cases)
            if (members%n_fitted(i) > 0 .and. any(members%n_fitted == 0)) cycle
            call attend_to_others()
            call draw_law(plan%seed, models(wanted(1, i)), state%points, draws, n_independent)
            call state%pool%add_law(i, draws, n_independent)
         end do
         state%drawn = wanted
      end associate
   end subroutine load_pool

   !> Estimates the statistics of some numbers of one joint or dof, for all cases of the loaded
   !> pool.
   subroutine estimate_numbers(state, numbers, error)
      type(regression_state), intent(inout) :: state
      integer, intent(in) :: numbers(:)   !! their positions in numbers_of
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type), dimension(size(numbers), size(state%share_below) + 2, &
                                      size(state%pools(state%current)%cases)) :: &
         plain, estimates
      type(statistic_type) :: sensitivity(size(state%points), size(plain, 3))
      integer :: i

      associate (cases => state%pools(state%current)%cases)
         do i = 1, size(cases)
            plain(:, :, i) = state%plain(cases(i))%numbers(numbers, :)
         end do
         call estimate_scalars(state%pool, state%numbers(:, numbers), &
                               numbers <= state%n_joints, state%share_below, plain, &
                               estimates, sensitivity, error)
         if (allocated(error)) return
         do i = 1, size(cases)
            state%estimates(cases(i))%best%numbers(numbers, :) = estimates(:, :, i)
            if (numbers(1) <= state%n_joints) &
               state%estimates(cases(i))%sensitivity(:, numbers(1)) = sensitivity(:, i)
         end do
      end associate
   end subroutine estimate_numbers

   !> Estimates the statistics of the spectra of one dof, for all cases of the loaded pool.
   subroutine estimate_spectra(stored, dof, state, error)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: dof   !! position in state%dofs
      type(regression_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type), allocatable :: plain(:, :, :)      ! (frequency, statistic, case)
      type(statistic_type), allocatable :: spectra(:, :, :)    ! the same at the first n frequencies
      type(statistic_type), allocatable :: integrals(:, :)     ! (statistic, case)
      real(wp), allocatable :: density(:, :)          ! (sample, frequency)
      real(wp), allocatable :: case_density(:, :, :)  ! (1, frequency, sample) of one case
      integer :: i, n   ! n: frequencies up to the last one with power

      associate (cases => state%pools(state%current)%cases, &
                 n_fitted => state%pools(state%current)%n_fitted, pool => state%pool)
         associate (psd => state%plain(cases(1))%psd)
            allocate (plain(size(psd, 2), size(psd, 3), size(cases)))
         end associate
         n = 0
         do i = 1, size(cases)
            plain(:, :, i) = state%plain(cases(i))%psd(dof, :, :)
            n = max(n, last_powerful(plain(:, 1, i)%value))
         end do
         allocate (density(size(pool%x, 1), n), spectra(n, size(plain, 2), size(cases)), &
                   integrals(size(plain, 2) + 1, size(cases)))
         do i = 1, size(cases)
            if (n_fitted(i) == 0) cycle
            allocate (case_density(1, n, n_fitted(i)))
            call stored%read_part(cases(i), 'psd', [dof, 1, 1], case_density, error)
            if (allocated(error)) return
            density(pool%first(i):pool%last(i), :) = transpose(case_density(1, :, :))
            deallocate (case_density)
         end do
         call estimate_spectrum(pool, density, state%step, state%share_below, plain, &
                                spectra, integrals, error)
         if (allocated(error)) return
         do i = 1, size(cases)
            call state%estimates(cases(i))%store_spectrum(dof, state%plain(cases(i)), &
                                                          spectra(:, :, i), integrals(:, i))
         end do
      end associate
   end subroutine estimate_spectra

end module driver_regression
