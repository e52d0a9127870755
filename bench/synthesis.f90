!> Processor time of a record of the force: ns a value, drawn and summed, the least of ten. The
!> paper's band of 2.5 Hz holds 4 % of the frequencies.
program synthesis
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use dynamics_excitation, only: noise_force
   implicit none(type, external)
   integer, parameter :: lengths(*) = [20000, 100000, 400000, 2000000]   ! values
   real(wp), parameter :: band(2) = [0.0_wp, 2.5_wp], dt = 0.00843_wp     ! [Hz], [s]
   integer, parameter :: repeats = 10
   type(stream_type) :: stream
   real(wp), allocatable :: force(:)
   real(wp) :: began, ended, least
   integer :: i, r

   do i = 1, size(lengths)
      allocate (force(lengths(i)))
      least = huge(least)
      do r = 1, repeats
         stream = new_stream(1_long, label_of('bench_synthesis'), r)
         call cpu_time(began)
         call noise_force(band, dt, stream, force)
         call cpu_time(ended)
         least = min(least, ended - began)
      end do
      print '(i8, a, f6.2, a)', size(force), ' values: ', 1.0e9_wp*least/size(force), ' ns a value'
      deallocate (force)
   end do
end program synthesis
