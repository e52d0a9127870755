!> HDF5 for all other modules: files, groups with their datasets, and attributes. Every failure
!> becomes an error with HDF5's reason; HDF5 itself prints nothing.
module io_hdf5
   use io_hdf5_attributes, only: hdf5_object
   use io_hdf5_datasets, only: hdf5_group, new_group
   use io_hdf5_file, only: create_hdf5, hdf5_file, hdf5_library, open_hdf5
   implicit none(type, external)
   private
   public :: hdf5_file, create_hdf5, hdf5_library, open_hdf5
   public :: hdf5_group, hdf5_object, new_group

end module io_hdf5
