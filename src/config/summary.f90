!> Text of `entroslip check`: the parts of a scene that a run computes, and their cost.
module config_summary
   use campaign_plan, only: add_audits, case_type, integration_settings, plan_type, &
                            reference_for, repeats_samples
   use campaign_pooling, only: case_pool, estimators_of, find_pools
   use campaign_size, only: memory_of_rank, results_size
   use config_fingerprint, only: fingerprint
   use config_groups, only: scene_type
   use config_process_summary, only: max_rows, process_table
   use core_kinds, only: two_pi, wp
   use core_text, only: brief, counted, duration, joined, labelled, line_feed, lowered, numbered, &
                        row_text, size_text, to_text
   use process_model, only: is_fitted_by_simulation, process_model_type
   use process_scaling, only: first_of_fit
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: summary_text

contains

   !> Lines of the summary of a scene.
   function summary_text(scene, plan, nanoseconds, n_ranks, transitions, predicted, &
                         audit_nanoseconds, end_seconds, share_powerful) result(text)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: nanoseconds   !! time per step of a sample; 0: not known
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: transitions   !! transitions per step of a sample
      !> (process) model as far as it is known before the fit: is_solved, reason, branch
      type(process_model_type), intent(in) :: predicted(:)
      real(wp), intent(in) :: audit_nanoseconds   !! the same of samples of the audit
      real(wp), intent(in) :: end_seconds   !! time from the last march to the results file
      real(wp), intent(in) :: share_powerful   !! share of the frequencies that have the power
      character(:), allocatable :: text

      text = labelled('scene', plan%title//', '//scene%path)// &
             labelled('fingerprint', fingerprint(scene))
      text = text//labelled('runs', joined(activities(plan, wanted=.true.)))
      text = text//labelled('does not run', joined(activities(plan, wanted=.false.)))
      if (size(plan%processes) > 0) text = text//line_feed//process_table(plan, predicted)
      if (plan%has_structure) then
         text = text//line_feed//case_table(plan, scene%excitation%level_name())//line_feed// &
                motion_text(plan)
         text = text//labelled('work', work_text(plan, n_ranks, nanoseconds)//', '// &
                               duration(end_seconds)//' of statistics and writing'// &
                               trim(merge(', and the fits', '              ', &
                                          any(is_fitted_by_simulation(plan%processes))))// &
                               trim(merge(', and the realizations', '                      ', &
                                          plan%n_realizations > 0)))
         text = text//estimates_text(plan)
         if (repeats_samples(plan)) &
            text = text//labelled('audit', audit_text(plan, n_ranks, audit_nanoseconds))
      end if
      text = text//labelled('memory', 'about '// &
                            size_text(memory_of_rank(plan, transitions, share_powerful))// &
                            ' a rank')// &
             labelled('results', 'up to '// &
                      size_text(results_size(plan, transitions, predicted)))
      if (size(scene%unused) > 0) &
         text = text//labelled('note', 'given and not used: '//joined(scene%unused))
   end function summary_text

   !> Names of the parts that the plan computes, or of those that it does not.
   pure function activities(plan, wanted) result(names)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: wanted   !! true: computed parts, false: the others
      character(40), allocatable :: names(:)
      logical :: is_computed(9)
      integer :: i, n_fits
      logical, parameter :: needs_motion(9) = [.false., .false., spread(.true., 1, 6), .false.]

      n_fits = count(first_of_fit(plan%processes) == [(i, i=1, size(plan%processes))])
      associate (output => plan%output)
         is_computed = [size(plan%processes) > 0, size(plan%cases) > 0, &
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
      names = pack(names, (is_computed .eqv. wanted) .and. &
                   (plan%has_structure .or. .not. needs_motion))
   end function activities

   !> Table of the cases, one row per process with all its force levels.
   function case_table(plan, level) result(text)
      type(plan_type), intent(in) :: plan
      character(*), intent(in) :: level   !! name of the value that the force levels differ in
      character(:), allocatable :: columns, levels, name, numbers, text
      integer :: first, n_levels

      n_levels = count(plan%cases%process == plan%cases(1)%process)
      levels = levels_text(plan%cases(:n_levels))
      columns = 'case       |process  |samples  |'//level
      text = row_text(columns, columns)
      do first = 1, size(plan%cases), n_levels
         if (first > max_rows*n_levels) then
            text = text//'... and '//to_text(size(plan%cases) - first + 1)//' more'//line_feed
            exit
         end if
         numbers = numbered('c', first)
         if (n_levels > 1) numbers = numbers//'-'//numbered('c', first + n_levels - 1)
         name = 'none'
         associate (case => plan%cases(first))
            if (case%process > 0) name = numbered('p', case%process)
            text = text//row_text(columns, numbers//'|'//name//'|'//to_text(case%n_samples)// &
                                  '|'//levels)
         end associate
      end do
   end function case_table

   !> Force levels of the cases of one process; of sines the amplitudes and frequencies.
   pure function levels_text(cases) result(text)
      type(case_type), intent(in) :: cases(:)
      character(:), allocatable :: text
      integer :: n

      text = shortened(cases%strength)
      if (.not. any(cases%frequency > 0.0_wp)) return
      n = count(abs(cases%strength - cases(1)%strength) <= 0.0_wp)   ! number of frequencies
      text = shortened(cases(::n)%strength)//', each at '//shortened(cases(:n)%frequency)//' Hz'
   end function levels_text

   !> List of numbers; a long one is abbreviated by dots.
   pure function shortened(numbers) result(text)
      real(wp), intent(in) :: numbers(:)
      character(:), allocatable :: text
      integer, parameter :: shown = 6   ! numbers before the dots
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

   !> Kind and frequencies of the force.
   pure function force_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (excitation => plan%excitation)
         select case (excitation%kind)
         case ('file')
            text = excitation%file
         case ('psd')
            text = 'noise of a given spectrum, '//range_text(excitation%density(1, :))//' Hz'
         case ('sine')
            text = 'sine, '//range_text(plan%cases%frequency)//' Hz'
         case default
            text = 'noise, '//range_text(excitation%band)//' Hz'
         end select
      end associate
   end function force_text

   !> Text on the loss of density of noise at its highest frequency f: linear interpolation between
   !> steps multiplies a density by (sin(x)/x)^4, x = pi f dt.
   pure function interpolation_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text
      real(wp), parameter :: mentioned = 0.01_wp   !! smallest loss that is mentioned
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
   end function interpolation_text

   !> Lines on the structure, the force, the integration and the spectra.
   function motion_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text, method, steps
      !> Fewest steps per period of the fastest mode: the period error (omega dt)^2/12 is then 3 %
      real(wp), parameter :: fewest_steps = 10.0_wp
      real(wp) :: steps_per_period

      associate (s => plan%integration)
         text = structure_text(plan%structure)
         if (any(plan%cases%process == 0)) text = text//labelled('friction', friction_text(plan))
         text = text//labelled('force', force_text(plan)//load_text(plan)//', one record for '// &
                               trim(merge('each sample', 'all samples', &
                                          plan%excitation%per_sample))//interpolation_text(plan))
         method = 'event, tolerance '//brief(s%tolerance)
         if (s%method == 'newmark') &
            method = 'newmark, at most '//counted(s%max_halvings, 'halving', 'halvings')
         steps = to_text(s%n_steps)//' steps of '//lowered(to_text(s%dt))//' s, '// &
                 duration(s%n_steps*s%dt)
         if (s%n_discard > 0) steps = steps//', the first '//to_text(s%n_discard)//' discarded'
         text = text//labelled('integration', method//', '//steps)
         if (s%method == 'newmark') then   ! the exact march has no period error
            steps_per_period = 1.0_wp/(maxval(plan%structure%frequencies_stuck)*s%dt)
            text = text//labelled('resolution', brief(steps_per_period)// &
                                  ' steps in a period of the fastest mode'// &
                                  trim(merge(': newmark distorts it', '                     ', &
                                             steps_per_period < fewest_steps)))
         end if
         if (plan%output%spectrum) text = text//labelled('spectra', spectra_text(plan))
      end associate
   end function motion_text

   !> Text on the Welch segments of the spectra, and whether those of the samples are kept.
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

   !> Lines on the structure: sizes, mass if M is diagonal (else M may have rotations and modes),
   !> natural frequencies, zero modes, and an unusually large damping ratio.
   pure function structure_text(structure) result(text)
      type(structure_type), intent(in) :: structure
      character(:), allocatable :: text
      real(wp), parameter :: unusual = 0.2_wp   ! 1 % of critical is sometimes given as 1

      associate (n => structure%n_dof)
         text = counted(n, 'dof', 'dofs')//', '//counted(structure%n_joints, 'joint', 'joints')
         if (structure%has_lumped_mass()) &
            text = text//', mass '//brief(sum(structure%mass))
         text = labelled('structure', text)// &
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
      if (structure%dropped_frequency > 0.0_wp) &
         text = text//labelled('note', 'what K holds zero modes by, up to '// &
                               brief(structure%dropped_frequency)//' Hz, is below 1e-10 of its '// &
                               'terms and taken as rounding')
      if (any(structure%damping_ratio > unusual)) &
         text = text//labelled('note', 'damping_ratio = '// &
                               brief(maxval(structure%damping_ratio))//' is above '// &
                               brief(unusual)//': 1 % of critical is 0.01')
   end function structure_text

   !> Text on the dofs that the force acts on.
   pure function load_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (load => plan%structure%load)
         text = ''
         if (size(load, 2) > 1) text = ' for each of '//to_text(size(load, 2))//' forces'
         if (plan%excitation%base) then
            text = text//' as acceleration of the ground, '// &
                   trim(merge('of all dofs alike  ', 'of each by its load', &
                              all(abs(load(:, 1) + sum(plan%structure%mass, 2)) <= 0.0_wp)))
         else if (count(abs(load) > 0.0_wp) == 1) then
            text = ' on dof '//to_text(maxloc(abs(load(:, 1)), 1))
         else if (size(load, 2) == 1) then
            text = ' on '//counted(count(abs(load) > 0.0_wp), 'dof', 'dofs')
         end if
      end associate
   end function load_text

   !> Text on the friction of the deterministic cases, where it comes from, and other means.
   pure function friction_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text

      associate (least => minval(plan%friction), means => plan%processes%mean)
         text = range_text(plan%friction)//' in deterministic cases, from '//plan%friction_from
         if (any(abs(means - least) > 5.0e-3_wp*least)) &   ! three digits are shown
            text = text//', where process%mean is '//range_text(means)
      end associate
   end function friction_text

   !> Least and largest of some values, or the one value that all have.
   pure function range_text(values) result(text)
      real(wp), intent(in) :: values(:)
      character(:), allocatable :: text

      text = brief(minval(values))
      if (maxval(values) > minval(values)) text = text//' to '//brief(maxval(values))
   end function range_text

   !> Text on the regressions: number of pools of each size, their samples and cases.
   pure function estimates_text(plan) result(text)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: text
      type(case_pool), allocatable :: pools(:)
      character(64), allocatable :: parts(:), sizes(:)   ! sizes (pool)
      integer :: n_plain, p

      text = ''
      if (all(plan%cases%n_samples <= 1)) return
      pools = find_pools(plan)
      allocate (sizes(size(pools)), parts(0))
      do p = 1, size(pools)
         sizes(p) = to_text(sum(pools(p)%n_fitted))//' samples of '// &
                   counted(size(pools(p)%cases), 'case', 'cases')
      end do
      do p = 1, size(pools)
         if (any(sizes(:p - 1) == sizes(p))) cycle
         parts = [character(64) :: parts, counted(count(sizes == sizes(p)), 'regression', &
                                                  'regressions')//' over '//trim(sizes(p))]
      end do
      n_plain = count(estimators_of(pools, size(plan%cases)) == 'plain' &
                      .and. plan%cases%n_samples > 1)
      if (n_plain > 0) parts = [character(64) :: parts, 'plain sampling of '// &
                                counted(n_plain, 'case', 'cases')]
      text = labelled('estimates', joined(parts))
   end function estimates_text

   !> Text on the samples that the audit repeats, and its method.
   pure function audit_text(plan, n_ranks, nanoseconds) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: nanoseconds   !! time per step of a sample; 0: not known
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

   !> Text on the number of steps of all samples, and their time if that is known.
   pure function work_text(plan, n_ranks, nanoseconds) result(text)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: nanoseconds   !! time per step of a sample; 0: not known
      character(:), allocatable :: text
      real(wp) :: sample_steps

      sample_steps = sum(real(plan%cases%n_samples, wp))*plan%integration%n_steps
      text = brief(sample_steps)//' sample-steps'
      if (nanoseconds > 0.0_wp) &
         text = text//', '//duration(sample_steps*nanoseconds*1.0e-9_wp/n_ranks)// &
                ' of march at '//brief(nanoseconds)//' ns each on '// &
                counted(n_ranks, 'rank', 'ranks')
   end function work_text

end module config_summary
