!> The text of `entroslip check`: what a scene will do, what it will not, and what that will cost.
module config_summary
   use campaign_plan, only: add_audits, integration_settings, plan_type, reference_for, &
                            repeats_samples
   use campaign_pooling, only: case_pool, estimators_of, find_pools
   use campaign_size, only: memory_of_rank, results_size
   use config_fingerprint, only: fingerprint
   use config_groups, only: scene_type
   use config_process_summary, only: is_fitted_to_values, max_rows, process_table
   use core_kinds, only: two_pi, wp
   use core_text, only: brief, counted, duration, joined, labelled, numbered, padded, size_text, &
                        to_text
   use process_model, only: process_model_type
   use process_scaling, only: first_of_fit
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: summary_text

   character(*), parameter :: line_feed = new_line('a')

contains

   !> Aligned and short; ends without a line feed.
   function summary_text(scene, plan, nanoseconds, n_ranks, transitions, foreseen, &
                         audit_nanoseconds, regression_seconds) result(text)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: nanoseconds   !! cost of a sample-step; 0: not known
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: transitions   !! transitions of a sample in a step
      !> (process) whether it has a solution, as far as that is known before the fit, or why not
      type(process_model_type), intent(in) :: foreseen(:)
      real(wp), intent(in) :: audit_nanoseconds   !! of a sample-step that is repeated; 0: not known
      real(wp), intent(in) :: regression_seconds  !! of a processor
      character(:), allocatable :: text

      text = labelled('scene', plan%title//', '//scene%path)// &
             labelled('fingerprint', fingerprint(scene))
      text = text//labelled('runs', joined(activities(plan, wanted=.true.)))
      text = text//labelled('does not run', joined(activities(plan, wanted=.false.)))
      if (size(plan%processes) > 0) text = text//line_feed//process_table(plan, foreseen)
      if (plan%has_structure) then
         text = text//line_feed//case_table(plan, scene%excitation%level_name())//line_feed// &
                motion_text(plan)
         text = text//labelled('work', work_text(plan, n_ranks, nanoseconds)// &
                         trim(merge(', and the fits', '              ', &
                                    any(is_fitted_to_values(plan%processes)))))
         text = text//estimates_text(plan, regression_seconds, n_ranks)
         if (repeats_samples(plan)) &
            text = text//labelled('audit', audit_text(plan, n_ranks, audit_nanoseconds))
      end if
      text = text//labelled('memory', 'about '// &
                            size_text(memory_of_rank(plan, transitions))//' a rank')// &
             labelled('results', 'up to '// &
                      size_text(results_size(plan, transitions, foreseen)))
      if (size(scene%unused) > 0) &
         text = text//labelled('note', 'given and not used: '//joined(scene%unused))
      if (plan%has_structure) text = text//damping_note(scene%chain%damping_ratio)
      text = text(:len(text) - 1)
   end function summary_text

   !> Note on a ratio that structures held by friction do not have: 1 % is often given as 1.
   pure function damping_note(damping_ratio) result(text)
      real(wp), intent(in) :: damping_ratio(:)
      character(:), allocatable :: text
      real(wp), parameter :: unusual = 0.2_wp

      text = ''
      if (any(damping_ratio > unusual)) &
         text = labelled('note', 'chain%damping_ratio = '//brief(maxval(damping_ratio))// &
                         ' is above '//brief(unusual)//': 1 % of critical is 0.01')
   end function damping_note

   !> Activities of the plan, or those that it leaves out.
   pure function activities(plan, wanted) result(names)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: wanted
      character(40), allocatable :: names(:)
      logical :: is_there(9)
      integer :: i, n_fits
      logical, parameter :: is_of_motion(9) = [.false., .false., spread(.true., 1, 6), .false.]

      n_fits = count(first_of_fit(plan%processes) == [(i, i=1, size(plan%processes))])
      associate (output => plan%output)
         is_there = [size(plan%processes) > 0, size(plan%cases) > 0, &
                     any(plan%cases%process > 0), &
                     plan%has_structure .and. [output%spectrum, output%energy, output%history, &
                                               output%transitions, repeats_samples(plan)], &
                     plan%n_realizations > 0]
      end associate
      names = [character(40) :: 'processes', 'motion', 'samples with drawn friction', 'spectrum', &
               'energy', 'history', 'transitions', 'audit', 'realizations']
      if (wanted) then
         names(1) = counted(size(plan%processes), 'process', 'processes')
         if (n_fits < size(plan%processes)) &
            names(1) = trim(names(1))//' by '//counted(n_fits, 'fit', 'fits')
         names(2) = counted(size(plan%cases), 'case of motion', 'cases of motion')
         names(3) = counted(sum(plan%cases%n_samples), 'sample', 'samples')
         names(9) = counted(plan%n_realizations, 'realization', 'realizations')//' of '// &
                    counted(plan%n_points, 'point', 'points')
      end if
      names = pack(names, (is_there .eqv. wanted) .and. &
                   (plan%has_structure .or. .not. is_of_motion))
   end function activities

   !> One row per process: its cases differ in the level of the force only.
   function case_table(plan, level) result(text)
      type(plan_type), intent(in) :: plan
      character(*), intent(in) :: level   !! what levels of the force are called
      character(:), allocatable :: text, numbers, name
      integer :: first, last, n_rows

      text = 'case       process  samples  '//level//line_feed
      n_rows = 0
      first = 1
      do while (first <= size(plan%cases))
         last = first
         do while (last < size(plan%cases))
            if (plan%cases(last + 1)%process /= plan%cases(first)%process) exit
            last = last + 1
         end do
         n_rows = n_rows + 1
         if (n_rows > max_rows) then
            text = text//'... and '//to_text(size(plan%cases) - first + 1)//' more'//line_feed
            exit
         end if
         numbers = numbered('c', first)
         if (last > first) numbers = numbers//'-'//numbered('c', last)
         name = 'none'
         if (plan%cases(first)%process > 0) name = numbered('p', plan%cases(first)%process)
         text = text//padded(numbers, 11)//padded(name, 9)// &
                padded(to_text(plan%cases(first)%n_samples), 9)// &
                levels_text(plan, first, last)//line_feed
         first = last + 1
      end do
   end function case_table

   !> Levels of the cases from first to last; of sines with the frequencies, which vary fastest.
   pure function levels_text(plan, first, last) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: first, last
      character(:), allocatable :: text
      real(wp) :: levels(last - first + 1)
      integer :: n

      levels = plan%cases(first:last)%strength
      if (plan%excitation%kind == 'sine') then
         n = count(abs(levels - levels(1)) <= 0.0_wp)   ! each amplitude at all frequencies
         text = shortened(levels(::n))//', each at '// &
                shortened(plan%cases(first:first + n - 1)%frequency)//' Hz'
      else
         text = shortened(levels)
      end if
   end function levels_text

   !> A list of numbers, cut in the middle if it is long.
   pure function shortened(numbers) result(text)
      real(wp), intent(in) :: numbers(:)
      character(:), allocatable :: text
      integer, parameter :: shown = 6
      integer :: i

      text = brief(numbers(1))
      do i = 2, size(numbers)
         if (i <= shown .or. i == size(numbers)) then
            text = text//', '//brief(numbers(i))
         else if (i == shown + 1) then
            text = text//', ...'
         end if
      end do
   end function shortened

   !> The force, without where it acts.
   pure function force_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (excitation => plan%excitation)
         select case (excitation%kind)
         case ('file')
            text = excitation%file
         case ('psd')
            text = 'noise of a given spectrum from '//brief(excitation%density(1, 1))//' to '// &
                   brief(excitation%density(1, size(excitation%density, 2)))//' Hz'
         case ('sine')
            associate (least => minval(plan%cases%frequency), most => maxval(plan%cases%frequency))
               text = 'sine of '//brief(least)//' Hz'
               if (most > least) text = 'sines from '//brief(least)//' to '//brief(most)//' Hz'
            end associate
         case default
            text = 'noise from '//brief(excitation%band(1))//' to '//brief(excitation%band(2))// &
                   ' Hz'
         end select
      end associate
   end function force_text

   !> Text on what noise loses at its highest frequency, being linear between its values: a density
   !> becomes (sin(x)/x)^4 of it, x = pi f dt.
   pure function chord_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text
      real(wp), parameter :: mentioned = 0.01_wp   !! loss, at least
      real(wp) :: highest, loss, x

      text = ''
      select case (plan%excitation%kind)
      case ('band_limited')
         highest = plan%excitation%band(2)
      case ('psd')
         highest = maxval(plan%excitation%density(1, :))
      case default
         return
      end select
      x = 0.5_wp*two_pi*highest*plan%integration%dt
      loss = 1.0_wp - (sin(x)/x)**4
      if (loss > mentioned) text = '; linear between steps, which takes '// &
                                   brief(100.0_wp*loss)//' % of its density at '// &
                                   brief(highest)//' Hz'
   end function chord_text

   function motion_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text, method, steps
      real(wp), parameter :: fewest_steps = 10.0_wp   ! the period is wrong by (omega dt)^2/12: 3 %
      real(wp) :: finest, span

      associate (chain => plan%structure, how => plan%integration, excitation => plan%excitation, &
                 n => plan%structure%n_dof)
         text = structure_text(chain)
         if (any(plan%cases%process == 0)) text = text//labelled('friction', friction_text(plan))
         text = text//labelled('force', force_text(plan)//loaded_text(plan)//', one record for '// &
                               trim(merge('each sample', 'all samples', excitation%per_sample))// &
                               chord_text(plan))
         method = 'event, tolerance '//brief(how%tolerance)
         if (how%method == 'newmark') &
            method = 'newmark, at most '//counted(how%max_halvings, 'halving', 'halvings')
         span = how%n_steps*how%dt
         steps = to_text(how%n_steps)//' steps of '//to_text(how%dt)//' s, '
         if (span < 1.0_wp) then   ! no time of work, which would be "less than 1 s"
            steps = steps//brief(span)//' s'
         else
            steps = steps//duration(span)
         end if
         if (how%n_discard > 0) steps = steps//', the first '//to_text(how%n_discard)//' discarded'
         text = text//labelled('integration', method//', '//steps)
         if (how%method == 'newmark') then   ! the exact march has no error of periods
            finest = 1.0_wp/(chain%frequencies_stuck(n)*how%dt)
            text = text//labelled('resolution', brief(finest)// &
                                  ' steps in a period of the fastest mode'// &
                                  trim(merge(': newmark distorts it', '                     ', &
                                             finest < fewest_steps)))
         end if
         if (plan%output%spectrum) text = text//labelled('spectra', spectra_text(plan))
      end associate
   end function motion_text

   !> Text on how spectra are estimated, and what of them is not kept.
   pure function spectra_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (length => plan%output%segment_length)
         text = 'segments of '//to_text(length)//' steps, '// &
                brief(1.0_wp/(length*plan%integration%dt))//' Hz apart'
      end associate
      if (.not. plan%output%samples) text = text//'; those of the samples are not kept: none '// &
                                            'can be added later'
   end function spectra_text

   !> Sizes, mass, natural frequencies, and modes that move without force.
   pure function structure_text(structure) result(text)
      type(structure_type), intent(in) :: structure
      character(:), allocatable :: text

      associate (n => structure%n_dof)
         text = labelled('structure', counted(n, 'dof', 'dofs')//', '// &
                         counted(structure%n_joints, 'joint', 'joints')//', mass (1''M1) '// &
                         brief(sum(structure%mass))//' kg')// &
                labelled('frequencies', brief(structure%frequencies_stuck(1))//' to '// &
                         brief(structure%frequencies_stuck(n))//' Hz stuck, '// &
                         brief(structure%frequencies_slip(1))//' to '// &
                         brief(structure%frequencies_slip(n))//' Hz slipping')
      end associate
      if (structure%frequencies_slip(1) < 0.0_wp) &
         text = text//labelled('unstable', 'with all joints slipping, as K has a negative '// &
                               'eigenvalue: motion grows there')
      if (structure%n_zero_modes > 0) &
        text = text//labelled('zero modes', to_text(structure%n_zero_modes)//' with all joints '// &
                               'stuck: the structure moves there without force')
   end function structure_text

   !> Text on where the force acts: on one dof, or by the load.
   pure function loaded_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (load => plan%structure%load)
         if (plan%excitation%base) then
            text = ' as acceleration of the ground, '// &
                   trim(merge('of all dofs alike  ', 'of each by its load', &
                              all(abs(load(:, 1) + sum(plan%structure%mass, 2)) <= 0.0_wp)))
         else if (size(load, 2) > 1) then
            text = ' for each of '//to_text(size(load, 2))//' forces'
         else if (count(abs(load) > 0.0_wp) == 1) then
            text = ' on dof '//to_text(maxloc(abs(load(:, 1)), 1))
         else
            text = ' on '//counted(count(abs(load) > 0.0_wp), 'dof', 'dofs')
         end if
      end associate
   end function loaded_text

   !> Friction of the deterministic cases, and which value of the scene it is.
   pure function friction_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (least => minval(plan%friction), most => maxval(plan%friction))
         text = brief(least)
         if (most > least) text = text//' to '//brief(most)
         text = text//' in deterministic cases, from '//plan%friction_from
         if (any(abs(plan%processes%mean - least) > 0.0_wp)) &
            text = text//', where process%mean is '//brief(plan%processes(1)%mean)
      end associate
   end function friction_text

   !> Text on which samples serve one regression, and on their time; pools of one size are counted.
   pure function estimates_text(plan, seconds, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: seconds   !! of a processor, of all regressions
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      type(case_pool), allocatable :: pools(:)
      integer, allocatable :: sizes(:, :)   ! (samples and cases, pool)
      character(64), allocatable :: parts(:)
      integer :: n_alike, p

      text = ''
      if (all(plan%cases%n_samples <= 1)) return
      pools = find_pools(plan)
      sizes = reshape([(sum(pools(p)%n_fitted), size(pools(p)%cases), p=1, size(pools))], &
                      [2, size(pools)])
      allocate (parts(0))
      do p = 1, size(pools)
         if (any(is_alike(sizes(:, :p - 1), sizes(:, p)))) cycle
         n_alike = count(is_alike(sizes, sizes(:, p)))
         parts = [character(64) :: parts, counted(n_alike, 'regression', 'regressions')// &
                  ' over '//to_text(sizes(1, p))//' samples of '// &
                  counted(sizes(2, p), 'case', 'cases')]
      end do
      if (size(pools) > 0) parts = [character(64) :: parts, duration(seconds/n_ranks)//' on '// &
                                    counted(n_ranks, 'rank', 'ranks')]
      n_alike = count(estimators_of(plan) == 'plain' .and. plan%cases%n_samples > 1)
      if (n_alike > 0) parts = [character(64) :: parts, 'plain sampling of '// &
                                counted(n_alike, 'case', 'cases')]
      text = labelled('estimates', joined(parts))

   contains

      pure function is_alike(all_sizes, one)
         integer, intent(in) :: all_sizes(:, :), one(:)
         logical :: is_alike(size(all_sizes, 2))

         is_alike = all_sizes(1, :) == one(1) .and. all_sizes(2, :) == one(2)
      end function is_alike

   end function estimates_text

   !> Line on the samples that are repeated, and how.
   pure function audit_text(plan, n_ranks, nanoseconds) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: nanoseconds   !! 0: not known
      character(:), allocatable :: text
      type(plan_type) :: audited
      type(integration_settings) :: reference

      audited = plan
      call add_audits(audited)
      audited%cases = pack(audited%cases, audited%cases%audits > 0)
      reference = reference_for(plan%integration)
      text = counted(sum(audited%cases%n_samples), 'sample', 'samples')//' repeated, '// &
             trim(reference%method)//', tolerance '//brief(reference%tolerance)//': '// &
             work_text(audited, n_ranks, nanoseconds)
   end function audit_text

   !> Work of the march of all samples, and its time where the cost of a sample-step is known.
   pure function work_text(plan, n_ranks, nanoseconds) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: nanoseconds   !! 0: not known
      character(:), allocatable :: text
      real(wp) :: sample_steps

      sample_steps = sum(real(plan%cases%n_samples, wp))*plan%integration%n_steps
      text = brief(sample_steps)//' sample-steps'
      if (nanoseconds > 0.0_wp) &
         text = text//', '//duration(sample_steps*nanoseconds*1.0e-9_wp/n_ranks)//' at '// &
                brief(nanoseconds)//' ns each on '//counted(n_ranks, 'rank', 'ranks')
   end function work_text

end module config_summary
