!> Upper bounds of the entropy of sign sequences, to leave out those that cannot win (Sec. 2.2).
!>
!> Every delta and s bounds the entropy of a sequence, see `process_direct_sign_sequence`; here
!> those of a solution that is known.
module process_direct_sequence_bound
   use core_kinds, only: pi, wp
   use process_direct_constraint, only: length_constraint
   use process_direct_sign_sequence, only: sequence_solution
   use process_entropy, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: sequence_bound

   !> Bound on the entropy of sign sequences: g on points 0..n of half the circle.
   type :: sequence_bound
      private
      real(wp) :: to_beat = 0.0_wp            !! entropy of the known solution
      real(wp), allocatable :: term(:, :)     !! delta a_m cos(m t), (point, rewarded lag)
      real(wp), allocatable :: others(:)      !! g without these terms, (point)
   contains
      procedure :: prepare
      procedure :: excludes
   end type sequence_bound

   real(wp), parameter :: margin = 1.0e-9_wp   !! nat; sequences closer than this are solved

contains

   !> Prepares the bounds that follow from a known solution, on enough points to give its own
   !> entropy.
   subroutine prepare(self, constraint, known)
      class(sequence_bound), intent(inout) :: self
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(in) :: known   !! feasible
      integer, parameter :: max_points = 65536
      integer :: n

      self%to_beat = known%entropy
      n = 16*constraint%m_max
      do
         call tabulate(self, constraint, known, n)
         if (abs(bound(self, nint(known%s(constraint%rewarded))) - known%entropy) &
             < 0.1_wp*margin) exit
         n = 2*n
         if (n > max_points) exit
      end do
   end subroutine prepare

   !> True if a sequence has certainly less entropy than the known solution.
   pure logical function excludes(self, signs)
      class(sequence_bound), intent(in) :: self
      integer, intent(in) :: signs(:)   !! of the rewarded lags

      excludes = bound(self, signs) < self%to_beat - margin
   end function excludes

   !> Tabulates the terms of g at n + 1 points of half the circle, 0 and pi among them.
   pure subroutine tabulate(self, constraint, known, n)
      class(sequence_bound), intent(inout) :: self
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(in) :: known
      integer, intent(in) :: n
      real(wp) :: terms(n + 1, constraint%m_max)
      integer :: j, m

      do m = 1, constraint%m_max
         terms(:, m) = known%delta*constraint%weights(m)*[(cos(pi*m*j/n), j=0, n)]
      end do
      self%term = terms(:, constraint%rewarded)
      self%others = 1.0_wp + known%delta*constraint%weights(0) &
                    + matmul(terms(:, constraint%penalized), known%s(constraint%penalized))
   end subroutine tabulate

   !> Upper bound of a sequence's entropy; huge where g is not positive, and nothing is known.
   pure real(wp) function bound(self, signs)
      class(sequence_bound), intent(in) :: self
      integer, intent(in) :: signs(:)
      real(wp) :: g(size(self%others))

      g = self%others + matmul(self%term, real(signs, wp))
      bound = huge(1.0_wp)
      if (.not. minval(g) > 0.0_wp) return
      associate (n => size(g) - 1)
         bound = gaussian_entropy(1.0_wp) - 0.5_wp*(0.5_wp*(log(g(1)) + log(g(n + 1))) &
                                                       + sum(log(g(2:n))))/n
      end associate
   end function bound

end module process_direct_sequence_bound
