!> The one door to HDF5: files, groups with their datasets, and attributes; every status is checked,
!> and HDF5 itself says nothing. The rooms behind it are io_hdf5_file, io_hdf5_datasets and
!> io_hdf5_attributes.
module io_hdf5
   use io_hdf5_attributes, only: hdf5_object
   use io_hdf5_datasets, only: hdf5_group
   use io_hdf5_file, only: create_hdf5, hdf5_file, hdf5_library, open_hdf5
   implicit none(type, external)
   private
   public :: hdf5_file, create_hdf5, hdf5_library, open_hdf5
   public :: hdf5_group, hdf5_object

end module io_hdf5
