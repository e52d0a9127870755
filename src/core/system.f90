!> Calls of libc for errors, signals, streams, links, environment variables and libraries.
module core_system
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_funptr, c_int, c_long, c_ptr, &
                                                                             c_size_t
   use core_error, only: error_type, exit_file, raise
   implicit none(type, external)
   private
   public :: c_dlsym, c_fopen, c_readlink, c_setenv, c_signal, raise_system, system_error, &
             system_text, text_at

   interface
      function c_strlen(text) result(length) bind(c, name='strlen')
         import :: c_ptr, c_size_t
         type(c_ptr), value :: text
         integer(c_size_t) :: length
      end function c_strlen

      function c_strerror(number) result(text) bind(c, name='strerror')
         import :: c_int, c_ptr
         integer(c_int), value :: number
         type(c_ptr) :: text
      end function c_strerror

      function c_errno_location() result(location) bind(c, name='__errno_location')
         import :: c_ptr
         type(c_ptr) :: location
      end function c_errno_location

      function c_setenv(name, value, overwrite) result(status) bind(c, name='setenv')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: name(*), value(*)
         integer(c_int), value :: overwrite
         integer(c_int) :: status
      end function c_setenv

      function c_fopen(path, mode) result(stream) bind(c, name='fopen')
         import :: c_char, c_ptr
         character(kind=c_char), intent(in) :: path(*), mode(*)
         type(c_ptr) :: stream
      end function c_fopen

      !> Length of the target of a symbolic link; -1 if the path is not a link.
      function c_readlink(path, target, most) result(length) bind(c, name='readlink')
         import :: c_char, c_long, c_size_t
         character(kind=c_char), intent(in) :: path(*)
         character(kind=c_char), intent(out) :: target(*)
         integer(c_size_t), value :: most
         integer(c_long) :: length
      end function c_readlink

      !> Address of a procedure; null if no library has it.
      function c_dlsym(library, name) result(address) bind(c, name='dlsym')
         import :: c_char, c_funptr, c_ptr
         type(c_ptr), value :: library   !! null: all libraries that this process has loaded
         character(kind=c_char), intent(in) :: name(*)
         type(c_funptr) :: address
      end function c_dlsym

      !> Sets the action of a signal.
      function c_signal(number, handler) result(previous) bind(c, name='signal')
         import :: c_funptr, c_int
         integer(c_int), value :: number
         type(c_funptr), value :: handler
         type(c_funptr) :: previous
      end function c_signal
   end interface

contains

   !> Error number of the call that has just failed (errno).
   function system_error() result(number)
      integer(c_int) :: number
      integer(c_int), pointer :: errno

      call c_f_pointer(c_errno_location(), errno)
      number = errno
   end function system_error

   !> System's message for an error number.
   function system_text(number) result(text)
      integer(c_int), intent(in) :: number   !! from `system_error`
      character(:), allocatable :: text

      text = text_at(c_strerror(number))
   end function system_text

   !> Raises exit_file with a message and the system's message for an error number.
   subroutine raise_system(number, message, error)
      integer(c_int), intent(in) :: number   !! from `system_error`
      character(*), intent(in) :: message
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, message//': '//system_text(number))
   end subroutine raise_system

   !> Text of a C string.
   function text_at(location) result(text)
      type(c_ptr), intent(in) :: location
      character(:), allocatable :: text
      character(kind=c_char), pointer :: characters(:)
      integer :: i

      call c_f_pointer(location, characters, [c_strlen(location)])
      allocate (character(size(characters)) :: text)
      do i = 1, size(characters)
         text(i:i) = characters(i)
      end do
   end function text_at

end module core_system
