!> Reads matrices from Matrix Market files (math.nist.gov/MatrixMarket/formats.html): coordinate or
!> array, real or integer, general or symmetric. Refuses all other files, and those whose content is
!> not what their header says.
module structure_matrix_market
   use core_complaints, only: complaint_list, printable
   use core_kinds, only: wp
   use core_source, only: read_source, source_type
   use core_table, only: next_word, parse_rows, table_type
   use core_text, only: counted, lowered, to_text
   use structure_model, only: most_dofs, too_large
   implicit none(type, external)
   private
   public :: matrix_file, read_matrix

   !> A full matrix, and the lines of its entries in the file.
   type :: matrix_file
      character(:), allocatable :: path
      real(wp), allocatable :: value(:, :)   !! (row, column); undefined after a complaint
      integer, allocatable :: line(:, :)     !! (row, column) line of the entry; 0: not in the file
      integer :: size_line = 0               !! line of the sizes
   contains
      procedure :: refuse
   end type matrix_file

   !> A file, its header, and a table of its other lines: sizes (rows, columns [, entries]), then
   !> entries (row, column, value, or value alone).
   type :: reader_type
      type(source_type) :: source
      type(table_type) :: table
      logical :: is_coordinate = .false., is_symmetric = .false., is_integer = .false.
      integer :: line = 1                !! present line
      character(:), allocatable :: rule  !! message, if the present line breaks a rule
   end type reader_type

contains

   !> Reads a matrix from a file.
   subroutine read_matrix(path, matrix, complaints)
      character(*), intent(in) :: path
      type(matrix_file), intent(out) :: matrix
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      type(reader_type) :: reader
      integer :: n_before

      matrix%path = path
      call read_source(path, reader%source, refusal, huge(1) - 1)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
         return
      end if
      n_before = complaints%n
      call read_header(reader)
      if (.not. allocated(reader%rule)) &
         call parse_rows(reader%source, '%', 1, 3, reader%table, complaints)
      if (complaints%n > n_before) return
      if (.not. allocated(reader%rule)) call check_sizes(reader)
      matrix%size_line = reader%line
      if (.not. allocated(reader%rule)) call read_entries(reader, matrix)
      if (allocated(reader%rule)) call matrix%refuse(reader%line, reader%rule, complaints)
   end subroutine read_matrix

   !> Complains of a line, or of the file if the line is 0.
   subroutine refuse(self, line, rule, complaints)
      class(matrix_file), intent(in) :: self
      integer, intent(in) :: line
      character(*), intent(in) :: rule   !! begins with what breaks it
      type(complaint_list), intent(inout) :: complaints

      if (line == 0) then
         call complaints%add_general(self%path//': '//rule)
      else
         call complaints%add_general(self%path//':'//to_text(line)//': '//rule)
      end if
   end subroutine refuse

   !> Reads the header: %%MatrixMarket matrix coordinate|array real|integer general|symmetric.
   pure subroutine read_header(reader)
      type(reader_type), intent(inout) :: reader
      character(:), allocatable :: line
      character(40) :: words(5)
      integer :: first, last, n

      line = lowered(reader%source%line(1))
      words = ''
      n = 0
      last = 0
      do
         call next_word(line, first, last)
         if (first > last) exit
         n = n + 1
         if (n <= size(words)) words(n) = line(first:last)
      end do
      if (words(1) /= '%%matrixmarket') then
         reader%rule = shown(reader)//': must begin with %%MatrixMarket matrix; '// &
                       '`python -m entroslip.structure` converts matrices of Abaqus'
      else if (n /= 5 .or. words(2) /= 'matrix') then
         reader%rule = shown(reader)//': must be %%MatrixMarket matrix, form, field, symmetry'
      else if (all(words(3) /= [character(10) :: 'coordinate', 'array'])) then
         reader%rule = printable(trim(words(3)))//': must be coordinate or array'
      else if (all(words(4) /= [character(7) :: 'real', 'integer'])) then
         reader%rule = printable(trim(words(4)))//': must be real or integer'
      else if (all(words(5) /= [character(9) :: 'general', 'symmetric'])) then
         reader%rule = printable(trim(words(5)))//': must be general or symmetric'
      end if
      reader%is_coordinate = words(3) == 'coordinate'
      reader%is_integer = words(4) == 'integer'
      reader%is_symmetric = words(5) == 'symmetric'
   end subroutine read_header

   !> Checks the line of sizes: rows, columns [, entries].
   subroutine check_sizes(reader)
      type(reader_type), intent(inout) :: reader
      real(wp) :: sizes(3)

      if (reader%table%n_rows == 0) then
         reader%rule = 'ends before its sizes'
         return
      end if
      reader%line = reader%table%line(1)
      sizes = reader%table%value(:, 1)
      if (reader%table%n_columns(1) /= merge(3, 2, reader%is_coordinate) .or. &
          any(abs(sizes - aint(sizes)) > 0.0_wp)) then
         reader%rule = shown(reader)//': must be the 2 sizes: rows, columns'
         if (reader%is_coordinate) &
            reader%rule = shown(reader)//': must be the 3 sizes: rows, columns, entries'
      else if (any(sizes(:2) < 1.0_wp .or. sizes(:2) > most_dofs)) then
         reader%rule = shown(reader)//': rows and columns must be from 1 to '//to_text(most_dofs)
      else if (too_large(int(sizes(1)), int(sizes(2) - sizes(1))) /= '') then
         reader%rule = shown(reader)//': '//too_large(int(sizes(1)), int(sizes(2) - sizes(1)))
      else if (reader%is_symmetric .and. abs(sizes(1) - sizes(2)) > 0.0_wp) then
         reader%rule = shown(reader)//': a symmetric matrix must have as many rows as columns'
      else if (sizes(3) < 0.0_wp .or. sizes(3) > sizes(1)*sizes(2)) then
         reader%rule = shown(reader)//': entries must be from 0 to rows times columns'
      end if
   end subroutine check_sizes

   !> Reads the entries, which must be as many as the sizes say.
   subroutine read_entries(reader, matrix)
      type(reader_type), intent(inout) :: reader
      type(matrix_file), intent(inout) :: matrix
      integer :: i, j, n, n_entries, sizes(3)

      sizes = int(reader%table%value(:, 1))
      n_entries = sizes(1)*sizes(2)
      if (reader%is_symmetric) n_entries = sizes(1)*(sizes(1) + 1)/2
      if (reader%is_coordinate) n_entries = sizes(3)
      allocate (matrix%value(sizes(1), sizes(2)), source=0.0_wp)
      allocate (matrix%line(sizes(1), sizes(2)), source=0)
      i = 0
      j = 1
      do n = 2, reader%table%n_rows
         reader%line = reader%table%line(n)
         if (n > n_entries + 1) then
            reader%rule = shown(reader)//': stands behind the last of '//to_text(n_entries)// &
                          ' entries'
         else
            call check_entry(reader, n, matrix%line)
         end if
         if (allocated(reader%rule)) return
         if (reader%is_coordinate) then
            i = int(reader%table%value(1, n))
            j = int(reader%table%value(2, n))
         else
            i = i + 1   ! column by column; in a symmetric matrix from the diagonal down
            if (i > sizes(1)) then
               j = j + 1
               i = merge(j, 1, reader%is_symmetric)
            end if
         end if
         matrix%value(i, j) = reader%table%value(reader%table%n_columns(n), n)
         matrix%line(i, j) = reader%line
         if (reader%is_symmetric) then
            matrix%value(j, i) = matrix%value(i, j)
            matrix%line(j, i) = reader%line
         end if
      end do
      if (n < n_entries + 2) reader%rule = 'holds '//counted(n - 2, 'entry', 'entries')// &
                                           ': must be '//to_text(n_entries)
   end subroutine read_entries

   !> Checks an entry. In a coordinate file, its place must be within the matrix, in the lower
   !> triangle of a symmetric one, and not taken.
   pure subroutine check_entry(reader, n, line)
      type(reader_type), intent(inout) :: reader
      integer, intent(in) :: n
      integer, intent(in) :: line(:, :)   !! lines of the entries read before
      real(wp) :: fraction(3), row(3)

      row = reader%table%value(:, n)
      fraction = abs(row - aint(row))
      if (.not. reader%is_coordinate) then
         if (reader%table%n_columns(n) /= 1) reader%rule = shown(reader)//': must be one value'
      else if (reader%table%n_columns(n) /= 3) then
         reader%rule = shown(reader)//': must be row, column and value between blanks'
      else if (any(row(:2) < 1.0_wp .or. row(:2) > shape(line) .or. fraction(:2) > 0.0_wp)) then
         reader%rule = shown(reader)//': row and column must be from 1 to '// &
                       to_text(size(line, 1))//' and '//to_text(size(line, 2))
      else if (reader%is_symmetric .and. row(1) < row(2)) then
         reader%rule = shown(reader)//': a symmetric file must hold the lower triangle alone'
      else if (line(int(row(1)), int(row(2))) > 0) then
         reader%rule = shown(reader)//': the entry is there twice'
      end if
      if (reader%is_integer .and. fraction(reader%table%n_columns(n)) > 0.0_wp .and. &
          .not. allocated(reader%rule)) reader%rule = shown(reader)//': must be a whole number'
   end subroutine check_entry

   !> Present line, at most 60 characters of it.
   pure function shown(reader) result(text)
      type(reader_type), intent(in) :: reader
      character(:), allocatable :: text

      text = reader%source%line(reader%line)
      text = printable(text(:min(len_trim(text), 60)))
   end function shown

end module structure_matrix_market
