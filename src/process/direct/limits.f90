!> Requests that the direct method refuses, and the m_max that a length needs (Sec. 2.2).
!>
!> L0 needs m_max > L0. For L1, all signs + have a solution if m_max > 2 L1; other signs may have
!> one at a smaller m_max. As |K(m)| <= K(0), the sum of (m - L1)|K(m)| over m > L1 must exceed
!> L1 K(0), which gives a lower bound of m_max.
module process_direct_limits
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use process_direct_constraint, only: constraint_of, length_constraint
   use process_direct_sign_search, only: count_sequences, search_all_signs, sign_search_result
   use process_model, only: process_request
   implicit none(type, external)
   private
   public :: check_sign_count, reason_of_failure, reason_of_inaccuracy
   public :: certainly_feasible_m_max, certainly_infeasible_m_max

   character(*), parameter :: too_near = &
      'too near the limit for double precision; a larger m_max is farther from it'

contains

   !> Checks the number of sequences of signs, if all of them are to be solved; `complaint` is
   !> unallocated if they are not too many.
   subroutine check_sign_count(request, complaint)
      type(process_request), intent(in) :: request
      character(:), allocatable, intent(out) :: complaint
      integer(long) :: most, n

      if (.not. request%all_signs) return
      n = count_sequences(constraint_of(request))
      most = 2_long**30   ! half a day of a processor
      if (request%positive) then   ! each is sampled, and its mirror image too
         n = 2*n
         most = 2_long**11
      end if
      if (n > most) complaint = named(request)//': all_signs = .true. would solve '// &
         to_text(n)//' sequences of signs: must be at most '//to_text(most)
   end subroutine check_sign_count

   !> Reason why there is no solution, with a feasible m_max.
   function reason_of_failure(request, is_certain) result(reason)
      type(process_request), intent(in) :: request
      logical, intent(in) :: is_certain   !! all sequences were examined
      character(:), allocatable :: reason

      if (request%order >= certainly_feasible_m_max(request)) then
         reason = named(request)//': '//too_near
      else if (is_certain) then
         reason = named(request)//': no process has this; '//advice(request)
      else
         reason = named(request)//': no process was found that has this; '//advice(request)
      end if
   end function reason_of_failure

   !> Reason to refuse a solution that double precision does not resolve.
   pure function reason_of_inaccuracy(request, residual) result(reason)
      type(process_request), intent(in) :: request
      real(wp), intent(in) :: residual   !! residual of the optimality conditions
      character(:), allocatable :: reason

      reason = named(request)//': the optimality conditions are met to '//to_text(residual)// &
               ' only, '//too_near
   end function reason_of_inaccuracy

   pure function named(request) result(name)
      type(process_request), intent(in) :: request
      character(:), allocatable :: name

      name = 'direct method, '//trim(request%correlation)//' = '// &
             to_text(request%correlation_length)//' cut at m_max = '//to_text(request%order)
   end function named

   !> Advice on the smallest feasible m_max.
   function advice(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text
      integer :: m_max
      logical :: is_smallest

      call smallest_feasible_m_max(request, m_max, is_smallest)
      if (is_smallest) then
         text = 'the smallest m_max that is feasible is '//to_text(m_max)
      else
         text = 'm_max = '//to_text(m_max)//' is feasible, and none below '// &
                to_text(certainly_infeasible_m_max(request) + 1)//' is'
      end if
   end function advice

   !> Finds the smallest m_max with a solution by searching all signs. If that would take too long,
   !> `is_smallest` is false and m_max is one that is certainly feasible.
   subroutine smallest_feasible_m_max(request, m_max, is_smallest)
      type(process_request), intent(in) :: request
      integer, intent(out) :: m_max
      logical, intent(out) :: is_smallest
      integer, parameter :: most_sequences = 256
      type(process_request) :: trial
      type(length_constraint) :: constraint
      type(sign_search_result) :: search
      integer :: enough

      enough = certainly_feasible_m_max(request)
      is_smallest = .true.
      trial = request
      do m_max = certainly_infeasible_m_max(request) + 1, enough - 1
         trial%order = m_max
         constraint = constraint_of(trial)
         is_smallest = count_sequences(constraint) <= most_sequences
         if (.not. is_smallest) exit
         search = sign_search_result()
         call search_all_signs(constraint, 1, 1, search)
         if (size(search%solutions) > 0) return
      end do
      m_max = enough
   end subroutine smallest_feasible_m_max

   !> Order m_max from which on there is a solution.
   pure integer function certainly_feasible_m_max(request) result(m_max)
      type(process_request), intent(in) :: request

      associate (length => request%correlation_length)
         m_max = floor(min(merge(length, 2.0_wp*length, request%correlation == 'L0'), 1.0e9_wp)) + 1
      end associate
   end function certainly_feasible_m_max

   !> Order m_max up to which there is no solution.
   pure integer function certainly_infeasible_m_max(request) result(m_max)
      type(process_request), intent(in) :: request
      real(wp) :: b   ! n lags more suffice if n^2 - b n > 2 L1

      associate (length => min(request%correlation_length, 0.4e9_wp))
         m_max = floor(length)
         if (request%correlation == 'L0') return
         b = 2.0_wp*(length - m_max) - 1.0_wp
         m_max = m_max + floor(0.5_wp*(b + sqrt(b**2 + 8.0_wp*length)))
      end associate
   end function certainly_infeasible_m_max

end module process_direct_limits
