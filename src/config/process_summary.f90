!> The part of `entroslip check` on processes: a table, the reasons why some have no solution, and
!> how realizations of the exact law are drawn.
module config_process_summary
   use campaign_plan, only: plan_type
   use core_kinds, only: wp
   use core_text, only: brief, labelled, numbered, numbers_text, padded, to_text
   use process_model, only: branch_note, process_model_type, process_request
   use process_realization, only: cheaper_drawing, exact_drawing
   use process_reference, only: is_reference, law_name
   implicit none(type, external)
   private
   public :: is_fitted_by_simulation, max_rows, process_table

   character(*), parameter :: line_feed = new_line('a')
   integer, parameter :: max_rows = 40   !! largest number of rows of a table

contains

   !> True if the fit simulates values and takes seconds, not milliseconds.
   elemental logical function is_fitted_by_simulation(request)
      type(process_request), intent(in) :: request

      is_fitted_by_simulation = request%positive .and. request%order /= 1
   end function is_fitted_by_simulation

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
                   solution_text(predicted(i))//line_feed
         end associate
      end do
      if (size(plan%processes) > max_rows) &
         text = text//'... and '//to_text(size(plan%processes) - max_rows)//' more, of which '// &
                to_text(count(.not. predicted(max_rows + 1:)%is_solved))//' infeasible'//line_feed
      if (plan%n_realizations > 0 .or. any(plan%cases%process > 0)) &
         text = text//drawing_text(predicted, plan%n_points)
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

   !> Text on how realizations of the exact law are drawn; '' if there is no such process.
   function drawing_text(predicted, n_points) result(text)
      type(process_model_type), intent(in) :: predicted(:)
      integer, intent(in) :: n_points
      character(:), allocatable :: text
      type(exact_drawing) :: drawings(size(predicted))
      logical :: is_exact(size(predicted))
      integer :: i

      do i = 1, size(predicted)
         associate (request => predicted(i)%request)
            is_exact(i) = predicted(i)%is_solved .and. request%positive .and. &
                          request%sampler == 'exact' .and. allocated(predicted(i)%a) .and. &
                          .not. allocated(predicted(i)%g)
         end associate
         if (is_exact(i)) drawings(i) = cheaper_drawing(predicted(i), n_points)
      end do
      text = drawing_line(is_exact .and. drawings%by_windows, &
                          'whole windows, redrawn until one is positive: ', drawings%n_windows, &
                          ' a realization')// &
             drawing_line(is_exact .and. .not. drawings%by_windows, &
                          'values of a window redrawn one at a time, in ', &
                          real(drawings%n_sweeps, wp), ' sweeps')
   end function drawing_text

   !> Line on the processes that are drawn in one way, with their largest number; '' without any.
   pure function drawing_line(are_meant, method, numbers, unit) result(text)
      logical, intent(in) :: are_meant(:)    !! (process) true if it is drawn in this way
      character(*), intent(in) :: method, unit
      real(wp), intent(in) :: numbers(:)     !! (process)
      character(:), allocatable :: text

      text = ''
      if (.not. any(are_meant)) return
      text = 'about '//brief(maxval(numbers, are_meant))//unit
      if (count(are_meant) > 1) text = 'up to '//text
      text = labelled('exact law', numbers_text('p', are_meant, 'processes')//': '//method//text)
   end function drawing_line

end module config_process_summary
