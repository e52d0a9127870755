!> Which samples march when: each at its own pace, by strides as long as may be, or held up by its
!> transitions.
module dynamics_schedule
   use dynamics_propagator, only: levels, stride_of
   implicit none(type, external)
   private
   public :: schedule_type, sort_out, waiting, crowded
   public :: book_size, of_pattern, of_place, of_position, of_last, of_due, of_phase, of_level, &
             of_suspects

   !> What each sample is doing, side by side: entries of book(:, sample). Positions are those in
   !> the force, taken as one long array.
   integer, parameter :: of_pattern = 1    !! of stuck masses
   integer, parameter :: of_place = 2      !! 0 or 1: where its state is
   integer, parameter :: of_position = 3   !! of the next step
   integer, parameter :: of_last = 4       !! position after the last step
   integer, parameter :: of_due = 5        !! of the next record; -1: none
   integer, parameter :: of_phase = 6      !! strides begin a multiple of them after this one
   integer, parameter :: of_level = 7      !! of the stretch that was not quiet
   integer, parameter :: of_suspects = 8   !! bit i-1: the guard of mass i may have been crossed
   integer, parameter :: book_size = 8

   !> Lists where a sample can stand: free to go on by a stride of some level (1 .. levels), waiting
   !> for its transitions to be located, or crowded with them.
   integer, parameter :: waiting = levels + 1, crowded = levels + 2

   !> What each sample is doing.
   type :: schedule_type
      integer :: level = 1                 !! of the longest stride between the records to be made
      integer, allocatable :: book(:, :)   !! (book_size, sample)
      integer, allocatable :: origin(:)    !! (sample) position of the first step
      integer, allocatable :: n_records(:) !! (sample) made
      integer, allocatable :: list(:, :)   !! (entry, 1 .. crowded) samples
      integer :: n_listed(crowded) = 0
   contains
      procedure :: free
      procedure :: append
      procedure :: pop
   end type schedule_type

contains

   !> Frees a sample to go on from its position, if it is not the last one.
   pure subroutine free(self, w)
      class(schedule_type), intent(inout) :: self
      integer, intent(in) :: w
      integer :: level

      level = level_at(self%level, self%book(of_position, w), self%book(of_phase, w), &
                       self%book(of_last, w))
      if (level > 0) call self%append(w, level)
   end subroutine free

   pure subroutine append(self, w, list)
      class(schedule_type), intent(inout) :: self
      integer, intent(in) :: w, list

      self%n_listed(list) = self%n_listed(list) + 1
      self%list(self%n_listed(list), list) = w
   end subroutine append

   !> Takes up to so many entries from the front of a list.
   pure subroutine pop(self, list, most, entry, m)
      class(schedule_type), intent(inout) :: self
      integer, intent(in) :: list, most
      integer, intent(out) :: entry(most), m

      associate (n => self%n_listed(list))
         m = min(most, n)
         entry(:m) = self%list(:m, list)
         self%list(:n - m, list) = self%list(m + 1:n, list)
         n = n - m
      end associate
   end subroutine pop

   !> Sorts samples that have taken a stretch into those that go on likewise, those that stop to do
   !> so (by -w if the stretch was not quiet), and those that must make a record: without a branch,
   !> as one that goes wrong throws away what the processor has already begun. A quiet stretch
   !> counts; otherwise the state is as it was.
   pure subroutine sort_out(n_tried, tried, suspects, level, longest, n_samples, book, n_going, &
                            going, n_stopping, stopping, n_due, due)
      integer, intent(in) :: n_tried, tried(n_tried), suspects(n_tried)
      integer, intent(in) :: level     !! of the stretch
      integer, intent(in) :: longest   !! level of the longest stride
      integer, intent(in) :: n_samples
      integer, intent(inout) :: book(book_size, n_samples)
      integer, intent(out) :: n_going, n_stopping, n_due
      integer, intent(out) :: going(n_samples + 1), stopping(n_samples + 1), due(n_samples + 1)
      integer :: a, goes, is_quiet, now, stride, w

      stride = stride_of(level)
      n_going = 0
      n_stopping = 0
      n_due = 0
      do a = 1, n_tried
         w = tried(a)
         is_quiet = merge(1, 0, suspects(a) == 0)
         now = book(of_position, w) + stride*is_quiet
         book(of_position, w) = now
         book(of_suspects, w) = suspects(a)
         book(of_place, w) = ieor(book(of_place, w), is_quiet)
         goes = is_quiet*(1 - min(1, abs(level - level_at(longest, now, book(of_phase, w), &
                                                              book(of_last, w)))))
         going(n_going + 1) = w
         n_going = n_going + goes
         stopping(n_stopping + 1) = merge(w, -w, is_quiet == 1)
         n_stopping = n_stopping + (1 - goes)
         due(n_due + 1) = w
         n_due = n_due + is_quiet*(1 - min(1, abs(now - book(of_due, w))))
      end do
   end subroutine sort_out

   !> The level of the longest stride that a sample may take from its position: no longer than the
   !> longest one, in phase, and not past its last step; 0: it is there.
   elemental function level_at(longest, position, phase, last) result(level)
      integer, intent(in) :: longest, position, phase, last
      integer :: level

      level = min(longest, 1 + trailz(position - phase), bit_size(last) - leadz(last - position))
   end function level_at

end module dynamics_schedule
