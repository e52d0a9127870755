!> Tables of `entroslip tradeoff`: settings, cheapest settings for wanted errors, components of the
!> error, numbers of samples and steps, spectra, orders of processes and lengths of their fits.
module driver_tradeoff_text
   use campaign_plan, only: plan_type
   use core_kinds, only: wp
   use core_text, only: brief, counted, duration, labelled, numbered, padded, to_text
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use tradeoff_effects, only: variant_row
   use tradeoff_front, only: error_components, has_drawn_friction, meets_targets, sample_steps, &
                             setting_row, size_row, spectrum_row
   use tradeoff_settings, only: setting_dt, setting_type
   use tradeoff_task_results, only: band_ratio, psd_mean, psd_percentiles, slip, slip_std
   use tradeoff_tasks, only: tradeoff_type
   use tradeoff_variants, only: order_row, variant_type
   implicit none(type, external)
   private
   public :: components_text, fits_text, orders_text, setting_text, settings_text, sizes_text, &
             spectra_text, variants_text, wanted_text

   character, parameter :: line_feed = new_line('a')

contains

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

   !> Table of the settings on the front and of the scene's own, with the extent of the marches.
   pure function settings_text(plan, tradeoff, rows, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      integer, allocatable :: ranking(:)
      integer :: i, k

      text = labelled('measured', counted(size(rows), 'setting', 'settings')//' on '// &
                      counted(sum([(size(tradeoff%levels(k)%sample), &
                                    k=1, size(tradeoff%levels))]), 'sample', 'samples')//' at '// &
                      counted(size(tradeoff%levels), 'level', 'levels')//' of force, '// &
                      to_text(tradeoff%plan%integration%n_steps)//' steps each')// &
             labelled('against', 'event, tolerance 1e-12, on the same samples; errors are the '// &
                      'largest over levels and dofs')//line_feed// &
             '  method   dt [s]   halvings tolerance slip [points] bands [%]  ns/step  run [s]'// &
             line_feed
      ranking = sort_order(rows%cost)
      do i = 1, size(ranking)
         associate (row => rows(ranking(i)))
            if (row%is_on_front .or. row%is_own) text = text//line_of(row)
         end associate
      end do
      text = text//'* the scene''s own; the others: nothing cheaper has a smaller error of slip'// &
             line_feed//line_feed

   contains

      pure function line_of(row) result(line)
         type(setting_row), intent(in) :: row
         character(:), allocatable :: line

         associate (s => row%setting)
            line = merge('* ', '  ', row%is_own)//padded(trim(s%method), 9)// &
                   padded(brief(setting_dt(s, plan%integration%dt)), 9)
            if (s%method == 'newmark') then
               line = line//padded(to_text(s%max_halvings), 9)//padded('-', 10)
            else
               line = line//padded('-', 9)//padded(brief(s%tolerance), 10)
            end if
         end associate
         line = line//padded(brief(row%error(slip)), 14)// &
                padded(known(100*row%error(band_ratio), has_bands(plan)), 11)// &
                padded(brief(row%cost), 9)// &
                brief(1.0e-9_wp*row%cost*sample_steps(plan)/n_ranks)//line_feed
      end function line_of

   end function settings_text

   !> True if the results have bands: spectra over several samples.
   pure logical function has_bands(plan)
      type(plan_type), intent(in) :: plan

      has_bands = plan%output%spectrum .and. maxval(plan%cases%n_samples) > 1
   end function has_bands

   !> Lines on the cheapest setting for wanted errors: the scene's targets, or a list of errors.
   pure function wanted_text(plan, rows, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      real(wp), parameter :: errors(*) = [1.0_wp, 0.1_wp, 1.0e-2_wp, 1.0e-3_wp, 1.0e-6_wp]
      integer :: i

      associate (points => plan%accuracy%target_slip_points, &
                 ratio => plan%accuracy%target_band_ratio)
         text = ''
         if (max(points, ratio) > 0.0_wp) text = answer(points, ratio)
         if (text /= '') return
      end associate
      do i = 1, size(errors)
         text = text//answer(errors(i), 0.0_wp)
      end do

   contains

      pure function answer(points, ratio) result(line)
         real(wp), intent(in) :: points, ratio
         character(:), allocatable :: line, wanted
         integer :: best

         wanted = ''
         if (points > 0.0_wp) wanted = 'slip to '//brief(points)//' points'
         if (points > 0.0_wp .and. ratio > 0.0_wp) wanted = wanted//', '
         if (ratio > 0.0_wp) wanted = wanted//'band ratios to '//brief(100*ratio)//' %'
         best = minloc(rows%cost, 1, mask=meets_targets(rows, points, ratio))
         if (best == 0) then
            line = labelled('cheapest', wanted//': no setting that was measured')
         else
            line = labelled('cheapest', wanted//': '// &
                            setting_text(rows(best)%setting, plan%integration%dt)//' ('// &
                            run_time(plan, rows(best), n_ranks, 1.0_wp)//')')
         end if
      end function answer

   end function wanted_text

   !> Table of the components of the error, with the largest of them and the cost of halving it.
   pure function components_text(plan, rows, own, errors, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: own
      type(error_components), intent(in) :: errors
      integer, intent(in) :: n_ranks
      character(:), allocatable :: now, text
      real(wp) :: parts(3)   ! components of the error of slip

      text = 'error now        slip [points] its std  spectrum [%] percentiles [%]  bands [%]'// &
             line_feed//component_text(plan, 'discretisation', errors%discretisation)// &
             component_text(plan, 'time average', errors%time)
      if (has_drawn_friction(plan)) text = text//component_text(plan, 'Monte Carlo', errors%samples)
      now = run_time(plan, rows(own), n_ranks, 1.0_wp)
      parts = [errors%discretisation(slip), errors%time(slip), errors%samples(slip)]
      if (.not. maxval(parts) > 0.0_wp) then
         text = text//labelled('largest', 'none of slip: nothing slips, or all the time')
         return
      end if
      select case (maxloc(parts, 1))
      case (1)
         text = text//labelled('largest', 'of slip: discretisation; to halve it: '//halved())
      case (2)
         text = text//labelled('largest', 'of slip: time average; to halve it: '//own_records()// &
                               longer()//', '//as_long(4.0_wp))
      case (3)
         text = text//labelled('largest', 'of slip: Monte Carlo; to halve it: '// &
                               'campaign%n_samples = '//to_text( &
                               ceiling(errors%times_to_halve*maxval(plan%cases%n_samples)))// &
                               ', '//as_long(errors%times_to_halve))
      end select

   contains

      !> Advice to draw a record for each sample, so that more samples lower the time-average error.
      pure function own_records() result(words)
         character(:), allocatable :: words

         words = ''
         if (plan%excitation%per_sample .or. plan%excitation%kind == 'file') return
         if (.not. has_drawn_friction(plan) .or. maxval(plan%cases%n_samples) < 4) return
         words = 'excitation%per_sample = .true. ('//brief(parts(2)/sqrt(real( &
                 maxval(plan%cases%n_samples), wp)))//' points are left), or '
      end function own_records

      pure function longer() result(words)
         character(:), allocatable :: words

         words = 'integration%n_steps = '//brief(4.0_wp*plan%integration%n_steps)
         if (plan%excitation%kind == 'file') words = words//', with a record as long'
      end function longer

      pure function halved() result(words)
         character(:), allocatable :: words
         integer :: best

         best = minloc(rows%cost, 1, mask=meets_targets(rows, 0.5_wp*parts(1), 0.0_wp))
         words = 'no setting that was measured'
         if (best > 0) words = setting_text(rows(best)%setting, plan%integration%dt)//', '// &
                               run_time(plan, rows(best), n_ranks, 1.0_wp)//' instead of '//now
      end function halved

      pure function as_long(times) result(words)
         real(wp), intent(in) :: times
         character(:), allocatable :: words

         words = run_time(plan, rows(own), n_ranks, times)//' instead of '//now
      end function as_long
   end function components_text

   !> Line on one component of the error, for all published numbers.
   pure function component_text(plan, name, error) result(line)
      type(plan_type), intent(in) :: plan
      character(*), intent(in) :: name
      real(wp), intent(in) :: error(:)   !! (published number)
      character(:), allocatable :: line

      associate (many => maxval(plan%cases%n_samples) > 1, spectrum => plan%output%spectrum)
         line = '  '//padded(name, 15)//padded(brief(error(slip)), 14)// &
                padded(known(error(slip_std), many), 9)// &
                padded(known(100*error(psd_mean), spectrum), 13)// &
                padded(known(100*error(psd_percentiles), spectrum .and. many), 17)// &
                known(100*error(band_ratio), spectrum .and. many)//line_feed
      end associate
   end function component_text

   !> A number, or '-' if it is not known.
   pure function known(value, is_known) result(text)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_known
      character(:), allocatable :: text

      text = '-'
      if (is_known) text = brief(value)
   end function known

   !> Run time of the whole scene with a setting, multiplied by `times`.
   pure function run_time(plan, row, n_ranks, times) result(text)
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: row
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: times
      character(:), allocatable :: text
      real(wp) :: seconds

      seconds = times*(1.0e-9_wp*row%cost*sample_steps(plan)/n_ranks)
      text = duration(seconds)
      if (seconds < 1.0_wp) text = brief(seconds)//' s'
   end function run_time

   !> Table of the total errors and run times with other numbers of samples and steps.
   pure function sizes_text(plan, rows, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(size_row), intent(in) :: rows(:)
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      logical :: many
      integer :: i

      text = 'all errors by samples and steps'//line_feed//'  '//padded('samples', 9)// &
             padded('steps', 11)//padded('mean slip [points]', 20)// &
             padded('std of slip', 13)//padded('bands [%]', 11)//'run [s]'//line_feed
      do i = 1, size(rows)
         many = rows(i)%n_samples > 1
         text = text//'  '//padded(to_text(rows(i)%n_samples), 9)// &
                padded(to_text(rows(i)%n_steps), 11)//padded(brief(rows(i)%error(slip)), 20)// &
                padded(known(rows(i)%error(slip_std), many), 13)// &
                padded(known(100*rows(i)%error(band_ratio), &
                             many .and. plan%output%spectrum), 11)// &
                brief(rows(i)%seconds/n_ranks)//line_feed
      end do
   end function sizes_text

   !> Table of changes of band ratios and cost by spectrum_every and segment_length.
   pure function spectra_text(rows) result(text)
      type(spectrum_row), intent(in) :: rows(:)
      character(:), allocatable :: text
      integer :: i

      text = 'spectra: every  segment [steps]  change of band ratios [%]  ns/step'//line_feed
      do i = 1, size(rows)
         text = text//repeat(' ', 9)//padded(to_text(rows(i)%every), 7)// &
                padded(to_text(rows(i)%segment_length), 17)// &
                padded(brief(100*rows(i)%band_ratio), 27)//brief(rows(i)%cost)//line_feed
      end do
   end function spectra_text

   !> Table of changes of published numbers with orders and lengths of fits.
   pure function variants_text(plan, variants, rows) result(text)
      type(plan_type), intent(in) :: plan
      type(variant_type), intent(in) :: variants(:)
      type(variant_row), intent(in) :: rows(:)
      character(:), allocatable :: bands, fit, head, text
      integer :: i

      text = ''
      head = ''
      do i = 1, size(rows)
         associate (row => rows(i), variant => variants(rows(i)%variant))
            if (heading(variant) /= head) then
               head = heading(variant)
               if (i > 1) text = text//line_feed
               text = text//head
            end if
            fit = 'chosen'
            if (variant%request%fit_steps > 0) fit = to_text(variant%request%fit_steps)
            text = text//merge('* ', '  ', variant%is_own)// &
                   padded(to_text(variant%request%order), 6)//padded(fit, 8)// &
                   padded(brief(row%seconds), 8)
            if (row%is_reference) then
               text = text//'compared with'//line_feed
               cycle
            end if
            bands = '-'
            if (plan%output%spectrum) &
               bands = with_error(100*row%change(band_ratio), 100*row%error(band_ratio))
            text = text//padded(with_error(row%change(slip), row%error(slip)), 19)// &
                   padded(with_error(row%change(slip_std), row%error(slip_std)), 18)// &
                   bands//line_feed
         end associate
      end do
      if (size(rows) > 0) text = text//'* the scene''s own; the largest change over levels and '// &
                                 'dofs +- standard error'//line_feed
   end function variants_text

   !> Heading of the variants of a process, orders or lengths of the fit.
   pure function heading(variant) result(text)
      type(variant_type), intent(in) :: variant
      character(:), allocatable :: text

      associate (request => variant%request)
         text = numbered('p', variant%process)//', '//trim(request%correlation)//' = '// &
                brief(request%correlation_length)//', std '//brief(request%std)//': other '// &
                trim(merge('lengths of its fit', 'orders            ', variant%is_of_fit))// &
                line_feed//'  order fit     fit [s] mean slip [points] std of slip       '// &
                'bands [%]'//line_feed
      end associate
   end function heading

   !> A number with its standard error.
   pure function with_error(value, standard_error) result(text)
      real(wp), intent(in) :: value, standard_error
      character(:), allocatable :: text

      text = brief(value)//'+-'//brief(standard_error)
   end function with_error

   !> Table of entropy, the other correlation length and time of the fit by the order of processes.
   pure function orders_text(rows) result(text)
      type(order_row), intent(in) :: rows(:)
      character(:), allocatable :: text, other
      integer :: i

      text = '  process                  order  entropy lost  other length  fit [ms]'//line_feed
      do i = 1, size(rows)
         associate (row => rows(i))
            other = trim(merge('L1', 'L0', row%correlation == 'L0'))//' = '// &
                    brief(row%other_length)
            text = text//merge('* ', '  ', row%is_own)// &
                   padded(row%method//', '//row%correlation//' = '// &
                          brief(row%correlation_length), 25)// &
                   padded(to_text(row%order), 7)//padded(brief(row%entropy_lost), 14)// &
                   padded(other, 14)//brief(row%milliseconds)//line_feed
         end associate
      end do
      text = text//'* an order of the scene; entropy [nat] per point below that of white noise'// &
             line_feed
   end function orders_text

   !> Table of the standard errors of positive processes that are fitted to simulated values.
   pure function fits_text(models) result(text)
      type(process_model_type), intent(in) :: models(:)
      character(:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(models)
         associate (m => models(i))
            if (.not. (m%request%positive .and. m%is_solved .and. m%l0_error > 0.0_wp)) cycle
            text = text//padded(numbered('p', i), 10)// &
                   padded(brief(100*m%mean_error/m%mean), 11)// &
                   padded(brief(100*m%std_error/m%std), 11)// &
                   brief(100*m%l0_error/m%l0)//line_feed
         end associate
      end do
      if (text /= '') text = 'fit       mean [%]   std [%]    L0 [%], standard errors'// &
                             line_feed//text
   end function fits_text

end module driver_tradeoff_text
