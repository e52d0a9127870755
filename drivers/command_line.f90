!> Reads the command line: a command, a scene and options. Writes the help texts.
module driver_command_line
   use core_complaints, only: suggestion
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long
   use core_text, only: joined, nl => line_feed, parse_integer
   use io_files, only: exists
   implicit none(type, external)
   private
   public :: command_line, help_text, read_command_line

   !> Commands, one row each: name and argument; its purpose begins at `text_column`.
   character(*), parameter :: commands(*) = [character(76) :: &
      'run SCENE       all that the scene asks for; continues an interrupted run', &
      'check SCENE     read and validate; what would run, its cost and memory', &
      'tradeoff SCENE  what accuracy costs in this scene, and the cheapest settings', &
      'replay SCENE    one sample again, with its full history (--case, --sample)', &
      'estimate DATA   measured values to the process that explains them', &
      'whatif RESULTS  the samples of a run under another law of friction (--set)', &
      'template        print a complete commented scene']
   !> Options, one row each.
   character(*), parameter :: options(*) = [character(76) :: &
      '--output FILE   file to write; run: default SCENE.h5 here; estimate: a scene', &
      '--fresh         run: discard what an earlier run of the scene left', &
      '--set G%N=V     override a value: --set campaign%n_samples=20; repeatable', &
      '--share         run: one of several on one output; a plain run then merges', &
      '--case I        replay: case number, from 1', &
      '--sample J      replay: sample number, from 1', &
      '--reference     template: the scene reference instead, in Markdown', &
      '--quiet         no progress, no summary; check: complaints alone', &
      '--help          this text', &
      '--version       version, compiler, flags, libraries']
   integer, parameter :: text_column = 17
   !> (option) Commands that accept it; --help and --version need no command.
   character(*), parameter :: commands_of_option(*) = [character(46) :: &
      'run, tradeoff, replay, estimate', 'run', 'run, check, tradeoff, replay, whatif', 'run', &
      'replay', 'replay', 'template', 'run, check, tradeoff, replay, estimate, whatif', '', '']

   !> Command, paths and options.
   type :: command_line
      character(:), allocatable :: command        !! one of `commands`, 'help' or 'version'
      character(:), allocatable :: scene          !! path of the scene file
      character(:), allocatable :: output         !! path of the file to be written
      character(:), allocatable :: overrides      !! --set options, `group%name=value`, one a line
      integer :: case_number = 0                  !! replay: case, from 1
      integer :: sample = 0                       !! replay: sample, from 1
      logical, private :: is_given(size(options)) = .false.
   contains
      procedure :: has
   end type command_line

contains

   !> Reads the arguments of the program. Refuses unknown ones, and combinations without meaning.
   subroutine read_command_line(line, error)
      type(command_line), intent(out) :: line
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: word, value
      integer :: equals, i

      line%overrides = ''
      i = 0
      do while (i < command_argument_count())
         i = i + 1
         word = argument(i)
         if (allocated(value)) deallocate (value)
         equals = index(word, '=')
         if (equals >= 4 .and. index(word, '--') == 1) then   ! --name=value
            value = word(equals + 1:)
            word = word(:equals - 1)
         end if
         where (names_in(options) == word) line%is_given = .true.
         if (any(word == pack(names_in(options), takes_value(options)))) then
            if (.not. allocated(value)) then
               i = i + 1
               value = argument(i)
            end if
            call store_value(line, word, value, error)
         else if (allocated(value) .and. any(word == names_in(options))) then
            call raise(error, exit_bad_input, word//' takes no value')
         else if (word == '--help' .or. word == '-h' .or. word == 'help' .and. i == 1) then
            line%command = 'help'
            return
         else if (word == '--version' .or. word == 'version' .and. i == 1) then
            line%command = 'version'
            return
         else if (any(word == names_in(options))) then
            cycle   ! it has no value
         else if (index(word, '-') == 1) then
            call raise(error, exit_bad_input, 'unknown option '//word// &
                       suggestion(word, names_in(options)))
         else if (.not. allocated(line%command)) then
            line%command = word
            if (any(word == names_in(commands))) cycle
            if (exists(word)) then
               call raise(error, exit_bad_input, 'no command before '//word//'; there are '// &
                          joined(names_in(commands)))
            else
               call raise(error, exit_bad_input, 'unknown command '//word// &
                          suggestion(word, names_in(commands)))
            end if
         else if (.not. allocated(line%scene)) then
            line%scene = word
         else
            call raise(error, exit_bad_input, 'one file at a time: '//line%scene//' and '//word)
         end if
         if (allocated(error)) return
      end do
      call check_combination(line, error)
   end subroutine read_command_line

   !> True if an option is given.
   pure logical function has(self, option)
      class(command_line), intent(in) :: self
      character(*), intent(in) :: option

      has = any(self%is_given .and. names_in(options) == option)
   end function has

   !> Stores the value of an option.
   subroutine store_value(line, option, value, error)
      type(command_line), intent(inout) :: line
      character(*), intent(in) :: option, value
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      if (value == '') then
         call raise(error, exit_bad_input, option//' needs a value')
         return
      end if
      select case (option)
      case ('--output')
         line%output = value
         if (len(value) > len_trim(value)) &   ! Fortran and HDF5 ignore it
            call raise(error, exit_bad_input, option//' '//value//': must not end in a blank')
      case ('--set')
         do i = 1, len_trim(value)
            line%overrides = line%overrides//merge(' ', value(i:i), value(i:i) == nl)
         end do
         line%overrides = line%overrides//nl
      case ('--case')
         call read_count(option, value, line%case_number, error)
      case ('--sample')
         call read_count(option, value, line%sample, error)
      end select
   end subroutine store_value

   !> Reads an integer of 1 or more.
   subroutine read_count(option, value, n, error)
      character(*), intent(in) :: option, value
      integer, intent(out) :: n
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: rule
      integer(long) :: number

      call parse_integer(value, int(huge(n), long), number, rule)
      n = int(number)
      if (allocated(rule) .or. n < 1) &
         call raise(error, exit_bad_input, option//' '//value//': needs a whole number from 1')
   end subroutine read_count

   !> Refuses options that the command does not accept, and a command without its arguments.
   subroutine check_combination(line, error)
      type(command_line), intent(in) :: line
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      if (.not. allocated(line%command)) then
         call raise(error, exit_bad_input, 'no command; there are '//joined(names_in(commands))// &
                    ' (entroslip --help)')
         return
      end if
      do i = 1, size(options)
         if (.not. line%is_given(i) .or. index(', '//trim(commands_of_option(i))//',', &
                                               ', '//line%command//',') > 0) cycle
         call raise(error, exit_bad_input, line%command//' takes no '// &
                    trim(names_in(options(i)))//', which is for '//trim(commands_of_option(i)))
         return
      end do
      if (line%command == 'template') then
         if (allocated(line%scene)) call raise(error, exit_bad_input, 'template takes no scene')
      else if (.not. allocated(line%scene) .and. line%command == 'estimate') then
         call raise(error, exit_bad_input, 'estimate needs data: entroslip estimate DATA')
      else if (.not. allocated(line%scene) .and. line%command == 'whatif') then
         call raise(error, exit_bad_input, 'whatif needs results: entroslip whatif RESULTS.h5 '// &
                    '--set process%std=0.1')
      else if (.not. allocated(line%scene)) then
         call raise(error, exit_bad_input, line%command//' needs a scene: entroslip '// &
                    line%command//' SCENE')
      else if (line%command == 'replay' .and. (line%case_number == 0 .or. line%sample == 0)) then
         call raise(error, exit_bad_input, 'replay needs --case and --sample')
      else if (line%has('--share') .and. line%has('--fresh')) then
         call raise(error, exit_bad_input, '--fresh discards what others share: start one run '// &
                    'without --share for it')
      end if
   end subroutine check_combination

   !> Help: 23 lines of at most 80 columns, one screen of a terminal.
   pure function help_text() result(text)
      character(:), allocatable :: text

      text = 'entroslip: maximum-entropy properties, and vibration held by friction'//nl// &
             'usage: [mpirun -n RANKS] entroslip COMMAND [FILE] [options]'//nl// &
             rows(commands)//nl//rows(options)//nl// &
             'exit codes: 0 done; 2 bad usage or input; 3 a file is unwritable, locked or'//nl// &
             'foreign; 4 no solution, or a target out of reach; 75 stopped early: start again'

   contains

      !> Rows of a table, indented.
      pure function rows(table) result(lines)
         character(*), intent(in) :: table(:)
         character(:), allocatable :: lines
         integer :: i

         lines = ''
         do i = 1, size(table)
            lines = lines//'  '//trim(table(i))//nl
         end do
      end function rows

   end function help_text

   !> Name at the beginning of a row of `commands` or `options`.
   elemental function names_in(row) result(name)
      character(*), intent(in) :: row
      character(text_column) :: name

      name = row(:index(row, ' '))
   end function names_in

   !> True if a row of `options` has a value.
   elemental logical function takes_value(row)
      character(*), intent(in) :: row

      takes_value = row(index(row, ' '):text_column - 1) /= ''
   end function takes_value

   !> The i-th argument of the program.
   function argument(i) result(text)
      integer, intent(in) :: i
      character(:), allocatable :: text
      integer :: length

      call get_command_argument(i, length=length)
      allocate (character(length) :: text)
      call get_command_argument(i, text)
   end function argument

end module driver_command_line
