!> The bootstrap over samples: samples drawn again, and order statistics of them.
module campaign_bootstrap
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   implicit none(type, external)
   private
   public :: draw_again, find_again

contains

   !> Finds the values at a rank among samples drawn again, all replicates side by side: sample
   !> ranking(i) is drawn times(b, ranking(i)) times in replicate b. Counts from the nearer end: few
   !> steps for an outer percentile.
   pure subroutine find_again(sorted, ranking, times, rank, values)
      real(wp), intent(in) :: sorted(:), rank
      integer, intent(in) :: ranking(:), times(:, :)
      real(wp), intent(out) :: values(:)   !! (replicate)
      integer :: count(size(values))       ! samples from the end up to here
      integer :: place(size(values)), next(size(values))   ! from the end, of the order statistics
      integer :: b, below, from_end, i, n, needed
      logical :: is_low

      n = size(sorted)
      below = min(int(rank), n - 1)
      is_low = 2*below <= n
      needed = merge(below, n - below, is_low)
      count = 0
      place = 1
      next = 1
      from_end = 0
      do while (minval(count) <= needed)
         from_end = from_end + 1
         i = merge(from_end, n + 1 - from_end, is_low)
         associate (here => times(:, ranking(i)))
            do b = 1, size(values)
               count(b) = count(b) + here(b)
               place(b) = place(b) + merge(1, 0, count(b) < needed)
               next(b) = next(b) + merge(1, 0, count(b) <= needed)
            end do
         end associate
      end do
      do b = 1, size(values)
         associate (low => merge(place(b), n + 1 - next(b), is_low), &
                    high => merge(next(b), n + 1 - place(b), is_low))
            values(b) = sorted(low) + (rank - below)*(sorted(high) - sorted(low))
         end associate
      end do
   end subroutine find_again

   !> Draws bootstrap replicates: as many samples, with replacement, as there are, given as counts.
   pure subroutine draw_again(seed, n_before, times)
      integer(long), intent(in) :: seed
      integer, intent(in) :: n_before       !! replicates of the groups before
      integer, intent(out) :: times(:, :)   !! (replicate, sample)
      type(stream_type) :: stream
      real(wp) :: u(size(times, 2))
      integer :: b, i, drawn, n

      n = size(times, 2)
      times = 0
      do b = 1, size(times, 1)
         stream = new_stream(seed, label_of('bootstrap'), n_before + b)
         call stream%uniforms(u)
         do i = 1, n
            drawn = min(1 + int(u(i)*n), n)
            times(b, drawn) = times(b, drawn) + 1
         end do
      end do
   end subroutine draw_again

end module campaign_bootstrap
