!> The part of `entroslip check` on processes: a table, and the reasons why some have no solution.
module config_process_summary
   use campaign_plan, only: plan_type
   use core_text, only: brief, labelled, line_feed, numbered, padded, row_text, to_text
   use process_model, only: branch_note, process_model_type, process_request
   use process_reference, only: is_reference, law_name
   implicit none(type, external)
   private
   public :: max_rows, process_table

   integer, parameter :: max_rows = 40   !! largest number of rows of a table

contains

   !> Imposed lengths: 'L0 = 3', 'both = 3, 2.5' of L0 and L1, or '-' for given values.
   pure function length_text(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = trim(request%correlation)//' = '//brief(request%correlation_length)
      if (request%correlation == 'both') text = text//', '//brief(request%second_length)
      if (request%method == 'values') text = '-'
   end function length_text

   !> Table of the processes, one row each, then notes on them.
   function process_table(plan, predicted) result(text)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: predicted(:)
      character(:), allocatable :: columns, law, order, text
      integer :: i, width

      width = len('correlation') + 2
      do i = 1, min(size(plan%processes), max_rows)
         width = max(width, len(length_text(plan%processes(i))) + 2)
      end do
      columns = 'process  |method         |'//padded('correlation', width)// &
                '|order  |mean   |std     |law        |solution'
      text = row_text(columns, columns)
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
            text = text//row_text(columns, numbered('p', i)//'|'//trim(p%method)//'|'// &
                                  length_text(p)//'|'//order//'|'//brief(p%mean)//'|'// &
                                  brief(p%std)//'|'//law//'|'//solution_text(predicted(i)))
         end associate
      end do
      if (size(plan%processes) > max_rows) &
         text = text//'... and '//to_text(size(plan%processes) - max_rows)//' more, of which '// &
                to_text(count(.not. predicted(max_rows + 1:)%is_solved))//' infeasible'//line_feed
      do i = 1, size(predicted)
         if (.not. predicted(i)%is_solved) &
            text = text//labelled(numbered('p', i), predicted(i)%reason)
         if (len(branch_note(predicted(i))) > 0) &
            text = text//labelled(numbered('p', i), branch_note(predicted(i)))
      end do
   end function process_table

   !> 'feasible', 'infeasible', or 'open' if only the fit can tell.
   pure function solution_text(predicted) result(text)
      type(process_model_type), intent(in) :: predicted
      character(:), allocatable :: text

      text = trim(merge('feasible  ', 'infeasible', predicted%is_solved))
      if (.not. allocated(predicted%branch)) return
      if (predicted%branch == 'open') text = 'open'
   end function solution_text

end module config_process_summary
