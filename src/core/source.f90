!> Text of a scene or table with its lines, from a file or from the --set options.
module core_source
   use core_kinds, only: long
   use core_text, only: line_feed, to_text
   implicit none(type, external)
   private
   public :: source_type, find_beside, is_folder, is_hdf5_file, new_source, read_source

   character, parameter :: carriage_return = achar(13)
   !> Byte order mark with which some editors begin UTF-8 text.
   character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)
   character(*), parameter :: not_text = 'is not plain text: HDF5, UTF-16 or another binary format'

   !> Text and the places where its lines begin.
   type :: source_type
      character(:), allocatable :: name       !! name in complaints
      character(:), allocatable :: text
      integer, allocatable :: line_start(:)   !! (line) position of its first character
   contains
      procedure :: n_lines
      procedure :: line
   end type source_type

contains

   !> Source of a given text without its byte order mark, with its name in complaints.
   pure function new_source(name, text) result(source)
      character(*), intent(in) :: name, text
      type(source_type) :: source
      integer :: i, n

      source%name = name
      source%text = text(1 + merge(len(byte_order_mark), 0, index(text, byte_order_mark) == 1):)
      n = 1
      do i = 1, len(source%text)
         if (source%text(i:i) == line_feed) n = n + 1
      end do
      allocate (source%line_start(n))
      source%line_start(1) = 1
      n = 1
      do i = 1, len(source%text)
         if (source%text(i:i) /= line_feed) cycle
         n = n + 1
         source%line_start(n) = i + 1
      end do
   end function new_source

   !> Path of a file in the folder of another path, else in the current folder; '' if it is in
   !> neither.
   function find_beside(path, file) result(found)
      character(*), intent(in) :: path, file
      character(:), allocatable :: found
      logical :: exists

      found = file
      if (file(1:1) /= '/') found = path(:index(path, '/', back=.true.))//file
      inquire (file=found, exist=exists)
      if (exists) return
      found = file
      inquire (file=found, exist=exists)
      if (.not. exists) found = ''
   end function find_beside

   !> True if there is a folder of this name.
   logical function is_folder(path)
      character(*), intent(in) :: path

      inquire (file=path//'/.', exist=is_folder)
   end function is_folder

   !> True if the file begins with HDF5's signature.
   logical function is_hdf5_file(path)
      character(*), intent(in) :: path
      character(8) :: signature
      integer(long) :: n_bytes
      integer :: unit, status

      is_hdf5_file = .false.
      inquire (file=path, size=n_bytes)
      if (n_bytes == 0) return   ! perhaps a pipe, where opening would wait
      open (newunit=unit, file=path, access='stream', form='unformatted', action='read', &
            status='old', iostat=status)
      if (status /= 0) return
      read (unit, iostat=status) signature
      if (status == 0) is_hdf5_file = &
         signature == char(137)//'HDF'//achar(13)//achar(10)//achar(26)//achar(10)
      close (unit, iostat=status)
   end function is_hdf5_file

   !> Reads a whole file; if that fails, `refusal` is allocated and has the reason.
   subroutine read_source(path, source, refusal, most_bytes)
      character(*), intent(in) :: path
      type(source_type), intent(out) :: source
      character(:), allocatable, intent(out) :: refusal
      integer, intent(in) :: most_bytes
      character(:), allocatable :: text
      character(256) :: reason
      integer(long) :: size
      integer :: unit, status
      logical :: exists

      size = 0
      inquire (file=path, exist=exists, size=size)
      if (.not. exists .or. len_trim(path) == 0) then
         refusal = 'no such file'
      else if (size <= 0) then   ! reading a pipe or a device could wait for ever
         refusal = 'is empty, or a pipe or a device'
      else if (is_hdf5_file(path)) then   ! before the size, as for results in place of a scene
         refusal = not_text
      else if (size > most_bytes) then
         refusal = 'is larger than '//to_text(most_bytes/1024**2)//' MB'
      end if
      if (allocated(refusal)) return
      open (newunit=unit, file=path, access='stream', form='unformatted', action='read', &
            status='old', iostat=status, iomsg=reason)
      allocate (character(size) :: text)
      if (status == 0) read (unit, iostat=status, iomsg=reason) text
      if (status /= 0) then
         refusal = 'cannot be read: '//trim(reason)
      else if (index(text, achar(0)) > 0) then
         refusal = not_text
      else if (scan(text, carriage_return) > 0 .and. scan(text, line_feed) == 0) then
         refusal = 'ends its lines with CR alone, not with LF or CR LF'
      else
         source = new_source(path, text)
      end if
      close (unit, iostat=status)
   end subroutine read_source

   !> Number of lines.
   pure integer function n_lines(self)
      class(source_type), intent(in) :: self

      n_lines = size(self%line_start)
   end function n_lines

   !> Line of a number, without its line feed.
   pure function line(self, number) result(text)
      class(source_type), intent(in) :: self
      integer, intent(in) :: number
      character(:), allocatable :: text

      if (number < self%n_lines()) then
         text = self%text(self%line_start(number):self%line_start(number + 1) - 2)
      else
         text = self%text(self%line_start(number):)
      end if
   end function line

end module core_source
