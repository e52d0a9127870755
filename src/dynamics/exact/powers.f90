!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> The kernel is in a module of its own, because sums do not stay in registers if it is inlined.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: padded_rows, width
   use numerics_sparse, only: sparse_matrix, sparse_of
   implicit none(type, external)
   private
   public :: power_operator, new_power_operator, next_power

   !> Factors of powers k and k + 1 and of the forces in power k + 2: entries of K^, C^ and the load
   !> in one list. Rows are taken in pairs, so that what both multiply is loaded once; if their
   !> number is odd, the first pair is row 1 alone. Places are those of joint_paths; those of powers
   !> 0 and 1 alternate from part to part (exchange_ends).
   type :: power_operator
      integer :: from(0:1) = 0                  !! place before the first row of power k
      integer :: to = 0                         !! place before the first row of power k + 2
      integer :: n_single = 0                   !! rows without a pair: 1 if their number is odd
      logical :: has_pull = .false.             !! k = 0: the pull of the joints is a force
      real(wp) :: scale = 0.0_wp                !! -1/((k + 1)(k + 2))
      type(sparse_matrix) :: pairs              !! (pair, column) entries of one row or of both
      integer, allocatable :: place(:, :)       !! (entry, 0:1) what the entry multiplies
      real(wp), allocatable :: value(:, :)      !! (row, entry) K^, (k + 1) C^ or -h^2 M^-1 b
   end type power_operator

contains

   !> Operator of power k + 2 for paths of n_rows rows.
   pure function new_power_operator(k, degree, n_rows, springs, damping, load) result(operator)
      integer, intent(in) :: k, degree, n_rows
      real(wp), intent(in) :: springs(:, :)   !! K^ without its diagonal (dof, dof)
      real(wp), intent(in) :: damping(:, :)   !! C^ without its negligible entries (dof, dof)
      real(wp), intent(in) :: load(:, :)      !! h^2 M^-1 b (dof, force)
      type(power_operator) :: operator
      !> first: places before powers k and k + 1, and before the force
      integer :: first(3, 0:1), e, i, n, n_padded
      real(wp), allocatable :: entries(:, :)   ! (row, column)

      n = size(springs, 1)
      n_padded = padded_rows(n_rows)
      operator%to = n_padded*(k + 2)
      operator%has_pull = k == 0
      operator%scale = -1.0_wp/((k + 1)*(k + 2))
      first(:, 0) = [n_padded*k, n_padded*(k + 1), n_padded*(degree + 5) + size(load, 2)*k]
      first(:, 1) = first(:, 0) + merge(n_padded*(degree + 1), 0, [k <= 1, k == 0, .false.])
      operator%from = first(1, :)
      operator%n_single = modulo(n, 2)
      allocate (entries(1 - operator%n_single:n, 2*n + size(load, 2)), source=0.0_wp)
      entries(1:, :n) = springs
      entries(1:, n + 1:2*n) = (k + 1)*damping
      if (k <= 1) entries(1:, 2*n + 1:) = -load
      operator%pairs = sparse_of(abs(entries(lbound(entries, 1)::2, :)) &
                                 + abs(entries(lbound(entries, 1) + 1::2, :)))
      associate (column => operator%pairs%column, pair => operator%pairs%row_of_entries())
         allocate (operator%value(2, size(column)), operator%place(size(column), 0:1))
         do e = 1, size(column)
            i = 2*pair(e) - operator%n_single
            operator%value(:, e) = entries(i - 1:i, column(e))
            i = min((column(e) - 1)/n, 2)   ! 0: power k, 1: power k + 1, 2: force
            operator%place(e, :) = first(1 + i, :) + column(e) - n*i
         end do
      end associate
   end function new_power_operator

   !> Finds x_(k+2) = (f_k - K^ x_k - (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs.
   pure subroutine next_power(operator, turn, stiffness, pull, x)
      type(power_operator), intent(in) :: operator
      integer, intent(in) :: turn   !! 0 or 1: which places powers 0 and 1 have
      real(wp), intent(in), dimension(width, *) :: stiffness, pull   !! (.., row)
      real(wp), intent(inout) :: x(width, *)                         !! (.., place)
      real(wp) :: a(width), b(width), scale
      integer :: e, from, i, pair, to

      associate (start => operator%pairs%start, place => operator%place(:, turn), &
                 value => operator%value, n_single => operator%n_single)
         scale = operator%scale
         if (n_single > 0) then
            b = stiffness(:, 1)*x(:, operator%from(turn) + 1)
            if (operator%has_pull) b = b - pull(:, 1)
            do e = start(1), start(2) - 1
               b = b + value(2, e)*x(:, place(e))
            end do
            x(:, operator%to + 1) = scale*b
         end if
         do pair = 1 + n_single, operator%pairs%n_rows
            i = 2*pair - 1 - n_single
            from = operator%from(turn) + i
            to = operator%to + i
            a = stiffness(:, i)*x(:, from)
            b = stiffness(:, i + 1)*x(:, from + 1)
            if (operator%has_pull) a = a - pull(:, i)
            if (operator%has_pull) b = b - pull(:, i + 1)
            do e = start(pair), start(pair + 1) - 1
               a = a + value(1, e)*x(:, place(e))
               b = b + value(2, e)*x(:, place(e))
            end do
            x(:, to) = scale*a
            x(:, to + 1) = scale*b
         end do
      end associate
   end subroutine next_power

end module dynamics_exact_powers
