!> Positive processes of low order by quadrature, to check fits: the transfer operator on Gauss
!> nodes, which shares neither random numbers nor formulas with the fits.
!>
!> The kernel maps M past values to the next one. Its Perron value is Lambda, and left times right
!> Perron function is the law of M consecutive values under Eq. (25) in an infinite domain; divided
!> by the acceptance probability the kernel is a transition density, that of one-at-a-time
!> rejection. Everything is in units of b0.
module transfer_operator_checks
   use core_kinds, only: wp
   use numerics_quadrature, only: gauss_legendre
   use process_positive_truncated_normal, only: hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: transfer_operator, new_operator, find_stationary_law

   !> States are vectors of M past nodes, the newest varying fastest, the oldest apart: (newer,
   !> oldest).
   type :: transfer_operator
      real(wp), allocatable :: nodes(:)         !! (node)
      !> (next node, newer, oldest), weights of the next node in it
      real(wp), allocatable :: kernel(:, :, :)
      real(wp), allocatable :: newest(:, :)     !! (newer, oldest) the newest value of a state
      real(wp), allocatable :: c(:, :)          !! (newer, oldest) conditional mean
      real(wp) :: offset = 0.0_wp               !! conditional mean after zeros
      logical :: is_sequential = .false.
      real(wp) :: perron = 1.0_wp               !! Perron value of the kernel as stored
      real(wp) :: log_lambda = 0.0_wp           !! ln Lambda, Eq. (45)
      !> (newer, oldest) left Perron function times weights
      real(wp), allocatable :: left(:, :)
      real(wp), allocatable :: right(:, :)      !! (newer, oldest); sum left right = 1
   contains
      procedure :: autocovariance
      procedure :: expectation
   end type transfer_operator

contains

   !> Discretizes the kernel; n_nodes**(order + 1) numbers.
   pure function new_operator(a, offset, reach, n_nodes, is_sequential) result(operator)
      real(wp), intent(in) :: a(:)      !! a_q, Eq. (39)
      real(wp), intent(in) :: offset    !! conditional mean after zeros: mu (1 + sum a_q)/b0
      real(wp), intent(in) :: reach     !! no mass to speak of beyond [b0]
      integer, intent(in) :: n_nodes
      logical, intent(in) :: is_sequential
      type(transfer_operator) :: operator
      real(wp), parameter :: sqrt_two_pi = sqrt(8.0_wp*atan(1.0_wp))
      real(wp) :: weights(n_nodes)
      integer :: digit, n_newer, newer, oldest, q, rest

      n_newer = n_nodes**(size(a) - 1)
      allocate (operator%nodes(n_nodes), operator%kernel(n_nodes, n_newer, n_nodes))
      allocate (operator%newest(n_newer, n_nodes), operator%c(n_newer, n_nodes))
      operator%is_sequential = is_sequential
      operator%offset = offset
      call gauss_legendre(0.0_wp, reach, operator%nodes, weights)
      do oldest = 1, n_nodes
         do newer = 1, n_newer
            rest = newer - 1
            operator%c(newer, oldest) = offset - a(size(a))*operator%nodes(oldest)
            operator%newest(newer, oldest) = operator%nodes(oldest)
            do q = 1, size(a) - 1
               digit = 1 + modulo(rest, n_nodes)
               rest = rest/n_nodes
               if (q == 1) operator%newest(newer, oldest) = operator%nodes(digit)
               operator%c(newer, oldest) = operator%c(newer, oldest) - a(q)*operator%nodes(digit)
            end do
            associate (c => operator%c(newer, oldest))
               if (is_sequential) then
                  operator%kernel(:, newer, oldest) = -0.5_wp*(operator%nodes - c)**2 &
                     - log_acceptance(c)
               else
                  ! the same law, its linear terms gathered on the next value: no underflow for mu
                  ! << 0
                  operator%kernel(:, newer, oldest) = offset*(1.0_wp + sum(a))*operator%nodes &
                                                      - 0.5_wp*(operator%nodes - (c - offset))**2
               end if
            end associate
            operator%kernel(:, newer, oldest) = &
               weights*exp(max(operator%kernel(:, newer, oldest), -700.0_wp))/sqrt_two_pi
         end do
      end do
   end function new_operator

   !> Perron value and functions by power iteration.
   pure subroutine find_stationary_law(operator, tolerance, is_settled)
      type(transfer_operator), intent(inout) :: operator
      real(wp), intent(in) :: tolerance   !! relative change of the functions per step
      logical, intent(out) :: is_settled   !! else they are worth nothing
      integer, parameter :: max_steps = 100000
      real(wp), allocatable :: next(:, :)
      real(wp) :: change, norm
      integer :: side, step

      operator%left = 0.0_wp*operator%c + 1.0_wp/size(operator%c)
      operator%right = 0.0_wp*operator%c + 1.0_wp
      do side = 1, 2
         if (side == 2 .and. operator%is_sequential) exit   ! Lambda = 1, constant right function
         do step = 1, max_steps
            if (side == 1) then
               next = forward(operator, operator%left)
               norm = sum(next)
               change = sum(abs(next/norm - operator%left))
               operator%left = next/norm
            else
               next = backward(operator, operator%right)
               norm = sum(next*operator%left)
               change = sum(abs(next/norm - operator%right)*operator%left)
               operator%right = next/norm
            end if
            if (change <= tolerance) exit
         end do
         is_settled = step <= max_steps
         if (.not. is_settled) return
         operator%perron = norm
      end do
      operator%right = operator%right/sum(operator%left*operator%right)
      if (.not. operator%is_sequential) &
         operator%log_lambda = log(operator%perron) - 0.5_wp*operator%offset**2
   end subroutine find_stationary_law

   !> Law of the state one step later (left action).
   pure function forward(operator, law) result(next)
      class(transfer_operator), intent(in) :: operator
      real(wp), intent(in) :: law(:, :)   !! (newer, oldest)
      real(wp), allocatable :: next(:, :)
      real(wp) :: sums(size(operator%nodes), size(law, 1))
      integer :: newer, oldest

      sums = 0.0_wp
      do oldest = 1, size(law, 2)
         do newer = 1, size(law, 1)
            sums(:, newer) = sums(:, newer) + law(newer, oldest)*operator%kernel(:, newer, oldest)
         end do
      end do
      next = reshape(sums, shape(law))
   end function forward

   !> Expectation of a function of the state one step later (right action).
   pure function backward(operator, function_of_state) result(before)
      class(transfer_operator), intent(in) :: operator
      real(wp), intent(in) :: function_of_state(:, :)   !! (newer, oldest)
      real(wp), allocatable :: before(:, :)
      real(wp) :: ahead(size(operator%nodes), size(function_of_state, 1))
      integer :: newer, oldest

      allocate (before, mold=function_of_state)
      ahead = reshape(function_of_state, shape(ahead))
      do oldest = 1, size(before, 2)
         do newer = 1, size(before, 1)
            before(newer, oldest) = dot_product(operator%kernel(:, newer, oldest), ahead(:, newer))
         end do
      end do
   end function backward

   !> Stationary expectation of a function of the state.
   pure function expectation(self, function_of_state) result(value)
      class(transfer_operator), intent(in) :: self
      real(wp), intent(in) :: function_of_state(:, :)   !! (newer, oldest)
      real(wp) :: value

      value = sum(self%left*self%right*function_of_state)
   end function expectation

   !> K(m), m = 0..n_lags.
   pure function autocovariance(self, n_lags) result(k)
      class(transfer_operator), intent(in) :: self
      integer, intent(in) :: n_lags
      real(wp) :: k(0:n_lags)
      real(wp), allocatable :: d(:, :), moving(:, :)
      integer :: m

      d = self%newest - self%expectation(self%newest)
      moving = self%left*d
      do m = 0, n_lags
         k(m) = sum(moving*self%right*d)
         moving = forward(self, moving)/self%perron
      end do
   end function autocovariance

end module transfer_operator_checks
