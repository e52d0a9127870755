!> Kinds of reals and integers, and pi.
module core_kinds
   use, intrinsic :: iso_fortran_env, only: int64, real64
   implicit none(type, external)
   private
   public :: wp, long, extended, pi, two_pi

   integer, parameter :: wp = real64     !! reals (working precision)
   integer, parameter :: long = int64    !! counts that can exceed 2**31, words of random streams
   integer, parameter :: extended = selected_real_kind(p=30)   !! sums whose large terms cancel

   real(wp), parameter :: pi = 4.0_wp*atan(1.0_wp), two_pi = 2*pi

end module core_kinds
