!> Laws whose positive values are kept finite though no Gaussian process has their coefficients:
!> large values, among which neither noise nor field counts, must not grow.
module process_positive_confinement
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: is_confined_sequence, is_confined_law

   real(wp), parameter :: golden = 0.61803398874989485_wp   !! multiples are spread evenly modulo 1

contains

   !> True if x_n = max(0, - sum a_q x_(n-q)) does not grow: sequential law.
   pure function is_confined_sequence(a) result(is_so)
      real(wp), intent(in) :: a(:)   !! a_q, Eq. (39)
      logical :: is_so
      integer, parameter :: n_starts = 4
      real(wp), parameter :: growth = 1.01_wp
      real(wp) :: x(1 - size(a):12*size(a) + 180)
      integer :: i, n, third

      third = ubound(x, 1)/3
      is_so = .true.
      do i = 1, n_starts
         x(:0) = [(modulo(n*n*i*golden, 1.0_wp), n=1, size(a))]
         do n = 1, ubound(x, 1)
            x(n) = max(0.0_wp, -dot_product(a, x(n - 1:n - size(a):-1)))
            if (x(n) > 1.0e100_wp) exit
         end do
         is_so = n > ubound(x, 1)
         if (is_so) is_so = maxval(x(2*third:)) <= growth*maxval(x(third:2*third))
         if (.not. is_so) return
      end do
   end function is_confined_sequence

   !> True if x'Gx is not found negative for any x >= 0, by descent along one value after the other
   !> on a ring: Eq. (25).
   pure function is_confined_law(g) result(is_so)
      real(wp), intent(in) :: g(0:)   !! row of G
      logical :: is_so
      integer, parameter :: n_starts = 4, n_sweeps = 40
      real(wp), parameter :: rounding = 1.0e-4_wp
      real(wp), allocatable :: x(:)
      real(wp) :: energy, pull
      integer :: i, k, n, order, sweep

      order = ubound(g, 1)
      n = 60*((4*order + 59)/60)
      is_so = .true.
      do i = 1, n_starts
         x = [(modulo(k*k*i*golden, 1.0_wp), k=1 - order, n + order)]
         do sweep = 1, n_sweeps
            x = x/maxval(x)
            do k = order + 1, order + n
               pull = dot_product(g(1:), x(k + 1:k + order) + x(k - 1:k - order:-1))
               x(k) = max(0.0_wp, -pull/g(0))
               if (k <= 2*order) x(k + n) = x(k)
               if (k > n) x(k - n) = x(k)
            end do
            if (.not. maxval(x) > 0.0_wp) exit
         end do
         if (.not. maxval(x) > 0.0_wp) cycle
         energy = 0.0_wp
         do k = order + 1, order + n
            energy = energy + x(k)*(g(0)*x(k) + dot_product(g(1:), x(k + 1:k + order) &
                                                            + x(k - 1:k - order:-1)))
         end do
         is_so = energy >= -rounding*g(0)*sum(x(order + 1:order + n)**2)
         if (.not. is_so) return
      end do
   end function is_confined_law

end module process_positive_confinement
