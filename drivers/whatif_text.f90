!> Text of `entroslip whatif`: the estimates of a law of the friction without samples.
module driver_whatif_text
   use campaign_plan, only: case_type, kept_dofs, plan_type
   use campaign_pooling, only: case_pool
   use campaign_results, only: case_statistics, n_quantities
   use core_kinds, only: wp
   use core_text, only: brief, labelled, line_feed, numbered, padded, row_text, to_text, with_error
   use io_earlier_results, only: case_errors
   use process_model, only: lengths_of
   use statistics_estimates, only: is_near_samples, normal_95, statistic_type
   implicit none(type, external)
   private
   public :: law_text

   integer, parameter :: number_width = 6, cell_width = 18   !! columns of tables

contains

   !> Law, force and samples of a case, what the force record adds to errors, and the tables of its
   !> estimates.
   pure function law_text(plan, pool, number, errors, best) result(text)
      type(plan_type), intent(in) :: plan
      type(case_pool), intent(in) :: pool
      integer, intent(in) :: number               !! number of the case
      type(case_errors), intent(in) :: errors(:)  !! (case of the samples)
      type(case_statistics), intent(in) :: best   !! estimates of the case
      character(:), allocatable :: text, samples
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
      text = text//labelled('force', force_text(plan, plan%cases(number))) &
             //labelled('samples', samples(3:))
      if (record_error > 0.0_wp .and. plan%excitation%kind /= 'sine') &
         text = text//labelled('errors', 'of the friction alone; the time-average error of the '// &
                               'one force record is up to '//brief(100.0_wp*record_error)// &
                               ' points of a mean time in slip')
      text = text//tables_text(plan, best)
   end function law_text

   !> Text on the force of a case, such as 'variance = 41.1'.
   pure function force_text(plan, case) result(text)
      type(plan_type), intent(in) :: plan
      type(case_type), intent(in) :: case
      character(:), allocatable :: text

      select case (plan%excitation%kind)
      case ('band_limited')
         text = 'variance'
      case ('sine')
         text = 'frequency = '//to_text(case%frequency)//', amplitude'
      case default
         text = 'factor'
      end select
      text = text//' = '//to_text(case%strength)
   end function force_text

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

   !> Table of statistics: the mean, the percentiles and a last one. Those of a law that is too far
   !> from the samples are dashes, and one dash stands for a table of them.
   pure function table_text(title, place, numbers, last, percentiles, scale, rows) result(text)
      character(*), intent(in) :: title   !! quantity and unit
      character(*), intent(in) :: place   !! heading of the numbers
      integer, intent(in) :: numbers(:)   !! (row)
      character(*), intent(in) :: last    !! heading of the last statistic
      real(wp), intent(in) :: percentiles(:)   !! [%]
      real(wp), intent(in) :: scale            !! factor on the statistics
      type(statistic_type), intent(in) :: rows(:, :)   !! (row, statistic)
      character(:), allocatable :: cells, columns, text
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
            cells = cells//'|'//cell_text(rows(i, s), scale)
         end do
         text = text//row_text(columns, cells)
      end do
   end function table_text

   !> A statistic with its standard error; that of a percentile is taken from its interval.
   pure function cell_text(statistic, scale) result(text)
      type(statistic_type), intent(in) :: statistic
      real(wp), intent(in) :: scale
      character(:), allocatable :: text
      real(wp) :: error

      error = statistic%error + (statistic%high - statistic%low)/(2.0_wp*normal_95)
      text = '-'
      if (is_near_samples(statistic)) &
         text = with_error(scale*statistic%value, scale*error)
   end function cell_text

end module driver_whatif_text
