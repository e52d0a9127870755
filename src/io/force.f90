!> Force records that the user supplies in an HDF5 file.
module io_force
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use io_files, only: file_size
   use io_hdf5, only: hdf5_file, hdf5_group, hdf5_object, open_hdf5
   implicit none(type, external)
   private
   public :: read_force_hdf5

   character(*), parameter :: name = 'force'   !! name of the dataset

contains

   !> Reads the dataset /force(step), or /force(sample, step) in Python's order of axes. Its
   !> attribute dt, if it has one, must equal the scene's. The caller checks the values and their
   !> number.
   subroutine read_force_hdf5(path, dt, force, error)
      character(*), intent(in) :: path
      real(wp), intent(in) :: dt                          !! step of the scene [s]
      real(wp), allocatable, intent(out) :: force(:, :)   !! (0:n_steps, 1 or sample) [N]
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: rounding = 1.0e-12_wp   ! relative rounding error of a computed dt
      type(hdf5_file) :: file
      type(hdf5_group) :: root
      type(hdf5_object) :: dataset
      real(wp) :: found

      call open_hdf5(path, file, error)
      root = hdf5_group(file, '/')
      dataset%file = file
      dataset%path = root%path_of(name)
      if (.not. allocated(error)) then
         if (.not. root%has(name)) then
            call raise(error, exit_bad_input, path//': has no dataset '//dataset%path)
         else if (dataset%has_attribute('dt')) then
            found = dt   ! stays after an error
            call dataset%read('dt', found)
            call dataset%take_error(error)
            if (.not. (allocated(error) .or. abs(found - dt) <= rounding*dt)) &
               call raise(error, exit_bad_input, path//': attribute dt of '//dataset%path// &
                          ' = '//to_text(found)//': must be integration%dt = '//to_text(dt))
         end if
      end if
      if (.not. allocated(error)) call read_records(root, force, error)
      call file%abandon()
      if (allocated(error)) error%exit_code = exit_bad_input
   end subroutine read_force_hdf5

   !> Reads the dataset; refuses one with another number of axes, and one too large to be true.
   subroutine read_records(root, force, error)
      type(hdf5_group), intent(inout) :: root
      real(wp), allocatable, intent(out) :: force(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: densest = 1000.0_wp   ! values per byte, more than any compression has
      character(:), allocatable :: dataset
      integer(long), allocatable :: n(:)
      real(wp) :: most   ! values
      integer :: n_axes, status

      dataset = root%file%path//': '//root%path_of(name)
      call root%read_shape(name, n)
      if (allocated(root%error) .or. all(size(n) /= [1, 2])) then
         call raise(error, exit_bad_input, dataset// &
                    ': must be a dataset of one axis (step) or two (sample, step)')
         return
      end if
      n_axes = size(n)
      n = [n, 1_long]
      most = densest*real(file_size(root%file%path), wp)
      if (any(n < 1) .or. any(n > huge(0)) .or. product(real(n, wp)) > most) then
         call raise(error, exit_bad_input, dataset//' has '//to_text(n(2))//' records of '// &
                    to_text(n(1))//' values: none, or more than the file can hold')
         return
      end if
      allocate (force(0:n(1) - 1, n(2)), stat=status)
      if (status /= 0) then
         call raise(error, exit_bad_input, dataset//' does not fit into memory: '// &
                    to_text(product(n))//' values')
         return
      end if
      if (n_axes == 1) then
         call root%read_part(name, [1], force(:, 1))
      else
         call root%read_part(name, [1, 1], force)
      end if
      call root%take_error(error)
   end subroutine read_records

end module io_force
