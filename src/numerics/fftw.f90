!> Fourier transforms of real signals by FFTW; no other module calls it.
!>
!> Plans are made with FFTW_ESTIMATE, without measurements, so that the same length gives the same
!> bits in every run on a machine.
module numerics_fftw
   use, intrinsic :: iso_c_binding
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: fftw_library, good_fft_length, real_fft

   include 'fftw3.f03'

   interface
      subroutine c_free(memory) bind(c, name='free')
         import :: c_ptr
         type(c_ptr), value :: memory
      end subroutine c_free
   end interface

   !> Plan and aligned arrays of a transform, freed with the variable; it must not be copied. A
   !> forward transform is spectrum(k) = sum over j of signal(j) exp(-2 pi i j k/n), and keeps the
   !> signal; an inverse one is signal(j) = sum over all k of spectrum(k) exp(2 pi i j k/n), not
   !> divided by n, and destroys the spectrum.
   type :: real_fft
      integer :: n = 0                                              !! signal length; 0: no plan
      real(wp), pointer, contiguous :: signal(:) => null()          !! (0:n-1)
      complex(wp), pointer, contiguous :: spectrum(:) => null()     !! (0:n/2), without conjugates
      logical, private :: is_inverse = .false.
      type(c_ptr), private :: plan = c_null_ptr
      type(c_ptr), private :: signal_memory = c_null_ptr
      type(c_ptr), private :: spectrum_memory = c_null_ptr
   contains
      procedure :: prepare
      procedure :: execute
      final :: release
   end type real_fft

contains

   !> Version of the FFTW library, from its exported wisdom, which begins '(fftw-3.3.10 '.
   function fftw_library() result(text)
      character(:), allocatable :: text
      integer, parameter :: prefix = len('(fftw-'), longest = 40
      character(kind=c_char), pointer :: letters(:)
      type(c_ptr) :: wisdom
      integer :: i

      text = ''
      wisdom = fftw_export_wisdom_to_string()
      if (.not. c_associated(wisdom)) return
      call c_f_pointer(wisdom, letters, [longest])
      do i = prefix + 1, longest
         if (letters(i) == ' ' .or. letters(i) == c_null_char) exit
         text = text//letters(i)
      end do
      call c_free(wisdom)
   end function fftw_library

   !> Smallest even length of at least n that has no prime factors but 2, 3, 5 and 7.
   pure function good_fft_length(n) result(length)
      integer, intent(in) :: n
      integer :: length
      integer, parameter :: factors(4) = [2, 3, 5, 7]
      integer :: i, rest

      length = max(n + modulo(n, 2), 2)
      do
         rest = length
         do i = 1, size(factors)
            do while (modulo(rest, factors(i)) == 0)
               rest = rest/factors(i)
            end do
         end do
         if (rest == 1) exit
         length = length + 2
      end do
   end function good_fft_length

   !> Plans forward or inverse transforms of length n and frees an earlier plan.
   subroutine prepare(self, n, is_inverse)
      class(real_fft), intent(inout) :: self
      integer, intent(in) :: n   !! positive
      logical, intent(in), optional :: is_inverse   !! absent: forward
      real(wp), pointer, contiguous :: signal(:)
      complex(wp), pointer, contiguous :: spectrum(:)

      if (n < 1) error stop 'real_fft: a length below 1'
      call release(self)
      self%n = n
      self%is_inverse = .false.
      if (present(is_inverse)) self%is_inverse = is_inverse
      self%signal_memory = fftw_alloc_real(int(n, c_size_t))
      self%spectrum_memory = fftw_alloc_complex(int(n/2 + 1, c_size_t))
      call c_f_pointer(self%signal_memory, signal, [n])
      call c_f_pointer(self%spectrum_memory, spectrum, [n/2 + 1])
      self%signal(0:n - 1) => signal
      self%spectrum(0:n/2) => spectrum
      if (self%is_inverse) then
         self%plan = fftw_plan_dft_c2r_1d(int(n, c_int), spectrum, signal, fftw_estimate)
      else
         self%plan = fftw_plan_dft_r2c_1d(int(n, c_int), signal, spectrum, fftw_estimate)
      end if
   end subroutine prepare

   !> Transforms the signal into the spectrum, or the reverse.
   subroutine execute(self)
      class(real_fft), intent(inout) :: self

      if (.not. c_associated(self%plan)) error stop 'real_fft: execute before prepare'
      if (self%is_inverse) then
         call fftw_execute_dft_c2r(self%plan, self%spectrum, self%signal)
      else
         call fftw_execute_dft_r2c(self%plan, self%signal, self%spectrum)
      end if
   end subroutine execute

   !> Frees plan and arrays, if there are any.
   subroutine release(self)
      type(real_fft), intent(inout) :: self

      if (.not. c_associated(self%plan)) return
      call fftw_destroy_plan(self%plan)
      call fftw_free(self%signal_memory)
      call fftw_free(self%spectrum_memory)
      self%plan = c_null_ptr
      nullify (self%signal, self%spectrum)
      self%n = 0
   end subroutine release

end module numerics_fftw
