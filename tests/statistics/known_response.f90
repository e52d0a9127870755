!> A response whose statistics over a known law are known: friction values are squares of
!> independent normal values about 3, so inputs are normal, and y = exp(slope.x) is lognormal.
module known_response
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   implicit none(type, external)
   private
   public :: draw_values, log_response, n_inputs, slope

   integer, parameter :: n_inputs = 3
   real(wp), parameter :: slope(n_inputs) = [0.5_wp, 0.2_wp, 0.1_wp]
   real(wp), parameter :: centre = 3.0_wp, scatter = 0.5_wp   !! centre and scatter of the roots

contains

   !> (draw, input) friction values; the roots are normal.
   function draw_values(n, number) result(values)
      integer, intent(in) :: n, number
      real(wp) :: values(n, n_inputs)
      type(stream_type) :: stream
      integer :: j

      stream = new_stream(5_long, label_of('known_response'), number)
      do j = 1, n_inputs
         call stream%normals(values(:, j))
      end do
      values = (centre + scatter*values)**2
   end function draw_values

   !> ln y of friction values: normal, mean 0.
   pure function log_response(values) result(logarithm)
      real(wp), intent(in) :: values(:, :)
      real(wp) :: logarithm(size(values, 1))

      logarithm = matmul((sqrt(values) - centre)/scatter, slope)
   end function log_response

end module known_response
