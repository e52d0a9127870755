!> Powers of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> The kernel is in a module of its own, because sums do not stay in registers if it is inlined.
module dynamics_exact_powers
   use, intrinsic :: iso_fortran_env, only: compiler_options
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: padded_rows, width
   implicit none(type, external)
   private
   public :: power_operator, add_power, find_powers

   !> Options of the compiler: -march=native is followed by all that it stands for.
   character(*), parameter :: options = compiler_options()
   logical, parameter :: has_avx512 = index(options, '-mavx512f ') > 0 .or. &
                                      index(options, '=skylake-avx512 ') > 0 .or. &
                                      index(options, '=x86-64-v4 ') > 0
   !> Lanes of a sum. Three rows of them fill 12 registers: AVX2 has 16, AVX-512 has 32.
   integer, parameter :: lanes = merge(32, 16, has_avx512)

   !> Rows of one power k + 2 that are found together. Places are those of joint_paths; those of
   !> powers 0 and 1 alternate from part to part (exchange_ends).
   type :: row_group
      integer :: row = 0                   !! the first of them
      integer :: from(0:1) = 0, to = 0     !! places of this row in powers k and k + 2
      integer :: first = 0, last = 0       !! its factors
      logical :: is_pair = .false.         !! True for two rows, else three
      logical :: has_pull = .false.        !! k = 0: the pull of the joints is a force
      real(wp) :: scale = 0.0_wp           !! -1/((k + 1)(k + 2))
   end type row_group

   !> Entries of K^, (k + 1) C^ or -h^2 M^-1 b in the rows of a group, and the place of what they
   !> multiply.
   type :: factor_type
      integer :: place(0:1) = 0
      real(wp) :: value(3) = 0.0_wp
   end type factor_type

   !> Factors of powers k and k + 1 and of the forces in powers k + 2 = 2 .. P. Rows are taken by
   !> threes, and the first by twos if their number is no multiple of three, so that what they
   !> multiply is loaded once.
   type :: power_operator
      integer :: n_groups = 0                        !! of one power
      type(row_group), allocatable :: groups(:)      !! those of power 2 first
      type(factor_type), allocatable :: factors(:)
   end type power_operator

contains

   !> Adds power k + 2, for paths of n_rows rows.
   pure subroutine add_power(operator, k, degree, n_rows, springs, damping, load)
      type(power_operator), intent(inout) :: operator
      integer, intent(in) :: k, degree, n_rows
      real(wp), intent(in) :: springs(:, :)   !! K^ without its diagonal (dof, dof)
      real(wp), intent(in) :: damping(:, :)   !! C^ without its negligible entries (dof, dof)
      real(wp), intent(in) :: load(:, :)      !! h^2 M^-1 b (dof, force)
      !> before: places before powers k and k + 1, and before the force
      integer :: before(3, 0:1), column, g, i, last, n, n_pairs, n_padded
      real(wp), allocatable :: entries(:, :)   ! (row, column)
      type(factor_type), allocatable :: factors(:)
      type(row_group), allocatable :: groups(:)

      n = size(springs, 1)
      n_padded = padded_rows(n_rows)
      before(:, 0) = [n_padded*k, n_padded*(k + 1), n_padded*(degree + 5) + size(load, 2)*k]
      before(:, 1) = before(:, 0) + merge(n_padded*(degree + 1), 0, [k <= 1, k == 0, .false.])
      allocate (entries(n + 1, 2*n + size(load, 2)), source=0.0_wp)
      entries(:n, :n) = springs
      entries(:n, n + 1:2*n) = (k + 1)*damping
      if (k <= 1) entries(:n, 2*n + 1:) = -load
      if (k == 0) allocate (operator%groups(0), operator%factors(0))
      n_pairs = min(modulo(-n, 3), (n + 1)/2)   ! a single row is taken with the padding after it
      operator%n_groups = (n + n_pairs + 1)/3
      allocate (groups(operator%n_groups), factors(count(abs(entries) > 0.0_wp)))
      last = 0
      do g = 1, size(groups)
         associate (group => groups(g))
            group%row = 3*g - 2 - min(g - 1, n_pairs)
            group%from = before(1, :) + group%row
            group%to = n_padded*(k + 2) + group%row
            group%first = size(operator%factors) + last + 1
            group%is_pair = g <= n_pairs
            group%has_pull = k == 0
            group%scale = -1.0_wp/((k + 1)*(k + 2))
            do column = 1, size(entries, 2)
               associate (rows => entries(group%row:group%row + merge(1, 2, group%is_pair), column))
                  if (.not. any(abs(rows) > 0.0_wp)) cycle
                  last = last + 1
                  factors(last)%value(:size(rows)) = rows
               end associate
               i = min((column - 1)/n, 2)   ! 0: power k, 1: power k + 1, 2: force
               factors(last)%place = before(1 + i, :) + column - n*i
            end do
            group%last = size(operator%factors) + last
         end associate
      end do
      operator%groups = [operator%groups, groups]
      operator%factors = [operator%factors, factors(:last)]
   end subroutine add_power

   !> Finds x_(k+2) = (f_k - K^ x_k - (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs for
   !> k = first .. last.
   pure subroutine find_powers(operator, first, last, turn, stiffness, pull, x)
      type(power_operator), intent(in) :: operator
      integer, intent(in) :: first, last
      integer, intent(in) :: turn   !! 0 or 1: which places powers 0 and 1 have
      real(wp), intent(in), dimension(lanes, width/lanes, *) :: stiffness, pull   !! (.., row)
      real(wp), intent(inout) :: x(lanes, width/lanes, *)                         !! (.., place)
      real(wp) :: a(lanes), b(lanes), c(lanes)
      integer :: e, from, g, i, s

      do g = operator%n_groups*first + 1, operator%n_groups*(last + 1)
         associate (group => operator%groups(g), factors => operator%factors)
            i = group%row
            from = group%from(turn)
            do s = 1, width/lanes
               a = stiffness(:, s, i)*x(:, s, from)
               b = stiffness(:, s, i + 1)*x(:, s, from + 1)
               if (group%has_pull) a = a - pull(:, s, i)
               if (group%has_pull) b = b - pull(:, s, i + 1)
               if (group%is_pair) then
                  do e = group%first, group%last
                     a = a + factors(e)%value(1)*x(:, s, factors(e)%place(turn))
                     b = b + factors(e)%value(2)*x(:, s, factors(e)%place(turn))
                  end do
               else
                  c = stiffness(:, s, i + 2)*x(:, s, from + 2)
                  if (group%has_pull) c = c - pull(:, s, i + 2)
                  do e = group%first, group%last
                     a = a + factors(e)%value(1)*x(:, s, factors(e)%place(turn))
                     b = b + factors(e)%value(2)*x(:, s, factors(e)%place(turn))
                     c = c + factors(e)%value(3)*x(:, s, factors(e)%place(turn))
                  end do
                  x(:, s, group%to + 2) = group%scale*c
               end if
               x(:, s, group%to) = group%scale*a
               x(:, s, group%to + 1) = group%scale*b
            end do
         end associate
      end do
   end subroutine find_powers

end module dynamics_exact_powers
