!> Search for the signs s_m of largest entropy (Sec. 2.2).
!>
!> Only the signs of lags with a_m < 0 are searched. (-1)^m K(m) has the entropy and the length of
!> K(m), so the sign of the first odd one of these lags is +.
!>
!> If a_m <= 0 for all m >= 1 (L0, and L1 <= 1), all signs + are proven to be best. With
!> ln g = ln c + ln(1 - q/c), c = 1 + delta a_0 and q = -delta sum a_m s_m cos(mt), the mean of q^k
!> is a sum of products of signs with positive factors, and largest for all +. So, by the series of
!> the logarithm, the mean of ln g at the delta of the solution for all + is smallest for all +, and
!> for other signs it bounds their entropy.
module process_direct_sign_search
   use core_kinds, only: long, pi, wp
   use numerics_sorting, only: sort_order
   use process_direct_constraint, only: length_constraint
   use process_direct_sign_sequence, only: sequence_solution, solve_sequence
   implicit none(type, external)
   private
   public :: sign_search_result, count_sequences, search_all_signs, restore_search, &
             search_structured, is_all_plus_best, limit_of_entropy, sequence_signs

   !> Result of a search, or of a part of one.
   type :: sign_search_result
      integer(long) :: n_examined = 0     !! number of sequences
      integer(long) :: n_consistent = 0   !! solutions whose K(m) have the signs s_m
      real(wp) :: seconds = 0.0_wp        !! CPU time, if the caller measures it
      type(sequence_solution), allocatable :: solutions(:)   !! consistent, best first
   end type sign_search_result

   integer, parameter, public :: max_listed = 100   !! solutions that are kept
   real(wp), parameter :: rounding = 1.0e-11_wp     !! rounding of an entropy [nat]

contains

   !> Number of sequences, without mirror images.
   pure integer(long) function count_sequences(constraint) result(n)
      type(length_constraint), intent(in) :: constraint

      n = shiftl(1_long, min(size(searched_positions(constraint)), 62))
   end function count_sequences

   !> True if all signs + are proven to have the largest entropy.
   pure logical function is_all_plus_best(constraint) result(is_best)
      type(length_constraint), intent(in) :: constraint

      is_best = size(constraint%penalized) == 0
   end function is_all_plus_best

   !> Adds a part of all sequences to a search. The result does not depend on the order of the
   !> parts, which differ in the leading signs.
   subroutine search_all_signs(constraint, part, n_parts, search)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: part, n_parts   !! part = 1..n_parts
      type(sign_search_result), intent(inout) :: search   !! new or with other parts
      type(sequence_solution), allocatable :: solutions(:)
      type(sequence_solution) :: solution
      integer(long) :: first, index, n_longer, n

      n = count_sequences(constraint)
      call move_alloc(search%solutions, solutions)
      if (.not. allocated(solutions)) allocate (solutions(0))
      n_longer = modulo(n, int(n_parts, long))   ! parts with one sequence more
      first = n/n_parts*(part - 1) + min(int(part - 1, long), n_longer)
      do index = first, first + n/n_parts - merge(0, 1, part <= n_longer)
         call solve_sequence(constraint, sequence_signs(constraint, index), solution)
         search%n_examined = search%n_examined + 1
         if (.not. (solution%is_feasible .and. solution%is_consistent)) cycle
         search%n_consistent = search%n_consistent + 1
         solution%number = index
         solutions = [solutions, solution]
         if (size(solutions) >= 2*max_listed) call sort_and_cut(solutions)
      end do
      call sort_and_cut(solutions)
      call move_alloc(solutions, search%solutions)
   end subroutine search_all_signs

   !> Restores a search from the sums of its parts and the numbers of their solutions, which are
   !> solved once more, with the same bits.
   subroutine restore_search(constraint, sums, numbers, search)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: sums(3)      !! examined, consistent, seconds; exact up to 2**53
      real(wp), intent(in) :: numbers(:)   !! numbers of the sequences
      type(sign_search_result), intent(out) :: search
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

   !> Searches a few likely sequences: changes each until it is consistent, then flips the signs of
   !> the best one, singly and, if they are few, in pairs.
   !>
   !> All + is best if m_max is much larger than L1. Nearer to the limit the best sequences have a
   !> flat sum of cosines: quadratic phases. For more than `very_many_signs` signs fewer starts are
   !> tried.
   subroutine search_structured(constraint, best)
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(out) :: best   !! not feasible if none was found
      integer, parameter :: few_signs = 16, many_signs = 48, very_many_signs = 200
      type(sequence_solution) :: solution
      integer :: signs(size(constraint%rewarded)), i, k, n, n_rates, max_passes
      logical :: is_large

      n = size(constraint%rewarded)
      if (n == 0) return
      is_large = n > very_many_signs
      max_passes = merge(2, 50, is_large)
      n_rates = merge(4, 12, is_large)
      signs = 1
      call make_consistent(constraint, signs, max_passes, best)
      if (is_all_plus_best(constraint)) return
      if (constraint%m_max > 4*size(constraint%penalized) .and. best%is_feasible) return
      do i = 1, n_rates   ! quadratic phases
         signs = [(merge(1, -1, cos(3.0_wp*i/n_rates*pi*real(k, wp)**2/n) >= 0.0_wp), k=0, n - 1)]
         call make_consistent(constraint, signs, max_passes, solution)
         call keep_better(solution, best)
         if (is_large) cycle
         call make_consistent(constraint, -signs, max_passes, solution)
         call keep_better(solution, best)
      end do
      if (best%is_feasible .and. n <= many_signs) call flip_signs(constraint, n <= few_signs, best)
   end subroutine search_structured

   !> Computes an upper bound of the entropy of all sequences: that of all + without the penalized
   !> lags, by the argument above.
   subroutine limit_of_entropy(constraint, entropy)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(out) :: entropy   !! -huge if no sequence has a solution
      type(length_constraint) :: relaxed
      type(sequence_solution) :: solution
      integer :: i

      relaxed = constraint
      relaxed%weights(1:) = min(constraint%weights(1:), 0.0_wp)
      relaxed%penalized = [integer ::]
      call solve_sequence(relaxed, [(1, i=1, size(relaxed%rewarded))], solution)
      entropy = merge(solution%entropy, -huge(1.0_wp), solution%is_feasible)
   end subroutine limit_of_entropy

   !> Replaces the signs by those of K(m) until they are the same, which raises the entropy each
   !> time: with the new signs the old solution has more than the imposed length.
   subroutine make_consistent(constraint, signs, max_passes, solution)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: signs(:)   !! first signs
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

   !> Flips single signs, or pairs of them too, as long as the best entropy grows.
   subroutine flip_signs(constraint, in_pairs, best)
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
               call keep_better(solution, best)
            end do
         end do
         if (.not. best%entropy > before) exit
      end do
   end subroutine flip_signs

   !> Replaces the best consistent solution by a better one.
   pure subroutine keep_better(solution, best)
      type(sequence_solution), intent(in) :: solution   !! result of make_consistent
      type(sequence_solution), intent(inout) :: best

      if (.not. solution%is_feasible) return
      if (best%is_feasible .and. .not. solution%entropy > best%entropy + rounding) return
      best = solution
   end subroutine keep_better

   !> Positions, among the rewarded lags, of the signs that are searched.
   pure function searched_positions(constraint) result(positions)
      type(length_constraint), intent(in) :: constraint
      integer, allocatable :: positions(:)
      integer :: first_odd, i

      first_odd = findloc(modulo(constraint%rewarded, 2), 1, dim=1)
      positions = [(i, i=1, size(constraint%rewarded))]
      positions = pack(positions, positions /= first_odd)
   end function searched_positions

   !> Signs of sequence number `index`, 0..count_sequences - 1. Number 0 is all +; the leading signs
   !> are the highest bits.
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

   !> Sorts solutions by descending entropy, equal ones by their numbers, and keeps the best
   !> `max_listed`.
   pure subroutine sort_and_cut(solutions)
      type(sequence_solution), allocatable, intent(inout) :: solutions(:)
      integer, allocatable :: order(:)

      order = sort_order(real(solutions%number, wp))
      order = order(sort_order(-anint(solutions(order)%entropy/rounding)))
      solutions = solutions(order(:min(size(order), max_listed)))
   end subroutine sort_and_cut

end module process_direct_sign_search
