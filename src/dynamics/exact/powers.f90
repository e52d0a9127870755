!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> A room by itself: inlined where powers are expanded, the sums of a row do not stay in registers.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, width
   use dynamics_exact_series, only: series_type
   implicit none(type, external)
   private
   public :: power_operator, next_power, power_operators

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

   !> Forms the operators of all powers.
   subroutine power_operators(series, paths, operators)
      type(series_type), intent(in) :: series
      type(joint_paths), intent(in) :: paths
      type(power_operator), allocatable, intent(out) :: operators(:)   !! (0:degree - 2)
      integer :: e, f, i, k, layer(0:1, 0:1), loaded, n, n_forces, top

      top = paths%top
      n_forces = size(series%load, 2)
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
            n = size(springs%value) + size(damping%value) + size(series%load)
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
               loaded = findloc(series%loaded, i, 1)
               if (k > 1 .or. loaded == 0) cycle
               do f = 1, n_forces
                  n = n + 1
                  to%place(n, :) = size(paths%x(1, :, :)) + n_forces*k + f
                  to%value(n) = -series%load(loaded, f)
               end do
            end do
            to%start(series%n_dof + 1) = n + 1
         end associate
      end do
   end subroutine power_operators

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
