!> Visitor of the datasets of a block of samples: writes them into a file of their own, reads them,
!> or puts them among those of all samples.
module io_dataset_visitor
   use core_chunks, only: frequencies_together
   use core_error, only: exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use io_group, only: group_type
   use io_hdf5, only: label_type, make_dataset, move_part, read_extent
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
      generic :: visit => visit_row, visit_matrix, visit_cube
      procedure, private :: visit_row, visit_matrix, visit_cube
   end type dataset_visitor

contains

   subroutine visit_row(self, what, values)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:)
      integer(long) :: n(1)
      integer :: status

      if (.not. is_concerned(self, what, allocated(values), n, status)) return
      if (.not. allocated(values)) allocate (values(self%n_all), stat=status)
      if (fits(self, what, n, status)) &
         call act(self, what, values(self%place + 1:self%place + self%n))
   end subroutine visit_row

   subroutine visit_matrix(self, what, values)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer(long) :: n(2)
      integer :: status

      if (.not. is_concerned(self, what, allocated(values), n, status)) return
      if (.not. allocated(values)) allocate (values(n(1), self%n_all), stat=status)
      if (fits(self, what, n, status)) &
         call act(self, what, values(:, self%place + 1:self%place + self%n))
   end subroutine visit_matrix

   subroutine visit_cube(self, what, values)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:, :, :)
      integer(long) :: n(3)
      integer :: status

      if (.not. is_concerned(self, what, allocated(values), n, status)) return
      if (.not. allocated(values)) allocate (values(n(1), n(2), self%n_all), stat=status)
      if (fits(self, what, n, status)) &
         call act(self, what, values(:, :, self%place + 1:self%place + self%n))
   end subroutine visit_cube

   !> True if there is something to do with a dataset; finds the extents that a file has of it.
   logical function is_concerned(self, what, is_there, extents, status)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      logical, intent(in) :: is_there   !! in the block
      integer(long), intent(out) :: extents(:)   !! when reading; else 0
      integer, intent(out) :: status    !! 0, for an allocate that is not needed
      integer(long), allocatable :: found(:)

      status = 0
      extents = 0
      is_concerned = is_there
      if (self%deed == reads) is_concerned = self%group%has(trim(what%name))
      is_concerned = is_concerned .and. .not. allocated(self%group%error)
      if (.not. is_concerned .or. self%deed /= reads) return
      call read_extent(self%group%file, path_of(self, what), size(extents), found, self%group%error)
      is_concerned = .not. allocated(self%group%error)
      if (is_concerned) extents = found
   end function is_concerned

   !> True if the memory holds a dataset, else an error: a damaged file names any extent.
   logical function fits(self, what, extents, status)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      integer(long), intent(in) :: extents(:)
      integer, intent(in) :: status   !! of allocate

      fits = status == 0
      if (.not. fits) call raise(self%group%error, exit_file, self%group%file%path//': '// &
                                 path_of(self, what)//' does not fit into memory: '// &
                                 to_text(product(extents))//' values')
   end function fits

   !> Does the deed on the rows concerned.
   subroutine act(self, what, values)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      real(wp), intent(inout), contiguous :: values(..)
      integer :: first(rank(values))

      first = 1
      first(rank(values)) = self%before + 1
      if (self%deed /= reads) call make(self, what, shape(values))
      if (.not. allocated(self%group%error)) &
         call move_part(self%group%file, path_of(self, what), first, values, self%deed /= reads, &
                        self%group%error)
   end subroutine act

   !> Makes a dataset where it is not there yet. In a block's own file it has no axes, and spectra
   !> are cut into ranges of frequencies, which is how statistics read them. A chunk has the samples
   !> of one block: more would not fit into HDF5's cache of 1 MB.
   subroutine make(self, what, extents)
      class(dataset_visitor), intent(inout) :: self
      type(dataset_type), intent(in) :: what
      integer, intent(in) :: extents(:)   !! of the rows concerned
      type(label_type) :: label
      integer :: last

      if (self%group%has(trim(what%name))) return
      label%units = trim(what%units)
      label%long_name = trim(what%about)
      label%axes = ''
      label%kind = what%kind
      if (self%deed == puts) then
         label%axes = trim(what%axes)
         last = index(label%axes, ' ', back=.true.)
         if (label%axes(last + 1:) == 'kept') label%axes = label%axes(:last)//self%dof
      else if (what%name == 'psd') then
         label%chunk = [extents(1), frequencies_together(extents(1), extents(2)), extents(3)]
      end if
      call make_dataset(self%group%file, path_of(self, what), &
                        int([extents(:size(extents) - 1), self%n_all], long), label, &
                        self%group%error)
   end subroutine make

   !> Place of a dataset in the file.
   pure function path_of(self, what) result(path)
      class(dataset_visitor), intent(in) :: self
      type(dataset_type), intent(in) :: what
      character(:), allocatable :: path

      path = self%group%at(trim(what%name))
   end function path_of

end module io_dataset_visitor
