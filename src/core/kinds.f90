!> Kinds of numbers, the same in every room.
module core_kinds
   use, intrinsic :: iso_fortran_env, only: int64, real64
   implicit none(type, external)
   private
   public :: wp, long

   integer, parameter :: wp = real64     !! every real
   integer, parameter :: long = int64    !! counts that can exceed 2**31, words of random streams

end module core_kinds
