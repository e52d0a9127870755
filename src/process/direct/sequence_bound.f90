!> Upper bounds of the entropy of sign sequences, to leave out those that cannot win (Sec. 2.2).
!>
!> Every delta and s bounds the entropy of a sequence, see `process_direct_sign_sequence`; here
!> those of a
!> solution that is known. Sequences that share their leading signs share most of the work.
module process_direct_sequence_bound
   use core_kinds, only: wp
   use process_direct_constraint, only: length_constraint
   use process_direct_sign_sequence, only: sequence_solution
   use process_entropy, only: white_noise_entropy
   implicit none(type, external)
   private
   public :: sequence_bound

   !> Bound on the entropy of sign sequences, and data that those with the same leading signs share.
   type :: sequence_bound
      private
      real(wp) :: to_beat = 0.0_wp                !! entropy of the known solution
      real(wp), allocatable :: term(:, :)         !! delta a_m cos(m t), (point, rewarded lag)
      real(wp), allocatable :: partial(:, :)      !! g with the leading signs, (point, 0:n_rewarded)
      integer, allocatable :: signs(:)            !! of `partial`
   contains
      procedure :: prepare
      procedure :: excludes
   end type sequence_bound

   real(wp), parameter :: margin = 1.0e-9_wp   !! nat; sequences closer than this are solved

contains

   !> From a known solution; uses enough points to give the solution's own entropy.
   subroutine prepare(self, constraint, known)
      class(sequence_bound), intent(inout) :: self
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(in) :: known   !! feasible
      integer, parameter :: max_points = 65536
      real(wp) :: error
      integer :: n

      self%to_beat = known%entropy
      n = 16*constraint%m_max
      do
         call tabulate(self, constraint, known, n)
         error = bound(self, nint(known%s(constraint%rewarded))) - known%entropy
         if (abs(error) < 0.1_wp*margin) exit
         n = 2*n
         if (n > max_points) exit
      end do
   end subroutine prepare

   !> True if a sequence has certainly less entropy than the known solution.
   function excludes(self, signs) result(is_excluded)
      class(sequence_bound), intent(inout) :: self
      integer, intent(in) :: signs(:)   !! of the rewarded lags
      logical :: is_excluded

      is_excluded = bound(self, signs) < self%to_beat - margin
   end function excludes

   !> n points on half the circle, 0 and pi among them.
   subroutine tabulate(self, constraint, known, n)
      class(sequence_bound), intent(inout) :: self
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(in) :: known
      integer, intent(in) :: n
      real(wp), parameter :: pi = 4.0_wp*atan(1.0_wp)
      real(wp) :: t(0:n)
      integer :: i, j, m

      t = [(pi*j/n, j=0, n)]
      if (allocated(self%term)) deallocate (self%term, self%partial)
      associate (lags => constraint%rewarded, weights => constraint%weights)
         allocate (self%term(0:n, size(lags)), self%partial(0:n, 0:size(lags)))
         do i = 1, size(lags)
            self%term(:, i) = known%delta*weights(lags(i))*cos(lags(i)*t)
         end do
         self%partial(:, 0) = 1.0_wp + known%delta*weights(0)
         do i = 1, size(constraint%penalized)
            m = constraint%penalized(i)
            self%partial(:, 0) = self%partial(:, 0) + known%delta*known%s(m)*weights(m)*cos(m*t)
         end do
         self%signs = 0*lags
      end associate
   end subroutine tabulate

   !> Huge where g is not positive: these multipliers then tell nothing of the sequence.
   function bound(self, signs) result(entropy)
      class(sequence_bound), intent(inout) :: self
      integer, intent(in) :: signs(:)
      real(wp) :: entropy
      real(wp) :: log_mean
      integer :: i, n, n_signs

      n_signs = size(signs)
      n = ubound(self%partial, 1)
      do i = findloc(self%signs /= signs, .true., dim=1), n_signs
         if (i == 0) exit
         self%partial(:, i) = self%partial(:, i - 1) + signs(i)*self%term(:, i)
      end do
      self%signs = signs
      associate (g => self%partial(:, n_signs))
         entropy = huge(1.0_wp)
         if (.not. minval(g) > 0.0_wp) return
         log_mean = (sum_of_logs(g) - 0.5_wp*(log(g(lbound(g, 1))) + log(g(ubound(g, 1)))))/n
         entropy = white_noise_entropy(1.0_wp) - 0.5_wp*log_mean
      end associate
   end function bound

   !> Few logarithms: eight values, none of them extreme, are multiplied first.
   pure function sum_of_logs(values) result(total)
      real(wp), intent(in) :: values(:)
      real(wp) :: total
      integer, parameter :: width = 8
      real(wp) :: block_product(size(values)/width)
      integer :: i, n

      n = size(values)/width
      block_product = values(:n)
      do i = 2, width
         block_product = block_product*values((i - 1)*n + 1:i*n)
      end do
      total = sum(log(block_product)) + sum(log(values(width*n + 1:)))
   end function sum_of_logs

end module process_direct_sequence_bound
