!> Tables of `entroslip tradeoff`: settings, cheapest settings for wanted errors, components of the
!> error, numbers of samples and steps, spectra, orders of processes and lengths of their fits.
module driver_tradeoff_text
   use core_kinds, only: wp
   use core_text, only: brief, counted, duration, labelled, line_feed, numbered, row_text, &
                        to_text, with_error
   use driver_trial_runs, only: setting_text
   use io_tradeoff_results, only: tradeoff_findings
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use tradeoff_front, only: has_drawn_friction, meets_targets
   use tradeoff_settings, only: reference_setting, setting_dt
   use tradeoff_task_results, only: band_ratio, n_published, psd_mean, psd_percentiles, slip, &
                                    slip_std
   use tradeoff_variants, only: variant_type
   implicit none(type, external)
   private
   public :: tradeoff_text

contains

   !> All tables, each with an empty line below it.
   function tradeoff_text(found, models) result(text)
      type(tradeoff_findings), intent(in) :: found
      type(process_model_type), intent(in) :: models(:)
      character(:), allocatable :: text

      text = ''
      if (found%plan%has_structure) then
         text = settings_text(found)//line_feed//wanted_text(found)//line_feed// &
                components_text(found)//line_feed//sizes_text(found)//line_feed
         if (size(found%spectra) > 0) text = text//spectra_text(found)//line_feed
         if (size(found%variants) > 0) text = text//variants_text(found)//line_feed
      end if
      if (size(found%orders) > 0) text = text//orders_text(found)//line_feed//fits_text(models)
   end function tradeoff_text

   !> Table of the settings on the front and of the scene's own, with the extent of the marches.
   pure function settings_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: text
      character(*), parameter :: columns = '  |method   |dt [s]   |halvings |tolerance |'// &
                                           'slip [points] |bands [%]  |ns/step  |run [s]'
      integer, allocatable :: ranking(:)
      integer :: i, k
      logical :: has_bands

      associate (rows => found%settings, plan => found%plan, levels => found%tradeoff%levels)
         text = labelled('measured', counted(size(rows), 'setting', 'settings')//' on '// &
                         counted(sum([(size(levels(k)%samples), k=1, size(levels))]), 'sample', &
                                 'samples')//' at '//counted(size(levels), 'level', 'levels')// &
                         ' of force, '//to_text(found%tradeoff%plan%integration%n_steps)// &
                         ' steps each')// &
                labelled('against', setting_text(reference_setting, plan%integration%dt)// &
                         ', on the same samples; errors are the largest over levels and dofs')// &
                line_feed//row_text(columns, columns)
         has_bands = plan%output%spectrum .and. maxval(plan%cases%n_samples) > 1
         ranking = sort_order(rows%cost)
         do i = 1, size(ranking)
            associate (row => rows(ranking(i)), setting => rows(ranking(i))%setting)
               if (.not. (row%is_on_front .or. row%is_own)) cycle
               text = text//row_text(columns, merge('*', ' ', row%is_own)//'|'// &
                      setting%method//'|'//brief(setting_dt(setting, plan%integration%dt))//'|'// &
                      known(1.0_wp*setting%max_halvings, setting%method == 'newmark')//'|'// &
                      known(setting%tolerance, setting%method == 'event')//'|'// &
                      brief(row%error(slip))//'|'//known(100*row%error(band_ratio), has_bands)// &
                      '|'//brief(row%cost)//'|'//brief(row%seconds/found%n_ranks))
            end associate
         end do
      end associate
      text = text//'* the scene''s own; the others: nothing cheaper has a smaller error of slip'// &
             line_feed
   end function settings_text

   !> Lines on the cheapest setting for wanted errors: the scene's targets, or a list of errors.
   pure function wanted_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: text
      real(wp), parameter :: errors(*) = [1.0_wp, 0.1_wp, 1.0e-2_wp, 1.0e-3_wp, 1.0e-6_wp]
      integer :: i

      text = ''
      associate (points => found%plan%accuracy%target_slip_points, &
                 ratio => found%plan%accuracy%target_band_ratio)
         if (max(points, ratio) > 0.0_wp) then
            text = answer(points, ratio)
         else
            do i = 1, size(errors)
               text = text//answer(errors(i), 0.0_wp)
            end do
         end if
      end associate

   contains

      !> Line on the cheapest setting for one pair of wanted errors.
      pure function answer(points, ratio) result(line)
         real(wp), intent(in) :: points, ratio   !! 0: not wanted
         character(:), allocatable :: line
         integer :: best

         line = ''
         if (points > 0.0_wp) line = 'slip to '//brief(points)//' points'
         if (points > 0.0_wp .and. ratio > 0.0_wp) line = line//', '
         if (ratio > 0.0_wp) line = line//'band ratios to '//brief(100*ratio)//' %'
         associate (rows => found%settings)
            best = minloc(rows%cost, 1, mask=meets_targets(rows, points, ratio))
            if (best == 0) then
               line = line//': no setting that was measured'
            else
               line = line//': '//setting_text(rows(best)%setting, found%plan%integration%dt)// &
                      ' ('//duration(rows(best)%seconds/found%n_ranks)//')'
            end if
         end associate
         line = labelled('cheapest', line)
      end function answer

   end function wanted_text

   !> Table of the components of the error, with the largest of them and the cost of halving it.
   pure function components_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: remedy, text
      character(*), parameter :: columns = 'error now        |slip [points] |its std  |'// &
                                           'spectrum [%] |percentiles [%]  |bands [%]'
      character(14), parameter :: names(3) = [character(14) :: 'discretisation', 'time average', &
                                              'Monte Carlo']
      real(wp) :: parts(n_published, 3)
      real(wp) :: seconds   ! run time with half of the largest part; 0: no setting has it
      integer :: best, i, largest, n_samples

      associate (errors => found%errors, plan => found%plan, rows => found%settings)
         n_samples = maxval(plan%cases%n_samples)
         parts = reshape([errors%discretisation, errors%time, errors%samples], shape(parts))
         text = row_text(columns, columns)
         do i = 1, merge(3, 2, has_drawn_friction(plan))
            associate (part => parts(:, i), spectrum => plan%output%spectrum)
               text = text//row_text(columns, '  '//names(i)//'|'//brief(part(slip))//'|'// &
                      known(part(slip_std), n_samples > 1)//'|'// &
                      known(100*part(psd_mean), spectrum)//'|'// &
                      known(100*part(psd_percentiles), spectrum .and. n_samples > 1)//'|'// &
                      known(100*part(band_ratio), spectrum .and. n_samples > 1))
            end associate
         end do
         largest = maxloc(parts(slip, :), 1)
         if (.not. parts(slip, largest) > 0.0_wp) then
            text = text//labelled('largest', 'none of slip: nothing slips, or all the time')
            return
         end if
         seconds = rows(found%tradeoff%own)%seconds
         select case (largest)
         case (1)
            best = minloc(rows%cost, 1, mask=meets_targets(rows, 0.5_wp*parts(slip, 1), 0.0_wp))
            remedy = 'no setting that was measured'
            seconds = 0.0_wp
            if (best > 0) then
               remedy = setting_text(rows(best)%setting, plan%integration%dt)
               seconds = rows(best)%seconds
            end if
         case (2)
            remedy = 'integration%n_steps = '//brief(4.0_wp*plan%integration%n_steps)
            if (plan%excitation%kind == 'file') then
               remedy = remedy//', with a record as long'
            else if (.not. plan%excitation%per_sample .and. has_drawn_friction(plan) .and. &
                     n_samples >= 4) then
               remedy = 'excitation%per_sample = .true. ('// &
                        brief(parts(slip, 2)/sqrt(1.0_wp*n_samples))//' points are left), or '// &
                        remedy
            end if
            seconds = 4*seconds
         case (3)
            remedy = 'campaign%n_samples = '//to_text(ceiling(errors%times_to_halve*n_samples))
            seconds = errors%times_to_halve*seconds
         end select
         if (seconds > 0.0_wp) remedy = remedy//', '//duration(seconds/found%n_ranks)// &
                  ' instead of '//duration(rows(found%tradeoff%own)%seconds/found%n_ranks)
         text = text//labelled('largest', 'of slip: '//trim(names(largest))// &
                               '; to halve it: '//remedy)
      end associate
   end function components_text

   !> Table of the total errors and run times with other numbers of samples and steps.
   pure function sizes_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: text
      character(*), parameter :: columns = '  |samples  |steps      |mean slip [points]  |'// &
                                           'std of slip  |bands [%]  |run [s]'
      integer :: i

      text = 'all errors by samples and steps'//line_feed//row_text(columns, columns)
      do i = 1, size(found%sizes)
         associate (row => found%sizes(i), many => found%sizes(i)%n_samples > 1)
            text = text//row_text(columns, '|'//to_text(row%n_samples)//'|'// &
                   to_text(row%n_steps)//'|'//brief(row%error(slip))//'|'// &
                   known(row%error(slip_std), many)//'|'// &
                   known(100*row%error(band_ratio), many .and. found%plan%output%spectrum)// &
                   '|'//brief(row%seconds/found%n_ranks))
         end associate
      end do
   end function sizes_text

   !> Table of changes of band ratios and cost by spectrum_every and segment_length.
   pure function spectra_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: text
      character(*), parameter :: columns = 'spectra: |every  |segment [steps]  |'// &
                                           'change of band ratios [%]  |ns/step'
      integer :: i

      text = row_text(columns, columns)
      do i = 1, size(found%spectra)
         associate (row => found%spectra(i))
            text = text//row_text(columns, '|'//to_text(row%every)//'|'// &
                   to_text(row%segment_length)//'|'//brief(100*row%band_ratio)//'|'// &
                   brief(row%cost))
         end associate
      end do
   end function spectra_text

   !> Table of changes of published numbers with orders and lengths of fits.
   pure function variants_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: bands, changes, fit, head, text
      character(*), parameter :: columns = '  |order |fit     |fit [s] |mean slip [points] |'// &
                                           'std of slip       |bands [%]'
      integer :: i

      text = ''
      head = ''
      do i = 1, size(found%variants)
         associate (row => found%variants(i), &
                    variant => found%tradeoff%scope%variants(found%variants(i)%variant))
            if (heading(variant) /= head) then
               head = heading(variant)
               if (i > 1) text = text//line_feed
               text = text//head//row_text(columns, columns)
            end if
            fit = 'chosen'
            if (variant%request%fit_steps > 0) fit = to_text(variant%request%fit_steps)
            changes = 'compared with||'
            if (.not. row%is_reference) then
               bands = '-'
               if (found%plan%output%spectrum) &
                  bands = with_error(100*row%change(band_ratio), 100*row%error(band_ratio))
               changes = with_error(row%change(slip), row%error(slip))//'|'// &
                         with_error(row%change(slip_std), row%error(slip_std))//'|'//bands
            end if
            text = text//row_text(columns, merge('*', ' ', variant%is_own)//'|'// &
                   to_text(variant%request%order)//'|'//fit//'|'//brief(row%seconds)//'|'//changes)
         end associate
      end do
      text = text//'* the scene''s own; the largest change over levels and dofs +- standard '// &
             'error'//line_feed
   end function variants_text

   !> Heading of the variants of a process, orders or lengths of the fit.
   pure function heading(variant) result(text)
      type(variant_type), intent(in) :: variant
      character(:), allocatable :: text

      associate (request => variant%request)
         text = numbered('p', variant%process)//', '//trim(request%correlation)//' = '// &
                brief(request%correlation_length)//', std '//brief(request%std)//': other '// &
                trim(merge('lengths of its fit', 'orders            ', variant%is_of_fit))// &
                line_feed
      end associate
   end function heading

   !> Table of entropy, the other correlation length and time of the fit by the order of processes.
   pure function orders_text(found) result(text)
      type(tradeoff_findings), intent(in) :: found
      character(:), allocatable :: text
      character(*), parameter :: columns = '  |process                  |order  |'// &
                                           'entropy lost  |other length  |fit [ms]'
      integer :: i

      text = row_text(columns, columns)
      do i = 1, size(found%orders)
         associate (row => found%orders(i))
            text = text//row_text(columns, merge('*', ' ', row%is_own)//'|'//row%method//', '// &
                   row%correlation//' = '//brief(row%correlation_length)//'|'// &
                   to_text(row%order)//'|'//brief(row%entropy_lost)//'|'// &
                   merge('L1', 'L0', row%correlation == 'L0')//' = '//brief(row%other_length)// &
                   '|'//brief(row%milliseconds))
         end associate
      end do
      text = text//'* an order of the scene; entropy [nat] per point below that of white noise'// &
             line_feed
   end function orders_text

   !> Table of the standard errors of positive processes that are fitted to simulated values.
   pure function fits_text(models) result(text)
      type(process_model_type), intent(in) :: models(:)
      character(:), allocatable :: text
      character(*), parameter :: columns = 'fit       |mean [%]   |std [%]    |'// &
                                           'L0 [%], standard errors'
      integer :: i

      text = ''
      do i = 1, size(models)
         associate (m => models(i))
            if (.not. (m%request%positive .and. m%is_solved .and. m%l0_error > 0.0_wp)) cycle
            if (text == '') text = row_text(columns, columns)
            text = text//row_text(columns, numbered('p', i)//'|'// &
                   brief(100*m%mean_error/m%mean)//'|'//brief(100*m%std_error/m%std)//'|'// &
                   brief(100*m%l0_error/m%l0))
         end associate
      end do
   end function fits_text

   !> A number, or '-' if it is not known.
   pure function known(value, is_known) result(text)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_known
      character(:), allocatable :: text

      text = '-'
      if (is_known) text = brief(value)
   end function known

end module driver_tradeoff_text
