!> What `entroslip tradeoff` says: settings, wanted errors, parts of the error, spectra, orders.
module driver_tradeoff_text
   use config_phrases, only: brief, counted, duration, labelled, numbered, padded
   use core_kinds, only: wp
   use core_text, only: to_text
   use ensemble_plan, only: plan_type
   use ensemble_tradeoff_effects, only: variant_row
   use ensemble_tradeoff_front, only: cheapest, error_parts, keeps, sample_steps, setting_row, &
                                      size_row, spectrum_row
   use ensemble_tradeoff_process, only: order_row
   use ensemble_tradeoff_settings, only: setting_dt, setting_type
   use ensemble_tradeoff_tasks, only: tradeoff_type
   use ensemble_tradeoff_variants, only: variant_type
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: fits_text, orders_text, parts_text, setting_text, settings_text, sizes_text, &
             spectra_text, variants_text, wanted_text

   character, parameter :: line_feed = new_line('a')

contains

   !> event, tolerance 1e-3; newmark, dt 0.0042, 4 halvings
   pure function setting_text(setting, dt) result(text)
      type(setting_type), intent(in) :: setting
      real(wp), intent(in) :: dt   !! the scene's [s]
      character(:), allocatable :: text

      text = trim(setting%method)
      if (setting%parts /= setting%stride) text = text//', dt '//brief(setting_dt(setting, dt))
      if (setting%method == 'newmark') then
         text = text//', '//counted(setting%max_halvings, 'halving', 'halvings')
      else
         text = text//', tolerance '//brief(setting%tolerance)
      end if
   end function setting_text

   !> What was marched, and the front as a table, the scene's own setting with it.
   pure function settings_text(plan, tradeoff, rows, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(tradeoff_type), intent(in) :: tradeoff
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      integer, allocatable :: order(:)
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
      order = by_cost(rows)
      do i = 1, size(order)
         associate (row => rows(order(i)))
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
         line = line//padded(brief(row%slip), 14)//padded(brief(100*row%band_ratio), 11)// &
                padded(brief(row%cost), 9)// &
                brief(1.0e-9_wp*row%cost*sample_steps(plan)/n_ranks)//line_feed
      end function line_of

   end function settings_text

   !> Rows from the cheapest to the dearest.
   pure function by_cost(rows) result(order)
      type(setting_row), intent(in) :: rows(:)
      integer :: order(size(rows))
      logical :: is_left(size(rows))
      integer :: i

      is_left = .true.
      do i = 1, size(rows)
         order(i) = minloc(rows%cost, 1, mask=is_left)
         is_left(order(i)) = .false.
      end do
   end function by_cost

   !> The cheapest setting for wanted errors: the scene's targets, or a ladder.
   pure function wanted_text(plan, rows, slip_points, band_ratio, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: rows(:)
      real(wp), intent(in) :: slip_points, band_ratio   !! targets of the scene; 0: none
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      real(wp), parameter :: ladder(*) = [1.0_wp, 0.1_wp, 1.0e-2_wp, 1.0e-3_wp, 1.0e-6_wp]
      integer :: i

      if (max(slip_points, band_ratio) > 0.0_wp) then
         text = answer(slip_points, band_ratio)
         return
      end if
      text = ''
      do i = 1, size(ladder)
         text = text//answer(ladder(i), 0.0_wp)
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
         if (.not. any(keeps(rows, points, ratio))) then
            line = labelled('cheapest', wanted//': no setting that was measured')
            return
         end if
         best = cheapest(rows, points, ratio, by_work=.false.)
         line = labelled('cheapest', wanted//': '// &
                         setting_text(rows(best)%setting, plan%integration%dt)//' ('// &
                         duration(1.0e-9_wp*rows(best)%cost*sample_steps(plan)/n_ranks)//')')
      end function answer

   end function wanted_text

   !> What the error is made of, which part is the largest, and what halving that costs.
   pure function parts_text(plan, rows, own, parts, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: own
      type(error_parts), intent(in) :: parts
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      real(wp) :: slip(3)

      text = 'error now        mean slip [points]  std of slip [points]  band ratio [%]'// &
             line_feed//row('discretisation', parts%discretisation_slip, rows(own)%slip_std, &
                            parts%discretisation_ratio)// &
             row('time average', parts%time_slip, -1.0_wp, parts%time_ratio)// &
             row('Monte Carlo', parts%samples_slip, parts%samples_slip_std, parts%samples_ratio)
      slip = [parts%discretisation_slip, parts%time_slip, parts%samples_slip]
      select case (maxloc(slip, 1))
      case (1)
         text = text//labelled('largest', 'discretisation; to halve it: '//halved())
      case (2)
         text = text//labelled('largest', 'time average; to halve it: '// &
                               'integration%n_steps = '//brief(4.0_wp*plan%integration%n_steps)// &
                               ', '//four_times())
      case (3)
         text = text//labelled('largest', 'Monte Carlo; to halve it: campaign%n_samples = '// &
                               to_text(4*maxval(plan%cases%n_samples))//', '//four_times())
      end select

   contains

      pure function row(name, mean, std, ratio) result(line)
         character(*), intent(in) :: name
         real(wp), intent(in) :: mean, std, ratio   !! std below 0: none
         character(:), allocatable :: line, second

         second = '-'
         if (std >= 0.0_wp) second = brief(std)
         line = '  '//padded(name, 15)//padded(brief(mean), 20)//padded(second, 22)// &
                brief(100*ratio)//line_feed
      end function row

      pure function halved() result(words)
         character(:), allocatable :: words

         if (.not. any(keeps(rows, 0.5_wp*slip(1), 0.0_wp))) then
            words = 'no setting that was measured'
            return
         end if
         associate (best => cheapest(rows, 0.5_wp*slip(1), 0.0_wp, by_work=.false.))
            words = setting_text(rows(best)%setting, plan%integration%dt)//', '// &
                    duration(1.0e-9_wp*rows(best)%cost*sample_steps(plan)/n_ranks)// &
                    ' instead of '//now()
         end associate
      end function halved

      pure function four_times() result(words)
         character(:), allocatable :: words

         words = duration(4.0e-9_wp*rows(own)%cost*sample_steps(plan)/n_ranks)//' instead of '// &
                 now()
      end function four_times

      pure function now() result(words)
         character(:), allocatable :: words

         words = duration(1.0e-9_wp*rows(own)%cost*sample_steps(plan)/n_ranks)
      end function now

   end function parts_text

   !> The whole error that other numbers of samples and steps would leave, and their time.
   pure function sizes_text(rows, n_ranks) result(text)
      type(size_row), intent(in) :: rows(:)
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      integer :: i

      text = 'all errors by samples and steps'//line_feed//'  '//padded('samples', 9)// &
             padded('steps', 11)//padded('mean slip [points]', 20)// &
             padded('std of slip', 13)//padded('bands [%]', 11)//'run [s]'//line_feed
      do i = 1, size(rows)
         text = text//'  '//padded(to_text(rows(i)%n_samples), 9)// &
                padded(to_text(rows(i)%n_steps), 11)//padded(brief(rows(i)%slip_mean), 20)// &
                padded(brief(rows(i)%slip_std), 13)//padded(brief(100*rows(i)%band_ratio), 11)// &
                brief(rows(i)%seconds/n_ranks)//line_feed
      end do
   end function sizes_text

   !> What orders and lengths of fits change in what is published.
   pure function variants_text(variants, rows) result(text)
      type(variant_type), intent(in) :: variants(:)
      type(variant_row), intent(in) :: rows(:)
      character(:), allocatable :: fit, text
      integer :: i

      text = ''
      do i = 1, size(rows)
         associate (variant => variants(rows(i)%variant))
            if (is_first(i)) then
               if (i > 1) text = text//line_feed
               text = text//heading(variant)
            end if
            fit = 'chosen'
            if (variant%request%fit_steps > 0) fit = to_text(variant%request%fit_steps)
            text = text//merge('* ', '  ', variant%is_own)// &
                   padded(to_text(variant%request%order), 6)//padded(fit, 8)// &
                   padded(brief(rows(i)%seconds), 8)
            if (rows(i)%is_reference) then
               text = text//'compared with'//line_feed
               cycle
            end if
            text = text//padded(with_error(rows(i)%slip_mean, rows(i)%slip_mean_error), 19)// &
                   padded(with_error(rows(i)%slip_std, rows(i)%slip_std_error), 18)// &
                   with_error(100*rows(i)%band_ratio, 100*rows(i)%band_ratio_error)//line_feed
         end associate
      end do
      if (size(rows) > 0) text = text//'* the scene''s own; the largest change over levels and '// &
                                 'dofs +- standard error'//line_feed

   contains

      pure logical function is_first(i)
         integer, intent(in) :: i

         is_first = i == 1
         if (is_first) return
         associate (a => variants(rows(i - 1)%variant), b => variants(rows(i)%variant))
            is_first = a%process /= b%process .or. (a%is_of_fit .neqv. b%is_of_fit)
         end associate
      end function is_first

   end function variants_text

   pure function heading(variant) result(text)
      type(variant_type), intent(in) :: variant
      character(:), allocatable :: text

      associate (request => variant%request)
         text = numbered('p', variant%process)//', '//request%correlation//' = '// &
                brief(request%correlation_length)//', std '//brief(request%std)//': other '// &
                trim(merge('lengths of its fit', 'orders            ', variant%is_of_fit))// &
                line_feed//'  order fit     fit [s] mean slip [points] std of slip       '// &
                'bands [%]'//line_feed
      end associate
   end function heading

   pure function with_error(value, standard_error) result(text)
      real(wp), intent(in) :: value, standard_error
      character(:), allocatable :: text

      text = brief(value)//'+-'//brief(standard_error)
   end function with_error

   !> What the ways to form spectra change and cost.
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

   !> What orders of the processes cost in entropy and time.
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

   !> Standard errors that the simulated fits of positive processes end with.
   pure function fits_text(models) result(text)
      type(process_model_type), intent(in) :: models(:)
      character(:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(models)
         associate (m => models(i))
            if (.not. (m%request%positive .and. m%is_solved)) cycle
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
