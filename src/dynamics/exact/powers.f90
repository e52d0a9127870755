!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> A room by itself: inlined where powers are expanded, the sums of a row do not stay in registers.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_series, only: series_type
   implicit none(type, external)
   private
   public :: power_operator, next_power, power_operators

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
