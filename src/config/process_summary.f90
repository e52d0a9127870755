!> The part of `entroslip check` on processes: a table, reasons of refusal, and how their
!> realizations will be drawn.
module config_process_summary
   use campaign_plan, only: plan_type
   use core_kinds, only: wp
   use core_text, only: brief, labelled, numbered, numbers_text, padded, to_text
   use process_model, only: branch_note, process_model_type, process_request
   use process_realization, only: way_of_drawing, way_type
   use process_reference, only: is_reference, law_name
   implicit none(type, external)
   private
   public :: is_fitted_to_values, max_rows, process_table

   character(*), parameter :: line_feed = new_line('a')
   integer, parameter :: max_rows = 40   !! rows of a table

contains

   !> True if a fit takes seconds, not milliseconds.
   elemental logical function is_fitted_to_values(request)
      type(process_request), intent(in) :: request

      is_fitted_to_values = request%positive .and. request%order /= 1
   end function is_fitted_to_values

   !> 'L0 = 3'; 'both = 3, 2.5': L0 and L1; '-' of given values, which no length is imposed on.
   pure function length_text(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = trim(request%correlation)//' = '//brief(request%correlation_length)
      if (request%correlation == 'both') text = text//', '//brief(request%second_length)
      if (request%method == 'values') text = '-'
   end function length_text

   !> One row per process, then the reasons why some have no solution.
   function process_table(plan, foreseen) result(text)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: foreseen(:)
      character(:), allocatable :: text, order, law
      integer :: i, width

      width = len('correlation') + 2
      do i = 1, min(size(plan%processes), max_rows)
         width = max(width, len(length_text(plan%processes(i))) + 2)
      end do
      text = 'process  method         '//padded('correlation', width)// &
             'order  mean   std     law        solution'//line_feed
      do i = 1, min(size(plan%processes), max_rows)
         associate (p => plan%processes(i))
            order = to_text(p%order)
            if (p%order == 0) order = 'chosen'
            law = 'any sign'
            if (p%positive) law = trim(p%sampler)
            if (is_reference(p)) then
               law = law_name(p)
               order = '-'
            end if
            text = text//padded(numbered('p', i), 9)//padded(trim(p%method), 15)// &
                   padded(length_text(p), width)//padded(order, 7)// &
                   padded(brief(p%mean), 7)//padded(brief(p%std), 8)//padded(law, 11)// &
                   verdict(foreseen(i))//line_feed
         end associate
      end do
      if (size(plan%processes) > max_rows) &
         text = text//'... and '//to_text(size(plan%processes) - max_rows)//' more, of which '// &
                to_text(count(.not. foreseen(max_rows + 1:)%is_solved))//' infeasible'//line_feed
      if (plan%n_realizations > 0 .or. any(plan%cases%process > 0)) &
         text = text//drawing_text(foreseen, plan%n_points)
      do i = 1, size(foreseen)
         if (.not. foreseen(i)%is_solved) &
            text = text//labelled(numbered('p', i), foreseen(i)%reason)
         if (len(branch_note(foreseen(i))) > 0) &
            text = text//labelled(numbered('p', i), branch_note(foreseen(i)))
      end do
   end function process_table

   !> Verdict on a process that is not fitted yet.
   pure function verdict(foreseen) result(text)
      type(process_model_type), intent(in) :: foreseen
      character(:), allocatable :: text

      text = trim(merge('feasible  ', 'infeasible', foreseen%is_solved))
      if (.not. allocated(foreseen%branch)) return
      if (foreseen%branch == 'open') text = 'open'
   end function verdict

   !> Text on how realizations of the exact law will be drawn; '' where there is none.
   function drawing_text(foreseen, n_points) result(text)
      type(process_model_type), intent(in) :: foreseen(:)
      integer, intent(in) :: n_points
      character(:), allocatable :: text
      type(way_type) :: ways(size(foreseen))
      logical, dimension(size(foreseen)) :: by_sweeps, by_windows
      integer :: i

      by_windows = .false.
      by_sweeps = .false.
      do i = 1, size(foreseen)
         associate (asked => foreseen(i)%request)
            if (.not. (foreseen(i)%is_solved .and. asked%positive)) cycle
            if (asked%sampler /= 'exact' .or. .not. allocated(foreseen(i)%a)) cycle
            if (allocated(foreseen(i)%g)) cycle
         end associate
         ways(i) = way_of_drawing(foreseen(i), n_points)
         by_windows(i) = ways(i)%by_windows
         by_sweeps(i) = .not. ways(i)%by_windows
      end do
      text = ''
      if (any(by_windows)) text = drawn(by_windows, 'whole windows, redrawn until one is '// &
                                        'positive: ', maxval(ways%n_windows, by_windows), &
                                        ' a realization')
      if (any(by_sweeps)) text = text//drawn(by_sweeps, 'values of a window redrawn one at a '// &
                                             'time, in ', real(maxval(ways%n_sweeps, by_sweeps), &
                                                               wp), ' sweeps')
   end function drawing_text

   !> Line on processes drawn in one way, with a number that is the largest of theirs.
   pure function drawn(are_meant, way, most, unit) result(text)
      logical, intent(in) :: are_meant(:)   !! (process)
      character(*), intent(in) :: way, unit
      real(wp), intent(in) :: most
      character(:), allocatable :: text

      text = 'about '//brief(most)//unit
      if (count(are_meant) > 1) text = 'up to '//text
      text = labelled('exact law', numbers_text('p', are_meant, 'processes')//': '//way//text)
   end function drawn

end module config_process_summary
