!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> The sums of a row fill four arrays of eight lanes, each one or two vector operations. A room by
!> itself: inlined where powers are expanded, the sums do not stay in registers.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_series, only: series_type
   implicit none(type, external)
   private
   public :: power_operator, next_power, power_operators

   integer, parameter :: lanes = 8, vectors = width/lanes

   !> Coefficients of power k + 2 by powers k and k + 1, entries of K^ and of C^ in one list. Places
   !> are those of rows in the paths, all layers one after another: those of powers 0 and 1 change
   !> from part to part, see exchange_ends of joint_paths.
   type :: power_operator
      integer :: n_rows = 0
      integer :: from(0:1) = 0                  !! place before the first row of power k
      integer :: to = 0                         !! of power k + 2
      logical :: pulls = .false.                !! k = 0: the joints' pull counts
      real(wp) :: scale = 0.0_wp                !! -1/((k + 1)(k + 2))
      integer, allocatable :: start(:)          !! (row + 1)
      integer, allocatable :: place(:, :)       !! (entry, 0:1)
      real(wp), allocatable :: value(:)         !! (entry) of K^, of (k + 1) C^
   end type power_operator

contains

   !> Forms the operators of all powers.
   subroutine power_operators(series, top, operators)
      type(series_type), intent(in) :: series
      integer, intent(in) :: top   !! rows of a layer
      type(power_operator), allocatable, intent(out) :: operators(:)   !! (0:degree - 2)
      integer :: e, i, k, layer(0:1, 0:1), n

      allocate (operators(0:series%degree - 2))
      do k = 0, series%degree - 2
         layer(:, 0) = [k, k + 1]
         layer(:, 1) = merge(series%degree + 1 + layer(:, 0), layer(:, 0), layer(:, 0) <= 1)
         associate (to => operators(k), springs => series%springs, damping => series%damping(k))
            to%n_rows = series%n_dof
            to%from = top*layer(0, :)
            to%to = top*(k + 2)
            to%pulls = k == 0
            to%scale = -1.0_wp/((k + 1)*(k + 2))
            n = size(springs%value) + size(damping%value)
            allocate (to%start(series%n_dof + 1), to%place(n, 0:1), to%value(n))
            n = 0
            do i = 1, series%n_dof
               to%start(i) = n + 1
               do e = springs%start(i), springs%start(i + 1) - 1
                  n = n + 1
                  to%place(n, :) = top*layer(0, :) + springs%column(e)
                  to%value(n) = springs%value(e)
               end do
               do e = damping%start(i), damping%start(i + 1) - 1
                  n = n + 1
                  to%place(n, :) = top*layer(1, :) + damping%column(e)
                  to%value(n) = damping%value(e)/to%scale
               end do
            end do
            to%start(series%n_dof + 1) = n + 1
         end associate
      end do
   end subroutine power_operators

   !> Finds x_(k+2) = -(K^ x_k + (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs.
   pure subroutine next_power(operator, turn, stiffness, pull, x)
      type(power_operator), intent(in) :: operator
      integer, intent(in) :: turn   !! 0 or 1: places of powers 0 and 1
      real(wp), intent(in), dimension(lanes, vectors, *) :: stiffness, pull   !! (.., row)
      real(wp), intent(inout) :: x(lanes, vectors, *)                         !! (.., place)
      real(wp), dimension(lanes) :: a1, a2, a3, a4
      real(wp) :: scale
      integer :: e, from, i, j, l, to

      scale = operator%scale
      do i = 1, operator%n_rows
         from = operator%from(turn) + i
         to = operator%to + i
         do l = 1, lanes
            a1(l) = stiffness(l, 1, i)*x(l, 1, from)
            a2(l) = stiffness(l, 2, i)*x(l, 2, from)
            a3(l) = stiffness(l, 3, i)*x(l, 3, from)
            a4(l) = stiffness(l, 4, i)*x(l, 4, from)
         end do
         if (operator%pulls) then
            do l = 1, lanes
               a1(l) = a1(l) - pull(l, 1, i)
               a2(l) = a2(l) - pull(l, 2, i)
               a3(l) = a3(l) - pull(l, 3, i)
               a4(l) = a4(l) - pull(l, 4, i)
            end do
         end if
         do e = operator%start(i), operator%start(i + 1) - 1
            j = operator%place(e, turn)
            do l = 1, lanes
               a1(l) = a1(l) + operator%value(e)*x(l, 1, j)
               a2(l) = a2(l) + operator%value(e)*x(l, 2, j)
               a3(l) = a3(l) + operator%value(e)*x(l, 3, j)
               a4(l) = a4(l) + operator%value(e)*x(l, 4, j)
            end do
         end do
         do l = 1, lanes
            x(l, 1, to) = scale*a1(l)
            x(l, 2, to) = scale*a2(l)
            x(l, 3, to) = scale*a3(l)
            x(l, 4, to) = scale*a4(l)
         end do
      end do
   end subroutine next_power

end module dynamics_exact_powers
