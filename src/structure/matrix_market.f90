!> Matrices in Matrix Market files (math.nist.gov/MatrixMarket/formats.html): coordinate or array,
!> real or integer, general or symmetric. A file that says anything else, or not exactly what its
!> header promises, is refused.
module structure_matrix_market
   use core_complaints, only: complaint_list, printable
   use core_kinds, only: long, wp
   use core_memory, only: gives_memory
   use core_source, only: read_source, source_type
   use core_table, only: next_word
   use core_text, only: lowered, parse_integer, parse_real, to_text
   use structure_sizes, only: memory_of_matrices, most_dofs, too_large
   implicit none(type, external)
   private
   public :: matrix_file, read_matrix

   integer, parameter :: word_length = 40        !! longer ones are no numbers
   character(*), parameter :: importer = ': convert it with `python -m entroslip.structure`'

   !> A full matrix, and where its entries stand in the file.
   type :: matrix_file
      character(:), allocatable :: path
      real(wp), allocatable :: value(:, :)       !! (row, column); of size (0, 0) after a complaint
      integer, allocatable :: line(:, :)         !! (row, column) of the file; 0: not there, a zero
      integer :: size_line = 0
   contains
      procedure :: refuse
   end type matrix_file

   !> The file on its way, and what its header says.
   type :: reader_type
      type(source_type) :: source
      integer :: line = 0                !! read last
      logical :: is_coordinate = .false., is_symmetric = .false., is_integer = .false.
      integer :: n_rows = 0, n_columns = 0
      integer :: n_entries = 0           !! entries that the file must hold
      character(:), allocatable :: rule  !! rule that the file breaks, its subject first
   end type reader_type

contains

   !> Reads a matrix, and where its entries stand.
   subroutine read_matrix(path, matrix, complaints)
      character(*), intent(in) :: path
      type(matrix_file), intent(out) :: matrix
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      type(reader_type) :: reader

      matrix%path = path
      allocate (matrix%value(0, 0))
      call read_source(path, reader%source, refusal, huge(1) - 1)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
         return
      end if
      call read_header(reader)
      if (.not. allocated(reader%rule)) call read_sizes(reader)
      matrix%size_line = reader%line
      if (.not. allocated(reader%rule)) call read_entries(reader, matrix)
      if (.not. allocated(reader%rule)) return
      call matrix%refuse(reader%line, reader%rule, complaints)
      deallocate (matrix%value)
      allocate (matrix%value(0, 0))
   end subroutine read_matrix

   !> Complains of a line; of the file where the line is 0.
   subroutine refuse(self, line, rule, complaints)
      class(matrix_file), intent(in) :: self
      integer, intent(in) :: line
      character(*), intent(in) :: rule   !! its subject first
      type(complaint_list), intent(inout) :: complaints

      if (line == 0) then
         call complaints%add_general(self%path//': '//rule)
      else
         call complaints%add_general(self%path//':'//to_text(line)//': '//rule)
      end if
   end subroutine refuse

   !> Reads %%MatrixMarket matrix coordinate|array real|integer general|symmetric
   subroutine read_header(reader)
      type(reader_type), intent(inout) :: reader
      character(word_length) :: words(6)
      integer :: n

      reader%line = 1
      call split(reader%source%line(1), words, n)
      if (n == 0 .or. lowered(words(1)) /= '%%matrixmarket') then
         call refuse_header(reader)
      else if (n /= 5 .or. lowered(words(2)) /= 'matrix') then
         reader%rule = shown(reader)//': must be %%MatrixMarket matrix, form, field, symmetry'
      else if (all(lowered(words(3)) /= [character(10) :: 'coordinate', 'array'])) then
         reader%rule = trim(words(3))//': must be coordinate or array'
      else if (all(lowered(words(4)) /= [character(7) :: 'real', 'integer'])) then
         reader%rule = trim(words(4))//': must be real or integer'
      else if (all(lowered(words(5)) /= [character(9) :: 'general', 'symmetric'])) then
         reader%rule = trim(words(5))//': must be general or symmetric'
      end if
      reader%is_coordinate = lowered(words(3)) == 'coordinate'
      reader%is_integer = lowered(words(4)) == 'integer'
      reader%is_symmetric = lowered(words(5)) == 'symmetric'
   end subroutine read_header

   !> Names a file of another program. Abaqus writes `node,dof,node,dof,value` (MATRIX INPUT, behind
   !> ** comments) or `row column value` (COORDINATE), without a header.
   subroutine refuse_header(reader)
      type(reader_type), intent(inout) :: reader
      character(word_length) :: words(6)
      character(:), allocatable :: line
      integer :: i, n

      do i = 1, reader%source%n_lines()
         line = reader%source%line(i)
         if (index(adjustl(line), '*') == 1 .or. verify(line, ' '//achar(9)//achar(13)) == 0) cycle
         call split(commas_to_blanks(line), words, n)
         if (are_numbers(words, n)) then
            reader%line = i
            if (n == 5) reader%rule = shown(reader)//': an Abaqus matrix (node, dof, node, '// &
                                      'dof, value), not Matrix Market'//importer
            if (n == 3) reader%rule = shown(reader)// &
                            ': row, column, value without a header, as Abaqus writes them'//importer
         end if
         exit
      end do
      if (.not. allocated(reader%rule)) &
         reader%rule = shown(reader)//': must begin with %%MatrixMarket matrix'
   end subroutine refuse_header

   !> True if all but the last word are whole numbers, and the last is a number.
   logical function are_numbers(words, n)
      character(*), intent(in) :: words(:)
      integer, intent(in) :: n
      character(:), allocatable :: rule
      integer(long) :: number
      real(wp) :: value
      integer :: i

      are_numbers = n >= 1 .and. n <= size(words)
      if (.not. are_numbers) return
      do i = 1, n - 1
         call parse_integer(trim(words(i)), int(huge(1), long), number, rule)
         are_numbers = are_numbers .and. .not. allocated(rule)
      end do
      call parse_real(trim(words(n)), value, rule)
      are_numbers = are_numbers .and. .not. allocated(rule)
   end function are_numbers

   pure function commas_to_blanks(line) result(text)
      character(*), intent(in) :: line
      character(len(line)) :: text
      integer :: i

      text = line
      do i = 1, len(line)
         if (line(i:i) == ',') text(i:i) = ' '
      end do
   end function commas_to_blanks

   !> Reads rows columns [entries], behind % comments.
   subroutine read_sizes(reader)
      type(reader_type), intent(inout) :: reader
      integer :: sizes(3), n

      n = merge(3, 2, reader%is_coordinate)
      sizes(3) = 0
      if (.not. advance(reader)) then
         reader%rule = 'ends before its sizes'
         return
      end if
      call read_numbers(reader, 'must be the '//to_text(n)//' sizes: rows, columns'// &
                        trim(merge(', entries', '         ', reader%is_coordinate)), sizes(:n))
      if (allocated(reader%rule)) return
      reader%n_rows = sizes(1)
      reader%n_columns = sizes(2)
      if (any(sizes(:2) < 1 .or. sizes(:2) > most_dofs)) then
         reader%rule = shown(reader)//': rows and columns must be from 1 to '//to_text(most_dofs)
      else if (.not. gives_memory(memory_of_matrices(sizes(1), sizes(2) - sizes(1)))) then
         reader%rule = shown(reader)//': '// &
                       too_large(memory_of_matrices(sizes(1), sizes(2) - sizes(1)))
      else if (reader%is_symmetric .and. sizes(1) /= sizes(2)) then
         reader%rule = shown(reader)//': a symmetric matrix must have as many rows as columns'
      else if (sizes(3) < 0 .or. sizes(3) > sizes(1)*sizes(2)) then
         reader%rule = shown(reader)//': entries must be from 0 to rows times columns'
      end if
      if (allocated(reader%rule)) return
      reader%n_entries = sizes(3)
      if (reader%is_coordinate) return
      reader%n_entries = sizes(1)*sizes(2)
      if (reader%is_symmetric) reader%n_entries = sizes(1)*(sizes(1) + 1)/2
   end subroutine read_sizes

   !> Reads exactly as many entries as the header promises, each once.
   subroutine read_entries(reader, matrix)
      type(reader_type), intent(inout) :: reader
      type(matrix_file), intent(inout) :: matrix
      real(wp) :: value
      integer :: i, j, n, place(2)

      deallocate (matrix%value)
      allocate (matrix%value(reader%n_rows, reader%n_columns), source=0.0_wp)
      allocate (matrix%line(reader%n_rows, reader%n_columns), source=0)
      i = 0
      j = 1
      do n = 1, reader%n_entries
         if (.not. advance(reader)) then
            reader%rule = 'holds '//to_text(n - 1)//' entries: must be '//to_text(reader%n_entries)
            return
         end if
         if (reader%is_coordinate) then
            call read_numbers(reader, 'must be row, column and value between blanks', place, value)
            i = place(1)
            j = place(2)
            if (.not. allocated(reader%rule)) call judge_place(reader, i, j, matrix%line)
         else
            i = i + 1   ! columns one behind the other; of a symmetric one from the diagonal down
            if (i > reader%n_rows) then
               j = j + 1
               i = merge(j, 1, reader%is_symmetric)
            end if
            call read_numbers(reader, 'must be one value', place(:0), value)
         end if
         if (allocated(reader%rule)) return
         matrix%value(i, j) = value
         matrix%line(i, j) = reader%line
         if (reader%is_symmetric) then
            matrix%value(j, i) = value
            matrix%line(j, i) = reader%line
         end if
      end do
      if (advance(reader)) reader%rule = shown(reader)//': stands behind the last of '// &
                                         to_text(reader%n_entries)//' entries'
   end subroutine read_entries

   !> Requires a place within the matrix, in the lower triangle of a symmetric one, and not given
   !> before.
   subroutine judge_place(reader, i, j, line)
      type(reader_type), intent(inout) :: reader
      integer, intent(in) :: i, j
      integer, intent(in) :: line(:, :)   !! of the entries before

      if (i < 1 .or. i > reader%n_rows .or. j < 1 .or. j > reader%n_columns) then
         reader%rule = shown(reader)//': row and column must be from 1 to '// &
                       to_text(reader%n_rows)//' and '//to_text(reader%n_columns)
      else if (reader%is_symmetric .and. i < j) then
         reader%rule = shown(reader)//': a symmetric file must hold the lower triangle alone'
      else if (line(i, j) > 0) then
         reader%rule = shown(reader)//': the entry is there twice'
      end if
   end subroutine judge_place

   !> Reads whole numbers and, behind them, a value where one is wanted, which fill the line.
   subroutine read_numbers(reader, rule, indices, value)
      type(reader_type), intent(inout) :: reader
      character(*), intent(in) :: rule   !! of a line that holds more or fewer
      integer, intent(out) :: indices(:)
      real(wp), intent(out), optional :: value
      character(word_length) :: words(4)
      integer :: i, n, wanted

      indices = 0
      if (present(value)) value = 0.0_wp
      wanted = size(indices) + merge(1, 0, present(value))
      call split(reader%source%line(reader%line), words, n)
      if (n /= wanted) reader%rule = shown(reader)//': '//rule
      do i = 1, size(indices)
         if (.not. allocated(reader%rule)) call parse_index(reader, words(i), indices(i))
      end do
      if (present(value) .and. .not. allocated(reader%rule)) &
         call parse_value(reader, words(wanted), value)
   end subroutine read_numbers

   subroutine parse_index(reader, word, value)
      type(reader_type), intent(inout) :: reader
      character(*), intent(in) :: word
      integer, intent(out) :: value
      character(:), allocatable :: rule
      integer(long) :: wide

      call parse_integer(trim(word), int(huge(1), long), wide, rule)
      value = int(wide)
      if (allocated(rule)) reader%rule = printable(trim(word))//': '//rule
   end subroutine parse_index

   subroutine parse_value(reader, word, value)
      type(reader_type), intent(inout) :: reader
      character(*), intent(in) :: word
      real(wp), intent(out) :: value
      character(:), allocatable :: rule
      integer(long) :: wide

      if (reader%is_integer) call parse_integer(trim(word), huge(1_long), wide, rule)
      if (.not. allocated(rule)) call parse_real(trim(word), value, rule)
      if (allocated(rule)) reader%rule = printable(trim(word))//': '//rule
   end subroutine parse_value

   !> True if another line that is neither blank nor a comment follows; moves to it.
   logical function advance(reader)
      type(reader_type), intent(inout) :: reader
      integer :: start

      advance = .true.
      do while (reader%line < reader%source%n_lines())
         reader%line = reader%line + 1
         start = verify(reader%source%line(reader%line), ' '//achar(9)//achar(13))
         if (start == 0) cycle
         if (index(adjustl(reader%source%line(reader%line)), '%') /= 1) return
      end do
      advance = .false.
   end function advance

   !> Splits a line into words; n exceeds their room where there are more, or where one is too long.
   pure subroutine split(line, words, n)
      character(*), intent(in) :: line
      character(word_length), intent(out) :: words(:)
      integer, intent(out) :: n
      integer :: first, last

      words = ''
      n = 0
      last = 0
      do
         call next_word(line, first, last)
         if (first > last) exit
         n = n + 1
         if (last - first >= len(words)) n = size(words) + 1
         if (n > size(words)) return
         words(n) = line(first:last)
      end do
   end subroutine split

   !> The line read last, cut where it is long.
   pure function shown(reader) result(text)
      type(reader_type), intent(in) :: reader
      character(:), allocatable :: text

      text = reader%source%line(reader%line)
      text = printable(text(:min(len_trim(text), 60)))
   end function shown

end module structure_matrix_market
