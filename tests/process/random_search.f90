!> Local maxima of the entropy among autoregressive processes with K(m) of any signs (Sec. 2.3).
!>
!> `process_autoregressive_fit` finds the maximum among processes with K(m) >= 0. Here no sign is
!> assumed: the infinite sums of |K(m)| are the constraints, one length or both, and NLopt searches
!> in atanh(kappa) from starts of random signs. It meets many inferior maxima.
module random_search
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use nlopt_search, only: minimization_problem, minimize
   use numerics_elementary, only: log_cosh
   use process_autoregressive_model, only: autocovariance_of, innovation_std
   use process_autoregressive_sums, only: correlation_sums, lag_sum_gradient, sum_correlation
   use process_model, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: ar_rival, find_rival

   !> Result of one search.
   type :: ar_rival
      real(wp), allocatable :: kappa(:)    !! (order)
      real(wp) :: entropy = -huge(1.0_wp)  !! per point, of unit std [nat]
      logical :: is_feasible = .false.     !! its length is the wanted one
   end type ar_rival

   !> Minus the entropy under the lengths wanted; x = atanh(kappa).
   type, extends(minimization_problem) :: length_problem
      character(2), allocatable :: correlation(:)   !! (equality) 'L0' or 'L1'
      real(wp), allocatable :: length(:)            !! (equality) [lags]
      real(wp) :: scale = 1.0_wp   !! brings the entropy lost to order 1 for the search
   contains
      procedure :: objective => entropy_lost
      procedure :: equalities => length_defect
   end type length_problem

   real(wp), parameter :: farthest = 8.0_wp             !! atanh(kappa): kappa = 1 - 2e-7
   real(wp), parameter :: out_of_reach = 1.0e3_wp       !! ln of a length that cannot be summed
   integer, parameter :: least_reach = 2000             !! lags worth summing at any length
   real(wp), parameter :: reach_per_length = 200.0_wp   !! and at great ones

contains

   !> Finds a local maximum of the entropy from the start that belongs to (seed, trial).
   subroutine find_rival(correlation, length, order, seed, trial, rival, second_length)
      character(*), intent(in) :: correlation   !! 'L0' or 'L1'
      real(wp), intent(in) :: length            !! [lags], positive
      integer, intent(in) :: order
      integer(long), intent(in) :: seed
      integer, intent(in) :: trial              !! counts from 1
      type(ar_rival), intent(out) :: rival
      real(wp), intent(in), optional :: second_length   !! with 'L0': L1, imposed too
      type(length_problem) :: problem
      real(wp), parameter :: met = 1.0e-9_wp   ! relative, of a length
      integer, parameter :: max_evaluations = 300
      real(wp) :: x(order)

      problem%correlation = [character(2) :: correlation]
      problem%length = [length]
      if (present(second_length)) then
         problem%correlation = ['L0', 'L1']
         problem%length = [length, second_length]
      end if
      problem%n_equalities = size(problem%length)
      x = start_of(problem, order, seed, trial)
      problem%scale = 1.0_wp/sum(log_cosh(x))
      call minimize(problem, farthest, met, max_evaluations, x, rival%is_feasible)
      rival%kappa = tanh(x)
      rival%entropy = gaussian_entropy(innovation_std(rival%kappa, 1.0_wp))
   end subroutine find_rival

   !> Random signs and sizes, scaled until the length is about the wanted one.
   function start_of(problem, order, seed, trial) result(x)
      type(length_problem), intent(inout) :: problem
      integer, intent(in) :: order, trial
      integer(long), intent(in) :: seed
      real(wp) :: x(order)
      integer, parameter :: n_bisections = 12
      real(wp), parameter :: largest = 3.0_wp   ! kappa = 0.995
      type(stream_type) :: stream
      real(wp) :: defect(problem%n_equalities), direction(order), high, low
      integer :: i

      stream = new_stream(seed, label_of('rival'), trial)
      call stream%normals(direction)
      direction = direction/maxval(abs(direction))
      low = 0.0_wp
      high = largest
      do i = 1, n_bisections
         x = 0.5_wp*(low + high)*direction
         call problem%equalities(x, defect)
         if (defect(1) > 0.0_wp) then
            high = 0.5_wp*(low + high)
         else
            low = 0.5_wp*(low + high)
         end if
      end do
   end function start_of

   !> Computes - 0.5 sum ln(1 - kappa^2) = sum ln cosh x, scaled, and its gradient.
   subroutine entropy_lost(self, x, value, gradient)
      class(length_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: value
      real(wp), optional, intent(out) :: gradient(:)

      value = self%scale*sum(log_cosh(x))
      if (present(gradient)) gradient = self%scale*tanh(x)
   end subroutine entropy_lost

   !> Computes ln(length/wanted length) for each imposed length, and its gradient; `out_of_reach`
   !> where K(m) does not fade within the reach.
   subroutine length_defect(self, x, values, jacobian)
      class(length_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: values(:)
      real(wp), optional, intent(out) :: jacobian(:, :)
      real(wp), parameter :: negligible = 1.0e-10_wp   ! K(m)/K(0) that counts as 0
      type(correlation_sums) :: sums
      type(error_type), allocatable :: error
      real(wp) :: length
      real(wp), allocatable :: rho(:), weights(:)   ! (0:reach); (lag) of |K(m)|
      integer :: i, last, m, reach

      values = out_of_reach
      if (present(jacobian)) jacobian = 0.0_wp
      reach = least_reach + int(reach_per_length*maxval(self%length))
      allocate (rho(0:reach), source=autocovariance_of(tanh(x), reach))
      last = max(size(x), findloc(abs(rho(1:)) > negligible, .true., 1, back=.true.))
      if (last == reach) return
      call sum_correlation(tanh(x), sums, error)
      if (allocated(error)) return
      do i = 1, size(values)
         length = max(merge(sums%l0, sums%l1, self%correlation(i) == 'L0'), tiny(1.0_wp))
         values(i) = log(length/self%length(i))
         if (.not. present(jacobian)) cycle
         weights = sign(1.0_wp, rho(1:last))   ! d L0 = sum d|rho|
         if (self%correlation(i) == 'L1') &    ! d L1 = sum (m - L1) d|rho|/(1 + L0)
            weights = weights*[(m - sums%l1, m=1, last)]/(1.0_wp + sums%l0)
         jacobian(:, i) = lag_sum_gradient(tanh(x), rho(:last), weights)/length
      end do
   end subroutine length_defect

end module random_search
