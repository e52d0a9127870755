!> A fingerprint of numbers and texts, by which damage to a file is seen.
module io_checksum
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc, c_ptr
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: checksum_type

   integer(long), parameter :: half = 2_long**32 - 1      !! mask of 32 bits
   integer(long), parameter :: modulus = 2_long**32 - 5   !! prime
   integer, parameter :: stride = 2**14   !! words between two divisions: the sums stay below 2**62

   !> Fletcher's two running sums over halves of words: a flipped bit and an exchange of two halves
   !> are always seen, anything else slips through with a chance of 2**-64.
   type :: checksum_type
      private
      integer(long) :: plain = 1      !! sum of what was added
      integer(long) :: weighted = 0   !! sum of the plain sums
   contains
      generic :: add => add_reals, add_longs, add_integers, add_text
      procedure :: value => value_of
      procedure, private :: add_reals, add_longs, add_integers, add_text, add_words
   end type checksum_type

contains

   pure function value_of(self) result(value)
      class(checksum_type), intent(in) :: self
      integer(long) :: value

      value = ior(ishft(self%weighted, 32), self%plain)
   end function value_of

   !> Adds real values of any rank by their bits.
   subroutine add_reals(self, values)
      class(checksum_type), intent(inout) :: self
      real(wp), intent(in), target, contiguous :: values(..)

      if (size(values) > 0) call self%add_words(c_loc(values), size(values, kind=long))
   end subroutine add_reals

   subroutine add_longs(self, values)
      class(checksum_type), intent(inout) :: self
      integer(long), intent(in), target, contiguous :: values(..)

      if (size(values) > 0) call self%add_words(c_loc(values), size(values, kind=long))
   end subroutine add_longs

   subroutine add_integers(self, values)
      class(checksum_type), intent(inout) :: self
      integer, intent(in) :: values(:)

      call self%add(int(values, long))
   end subroutine add_integers

   subroutine add_text(self, text)
      class(checksum_type), intent(inout) :: self
      character(*), intent(in) :: text
      integer :: i

      call self%add([len(text), (iachar(text(i:i)), i=1, len(text))])
   end subroutine add_text

   subroutine add_words(self, location, n_words)
      class(checksum_type), intent(inout) :: self
      type(c_ptr), intent(in) :: location
      integer(long), intent(in) :: n_words
      integer(long), pointer :: words(:)
      integer(long) :: first, i, plain, weighted

      call c_f_pointer(location, words, [n_words])
      plain = self%plain
      weighted = self%weighted
      do first = 1, n_words, stride
         do i = first, min(first + stride - 1, n_words)
            plain = plain + iand(words(i), half)
            weighted = weighted + plain
            plain = plain + ishft(words(i), -32)
            weighted = weighted + plain
         end do
         plain = mod(plain, modulus)
         weighted = mod(weighted, modulus)
      end do
      self%plain = plain
      self%weighted = weighted
   end subroutine add_words

end module io_checksum
