!> The direct method beside the paper's dense inversion, in CPU time of one run.
!>
!> For each request: one sequence of signs, to rounding, with its residual; then the inverse of 2M +
!> 1 points (LAPACK) with its error, for M of the paper's size and larger. The last lines are the
!> certificate of the sign search.
program bench_process_direct
   use, intrinsic :: iso_fortran_env, only: output_unit
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_direct_constraint, only: constraint_of, length_constraint
   use process_direct_fit, only: check_by_inversion, fit_direct
   use process_direct_sign_search, only: search_all_signs, sign_search_result
   use process_direct_sign_sequence, only: sequence_solution, solve_sequence
   use process_model, only: inversion_check, process_model_type, process_request
   implicit none(type, external)

   integer, parameter :: half_widths(3) = [50, 200, 600]

   write (output_unit, '(a)') &
      ' request                way                       CPU ms     ratio   residual, error in K'
   call compare('L0', 0.3_wp, 4)
   call compare('L0', 1.0_wp, 16)
   call compare('L0', 19.0_wp, 20)
   call compare('L0', 30.0_wp, 40)
   call compare('L1', 3.0_wp, 7)
   call certify('L0', 1.0_wp, 16)
   call certify('L1', 3.0_wp, 14)

contains

   !> Times one sequence, the winning one, against inversions.
   subroutine compare(correlation, length, m_max)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer, intent(in) :: m_max
      integer, parameter :: n_rounds = 5, n_repeats = 20
      type(process_model_type) :: model
      type(length_constraint) :: constraint
      type(sequence_solution) :: solution
      type(inversion_check) :: check
      type(error_type), allocatable :: error
      real(wp) :: best, finish, start
      integer :: i, round

      call fit_direct(request(correlation, length, m_max), model)
      constraint = constraint_of(request(correlation, length, m_max))
      best = huge(1.0_wp)
      do round = 1, n_rounds
         call cpu_time(start)
         do i = 1, n_repeats
            call solve_sequence(constraint, model%signs(constraint%rewarded), solution)
         end do
         call cpu_time(finish)
         best = min(best, (finish - start)/n_repeats)
      end do
      write (output_unit, '(1x, a, f5.1, a, i3, 6x, a24, f9.4, 12x, es10.1)') correlation//' =', &
         length, &
         ', m_max =', m_max, 'one sequence', 1.0e3_wp*best, model%optimality
      do i = 1, size(half_widths)
         call cpu_time(start)
         call check_by_inversion(model, half_widths(i), check, error)
         call cpu_time(finish)
         write (output_unit, '(25x, a, i5, a, f14.2, f10.0, es12.1)') 'inverse,', &
            2*half_widths(i) + 1, ' points', &
            1.0e3_wp*(finish - start), (finish - start)/best, check%error
      end do
   end subroutine compare

   !> Times all sequences, one part.
   subroutine certify(correlation, length, m_max)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer, intent(in) :: m_max
      type(sign_search_result) :: search
      real(wp) :: finish, start

      call cpu_time(start)
      call search_all_signs(constraint_of(request(correlation, length, m_max)), 1, 1, search)
      call cpu_time(finish)
      write (output_unit, '(1x, a, f5.1, a, i3, a, f9.3, a, i0, a, f14.10)') correlation//' =', &
         length, ', m_max =', m_max, ': all sequences solved ', finish - start, &
         ' s of one core, ', search%n_examined, ' examined, h = ', search%solutions(1)%entropy
   end subroutine certify

   pure function request(correlation, length, m_max)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer, intent(in) :: m_max
      type(process_request) :: request

      request%method = 'direct'
      request%correlation = correlation
      request%correlation_length = length
      request%order = m_max
      request%std = 1.0_wp
   end function request

end program bench_process_direct
