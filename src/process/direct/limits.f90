!> Which m_max a correlation length needs in the direct method (Sec. 2.2).
!>
!> L0 needs m_max > L0. With L1, all plus has a solution when m_max > 2 L1; other signs can do with
!> less. As |K(m)| <= K(0), sum (m - L1)|K(m)| over m > L1 must exceed L1 K(0), whence a bound from
!> below.
module process_direct_limits
   use core_kinds, only: wp
   use process_correlation, only: constraint_weights
   use process_direct_constraint, only: length_constraint, new_constraint
   use process_direct_reciprocal_symbol, only: reciprocal_workspace
   use process_direct_sign_search, only: count_sequences, search_all_signs, search_result
   implicit none(type, external)
   private
   public :: smallest_feasible_m_max, certainly_feasible_m_max, certainly_infeasible_m_max

contains

   !> Finds the smallest m_max that has a solution by searching all signs. Where that would take too
   !> long `is_smallest` is false, and m_max is one that is certainly feasible.
   subroutine smallest_feasible_m_max(correlation, length, m_max, is_smallest)
      character(*), intent(in) :: correlation   !! 'L0' or 'L1'
      real(wp), intent(in) :: length            !! [lags]
      integer, intent(out) :: m_max
      logical, intent(out) :: is_smallest
      integer, parameter :: most_sequences = 256
      type(length_constraint) :: constraint
      type(reciprocal_workspace) :: workspace
      type(search_result) :: search
      integer :: enough

      enough = certainly_feasible_m_max(correlation, length)
      is_smallest = .true.
      do m_max = certainly_infeasible_m_max(correlation, length) + 1, enough - 1
         constraint = new_constraint(constraint_weights(correlation, length, m_max))
         is_smallest = count_sequences(constraint) <= most_sequences
         if (.not. is_smallest) exit
         call workspace%prepare(m_max)
         call search_all_signs(constraint, 1, 1, workspace, search)
         if (size(search%solutions) > 0) return
      end do
      m_max = enough
   end subroutine smallest_feasible_m_max

   !> An m_max at which, as at all above, there is a solution.
   pure function certainly_feasible_m_max(correlation, length) result(m_max)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer :: m_max

      m_max = floor(min(merge(length, 2.0_wp*length, correlation == 'L0'), 1.0e9_wp)) + 1
   end function certainly_feasible_m_max

   !> An m_max at which, as at all below, there is none.
   pure function certainly_infeasible_m_max(correlation, length) result(m_max)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer :: m_max
      real(wp) :: shortest
      integer :: lag

      if (correlation == 'L0') then
         m_max = floor(min(length, 1.0e9_wp))
         return
      end if
      ! the sum with all |K(m)| = K(0)
      m_max = floor(min(length, 0.4e9_wp))
      shortest = 0.0_wp
      do lag = m_max + 1, m_max + 100000
         shortest = shortest + lag - length
         if (shortest > length) exit
         m_max = lag
      end do
   end function certainly_infeasible_m_max

end module process_direct_limits
