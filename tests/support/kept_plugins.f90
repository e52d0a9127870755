!> dlclose, in place of the C library's, for tests under LeakSanitizer: Open MPI leaks from plugins
!> that it unloads, and only of those that stay can the leak be told from ours.
function keep_plugin(handle) result(status) bind(c, name='dlclose')
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   implicit none(type, external)
   type(c_ptr), value :: handle
   integer(c_int) :: status

   status = merge(0_c_int, 1_c_int, c_associated(handle))
end function keep_plugin
