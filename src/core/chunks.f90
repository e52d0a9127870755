!> Chunks of datasets, in which HDF5 stores arrays: their extents, and the disk space of an array.
module core_chunks
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: chunk_of, frequencies_together, stored_bytes

   integer(long), parameter :: chunk_bytes = 2_long**18   !! largest size of a chunk
   integer(long), parameter :: word_bytes = 8             !! size of a number

contains

   !> Extents of a chunk in Fortran's order: whole axes, the fastest first, until the chunk is full.
   !> An axis that does not fit is cut evenly, because its last chunk takes as much space as the
   !> others.
   pure function chunk_of(extents) result(chunk)
      integer(long), intent(in) :: extents(:)   !! positive
      integer(long) :: chunk(size(extents))
      integer(long) :: most, n_chunks
      integer :: axis

      chunk = extents
      do axis = size(extents), 1, -1
         most = max(1_long, chunk_bytes/(word_bytes*product(chunk(:axis - 1))))
         n_chunks = (extents(axis) - 1)/most + 1
         chunk(axis) = (extents(axis) - 1)/n_chunks + 1
      end do
   end function chunk_of

   !> Disk space of an array of reals [byte]: all its chunks, each of full size.
   pure function stored_bytes(extents) result(bytes)
      integer, intent(in) :: extents(:)
      real(wp) :: bytes
      integer(long) :: chunk(size(extents))

      bytes = 0.0_wp
      if (any(extents < 1)) return
      chunk = chunk_of(int(extents, long))
      bytes = word_bytes*product(real(chunk*((extents - 1)/chunk + 1), wp))
   end function stored_bytes

   !> Number of frequencies in a range that a shard stores together: equal ranges of some 320 values
   !> of each sample.
   pure function frequencies_together(n_dof, n_frequencies) result(n)
      integer, intent(in) :: n_dof, n_frequencies
      integer :: n
      integer, parameter :: values_together = 320
      integer :: n_ranges

      n_ranges = (n_frequencies - 1)/max(values_together/n_dof, 1) + 1
      n = (n_frequencies - 1)/n_ranges + 1
   end function frequencies_together

end module core_chunks
