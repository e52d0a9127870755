!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> A room by itself: inlined where powers are expanded, the sums of a row do not stay in registers.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: padded_rows, width
   use numerics_sparse, only: sparse_matrix, sparse_of
   implicit none(type, external)
   private
   public :: power_operator, new_power_operator, next_power

   !> Coefficients of power k + 2 by powers k and k + 1 and by the forces, entries of K^, C^ and of
   !> the load in one list. Places are those of joint_paths: those of powers 0 and 1 change from
   !> part to part, see exchange_ends there.
   type :: power_operator
      integer :: n_rows = 0
      integer :: from(0:1) = 0                  !! place before the first row of power k
      integer :: to = 0                         !! of power k + 2
      logical :: pulls = .false.                !! k = 0: the joints' pull counts
      real(wp) :: scale = 0.0_wp                !! -1/((k + 1)(k + 2))
      integer, allocatable :: start(:)          !! (row + 1)
      integer, allocatable :: place(:, :)       !! (entry, 0:1)
      real(wp), allocatable :: value(:)         !! (entry) of K^, of (k + 1) C^, of -h^2 M^-1 b
   end type power_operator

contains

   !> Forms the operator of power k + 2 for paths of so many rows.
   pure function new_power_operator(k, degree, n_rows, springs, damping, load) result(operator)
      integer, intent(in) :: k, degree, n_rows
      real(wp), intent(in) :: springs(:, :)   !! K^ without its diagonal (dof, dof)
      real(wp), intent(in) :: damping(:, :)   !! C^, what counts of it (dof, dof)
      real(wp), intent(in) :: load(:, :)      !! h^2 M^-1 b (dof, force)
      type(power_operator) :: operator
      type(sparse_matrix) :: entries
      integer :: first(3, 0:1), top, turn   ! first: place before that of column 1 of each

      top = padded_rows(n_rows)
      operator%n_rows = size(springs, 1)
      operator%to = top*(k + 2)
      operator%pulls = k == 0
      operator%scale = -1.0_wp/((k + 1)*(k + 2))
      first(:, 0) = [top*k, top*(k + 1), top*(degree + 5) + size(load, 2)*k]
      first(:, 1) = first(:, 0) + merge(top*(degree + 1), 0, [k <= 1, k == 0, .false.])
      operator%from = first(1, :)
      entries = sparse_of(reshape([springs, (k + 1)*damping, -merge(load, 0.0_wp, k <= 1)], &
                                  [operator%n_rows, 2*operator%n_rows + size(load, 2)]))
      operator%start = entries%start
      operator%value = entries%value
      allocate (operator%place(size(entries%value), 0:1))
      associate (of => min((entries%column - 1)/operator%n_rows, 2))
         do turn = 0, 1
            operator%place(:, turn) = first(1 + of, turn) + entries%column - operator%n_rows*of
         end do
      end associate
   end function new_power_operator

   !> Finds x_(k+2) = (f_k - K^ x_k - (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs.
   pure subroutine next_power(operator, turn, stiffness, pull, x)
      type(power_operator), intent(in) :: operator
      integer, intent(in) :: turn   !! 0 or 1: places of powers 0 and 1
      real(wp), intent(in), dimension(width, *) :: stiffness, pull   !! (.., row)
      real(wp), intent(inout) :: x(width, *)                         !! (.., place)
      real(wp) :: force(width), scale
      integer :: e, from, i, j, l, to

      scale = operator%scale
      do i = 1, operator%n_rows
         from = operator%from(turn) + i
         to = operator%to + i
         do l = 1, width
            force(l) = stiffness(l, i)*x(l, from)
         end do
         if (operator%pulls) then
            do l = 1, width
               force(l) = force(l) - pull(l, i)
            end do
         end if
         do e = operator%start(i), operator%start(i + 1) - 1
            j = operator%place(e, turn)
            do l = 1, width
               force(l) = force(l) + operator%value(e)*x(l, j)
            end do
         end do
         do l = 1, width
            x(l, to) = scale*force(l)
         end do
      end do
   end subroutine next_power

end module dynamics_exact_powers
