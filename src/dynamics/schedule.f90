!> Which samples march when: each at its own pace, by long strides or by single steps, or held up by
!> its transitions.
module dynamics_schedule
   implicit none(type, external)
   private
   public :: schedule_type, sort_out, far, near, waiting, crowded
   public :: book_size, of_pattern, of_place, of_position, of_last, of_due, of_phase, of_taken

   !> What each sample is doing, side by side: entries of book(:, sample). Positions are those in
   !> the force, taken as one long array.
   integer, parameter :: of_pattern = 1    !! of stuck masses
   integer, parameter :: of_place = 2      !! 0 or 1: where its state is
   integer, parameter :: of_position = 3   !! of the next step
   integer, parameter :: of_last = 4       !! position after the last step
   integer, parameter :: of_due = 5        !! of the next record; -1: none
   integer, parameter :: of_phase = 6      !! long strides begin a multiple of them after this one
   integer, parameter :: of_taken = 7      !! steps of the stretch that was tried last
   integer, parameter :: book_size = 8

   !> Where a sample can stand: free to go on in long strides or by a single step, waiting for its
   !> transition to be located, or crowded with transitions.
   integer, parameter :: far = 1, near = 2, waiting = 3, crowded = 4

   !> What each sample is doing.
   type :: schedule_type
      integer :: stride = 1                !! most steps at once between the records to be made
      integer, allocatable :: book(:, :)   !! (book_size, sample)
      integer, allocatable :: origin(:)    !! (sample) position of the first step
      integer, allocatable :: n_records(:) !! (sample) made
      integer, allocatable :: list(:, :)   !! (entry, far .. crowded) samples
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
      integer :: is_far, is_near

      associate (book => self%book(:, w))
         call find_standing(self%stride, book(of_position), book(of_phase), book(of_last), is_far, &
                            is_near)
      end associate
      if (is_far + is_near > 0) call self%append(w, merge(far, near, is_far == 1))
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

   !> Sorts samples that have taken a stretch, without a branch: a branch that goes wrong throws
   !> away what the processor has already begun. A quiet stretch counts, and may lead to a record;
   !> otherwise the state is as it was.
   pure subroutine sort_out(n_tried, tried, is_quiet, stride, to_near, longest, n_samples, book, &
                            n_listed, list, n_due, due)
      integer, intent(in) :: n_tried, tried(n_tried), is_quiet(n_tried), stride
      integer, intent(in) :: to_near   !! 1: those whose stretch was not quiet go on by single steps
      integer, intent(in) :: longest   !! most steps at once
      integer, intent(in) :: n_samples
      integer, intent(inout) :: book(book_size, n_samples)
      integer, intent(inout) :: n_listed(crowded), list(n_samples + 1, crowded)
      integer, intent(out) :: n_due, due(n_samples)
      integer :: a, is_far, is_near, is_over, now, n_far, n_near, n_waiting, w

      n_far = n_listed(far)
      n_near = n_listed(near)
      n_waiting = n_listed(waiting)
      n_due = 0
      do a = 1, n_tried
         w = tried(a)
         now = book(of_position, w) + stride*is_quiet(a)
         book(of_position, w) = now
         book(of_taken, w) = stride
         book(of_place, w) = ieor(book(of_place, w), is_quiet(a))
         call find_standing(longest, now, book(of_phase, w), book(of_last, w), is_far, is_near)
         is_far = is_quiet(a)*is_far
         is_over = 1 - is_quiet(a)
         is_near = is_quiet(a)*is_near + is_over*to_near
         list(n_far + 1, far) = w
         n_far = n_far + is_far
         list(n_near + 1, near) = w
         n_near = n_near + is_near
         list(n_waiting + 1, waiting) = w
         n_waiting = n_waiting + is_over*(1 - to_near)
         due(n_due + 1) = w
         n_due = n_due + is_quiet(a)*(1 - min(1, abs(now - book(of_due, w))))
      end do
      n_listed(far) = n_far
      n_listed(near) = n_near
      n_listed(waiting) = n_waiting
   end subroutine sort_out

   !> How a sample may go on from its position: in long strides (is_far 1), by a single step
   !> (is_near 1), or not at all.
   elemental subroutine find_standing(stride, position, phase, last, is_far, is_near)
      integer, intent(in) :: stride   !! most steps at once, a power of two
      integer, intent(in) :: position, phase, last
      integer, intent(out) :: is_far, is_near   !! 1 or 0
      integer :: fits, is_in_phase

      is_in_phase = 1 - min(1, iand(position - phase, stride - 1))
      fits = 1 - shiftr(last - position - stride, bit_size(stride) - 1)
      is_far = is_in_phase*fits
      is_near = (1 - is_far)*min(1, last - position)
   end subroutine find_standing

end module dynamics_schedule
