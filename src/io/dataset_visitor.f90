!> Visitor of the datasets of a block of samples: writes them into a file of their own, reads them,
!> or puts them among those of all samples.
module io_dataset_visitor
   use core_chunks, only: frequencies_together
   use core_kinds, only: long, wp
   use io_group, only: group_type
   use io_hdf5, only: allocate_for, label_type, make_dataset, move_rows
   implicit none(type, external)
   private
   public :: dataset_type, dataset_visitor
   public :: puts, reads, writes

   integer, parameter :: writes = 1, reads = 2, puts = 3   !! what a visitor does

   !> Dataset of the samples of a block.
   type :: dataset_type
      character(24) :: name
      character(8) :: units    !! '1': a pure number
      character(24) :: axes    !! Python's order
      character(128) :: about
      character(8) :: kind = 'real'   !! as label_type has it
   end type dataset_type

   !> Does one thing with each dataset that it visits.
   type :: dataset_visitor
      integer :: deed = writes
      type(group_type) :: group            !! where the datasets are or come to be
      character(:), allocatable :: dof     !! the axis of the dofs whose spectra are kept
      integer :: before = 0                !! rows of the file before those concerned
      integer :: place = 0                 !! rows of the block before those concerned
      integer :: n = 0                     !! rows concerned: samples, at last transitions
      integer :: n_all = 0                 !! rows of what is made: in the block, in the file
   contains
      procedure :: visit
   end type dataset_visitor

contains

   !> Does the deed on the rows concerned. What is not there is passed by.
   subroutine visit(self, what, values)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(..)
      character(:), allocatable :: path

      if (allocated(self%group%error)) return
      path = self%group%at(trim(what%name))
      if (self%deed == reads) then
         if (.not. self%group%file%has(path)) return
         call allocate_for(self%group%file, path, values, self%group%error, self%n_all)
      else
         if (.not. allocated(values)) return
         if (.not. self%group%file%has(path)) call make(self, what, path, shape(values))
      end if
      if (.not. allocated(self%group%error)) &
         call move_rows(self%group%file, path, self%before, values, self%place, self%n, &
                        self%deed /= reads, self%group%error)
   end subroutine visit

   !> Makes a dataset where it is not there yet. In a block's own file it has no axes, and spectra
   !> are cut into ranges of frequencies, which is how statistics read them. A chunk has the samples
   !> of one block: more would not fit into HDF5's cache of 1 MB.
   subroutine make(self, what, path, extents)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      character(*), intent(in) :: path
      integer, intent(in) :: extents(:)   !! of the block
      type(label_type) :: label
      integer :: last

      label%units = trim(what%units)
      label%long_name = trim(what%about)
      label%axes = ''
      label%kind = what%kind
      if (self%deed == puts) then
         label%axes = trim(what%axes)
         last = index(label%axes, ' ', back=.true.)
         if (label%axes(last + 1:) == 'kept') label%axes = label%axes(:last)//self%dof
      else if (what%name == 'psd') then
         label%chunk = [extents(1), frequencies_together(extents(1), extents(2)), &
                        min(extents(3), self%n_all)]
      end if
      call make_dataset(self%group%file, path, &
                        int([extents(:size(extents) - 1), self%n_all], long), label, &
                        self%group%error)
   end subroutine make

end module io_dataset_visitor
