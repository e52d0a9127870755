!> Whether all of a file can be read: every number in it passes HDF5's checksums once.
module io_read_back
   use core_error, only: error_type
   use io_hdf5, only: check_dataset, hdf5_file, open_hdf5
   implicit none(type, external)
   private
   public :: read_back

contains

   !> An error names the dataset that is damaged.
   subroutine read_back(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      call check_group(file, '', error)
      call file%abandon()
   end subroutine read_back

   recursive subroutine check_group(file, group, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group   !! '' is the root
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: names(:)
      integer :: i

      call file%list(group//'/', names, error)
      if (allocated(error)) return
      do i = 1, size(names)
         if (file%is_group(group//'/'//trim(names(i)))) then
            call check_group(file, group//'/'//trim(names(i)), error)
         else
            call check_dataset(file, group//'/'//trim(names(i)), error)
         end if
         if (allocated(error)) return
      end do
   end subroutine check_group

end module io_read_back
