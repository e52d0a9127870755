!> `entroslip estimate`: fits a process to measured values and writes its &process group.
module driver_estimate
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use config_measured, only: read_measured
   use config_plan, only: scene_name
   use core_complaints, only: complaint_list
   use core_error, only: error_type, exit_bad_input, exit_done, exit_file, raise
   use core_kinds, only: long, wp
   use core_terminal, only: say
   use core_text, only: brief, counted, labelled, line_feed, rounded_by_error, shell_word, &
                        to_text, with_error
   use driver_command_line, only: command_line
   use io_files, only: exists, folder_of, make_folder, write_new_file
   use io_progress, only: inform, progress_type, set_quiet
   use parallel_world, only: start_world, stop_world, world_type
   use process_estimate, only: estimate_process, measured_record, process_estimate_type
   implicit none(type, external)
   private
   public :: estimate

   integer(long), parameter :: seed = 1_long   !! seed of the realizations that give the errors
   real(wp), parameter :: doubtful = 0.05_wp, rejected = 0.01_wp   !! p-values of a misfit

contains

   !> Runs the command `estimate`; only the root works. Prints the estimates, and prints or writes
   !> the group.
   subroutine estimate(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(complaint_list) :: complaints
      type(measured_record), allocatable :: records(:)
      type(process_estimate_type) :: found
      type(progress_type) :: progress
      type(error_type), allocatable :: error
      integer, parameter :: n_copies = 400   ! realizations for each record

      call start_world(world)
      call set_quiet(line%has('--quiet'))
      if (world%is_root()) then
         call read_measured(line%scene, records, complaints)
         if (complaints%n > 0) call raise(error, exit_bad_input, complaints%text)
         if (allocated(line%output) .and. .not. allocated(error)) then
            if (exists(line%output)) call raise(error, exit_file, line%output// &
                                                ': exists already: choose another name')
         end if
         if (.not. allocated(error)) then
            call progress%announce('fitting processes to the values, then to realizations of '// &
                                   'the best one')
            call estimate_process(records, seed, found, error)
            if (allocated(error)) error%message = line%scene//': '//error%message
         end if
         call progress%finish()
         if (.not. allocated(error)) call inform(estimates_text(found))
         if (.not. allocated(line%output)) then
            if (.not. allocated(error)) call say(group_text(line%scene, found))
         else
            if (.not. allocated(error)) call make_folder(folder_of(line%output), error)
            if (.not. allocated(error)) &
               call write_new_file(line%output, group_text(line%scene, found), error)
            if (.not. allocated(error)) &
               call inform('written to '//line%output//'; to draw the values beside the '// &
                           'process:'//line_feed//'  entroslip run '//shell_word(line%output)// &
                           ' --set process%n_points='//to_text(found%n_points)// &
                           ' --set process%n_realizations='// &
                           to_text(n_copies*found%n_records)//line_feed// &
                           '  python -m entroslip '// &
                           shell_word(scene_name(line%output)//'.h5')//' --measured '// &
                           shell_word(line%scene)//' --out figures')
         end if
      end if
      call world%stop_on(error)
      call stop_world(exit_done)
   end subroutine estimate

   !> Lines with the estimates, their errors, and whether the process explains the values.
   pure function estimates_text(found) result(text)
      type(process_estimate_type), intent(in) :: found
      character(:), allocatable :: text, lags, note, value
      integer :: n_lags, m

      text = labelled('values', counted(found%n_values, 'value', 'values')//' in '// &
                      counted(found%n_records, 'record', 'records')//', '// &
                      counted(found%n_gaps, 'gap', 'gaps')) &
             //labelled('mean', with_error(found%mean, found%mean_error)) &
             //labelled('std', with_error(found%std, found%std_error)) &
             //labelled('L0', with_range(found%l0, found%l0_error, found%l0_range)) &
             //labelled('L1', with_range(found%l1, found%l1_error, found%l1_range)) &
             //labelled('order', to_text(found%request%order))
      n_lags = min(size(found%correlation), found%n_points - 1)   ! a record has no larger ones
      lags = ''
      do m = 1, n_lags
         value = 'no pairs'
         if (.not. ieee_is_nan(found%correlation(m))) value = decimals(found%correlation(m))
         if (m > 1) lags = lags//', '
         lags = lags//value//' ('//decimals(found%expected(m))//')'
      end do
      text = text//labelled('correlation', 'at lags 1 to '//to_text(n_lags)// &
                            ' (of the process): '//lags) &
             //labelled('explained', judged('correlation', found%p_correlation)//'; '// &
                        judged('distribution', found%p_marginal))
      text = text//labelled('', 'errors are the scatter of the same estimates from '// &
                            'realizations of the process at the same points')
      if (found%n_records > found%n_points) &
         text = text//labelled('note', 'the file has more lines than values in a line: '// &
                               'correlation is sought along a line; transpose a file with '// &
                               'neighbouring joints below each other')
      if (allocated(found%refusal)) then
         note = found%refusal//'; the estimates above are the likeliest '// &
                trim(merge('of order 1         ', 'without correlation', found%l0 > 0.0_wp))
         if (found%request%std < found%std) &
            note = note//', and the group has a std of '//brief(found%request%std/found%mean)// &
                   ' of the mean, nearly exponential, from which theirs differs by chance'
         text = text//labelled('note', note)
         return
      end if
      if (found%l0 < found%longest) return
      note = 'no longer L0 of its order is tried for '//to_text(found%n_values)// &
             ' values: perhaps they are too few, have a trend or a period'
      if (found%std_of_record_means > 0.0_wp) &
         note = note//', or differ only from line to line (correlation_length = 1e12, std = '// &
                brief(found%std_of_record_means)//')'
      text = text//labelled('note', note)
   end function estimates_text

   !> Correlation in three decimals, as rounding leaves 2e-16 of a zero.
   pure function decimals(correlation) result(text)
      real(wp), intent(in) :: correlation
      character(:), allocatable :: text

      text = brief(nint(1000.0_wp*correlation)/1000.0_wp)
   end function decimals

   !> Length with its error, and the range of 95 % of the realizations.
   pure function with_range(value, error, range) result(text)
      real(wp), intent(in) :: value, error, range(2)
      character(:), allocatable :: text

      text = with_error(value, error)//' lags; 95 % of realizations give '//brief(range(1))// &
             ' to '//brief(range(2))
   end function with_range

   !> Verdict on a property by its p-value: 'correlation yes (p = 0.4)'
   pure function judged(property, p) result(text)
      character(*), intent(in) :: property
      real(wp), intent(in) :: p
      character(:), allocatable :: text

      text = property//' yes'
      if (p <= doubtful) text = property//' doubtful'
      if (p <= rejected) text = property//' NO'
      text = text//' (p = '//brief(p)//')'
   end function judged

   !> The &process group, with a comment on its source.
   pure function group_text(path, found) result(text)
      character(*), intent(in) :: path
      type(process_estimate_type), intent(in) :: found
      character(:), allocatable :: text

      associate (request => found%request)
         text = '! estimated from '//counted(found%n_values, 'value', 'values')//' of '//path// &
                line_feed//'&process'//line_feed//'  mean = '// &
                rounded_by_error(found%mean, found%mean_error)//'  std = '// &
                brief(request%std)//line_feed//'  correlation_length = '// &
                brief(request%correlation_length)//'  order = '//to_text(request%order)// &
                line_feed//'  positive = '//to_text(request%positive)
         if (request%positive .and. request%correlation_length > 0.0_wp) &
            text = text//"  branch = 'nonnegative'"
         text = text//line_feed//'/'//line_feed
      end associate
   end function group_text

end module driver_estimate
