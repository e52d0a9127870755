!> The best estimates of all cases: regressions over pools of cases, shared out over the ranks, a
!> joint or a dof at a time.
module driver_regression
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_pooling, only: case_pool, draw_law, estimators_of, find_points, find_pools, &
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

   !> Data that the tasks of all pools read and fill.
   type :: workshop_type
      type(case_pool), allocatable :: pools(:)
      type(case_statistics), pointer :: plain(:)       !! (case)
      type(case_estimates), pointer :: found(:)        !! (case) by this rank, zeros elsewhere
      integer :: n_joints = 0
      integer, allocatable :: points(:), takers(:)     !! of the process; a joint that takes each
      integer, allocatable :: dofs(:)                  !! whose spectra are there
      real(wp) :: step = 0.0_wp                        !! between frequencies [Hz]
      real(wp), allocatable :: share_below(:)          !! (percentile)
      integer :: at_hand = 0                           !! the pool of the next three
      type(pool_type) :: pool
      integer, allocatable :: drawn(:, :)              !! (process and samples fitted, case) of it
      real(wp), allocatable :: numbers(:, :)           !! (sample, number) as numbers_of has them
   end type workshop_type

contains

   !> Computes the estimates of every case: by a pool's regression, or plain ones. Collective.
   subroutine find_estimates(world, plan, models, stored, frequency, statistics, estimates, error)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      real(wp), intent(in) :: frequency(:)                  !! [Hz]; empty: no spectra
      type(case_statistics), intent(in), target :: statistics(:)    !! (case) plain
      type(case_estimates), intent(out), target :: estimates(:)     !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(workshop_type) :: workshop
      type(work_counter) :: counter
      integer :: c, n_tasks, p, task

      estimates%estimator = estimators_of(plan)
      do c = 1, size(estimates)
         estimates(c)%best = statistics(c)
         estimates(c)%reason = reason_for_plain(plan, c)
      end do
      workshop%pools = find_pools(plan)
      if (size(workshop%pools) == 0) return
      workshop%plain => statistics
      workshop%found => estimates
      call open_workshop(plan, frequency, workshop)
      n_tasks = workshop%n_joints + size(workshop%dofs)
      if (plan%excitation%kind == 'sine') n_tasks = n_tasks + plan%structure%n_dof
      call new_counter(world, n_tasks*size(workshop%pools), counter)
      do
         task = counter%next(stops=allocated(error))
         if (task == 0) exit
         call attend_to_others()
         call do_task(plan, models, stored, (task - 1)/n_tasks + 1, &
                      n_tasks - modulo(task - 1, n_tasks), workshop, error)   ! dofs take longest
      end do
      call counter%close()
      if (world%any_true(allocated(error))) return
      do p = 1, size(workshop%pools)
         associate (cases => workshop%pools(p)%cases)
            do c = 1, size(cases)
               call add_up(world, estimates(cases(c)))
            end do
         end associate
      end do
   end subroutine find_estimates

   !> Prepares the data that all tasks need.
   subroutine open_workshop(plan, frequency, workshop)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: frequency(:)
      type(workshop_type), intent(inout) :: workshop
      integer :: i, p

      workshop%share_below = plan%output%percentiles/100.0_wp
      workshop%n_joints = plan%structure%n_joints
      call find_points(plan%structure, workshop%points, workshop%takers)
      allocate (workshop%dofs(0))
      if (size(frequency) > 1) then
         workshop%dofs = kept_dofs(plan)
         workshop%step = frequency(2) - frequency(1)
      end if
      do p = 1, size(workshop%pools)
         associate (cases => workshop%pools(p)%cases)
            do i = 1, size(cases)
               associate (found => workshop%found(cases(i)))
                  call found%start(workshop%points)
                  found%pooled_with = pack(cases, cases /= cases(i))
               end associate
            end do
         end associate
      end do
   end subroutine open_workshop

   !> Estimates the quantities of one joint, or the spectra or the amplitude of one dof, for all
   !> cases of a pool.
   subroutine do_task(plan, models, stored, number, part, workshop, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number   !! of the pool
      integer, intent(in) :: part     !! a joint, or behind those a dof: of spectra, of amplitudes
      type(workshop_type), intent(inout) :: workshop
      type(error_type), allocatable, intent(inout) :: error
      integer :: i

      if (workshop%at_hand /= number) then
         call gather_pool(plan, models, stored, number, workshop, error)
         if (allocated(error)) return
      end if
      associate (dof => part - workshop%n_joints, n_spectra => size(workshop%dofs))
         if (dof <= 0) then
            call estimate_numbers(workshop, [(part + i*workshop%n_joints, i=0, n_quantities - 1)], &
                                  error)
         else if (dof <= n_spectra) then
            call estimate_dof(stored, dof, workshop, error)
         else
            call estimate_numbers(workshop, [dof - n_spectra + n_quantities*workshop%n_joints], &
                                  error)
         end if
      end associate
   end subroutine do_task

   !> Gathers the samples of a pool that the regression uses, and draws each case's law. Under
   !> another force the same processes have the same friction values.
   subroutine gather_pool(plan, models, stored, number, workshop, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number   !! of the pool
      type(workshop_type), intent(inout) :: workshop
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: friction(:, :), draws(:, :), values(:, :)
      real(wp) :: n_independent
      type(block_result) :: samples
      integer, allocatable :: first(:), n_samples(:), wanted(:, :)
      integer :: i

      associate (members => workshop%pools(number))
         first = [1, (1 + sum(members%n_fitted(:i)), i=1, size(members%cases))]
         wanted = reshape([plan%cases(members%cases)%process, members%n_fitted], &
                          [2, size(members%cases)], order=[2, 1])
         if (allocated(workshop%numbers)) deallocate (workshop%numbers)
         allocate (friction(first(size(first)) - 1, size(workshop%points)))
         do i = 1, size(members%cases)
            call stored%read(members%cases(i), 1, members%n_fitted(i), samples, error)
            if (allocated(error)) return
            friction(first(i):first(i + 1) - 1, :) = transpose(samples%friction(workshop%takers, :))
            values = numbers_of(samples)
            if (i == 1) allocate (workshop%numbers(size(friction, 1), size(values, 1)))
            workshop%numbers(first(i):first(i + 1) - 1, :) = transpose(values)
         end do
         workshop%at_hand = number
         n_samples = plan%cases(members%cases)%n_samples
         if (allocated(workshop%drawn)) then
            if (size(workshop%drawn) == size(wanted)) then
               if (all(workshop%drawn == wanted)) then
                  workshop%pool%n_samples = n_samples
                  return
               end if
            end if
         end if
         call new_pool(friction, first, n_samples, workshop%pool)
         do i = 1, size(members%cases)
            call attend_to_others()
            associate (model => models(wanted(1, i)))
               call draw_law(plan%seed, model, workshop%points, draws, n_independent)
               call workshop%pool%add_law(i, draws, n_independent)
            end associate
         end do
         workshop%drawn = wanted
      end associate
   end subroutine gather_pool

   !> Estimates numbers of one joint or dof, which follow the same inputs, for all cases at hand.
   subroutine estimate_numbers(workshop, numbers, error)
      type(workshop_type), intent(inout) :: workshop
      integer, intent(in) :: numbers(:)   !! their places as numbers_of has them
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type), dimension(size(numbers), size(workshop%share_below) + 2, &
                                      size(workshop%pools(workshop%at_hand)%cases)) :: &
         plain, estimates
      type(statistic_type) :: sensitivity(size(workshop%points), size(plain, 3))
      integer :: i

      associate (cases => workshop%pools(workshop%at_hand)%cases)
         do i = 1, size(cases)
            plain(:, :, i) = workshop%plain(cases(i))%numbers(numbers, :)
         end do
         call estimate_scalars(workshop%pool, workshop%numbers(:, numbers), &
                               numbers <= workshop%n_joints, workshop%share_below, plain, &
                               estimates, sensitivity, error)
         if (allocated(error)) return
         do i = 1, size(cases)
            associate (found => workshop%found(cases(i)))
               found%best%numbers(numbers, :) = estimates(:, :, i)
               if (numbers(1) <= workshop%n_joints) &
                  found%sensitivity(:, numbers(1)) = sensitivity(:, i)
            end associate
         end do
      end associate
   end subroutine estimate_numbers

   subroutine estimate_dof(stored, dof, workshop, error)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: dof   !! its place among those whose spectra are kept
      type(workshop_type), intent(inout) :: workshop
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type), allocatable :: plain(:, :, :)      ! (frequency, statistic, case)
      type(statistic_type), allocatable :: spectra(:, :, :)    ! the same, as far as there is power
      type(statistic_type), allocatable :: integrals(:, :)     ! (statistic, case)
      real(wp), allocatable :: density(:, :)      ! (sample, frequency)
      real(wp), allocatable :: of_case(:, :, :)   ! (1, frequency, sample)
      integer :: i, n

      associate (cases => workshop%pools(workshop%at_hand)%cases, &
                 n_fitted => workshop%pools(workshop%at_hand)%n_fitted, pool => workshop%pool)
         associate (psd => workshop%plain(cases(1))%psd)
            allocate (plain(size(psd, 2), size(psd, 3), size(cases)))
         end associate
         n = 0
         do i = 1, size(cases)
            plain(:, :, i) = workshop%plain(cases(i))%psd(dof, :, :)
            n = max(n, last_powerful(plain(:, 1, i)%value))
         end do
         allocate (density(size(pool%x, 1), n), spectra(n, size(plain, 2), size(cases)), &
                   integrals(size(plain, 2) + 1, size(cases)))
         do i = 1, size(cases)
            allocate (of_case(1, n, n_fitted(i)))
            call stored%read_part(cases(i), 'psd', [dof, 1, 1], of_case, error)
            if (allocated(error)) return
            density(pool%first(i):pool%first(i + 1) - 1, :) = transpose(of_case(1, :, :))
            deallocate (of_case)
         end do
         call estimate_spectrum(pool, density, workshop%step, workshop%share_below, plain, &
                                spectra, integrals, error)
         if (allocated(error)) return
         do i = 1, size(cases)
            call workshop%found(cases(i))%take_spectrum(dof, workshop%plain(cases(i)), &
                                                        spectra(:, :, i), integrals(:, i))
         end do
      end associate
   end subroutine estimate_dof

   !> Adds up the estimates of a case, of which each rank has some joints and dofs; collective.
   subroutine add_up(world, found)
      type(world_type), intent(in) :: world
      type(case_estimates), intent(inout) :: found

      call add_table(found%sensitivity)
      call add_table(found%best%numbers)
      call add_table(found%best%psd)
      call add_table(found%best%pseudo_variances)

   contains

      subroutine add_table(table)
         type(statistic_type), intent(inout), target, contiguous, optional :: table(..)
         real(wp), pointer :: numbers(:)

         if (.not. present(table)) return
         call c_f_pointer(c_loc(table), numbers, [size(table)*numbers_of_statistic])
         call world%add_up(size(numbers), numbers)
      end subroutine add_table

   end subroutine add_up

end module driver_regression
