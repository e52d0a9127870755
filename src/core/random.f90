!> Random streams, one for each sample, by Philox4x32-10 (Salmon et al., 2011).
!>
!> The key of a stream comes from seed and label, the upper half of its counter is the sample
!> number, the lower half the position in the stream. So a stream can start at any position at no
!> cost, and no two streams share numbers, whatever rank draws them.
module core_random
   use core_kinds, only: long, two_pi, wp
   implicit none(type, external)
   private
   public :: stream_type, new_stream, label_of, philox

   integer(long), parameter :: mask32 = int(z'FFFFFFFF', long)
   integer, parameter :: width = 64   !! values that are computed side by side

   !> Random stream; `uniforms` and `normals` draw its next numbers.
   type :: stream_type
      private
      integer(long) :: key(2) = 0      !! words of 32 bits
      integer(long) :: sample(2) = 0   !! words of 32 bits: upper half of the counter
      integer(long) :: position = 0    !! lower half of the counter: Philox blocks already used
      real(wp), allocatable :: kept(:)   !! first numbers of the stream, see `restart`
   contains
      procedure :: restart
      procedure :: uniforms
      procedure :: normals
   end type stream_type

   !> Label of a stream: a hash of a text, to which values are added one by one, as in
   !> label = label_of(label, x).
   interface label_of
      module procedure label_of_text, label_with_long, label_with_integer, label_with_real
   end interface label_of

contains

   !> Stream of a seed, a label and a sample.
   pure function new_stream(seed, label, sample) result(stream)
      integer(long), intent(in) :: seed
      integer(long), intent(in) :: label   !! result of label_of
      integer, intent(in) :: sample        !! number from 1; 0 for all samples
      type(stream_type) :: stream
      integer(long) :: key

      key = label_of(label, seed)
      stream%key = words_of(key)
      stream%sample = words_of(int(sample, long))
   end function new_stream

   !> Moves to the beginning of the stream, whose first n numbers are kept and not computed again.
   pure subroutine restart(self, n)
      class(stream_type), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), allocatable :: first(:)

      self%position = 0
      if (allocated(self%kept)) then
         if (size(self%kept) >= n) return
         deallocate (self%kept)
      end if
      allocate (first(n))
      call self%uniforms(first)
      call move_alloc(first, self%kept)
      self%position = 0
   end subroutine restart

   !> Draws the next numbers, uniform on the open interval (0, 1), 53 bits each. Two numbers share a
   !> Philox block; an odd request leaves the second one unused.
   pure subroutine uniforms(self, values)
      class(stream_type), intent(inout) :: self
      real(wp), intent(out) :: values(:)
      real(wp), parameter :: unit = 2.0_wp**(-53)
      integer(long) :: counter(width/2, 4), word(width/2, 4)
      real(wp) :: block(width)
      integer :: first, last, i

      if (allocated(self%kept)) then
         associate (n_used => 2*self%position, n => size(values))
            if (n_used + n <= size(self%kept)) then
               values = self%kept(n_used + 1:n_used + n)
               self%position = self%position + (n + 1)/2
               return
            end if
         end associate
      end if
      do first = 1, size(values), width
         last = min(first + width - 1, size(values))
         do i = 1, width/2
            counter(i, 1) = iand(self%position + i - 1, mask32)
            counter(i, 2) = ishft(self%position + i - 1, -32)
            counter(i, 3:4) = self%sample
         end do
         call philox(counter, self%key, word)
         do i = 1, width/2
            block(2*i - 1) = (real(upper_53(word(i, 1), word(i, 2)), wp) + 0.5_wp)*unit
            block(2*i) = (real(upper_53(word(i, 3), word(i, 4)), wp) + 0.5_wp)*unit
         end do
         values(first:last) = block(:last - first + 1)
         self%position = self%position + (last - first + 2)/2
      end do
   end subroutine uniforms

   !> Draws the next numbers, standard normal (Box and Muller; pairs share two uniforms).
   pure subroutine normals(self, values)
      class(stream_type), intent(inout) :: self
      real(wp), intent(out) :: values(:)
      real(wp) :: u(width), z(width), radius(width/2), angle(width/2)
      integer :: first, last

      do first = 1, size(values), width
         last = min(first + width - 1, size(values))
         u = 0.5_wp
         call self%uniforms(u(:2*((last - first + 2)/2)))
         radius = sqrt(-2.0_wp*log(u(1::2)))
         angle = two_pi*u(2::2)
         z(1::2) = radius*cos(angle)
         z(2::2) = radius*sin(angle)
         values(first:last) = z(:last - first + 1)
      end do
   end subroutine normals

   !> Applies Philox4x32-10 to several counters at once; each word holds 32 bits.
   pure subroutine philox(counter, key, word)
      integer(long), intent(in) :: counter(:, :)   !! (block, word 1..4)
      integer(long), intent(in) :: key(2)
      integer(long), intent(out) :: word(:, :)     !! (block, word 1..4)
      integer(long), parameter :: weyl(2) = [int(z'9E3779B9', long), int(z'BB67AE85', long)]
      integer(long), parameter :: multiplier(2) = [int(z'D2511F53', long), int(z'CD9E8D57', long)]
      integer(long) :: k(2), high1, low1, high2, low2
      integer :: i, round

      word = counter
      k = key
      do round = 1, 10
         !$omp simd private(high1, low1, high2, low2)
         do i = 1, size(word, 1)
            call multiply(multiplier(1), word(i, 1), high1, low1)
            call multiply(multiplier(2), word(i, 3), high2, low2)
            word(i, 1) = ieor(ieor(high2, word(i, 2)), k(1))
            word(i, 3) = ieor(ieor(high1, word(i, 4)), k(2))
            word(i, 2) = low2
            word(i, 4) = low1
         end do
         k = iand(k + weyl, mask32)
      end do
   end subroutine philox

   !> Multiplies two numbers of 32 bits; finds the upper and lower 32 bits of the product.
   pure subroutine multiply(a, b, high, low)
      integer(long), intent(in) :: a, b
      integer(long), intent(out) :: high, low
      integer(long) :: lower, upper

      lower = iand(a, 65535_long)*b
      upper = ishft(a, -16)*b + ishft(lower, -16)
      high = ishft(upper, -16)
      low = ior(ishft(iand(upper, 65535_long), 16), iand(lower, 65535_long))
   end subroutine multiply

   !> Upper 53 of the 64 bits of two words.
   elemental function upper_53(high, low) result(bits)
      integer(long), intent(in) :: high, low
      integer(long) :: bits

      bits = ishft(high, 21) + ishft(low, -11)
   end function upper_53

   !> Lower and upper 32 bits.
   pure function words_of(value) result(words)
      integer(long), intent(in) :: value
      integer(long) :: words(2)

      words = [iand(value, mask32), ishft(value, -32)]
   end function words_of

   !> Hash of label and value: 64 of the 128 bits of their Philox block under a fixed key.
   pure function label_with_long(label, value) result(mixed)
      integer(long), intent(in) :: label, value
      integer(long) :: mixed
      integer(long), parameter :: key(2) = [int(z'656E7472', long), int(z'6F736C70', long)]
      integer(long) :: word(1, 4)

      call philox(reshape([words_of(label), words_of(value)], [1, 4]), key, word)
      mixed = ior(ishft(word(1, 1), 32), word(1, 2))
   end function label_with_long

   !> Hash of label and value.
   pure function label_with_integer(label, value) result(mixed)
      integer(long), intent(in) :: label
      integer, intent(in) :: value
      integer(long) :: mixed

      mixed = label_with_long(label, int(value, long))
   end function label_with_integer

   !> Hash of label and the bits of a value, 0.0 for -0.0.
   pure function label_with_real(label, value) result(mixed)
      integer(long), intent(in) :: label
      real(wp), intent(in) :: value
      integer(long) :: mixed

      mixed = label_with_long(label, transfer(value + 0.0_wp, 0_long))
   end function label_with_real

   !> Hash of a text.
   pure function label_of_text(text) result(label)
      character(*), intent(in) :: text
      integer(long) :: label
      integer :: i

      label = len(text)
      do i = 1, len(text)
         label = label_with_long(label, int(iachar(text(i:i)), long))
      end do
   end function label_of_text

end module core_random
