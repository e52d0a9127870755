!> `entroslip whatif`: estimates for other laws of the friction, from the samples of a results file.
module driver_whatif
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_pooling, only: add_new_laws, case_pool, pools_of_new_laws
   use campaign_results, only: case_estimates, case_statistics, n_quantities, spectrum_layout
   use config_plan, only: build_plan
   use config_scene, only: complaint_list, parse_scene, scene_type
   use core_error, only: error_type, exit_bad_input, exit_done, exit_no_solution, raise
   use core_kinds, only: wp
   use core_source, only: new_source, source_type
   use core_terminal, only: say
   use core_text, only: brief, labelled, line_feed, lowered, numbered, padded, row_text, to_text, &
                        with_error
   use driver_campaign, only: refuse_unsolved
   use driver_command_line, only: command_line
   use driver_processes, only: solve_processes
   use driver_regression, only: find_estimates
   use driver_statistics, only: find_statistics
   use io_earlier_results, only: case_errors, read_campaign, stored_in_results
   use io_progress, only: set_quiet
   use io_shards, only: shard_type, sort_shards, stored_samples
   use io_store, only: identity_type, new_store
   use parallel_world, only: start_world, stop_world, world_type
   use process_model, only: lengths_of, process_model_type
   use statistics_estimates, only: is_near_samples, normal_95, statistic_type
   implicit none(type, external)
   private
   public :: whatif

   integer, parameter :: number_width = 5, cell_width = 19   !! columns of tables

   !> Samples of a results file, and cases without samples for the new laws.
   type :: question_type
      type(plan_type) :: plan                    !! cases of the file, then those of the new laws
      integer :: n_processes = 0                 !! processes of the file
      type(stored_samples) :: stored
      type(case_errors), allocatable :: errors(:)   !! (case of the file)
      type(spectrum_layout) :: layout            !! without frequencies if samples have no spectra
   end type question_type

contains

   !> Runs the command `whatif`. Collective.
   subroutine whatif(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(question_type) :: question
      type(process_model_type), allocatable :: models(:)
      type(case_statistics), allocatable :: statistics(:)
      type(case_estimates), allocatable :: estimates(:)
      type(case_pool), allocatable :: pools(:)
      type(error_type), allocatable :: error
      integer :: c, p

      call start_world(world)
      call set_quiet(line%has('--quiet') .or. .not. world%is_root())
      call read_question(line, question, error)
      call world%stop_on(error)
      associate (plan => question%plan)
         call solve_processes(world, plan, models, wanted=[(p > question%n_processes, &
                                                                 p=1, size(plan%processes))])
         call refuse_unsolved(plan, models, error)
         call world%stop_on(error)
         pools = pools_of_new_laws(plan)
         if (size(pools) == 0) call raise(error, exit_bad_input, line%scene// &
                                          ': no case has the samples of a regression')
         call world%stop_on(error)
         plan%cases%n_samples = 0
         do p = 1, size(pools)
            plan%cases(pools(p)%cases)%n_samples = pools(p)%n_fitted
         end do
         allocate (statistics(size(plan%cases)), estimates(size(plan%cases)))
         call find_statistics(world, plan, question%stored, statistics, error, question%layout)
         call world%stop_on(error)
         do p = 1, size(pools)   ! above the frequencies with power the spectra of the samples stand
            do c = 2, size(pools(p)%cases)
               if (pools(p)%n_fitted(c) == 0) &
                  statistics(pools(p)%cases(c)) = statistics(pools(p)%cases(1))
            end do
         end do
         call find_estimates(world, plan, models, question%stored, question%layout%frequency, &
                             statistics, estimates, error, pools)
         call world%stop_on(error)
         if (world%is_root()) call print_estimates(question, pools, estimates, error)
      end associate
      call world%stop_on(error)
      call stop_world(exit_done)
   end subroutine whatif

   !> Reads the scene of a results file, its samples, and the new laws.
   subroutine read_question(line, question, error)
      type(command_line), intent(in) :: line
      type(question_type), intent(out) :: question
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: campaign, changed
      character(:), allocatable :: options, text
      type(shard_type) :: none(0)

      call refuse_other_options(line, error)
      if (.not. allocated(error)) &
         call read_campaign(line%scene, text, options, campaign, question%layout%frequency, &
                            question%errors, error)
      if (allocated(error)) return
      if (all(campaign%cases%process == 0)) then
         call raise(error, exit_bad_input, line%scene//': has no samples of a process')
         return
      end if
      call plan_laws(line%scene, text, options, question%plan, error)
      if (allocated(error)) return
      associate (plan => question%plan)
         question%n_processes = size(plan%processes)
         plan%cases = campaign%cases
         plan%has_structure = .true.
         plan%structure = campaign%structure
         plan%output = campaign%output
         if (plan%estimator == 'plain') plan%estimator = 'pooled'
         associate (n => plan%cases%n_samples)
            call sort_shards(new_store(line%scene, identity_type()), &
                             stored_in_results([n, 0*n], maxval(n), none), question%stored)
         end associate
         if (options /= '') options = options//line_feed
         call plan_laws(line%scene, text, options//line%overrides, changed, error)
         if (allocated(error)) return
         call add_new_laws(changed%processes, plan)
         if (all(plan%cases%n_samples > 0)) &
            call raise(error, exit_bad_input, line%scene//': has samples of this law: see its '// &
                       'report')
      end associate
   end subroutine read_question

   !> Refuses options that change more than the law of the friction, and a command without any.
   subroutine refuse_other_options(line, error)
      type(command_line), intent(in) :: line
      type(error_type), allocatable, intent(out) :: error
      type(source_type) :: lines
      integer :: i

      if (line%overrides == '') &
         call raise(error, exit_bad_input, 'whatif needs another law: --set process%std=0.1')
      lines = new_source('--set', line%overrides)
      do i = 1, lines%n_lines() - 1   ! the last one is empty
         if (scan(lines%line(i), '%(') == 8 .and. index(lowered(lines%line(i)), 'process') == 1) &
            cycle
         call raise(error, exit_bad_input, '--set '//lines%line(i)// &
                    ': whatif changes the law of the friction alone, such as process%std')
         return
      end do
   end subroutine refuse_other_options

   !> Makes the plan of the processes of a scene.
   subroutine plan_laws(path, text, options, plan, error)
      character(*), intent(in) :: path      !! results file
      character(*), intent(in) :: text      !! text of the scene
      character(*), intent(in) :: options   !! --set options, one a line
      type(plan_type), intent(out) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(scene_type) :: scene
      type(complaint_list) :: complaints

      call parse_scene(new_source(path, text), options, scene, complaints, processes_alone=.true.)
      if (complaints%n == 0) call build_plan(scene, plan, complaints)
      if (complaints%n > 0) call raise(error, exit_bad_input, complaints%text)
      plan%excitation = scene%excitation%excitation_settings
   end subroutine plan_laws

   !> Prints the estimates of all new laws. An error says that none of them has any.
   subroutine print_estimates(question, pools, estimates, error)
      type(question_type), intent(in) :: question
      type(case_pool), intent(in) :: pools(:)
      type(case_estimates), intent(in) :: estimates(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      logical, allocatable :: is_near(:)            ! (statistic)
      integer :: i, p

      allocate (is_near(0))
      do p = 1, size(pools)
         associate (laws => pack(pools(p)%cases, pools(p)%n_fitted == 0))
            do i = 1, size(laws)
               associate (best => estimates(laws(i))%best)
                  call say(law_text(question%plan, pools(p), laws(i), question%errors, best))
                  is_near = [is_near, pack(is_near_samples(best%numbers), .true.)]
                  if (allocated(best%pseudo_variances)) &
                     is_near = [is_near, pack(is_near_samples(best%pseudo_variances), .true.)]
               end associate
            end do
         end associate
      end do
      if (.not. any(is_near)) then
         call raise(error, exit_no_solution, 'the samples do not reach this law: name it in '// &
                    'the scene, and run')
      else if (.not. all(is_near)) then
         call say('-: too far from the samples; name the law in the scene, and run')
      end if
   end subroutine print_estimates

   !> Law, force and samples of a case, what the force record adds to errors, and the tables of its
   !> estimates.
   pure function law_text(plan, pool, number, errors, best) result(text)
      type(plan_type), intent(in) :: plan
      type(case_pool), intent(in) :: pool
      integer, intent(in) :: number               !! number of the case
      type(case_errors), intent(in) :: errors(:)  !! (case of the samples)
      type(case_statistics), intent(in) :: best   !! estimates of the case
      character(:), allocatable :: force, text, samples
      real(wp) :: record_error   ! time-average error of a mean slip fraction, the largest
      integer :: i

      samples = ''
      record_error = 0.0_wp
      do i = 1, size(pool%cases)
         if (pool%n_fitted(i) == 0) cycle
         samples = samples//', '//to_text(pool%n_fitted(i))//' of '//numbered('c', pool%cases(i))
         associate (statistics => errors(pool%cases(i))%statistics)
            if (allocated(statistics%slip_mean_time_error)) &
               record_error = max(record_error, maxval(statistics%slip_mean_time_error))
         end associate
      end do
      associate (request => plan%processes(plan%cases(number)%process))
         text = labelled('law', 'mean = '//to_text(request%mean)//', std = '// &
                         to_text(request%std)//', '//lengths_of(request)//', order = '// &
                         to_text(request%order))
      end associate
      associate (case => plan%cases(number))
         select case (plan%excitation%kind)
         case ('band_limited')
            force = 'variance'
         case ('sine')
            force = 'frequency = '//to_text(case%frequency)//', amplitude'
         case default
            force = 'factor'
         end select
         text = text//labelled('force', force//' = '//to_text(case%strength)) &
                //labelled('samples', samples(3:))
      end associate
      if (record_error > 0.0_wp .and. plan%excitation%kind /= 'sine') &
         text = text//labelled('errors', 'of the friction alone; the time-average error of the '// &
                               'one force record is up to '//brief(100.0_wp*record_error)// &
                               ' points of a mean time in slip')
      text = text//tables_text(plan, best)
   end function law_text

   !> Tables of the estimates of a case: of the joints, then of the dofs.
   pure function tables_text(plan, best) result(text)
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: best
      character(:), allocatable :: text
      character(24), parameter :: names(n_quantities) = [character(24) :: 'time in slip [%]', &
                                                         'distance of slip [m]', 'dissipation [J]']
      real(wp), parameter :: scales(n_quantities) = [100.0_wp, 1.0_wp, 1.0_wp]
      integer :: i, q

      text = ''
      associate (n => plan%structure%n_joints, percentiles => plan%output%percentiles)
         do q = 1, n_quantities
            text = text//table_text(trim(names(q)), 'joint', [(i, i=1, n)], 'std', percentiles, &
                                    scales(q), best%numbers(n*(q - 1) + 1:n*q, :))
         end do
         if (size(best%numbers, 1) > n*n_quantities) &
            text = text//table_text('amplitude [m]', 'dof', [(i, i=1, plan%structure%n_dof)], &
                                    'std', percentiles, 1.0_wp, &
                                    best%numbers(n*n_quantities + 1:, :))
         if (allocated(best%pseudo_variances)) &
            text = text//table_text('pseudo-variance [m^2]', 'dof', kept_dofs(plan), &
                                    'band ratio', percentiles, 1.0_wp, best%pseudo_variances)
      end associate
   end function tables_text

   !> Table of statistics with their standard errors: the mean, the percentiles and a last one.
   !> Those of a law that is too far from the samples are dashes, and one dash stands for a table of
   !> them.
   pure function table_text(title, place, numbers, last, percentiles, scale, rows) result(text)
      character(*), intent(in) :: title   !! quantity and unit
      character(*), intent(in) :: place   !! heading of the numbers
      integer, intent(in) :: numbers(:)   !! (row)
      character(*), intent(in) :: last    !! heading of the last statistic
      real(wp), intent(in) :: percentiles(:)   !! [%]
      real(wp), intent(in) :: scale            !! factor on the statistics
      type(statistic_type), intent(in) :: rows(:, :)   !! (row, statistic)
      character(:), allocatable :: cells, columns, text
      real(wp) :: error
      integer :: i, s

      text = title//'  -'//line_feed
      if (.not. any(is_near_samples(rows))) return
      columns = padded(place, number_width)//'|'//padded('mean', cell_width)
      do s = 1, size(percentiles)
         columns = columns//'|'//padded(brief(percentiles(s))//' %', cell_width)
      end do
      columns = columns//'|'//last
      text = title//line_feed//row_text(columns, columns)
      do i = 1, size(rows, 1)
         cells = to_text(numbers(i))
         do s = 1, size(rows, 2)
            associate (cell => rows(i, s))   ! the error of a percentile is taken from its interval
               error = cell%error + (cell%high - cell%low)/(2.0_wp*normal_95)
               if (is_near_samples(cell)) then
                  cells = cells//'|'//with_error(scale*cell%value, scale*error)
               else
                  cells = cells//'|-'
               end if
            end associate
         end do
         text = text//row_text(columns, cells)
      end do
   end function table_text

end module driver_whatif
