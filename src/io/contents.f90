!> Completeness of a results file: each group lists its members in the attribute `contents`; a check
!> compares the lists with the file and reads every number.
!>
!> A list names a group as `c001/` and a dataset with its shape, in Python's order, as
!> `psd(6,513,5)`. It is made from the file itself.
module io_contents
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long
   use core_table, only: words_of
   use core_text, only: to_text
   use io_hdf5, only: hdf5_file, hdf5_group
   implicit none(type, external)
   private
   public :: check_contents, write_contents

   character(*), parameter :: attribute = 'contents'

   integer, parameter :: most_named = 3   !! largest number of faults in a message

contains

   !> Writes the attribute `contents` of a group and of all groups in it.
   recursive subroutine write_contents(file, path, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path   !! path of the group
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: members, words(:)
      type(hdf5_group) :: group
      integer :: i

      group = hdf5_group(file, path)
      group%has_fixed_texts = .true.
      call list_members(group, members)
      call group%attribute(attribute, members)
      call group%take_error(error)
      words = words_of(members)
      do i = 1, size(words)
         if (allocated(error)) return
         if (index(words(i), '/') > 0) &
            call write_contents(file, group%path_of(words(i) (:index(words(i), '/') - 1)), error)
      end do
   end subroutine write_contents

   !> Compares a file with its lists of contents and reads every number once, so that HDF5 verifies
   !> its checksums. An error names the members that are missing, damaged or of another shape.
   subroutine check_contents(file, error)
      type(hdf5_file), intent(in) :: file
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: faults   ! text of the first ones
      integer :: n_faults

      faults = ''
      n_faults = 0
      call check_group('/')
      if (n_faults == 0) return
      if (n_faults > most_named) faults = faults//' and '//to_text(n_faults - most_named)//' more'
      call raise(error, exit_file, file%path//' is damaged: '//faults)

   contains

      !> Adds the faults of a group and of all groups in it.
      recursive subroutine check_group(path)
         character(*), intent(in) :: path   !! path of the group
         character(:), allocatable :: listed, members, name, word, words(:)
         type(hdf5_group) :: group
         integer :: i

         group = hdf5_group(file, path)
         call group%read(attribute, listed)
         call list_members(group, members)
         if (allocated(group%error)) listed = ''
         call add_error(group)
         words = words_of(listed)
         do i = 1, size(words)
            word = trim(words(i))
            name = word(:scan(word//'/', '/(') - 1)
            if (index(' '//members//' ', ' '//word//' ') == 0) then
               if (group%has(name)) then
                  call add(group%path_of(name)//' does not have the shape '// &
                           word(len(name) + 1:)//' any more')
               else
                  call add(group%path_of(name)//' is missing')
               end if
            else if (word == name//'/') then
               call check_group(group%path_of(name))
            else
               call group%check(name)
               call add_error(group)
            end if
         end do
      end subroutine check_group

      !> Adds the error of a group, if it has one.
      subroutine add_error(group)
         type(hdf5_group), intent(inout) :: group

         if (.not. allocated(group%error)) return
         call add(group%error%message(len(file%path) + 3:))
         deallocate (group%error)
      end subroutine add_error

      !> Adds a fault. The text has no more than the first `most_named`.
      subroutine add(fault)
         character(*), intent(in) :: fault

         n_faults = n_faults + 1
         if (n_faults > 1 .and. n_faults <= most_named) faults = faults//'; '
         if (n_faults <= most_named) faults = faults//fault
      end subroutine add

   end subroutine check_contents

   !> Lists the members of a group as words, each with its shape, such as psd(6,513,5).
   subroutine list_members(group, members)
      type(hdf5_group), intent(inout) :: group
      character(:), allocatable, intent(out) :: members
      character(:), allocatable :: names(:)
      integer(long), allocatable :: extents(:)
      integer :: i, k

      members = ''
      if (allocated(group%error)) return
      call group%file%list(group%path, names, group%error)
      do i = 1, size(names)
         if (allocated(group%error)) return
         if (i > 1) members = members//' '
         if (group%file%is_group(group%path_of(trim(names(i))))) then
            members = members//trim(names(i))//'/'
         else
            call group%read_shape(trim(names(i)), extents)
            members = members//trim(names(i))//'('
            do k = size(extents), 1, -1   ! in Python's order of axes
               members = members//to_text(extents(k))
               if (k > 1) members = members//','
            end do
            members = members//')'
         end if
      end do
   end subroutine list_members

end module io_contents
