!> The one door to FFTW: real transforms in buffers of their own.
!>
!> Plans are made with FFTW_ESTIMATE, without measurements, so the same length gives the same bits
!> in every run on a machine.
module numerics_fftw
   use, intrinsic :: iso_c_binding
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: forward_fft, inverse_fft, fftw_library, good_fft_length

   include 'fftw3.f03'

   interface
      subroutine c_free(memory) bind(c, name='free')
         import :: c_ptr
         type(c_ptr), value :: memory
      end subroutine c_free
   end interface

   !> Plans and aligned arrays of both directions, freed with the variable; never copy it.
   type, abstract :: real_fft
      integer :: n = 0                                              !! length of the signal, 0: none
      real(wp), pointer, contiguous :: signal(:) => null()          !! (0:n-1)
      complex(wp), pointer, contiguous :: spectrum(:) => null()     !! (0:n/2), half of it
      type(c_ptr), private :: plan = c_null_ptr
      type(c_ptr), private :: signal_memory = c_null_ptr
      type(c_ptr), private :: spectrum_memory = c_null_ptr
   contains
      procedure(prepare_transform), deferred :: prepare
      procedure(execute_transform), deferred :: execute
      procedure, private :: release, allocate_buffers
   end type real_fft

   abstract interface
      subroutine prepare_transform(self, n)
         import :: real_fft
         class(real_fft), intent(inout) :: self
         integer, intent(in) :: n
      end subroutine prepare_transform

      subroutine execute_transform(self)
         import :: real_fft
         class(real_fft), intent(inout) :: self
      end subroutine execute_transform
   end interface

   !> spectrum(k) = sum over j of signal(j) exp(-2 pi i j k/n)
   type, extends(real_fft) :: forward_fft
   contains
      procedure :: prepare => prepare_forward
      procedure :: execute => execute_forward
      final :: finish_forward
   end type forward_fft

   !> signal(j) = sum over all k of spectrum(k) exp(2 pi i j k/n), not divided by n.
   !> The spectrum is destroyed.
   type, extends(real_fft) :: inverse_fft
   contains
      procedure :: prepare => prepare_inverse
      procedure :: execute => execute_inverse
      final :: finish_inverse
   end type inverse_fft

contains

   !> Version of the library, from its wisdom, which begins '(fftw-3.3.10 '.
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

   !> The smallest even length, not below n, that is a product of 2, 3, 5 and 7.
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

   !> Plans transforms of length n and frees earlier plans.
   subroutine prepare_forward(self, n)
      class(forward_fft), intent(inout) :: self
      integer, intent(in) :: n   !! positive

      call self%allocate_buffers(n)
      self%plan = fftw_plan_dft_r2c_1d(int(n, c_int), self%signal, self%spectrum, fftw_estimate)
   end subroutine prepare_forward

   subroutine prepare_inverse(self, n)
      class(inverse_fft), intent(inout) :: self
      integer, intent(in) :: n   !! positive

      call self%allocate_buffers(n)
      self%plan = fftw_plan_dft_c2r_1d(int(n, c_int), self%spectrum, self%signal, fftw_estimate)
   end subroutine prepare_inverse

   !> Goes from signal to spectrum; the signal is kept.
   subroutine execute_forward(self)
      class(forward_fft), intent(inout) :: self

      if (.not. c_associated(self%plan)) error stop 'forward_fft: execute before prepare'
      call fftw_execute_dft_r2c(self%plan, self%signal, self%spectrum)
   end subroutine execute_forward

   !> Goes from spectrum to signal; the spectrum is destroyed.
   subroutine execute_inverse(self)
      class(inverse_fft), intent(inout) :: self

      if (.not. c_associated(self%plan)) error stop 'inverse_fft: execute before prepare'
      call fftw_execute_dft_c2r(self%plan, self%spectrum, self%signal)
   end subroutine execute_inverse

   subroutine finish_forward(self)
      type(forward_fft), intent(inout) :: self

      call self%release()
   end subroutine finish_forward

   subroutine finish_inverse(self)
      type(inverse_fft), intent(inout) :: self

      call self%release()
   end subroutine finish_inverse

   !> Allocates aligned memory for a signal of n values and its spectrum.
   subroutine allocate_buffers(self, n)
      class(real_fft), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), pointer, contiguous :: signal(:)
      complex(wp), pointer, contiguous :: spectrum(:)

      if (n < 1) error stop 'real_fft: a length below 1'
      call self%release()
      self%n = n
      self%signal_memory = fftw_alloc_real(int(n, c_size_t))
      self%spectrum_memory = fftw_alloc_complex(int(n/2 + 1, c_size_t))
      call c_f_pointer(self%signal_memory, signal, [n])
      call c_f_pointer(self%spectrum_memory, spectrum, [n/2 + 1])
      self%signal(0:n - 1) => signal
      self%spectrum(0:n/2) => spectrum
   end subroutine allocate_buffers

   !> Frees plans and buffers, if there are any.
   subroutine release(self)
      class(real_fft), intent(inout) :: self

      if (.not. c_associated(self%plan)) return
      call fftw_destroy_plan(self%plan)
      call fftw_free(self%signal_memory)
      call fftw_free(self%spectrum_memory)
      self%plan = c_null_ptr
      nullify (self%signal, self%spectrum)
      self%n = 0
   end subroutine release

end module numerics_fftw
