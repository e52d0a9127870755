!> Ranks of a run and their communication by MPI.
!>
!> Only this module and parallel_work use MPI. Collective procedures must be called by all ranks, in
!> the same order.
module parallel_world
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use core_error, only: error_type, exit_done, exit_file
   use core_kinds, only: wp
   use core_system, only: c_setenv
   use core_terminal, only: end_program, output_is_lost, write_error
   use mpi_f08, only: MPI_Allgatherv, MPI_Allreduce, MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_Barrier, &
                      MPI_Bcast, MPI_CHARACTER, MPI_Comm, MPI_Comm_rank, MPI_Comm_size, &
                      MPI_COMM_WORLD, MPI_DOUBLE_PRECISION, MPI_Finalize, &
                      MPI_Get_library_version, MPI_IN_PLACE, MPI_Init, MPI_INTEGER, MPI_Iprobe, &
                      MPI_MAX, MPI_MAX_LIBRARY_VERSION_STRING, MPI_MIN, MPI_STATUS_IGNORE, MPI_SUM
   implicit none(type, external)
   private
   public :: world_type, new_world, attend_to_others, mpi_library, start_world, stop_world, &
             was_launched

   !> Group of ranks. Ranks are counted from 0, as in MPI; rank 0 is the root.
   type :: world_type
      type(MPI_Comm) :: comm
      integer :: rank = 0
      integer :: n_ranks = 1
   contains
      procedure :: is_root
      procedure :: stop_on
      procedure :: wait_for_all
      generic :: broadcast => broadcast_integers, broadcast_matrix
      procedure :: any_true
      procedure :: maximum
      procedure :: add_up
      procedure :: join
      procedure, private :: broadcast_integers, broadcast_matrix
   end type world_type

contains

   !> Initializes MPI, for the ranks that mpirun started or for this process alone.
   subroutine start_world(world)
      type(world_type), intent(out) :: world

      if (.not. was_launched()) then
         ! Open MPI would start a daemon and probe all networks, for 0.3 s
         call set_default('OMPI_MCA_ess_singleton_isolated', '1')
         call set_default('OMPI_MCA_pml', 'ob1')
         call set_default('OMPI_MCA_btl', 'self')
      end if
      call MPI_Init()
      world = new_world(MPI_COMM_WORLD)
   end subroutine start_world

   !> Name and version of the MPI library; does not need MPI to be initialized.
   function mpi_library() result(text)
      character(:), allocatable :: text
      character(MPI_MAX_LIBRARY_VERSION_STRING) :: buffer
      integer :: length

      call MPI_Get_library_version(buffer, length)
      text = buffer(:scan(buffer(:length)//',', ','//achar(10)) - 1)
   end function mpi_library

   !> Lets MPI answer other ranks, for calls in long computations: over TCP a rank that claims work
   !> waits for the root's answer. Networks with remote memory access need none.
   subroutine attend_to_others()
      logical :: unused

      call MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, unused, MPI_STATUS_IGNORE)
   end subroutine attend_to_others

   !> True if mpirun or the launcher of a batch system started this process.
   logical function was_launched()
      character(*), parameter :: names(*) = [character(20) :: 'OMPI_COMM_WORLD_SIZE', 'PMIX_RANK', &
                                                                         'PMI_RANK', 'SLURM_PROCID']
      integer :: i, status

      was_launched = .true.
      do i = 1, size(names)
         call get_environment_variable(trim(names(i)), status=status)
         if (status == 0) return
      end do
      was_launched = .false.
   end function was_launched

   !> Sets an environment variable unless it is set.
   subroutine set_default(name, value)
      character(*), intent(in) :: name, value
      integer(c_int) :: status

      status = c_setenv(name//c_null_char, value//c_null_char, 0_c_int)
   end subroutine set_default

   !> Ends the program with the same exit code on all ranks: exit_file instead of exit_done if a
   !> rank lost its standard output. Collective.
   subroutine stop_world(exit_code)
      integer, intent(in) :: exit_code
      integer :: code
      logical :: is_lost

      is_lost = output_is_lost()
      code = merge(exit_file, exit_code, exit_code == exit_done .and. is_lost)
      call MPI_Allreduce(MPI_IN_PLACE, code, 1, MPI_INTEGER, MPI_MAX, MPI_COMM_WORLD)
      call MPI_Finalize()
      call end_program(code)
   end subroutine stop_world

   !> World of a communicator.
   type(world_type) function new_world(comm) result(world)
      type(MPI_Comm), intent(in) :: comm

      world%comm = comm
      call MPI_Comm_rank(comm, world%rank)
      call MPI_Comm_size(comm, world%n_ranks)
   end function new_world

   !> True on the root.
   pure logical function is_root(self)
      class(world_type), intent(in) :: self

      is_root = self%rank == 0
   end function is_root

   !> Ends the program on all ranks if any of them has an error: the root reports the error of the
   !> lowest such rank, and all end with its exit code. Collective; only drivers call it.
   subroutine stop_on(self, error)
      class(world_type), intent(in) :: self
      type(error_type), allocatable, intent(in) :: error
      character(:), allocatable :: message
      integer :: exit_code, failed, n

      failed = merge(self%rank, self%n_ranks, allocated(error))
      call MPI_Allreduce(MPI_IN_PLACE, failed, 1, MPI_INTEGER, MPI_MIN, self%comm)
      if (failed == self%n_ranks) return

      exit_code = exit_done
      message = ''
      if (failed == self%rank) then
         exit_code = error%exit_code
         message = error%message
      end if
      exit_code = self%maximum(exit_code)   ! exit_done = 0 and no text on the other ranks
      n = self%maximum(len(message))
      if (failed /= self%rank) message = repeat(' ', n)
      call MPI_Bcast(message, n, MPI_CHARACTER, failed, self%comm)
      if (self%is_root()) call write_error(message)
      call stop_world(exit_code)
   end subroutine stop_on

   !> Waits until all ranks have called; collective.
   subroutine wait_for_all(self)
      class(world_type), intent(in) :: self

      call MPI_Barrier(self%comm)
   end subroutine wait_for_all

   !> True if `value` is true on any rank; collective.
   logical function any_true(self, value) result(is_true)
      class(world_type), intent(in) :: self
      logical, intent(in) :: value

      is_true = self%maximum(merge(1, 0, value)) == 1
   end function any_true

   !> Replaces values by their sums over the ranks; collective. If all ranks but one have zero, the
   !> sum equals the value of that rank to the last bit.
   subroutine add_up(self, n, values)
      class(world_type), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(inout) :: values(n)

      call MPI_Allreduce(MPI_IN_PLACE, values, n, MPI_DOUBLE_PRECISION, MPI_SUM, self%comm)
   end subroutine add_up

   !> Replaces the values on each rank by those of all ranks, in the order of ranks; collective.
   subroutine join(self, values)
      class(world_type), intent(in) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: joined(:)
      integer :: n(0:self%n_ranks - 1), rank

      n = 0
      n(self%rank) = size(values)
      call MPI_Allreduce(MPI_IN_PLACE, n, self%n_ranks, MPI_INTEGER, MPI_SUM, self%comm)
      allocate (joined(sum(n)))
      call MPI_Allgatherv(values(:), size(values), MPI_DOUBLE_PRECISION, joined(:), n, &
                          [(sum(n(:rank - 1)), rank=0, self%n_ranks - 1)], MPI_DOUBLE_PRECISION, &
                          self%comm)
      call move_alloc(joined, values)
   end subroutine join

   !> Largest value over the ranks; collective.
   integer function maximum(self, value) result(largest)
      class(world_type), intent(in) :: self
      integer, intent(in) :: value

      call MPI_Allreduce(value, largest, 1, MPI_INTEGER, MPI_MAX, self%comm)
   end function maximum

   !> Copies integers from the root, or from a rank `from`, to all ranks; collective.
   subroutine broadcast_integers(self, values, from)
      class(world_type), intent(in) :: self
      integer, allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: from
      real(wp), allocatable :: column(:, :)   ! exact

      if (allocated(values)) column = reshape(real(values, wp), [size(values), 1])
      call self%broadcast(column, from)
      values = nint(column(:, 1))
   end subroutine broadcast_integers

   !> Copies a matrix from the root, or from a rank `from`, to all ranks, unallocated if it is so
   !> there; collective.
   subroutine broadcast_matrix(self, values, from)
      class(world_type), intent(in) :: self
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in), optional :: from
      integer :: extent(2), source

      source = 0
      if (present(from)) source = from
      extent = -1
      if (allocated(values)) extent = shape(values)
      call MPI_Bcast(extent, 2, MPI_INTEGER, source, self%comm)
      if (self%rank /= source .and. allocated(values)) deallocate (values)
      if (extent(1) < 0) return
      if (self%rank /= source) allocate (values(extent(1), extent(2)))
      ! a section, because MPICH gives an array bounds from 0 in calls compiled by gfortran 11
      call MPI_Bcast(values(:, :), size(values), MPI_DOUBLE_PRECISION, source, self%comm)
   end subroutine broadcast_matrix

end module parallel_world
