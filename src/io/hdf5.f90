!> The one door to HDF5: files, labelled datasets and attributes; every status is checked, and HDF5
!> itself says nothing. The rooms behind it are io_hdf5_file, io_hdf5_values, io_hdf5_writing and
!> io_hdf5_attributes.
module io_hdf5
   use io_hdf5_attributes, only: hdf5_object
   use io_hdf5_file, only: create_hdf5, hdf5_file, hdf5_library, open_hdf5
   use io_hdf5_values, only: allocate_for, check_dataset, move_part, move_rows, read_dataset, &
                             read_extent, read_shape
   use io_hdf5_writing, only: label_type, make_dataset, write_dataset
   implicit none(type, external)
   private
   public :: hdf5_file, create_hdf5, hdf5_library, open_hdf5
   public :: label_type, allocate_for, check_dataset, make_dataset, move_part, move_rows, &
             read_dataset, read_extent, read_shape, write_dataset
   public :: hdf5_object

end module io_hdf5
