!> A block of samples on its way through a piece of the force: each at its own pace, by strides as
!> long as may be, or held up by its transitions; and what is recorded of it.
module dynamics_walk
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use core_kinds, only: long, wp
   use dynamics_course, only: course_type
   use dynamics_propagator, only: levels, stride_of, width
   use dynamics_registers, only: first_aligned
   use dynamics_response, only: block_state
   use dynamics_walker, only: walker_type
   implicit none(type, external)
   private
   public :: walk_type, start_walk, end_walk, append, pop, set_free, finish_stretch, record
   public :: sort_out, waiting, crowded

   !> Lists where a sample can stand: free to go on by a stride of some level (1 .. levels), waiting
   !> for its transitions to be located, or crowded with them.
   integer, parameter :: waiting = levels + 1, crowded = levels + 2
   !> Where every sample of the block is, and what has been recorded.
   type :: walk_type
      integer :: n_samples = 0
      real(wp) :: begin = 0.0_wp           !! steps done before
      type(course_type) :: course
      integer :: level = 1                 !! of the longest stride between the records to be made
      type(walker_type), pointer, contiguous :: walker(:) => null()   !! (sample)
      integer, allocatable :: list(:, :)   !! (entry, 1 .. crowded) samples
      integer :: n_listed(crowded) = 0
      integer, allocatable :: taken(:), suspects(:), stopping(:), due(:)   !! room for a pass
      integer, private :: spacing = 1      !! steps from record to record
      real(wp), allocatable, private :: x(:, :, :), u(:, :, :)   !! (mass, record, sample)
      real(wp), pointer, contiguous, private :: memory(:) => null()
   end type walk_type

contains

   !> All samples at the beginning, with nothing of the block taken in yet.
   subroutine start_walk(course, n_steps, begin, level, spacing, records, keeps_velocity, state, &
                         walk)
      type(course_type), intent(in) :: course
      integer, intent(in) :: n_steps
      real(wp), intent(in) :: begin
      integer, intent(in) :: level, spacing     !! of the longest stride; of records
      logical, intent(in) :: records, keeps_velocity
      type(block_state), intent(in) :: state
      type(walk_type), intent(out) :: walk
      type(walker_type) :: one
      integer :: first, n, room, w

      n = state%n_samples
      walk%n_samples = n
      walk%begin = begin
      walk%course = course
      walk%spacing = spacing
      walk%level = merge(min(level, 1 + trailz(spacing)), level, records)
      allocate (walk%list(n + 1, crowded))
      allocate (walk%taken(n), walk%suspects(n), walk%stopping(n + 1), walk%due(n + 1))
      room = merge(course%n_values/spacing + 1, 0, records)
      allocate (walk%x(width, room, n), walk%u(width, merge(room, 0, keeps_velocity), n))
      allocate (walk%memory(n*(storage_size(one)/storage_size(1.0_wp)) + width))
      first = first_aligned(walk%memory)
      call c_f_pointer(c_loc(walk%memory(first)), walk%walker, [n])
      do w = 1, n
         associate (walker => walk%walker(w))
            walker%x = 0.0_wp
            walker%u = 0.0_wp
            walker%slider = 0.0_wp
            walker%direction = 0.0_wp
            walker%start = 0.0_wp
            walker%reach = huge(1.0_wp)
            walker%place = 0
            walker%first = merge(0, (w - 1)*(n_steps + 1), course%n_values == n_steps + 1)
            walker%position = walker%first
            walker%last = walker%first + n_steps
            walker%phase = walker%first + spacing - int(modulo(nint(begin, long), &
                                                               int(spacing, long)))
            walker%due = merge(walker%phase, -1, records)
            walker%n_records = 0
         end associate
      end do
   end subroutine start_walk

   !> Gives back what was recorded, from record `first` on, and the memory.
   subroutine end_walk(walk, n, first, h, displacement, velocity)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: n, first   !! masses; record
      real(wp), intent(in) :: h         !! [s]
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0

      if (size(displacement) > 0) call unfold(n, walk%walker(1)%n_records, walk%x, 1.0_wp, first, &
                                              displacement)
      if (size(velocity) > 0) call unfold(n, walk%walker(1)%n_records, walk%u, 1.0_wp/h, first, &
                                          velocity)
      deallocate (walk%memory)
   end subroutine end_walk

   !> From traces (mass, record, sample) to histories, of which the records from `first` on are set.
   pure subroutine unfold(n, n_records, trace, scale, first, history)
      integer, intent(in) :: n, n_records, first
      real(wp), intent(in) :: trace(:, :, :), scale
      real(wp), intent(inout) :: history(:, :, :)   !! (record, dof, sample)
      integer :: i, w

      do w = 1, size(trace, 3)
         do i = 1, n
            history(first:first + n_records - 1, i, w) = scale*trace(i, :n_records, w)
         end do
      end do
   end subroutine unfold

   !> Puts a sample at the end of a list.
   pure subroutine append(walk, w, list)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: w, list

      walk%n_listed(list) = walk%n_listed(list) + 1
      walk%list(walk%n_listed(list), list) = w
   end subroutine append

   !> Takes up to so many entries from the front of a list.
   pure subroutine pop(walk, list, most, entry, m)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: list, most
      integer, intent(out) :: entry(most), m

      associate (n => walk%n_listed(list))
         m = min(most, n)
         entry(:m) = walk%list(:m, list)
         walk%list(:n - m, list) = walk%list(m + 1:n, list)
         n = n - m
      end associate
   end subroutine pop

   !> Frees a sample to go on from its position, if it is not the last one.
   pure subroutine set_free(walk, w)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: w
      integer :: level

      associate (walker => walk%walker(w))
         level = level_at(walk%level, walker%position, walker%phase, walker%last)
      end associate
      if (level > 0) call append(walk, w, level)
   end subroutine set_free

   !> Counts an eventful stretch that is done, and frees the sample for the next one.
   pure subroutine finish_stretch(walk, w)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: w

      associate (walker => walk%walker(w))
         walker%position = walker%position + stride_of(walker%level)
         if (walker%position == walker%due) call record(walk, w)
      end associate
      call set_free(walk, w)
   end subroutine finish_stretch

   !> Records the state of a sample, and sets the position of its next record.
   pure subroutine record(walk, w)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: w

      associate (walker => walk%walker(w))
         walker%n_records = walker%n_records + 1
         walker%due = walker%due + walk%spacing
         walk%x(:, walker%n_records, w) = walker%x(:, walker%place)
         if (size(walk%u) > 0) walk%u(:, walker%n_records, w) = walker%u(:, walker%place)
      end associate
   end subroutine record

   !> Sorts samples that have taken a stretch into those that go on likewise, those that stop to do
   !> so (by -w if the stretch was not quiet), and those that must make a record: without a branch,
   !> as one that goes wrong throws away what the processor has already begun. A quiet stretch
   !> counts; otherwise the state is as it was.
   pure subroutine sort_out(n_tried, tried, suspects, stride, is_longest, n_samples, walker, &
                            n_going, going, n_stopping, stopping, n_due, due)
      integer, intent(in) :: n_tried, tried(n_tried), suspects(n_tried)
      integer, intent(in) :: stride            !! of the stretch
      logical, intent(in) :: is_longest        !! no sample may take a longer one
      integer, intent(in) :: n_samples
      type(walker_type), intent(inout) :: walker(n_samples)
      integer, intent(out) :: n_going, n_stopping, n_due
      integer, intent(out) :: going(n_samples + 1), stopping(n_samples + 1), due(n_samples + 1)
      integer :: goes, is_quiet, k, may_go, now, w

      n_going = 0
      n_stopping = 0
      n_due = 0
      may_go = merge(1, 0, is_longest)
      do k = 1, n_tried
         w = tried(k)
         is_quiet = 1 - min(1, suspects(k))
         now = walker(w)%position + stride*is_quiet
         walker(w)%position = now
         walker(w)%suspects = suspects(k)
         walker(w)%place = ieor(walker(w)%place, is_quiet)
         goes = is_quiet*may_go*(1 + shifta(walker(w)%last - now - stride, bit_size(now) - 1))
         going(n_going + 1) = w
         n_going = n_going + goes
         stopping(n_stopping + 1) = w*(2*is_quiet - 1)
         n_stopping = n_stopping + (1 - goes)
         due(n_due + 1) = w
         n_due = n_due + is_quiet*(1 - min(1, abs(now - walker(w)%due)))
      end do
   end subroutine sort_out

   !> The level of the longest stride that a sample may take from its position: no longer than the
   !> longest one, in phase, and not past its last step; 0: it is there.
   elemental function level_at(longest, position, phase, last) result(level)
      integer, intent(in) :: longest, position, phase, last
      integer :: level

      level = min(longest, 1 + trailz(position - phase), bit_size(last) - leadz(last - position))
   end function level_at

end module dynamics_walk
