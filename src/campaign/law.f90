!> Draws of the law of a case's friction values.
module campaign_law
   use campaign_pooling, only: plan_draws
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use process_model, only: process_model_type, request_label
   use process_realization, only: chains_of, draw_chains, draw_points
   implicit none(type, external)
   private
   public :: draw_law

   real(wp), parameter :: share_of_windows = 0.8_wp   !! independent draws in a window

contains

   !> Draws windows of long realizations, or each from a stream of its own; fewer where fewer are
   !> wanted.
   subroutine draw_law(seed, model, points, draws, n_independent, at_most)
      integer(long), intent(in) :: seed
      type(process_model_type), intent(in) :: model
      integer, intent(in) :: points(:)                    !! of the process, ascending
      real(wp), allocatable, intent(out) :: draws(:, :)   !! (draw, point)
      real(wp), intent(out) :: n_independent              !! draws that all windows are worth
      integer, intent(in), optional :: at_most            !! windows
      type(stream_type) :: stream
      real(wp), allocatable :: chains(:, :), values(:)
      integer(long) :: label
      integer :: i, n, n_chains, stride

      label = label_of(request_label(model%request), label_of('law'))
      call plan_draws(points(size(points)), model%request%sampler == 'exact', model%l0, n, stride)
      n_independent = share_of_windows*n
      if (present(at_most)) n = min(n, at_most)
      allocate (draws(n, size(points)))
      if (stride == 0) then
         allocate (values(points(size(points))))
         do i = 1, n
            stream = new_stream(seed, label, i)
            call draw_points(model, stream, values)
            draws(i, :) = values(points)
         end do
      else
         n_chains = chains_of(model)
         allocate (chains(n_chains, stride*((n - 1)/n_chains + 1)))
         stream = new_stream(seed, label, 0)
         call draw_chains(model, stream, chains)
         do i = 1, n
            draws(i, :) = chains(1 + modulo(i - 1, n_chains), ((i - 1)/n_chains)*stride + points)
         end do
      end if
   end subroutine draw_law

end module campaign_law
