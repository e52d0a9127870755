!> Which signs s_m make the entropy largest (Sec. 2.2).
!>
!> Only lags with a_m < 0 have signs to be searched. Changing K(m) into (-1)^m K(m) changes neither
!> entropy nor length, so the sign of the first odd one of them is held at +.
!>
!> Where a_m <= 0 for all m >= 1 (L0, and L1 <= 1) all plus is the best sequence, provably. With ln
!> g = ln c + ln(1 - q/c), c = 1 + delta a_0, q = -delta sum a_m s_m cos(mt), the mean of q^k is a
!> sum of products of signs with positive factors: no signs give more than all plus. So, power by
!> power of the logarithm, no signs give a smaller mean of ln g at the delta of the all-plus
!> solution, and by that mean their entropy is bounded.
module process_direct_sign_search
   use core_kinds, only: long, pi, wp
   use numerics_sorting, only: sort_order
   use process_direct_constraint, only: length_constraint, new_constraint
   use process_direct_sign_sequence, only: sequence_solution, solve_sequence
   implicit none(type, external)
   private
   public :: search_result, count_sequences, search_all_signs, restore_search, search_structured, &
             is_all_plus_best, limit_of_entropy, sequence_signs

   !> Result of a search, or of a part of one.
   type :: search_result
      integer(long) :: n_examined = 0     !! sequences
      integer(long) :: n_consistent = 0   !! of them: solutions whose K(m) have the signs s_m
      real(wp) :: seconds = 0.0_wp        !! of CPU time, where the caller keeps it
      type(sequence_solution), allocatable :: solutions(:)   !! consistent, by descending entropy
   end type search_result

   integer, parameter, public :: max_listed = 100   !! solutions kept of a search
   real(wp), parameter :: rounding = 1.0e-11_wp     !! of an entropy [nat]

contains

   !> Sequences that differ by more than the mirror.
   pure function count_sequences(constraint) result(n)
      type(length_constraint), intent(in) :: constraint
      integer(long) :: n

      n = shiftl(1_long, min(size(searched_positions(constraint)), 62))
   end function count_sequences

   !> True if all plus has the largest entropy, by theory.
   pure function is_all_plus_best(constraint) result(is_best)
      type(length_constraint), intent(in) :: constraint
      logical :: is_best

      is_best = size(constraint%penalized) == 0
   end function is_all_plus_best

   !> Adds part `part` of `n_parts` of all sequences to a search, the same in whatever order that is
   !> done; the parts differ in the leading signs.
   subroutine search_all_signs(constraint, part, n_parts, search)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: part, n_parts   !! part = 1..n_parts
      type(search_result), intent(inout) :: search   !! at first as it is declared
      type(sequence_solution), allocatable :: found(:)
      type(sequence_solution) :: solution
      integer(long) :: first, index, longer, n

      n = count_sequences(constraint)
      call move_alloc(search%solutions, found)
      if (.not. allocated(found)) allocate (found(0))
      longer = modulo(n, int(n_parts, long))   ! parts that have one sequence more
      first = n/n_parts*(part - 1) + min(int(part - 1, long), longer)
      do index = first, first + n/n_parts - merge(0, 1, part <= longer)
         call solve_sequence(constraint, sequence_signs(constraint, index), solution)
         search%n_examined = search%n_examined + 1
         if (.not. (solution%is_feasible .and. solution%is_consistent)) cycle
         search%n_consistent = search%n_consistent + 1
         solution%number = index
         found = [found, solution]
         if (size(found) >= 2*max_listed) call sort_and_cut(found)
      end do
      call sort_and_cut(found)
      call move_alloc(found, search%solutions)
   end subroutine search_all_signs

   !> Restores a search from the sums of its parts and the numbers of their few solutions, which are
   !> solved once more: the same bits.
   subroutine restore_search(constraint, sums, numbers, search)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: sums(3)      !! examined, consistent, seconds; exact up to 2**53
      real(wp), intent(in) :: numbers(:)   !! of the sequences
      type(search_result), intent(out) :: search
      integer :: i

      search%n_examined = nint(sums(1), long)
      search%n_consistent = nint(sums(2), long)
      search%seconds = sums(3)
      allocate (search%solutions(size(numbers)))
      do i = 1, size(numbers)
         associate (number => nint(numbers(i), long))
            call solve_sequence(constraint, sequence_signs(constraint, number), search%solutions(i))
            search%solutions(i)%number = number
         end associate
      end do
      call sort_and_cut(search%solutions)
   end subroutine restore_search

   !> Searches a few sequences that are likely to win: improves each until it is consistent, then
   !> turns signs of the best one by one and, where they are few, pair by pair.
   !>
   !> All plus wins where m_max is large beside L1. Nearer to the limit the winners are sequences
   !> whose sum of cosines is flat: quadratic phases, and all plus with the last sign turned. Above
   !> `very_many` signs only the starts that have won there are tried.
   subroutine search_structured(constraint, best)
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(out) :: best   !! not feasible: none was found
      integer, parameter :: few = 16, many = 48, very_many = 200
      type(sequence_solution) :: solution
      integer :: signs(size(constraint%rewarded)), i, k, n, n_rates, max_passes
      logical :: is_large

      n = size(constraint%rewarded)
      if (n == 0) return
      is_large = n > very_many
      max_passes = merge(2, 50, is_large)
      n_rates = merge(4, 12, is_large)
      signs = 1
      call make_consistent(constraint, signs, max_passes, best)
      if (is_all_plus_best(constraint)) return
      if (constraint%m_max > 4*size(constraint%penalized) .and. best%is_feasible) return
      do i = merge(1, 0, is_large), n_rates
         ! quadratic phases
         signs = [(merge(1, -1, cos(3.0_wp*i/n_rates*pi*real(k, wp)**2/n) >= 0.0_wp), k=0, n - 1)]
         if (i == 0) signs(n) = -1
         call make_consistent(constraint, signs, max_passes, solution)
         call take_better(solution, best)
         if (is_large) cycle
         call make_consistent(constraint, -signs, max_passes, solution)
         call take_better(solution, best)
      end do
      if (best%is_feasible .and. n <= many) call turn_signs(constraint, n <= few, best)
   end subroutine search_structured

   !> Bounds the entropy of every sequence by that of all plus without the penalized lags, by the
   !> argument above.
   subroutine limit_of_entropy(constraint, entropy)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(out) :: entropy   !! minus huge: no sequence has a solution
      type(length_constraint) :: relaxed
      type(sequence_solution) :: solution
      integer :: i

      relaxed = new_constraint([constraint%weights(0), min(constraint%weights(1:), 0.0_wp)])
      call solve_sequence(relaxed, [(1, i=1, size(relaxed%rewarded))], solution)
      entropy = merge(solution%entropy, -huge(1.0_wp), solution%is_feasible)
   end subroutine limit_of_entropy

   !> Takes over the signs of K(m) until they stay. That only raises the entropy: with the new signs
   !> the old solution has more than the wanted length.
   subroutine make_consistent(constraint, signs, max_passes, solution)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: signs(:)   !! start
      integer, intent(in) :: max_passes
      type(sequence_solution), intent(out) :: solution
      integer :: now(size(signs)), pass

      now = signs
      do pass = 1, max_passes
         call solve_sequence(constraint, now, solution)
         if (.not. solution%is_feasible) return
         if (solution%is_consistent) exit
         now = merge(-1, 1, solution%correlation(constraint%rewarded) < 0.0_wp)
      end do
      solution%is_feasible = solution%is_consistent
   end subroutine make_consistent

   !> Turns single signs, and pairs of them if asked for, as long as the best entropy grows.
   subroutine turn_signs(constraint, in_pairs, best)
      type(length_constraint), intent(in) :: constraint
      logical, intent(in) :: in_pairs
      type(sequence_solution), intent(inout) :: best
      integer, parameter :: max_passes = 50
      type(sequence_solution) :: solution
      integer :: signs(size(constraint%rewarded)), i, j
      real(wp) :: before

      do
         before = best%entropy
         do i = 1, size(signs)
            do j = i, merge(size(signs), i, in_pairs)
               signs = nint(best%s(constraint%rewarded))
               signs(i) = -signs(i)
               if (j > i) signs(j) = -signs(j)
               call make_consistent(constraint, signs, max_passes, solution)
               call take_better(solution, best)
            end do
         end do
         if (.not. best%entropy > before) exit
      end do
   end subroutine turn_signs

   pure subroutine take_better(solution, best)
      type(sequence_solution), intent(in) :: solution
      type(sequence_solution), intent(inout) :: best

      if (.not. (solution%is_feasible .and. solution%is_consistent)) return
      if (best%is_feasible .and. best%is_consistent) then
         if (.not. solution%entropy > best%entropy + rounding) return
      end if
      best = solution
   end subroutine take_better

   !> Positions among the rewarded lags whose sign is not fixed by the mirror.
   pure function searched_positions(constraint) result(positions)
      type(length_constraint), intent(in) :: constraint
      integer, allocatable :: positions(:)
      integer :: first_odd, i

      first_odd = findloc(modulo(constraint%rewarded, 2), 1, dim=1)
      positions = [(i, i=1, size(constraint%rewarded))]
      positions = pack(positions, positions /= first_odd)
   end function searched_positions

   !> Sequence number `index`, 0..count_sequences - 1; 0 is all plus, and the leading signs change
   !> last.
   pure function sequence_signs(constraint, index) result(signs)
      type(length_constraint), intent(in) :: constraint
      integer(long), intent(in) :: index
      integer :: signs(size(constraint%rewarded))
      integer, allocatable :: positions(:)
      integer :: bit

      positions = searched_positions(constraint)
      signs = 1
      do bit = 0, size(positions) - 1
         if (btest(index, bit)) signs(positions(size(positions) - bit)) = -1
      end do
   end function sequence_signs

   !> Sorts by descending entropy, those that are equal to rounding by their numbers, and keeps the
   !> best `max_listed`.
   pure subroutine sort_and_cut(solutions)
      type(sequence_solution), allocatable, intent(inout) :: solutions(:)
      integer, allocatable :: order(:)

      order = sort_order(real(solutions%number, wp))
      order = order(sort_order(-anint(solutions(order)%entropy/rounding)))
      solutions = solutions(order(:min(size(order), max_listed)))
   end subroutine sort_and_cut

end module process_direct_sign_search
