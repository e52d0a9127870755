!> Random numbers that every trial of a search shares: drawn once, then read.
module process_positive_numbers
   use core_kinds, only: wp
   use core_random, only: stream_type
   implicit none(type, external)
   private
   public :: shared_numbers, new_shared_numbers

   integer, parameter :: most_kept = 2**22   !! values, 32 MB; longer trials draw their own

   !> A stream that begins again with each `rewind`.
   type, extends(stream_type) :: shared_numbers
      type(stream_type) :: origin
      real(wp), allocatable, private :: kept(:)   !! the first numbers of the stream
      integer, private :: n_read = 0
      logical, private :: is_kept = .false.       !! the trial reads `kept`, else it draws
   contains
      procedure :: rewind => rewind_numbers
      procedure :: uniforms => next_numbers
   end type shared_numbers

contains

   !> Numbers of which none has been read.
   pure function new_shared_numbers(stream) result(numbers)
      type(stream_type), intent(in) :: stream   !! where every trial begins
      type(shared_numbers) :: numbers

      numbers%origin = stream
   end function new_shared_numbers

   !> Back to the first number, for a trial that reads this many.
   pure subroutine rewind_numbers(self, n_values)
      class(shared_numbers), intent(inout) :: self
      real(wp), intent(in) :: n_values
      integer :: n_kept

      self%stream_type = self%origin
      self%n_read = 0
      self%is_kept = n_values <= most_kept
      if (.not. self%is_kept) return
      n_kept = 0
      if (allocated(self%kept)) n_kept = size(self%kept)
      if (n_kept >= n_values) return
      if (allocated(self%kept)) deallocate (self%kept)
      allocate (self%kept(ceiling(n_values)))
      call self%stream_type%uniforms(self%kept)
   end subroutine rewind_numbers

   !> Both ways give the same numbers where each request is even.
   pure subroutine next_numbers(self, values)
      class(shared_numbers), intent(inout) :: self
      real(wp), intent(out) :: values(:)

      if (self%is_kept) then
         values = self%kept(self%n_read + 1:self%n_read + size(values))
         self%n_read = self%n_read + size(values)
      else
         call self%stream_type%uniforms(values)
      end if
   end subroutine next_numbers

end module process_positive_numbers
