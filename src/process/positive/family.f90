!> Families of positive processes: parameters of a law as a function of the point of a search.
!> Everything is in units of b0.
!>
!> A positive process may exist though no Gaussian one has its coefficients. It exists if values so
!> large that noise and field are negligible do not grow.
module process_positive_family
   use core_kinds, only: wp
   use process_autoregressive_model, only: coefficients_of, reflection_of
   use process_autoregressive_spectral_factor, only: equivalent_process, symbol_of_process
   use process_positive_moments, only: batch_averages, positive_moments
   implicit none(type, external)
   private
   public :: law_estimate, parameter_family
   public :: by_coefficients, by_precision, by_symbol, by_reflection
   public :: is_confined_law, is_confined_sequence

   real(wp), parameter :: largest_kappa = 1.0_wp - 1.0e-6_wp
   real(wp), parameter :: outside = 40.0_wp   !! beyond any process, without overflow
   real(wp), parameter :: margin = 1.0e-5_wp   !! least of the sums in `couplings`
   !> golden section, whose multiples are spread evenly modulo 1
   real(wp), parameter :: golden = 0.61803398874989485_wp

   !> Kinds of points, each followed by asinh of the field: (ln factor of a symbol, its free s_m),
   !> atanh(kappa_1..kappa_order), and u_1..u_order of a_q or of 2 G_m/G_0, see `couplings`. A
   !> Gaussian process need not exist for the last two.
   integer, parameter :: by_symbol = 1, by_reflection = 2, by_coefficients = 3, by_precision = 4

   !> Kind of the points, and what they leave fixed.
   type :: parameter_family
      integer :: kind = by_reflection
      real(wp), allocatable :: start(:)   !! the companion's point without the field
      !> by_symbol: G_m/G_0 of the direct method where s_m = 1
      real(wp), allocatable :: direction(:)
      !> by_symbol: s_m, Eq. (30), and the lags whose s_m are unknowns
      real(wp), allocatable :: s(:)
      integer, allocatable :: free_lags(:)
   contains
      procedure :: is_near_start
      procedure :: is_weakly_correlated
      procedure :: signs_at
      procedure :: set_free_lags
      procedure :: point_of_order_1
      procedure :: set_parameters
   end type parameter_family

   !> Parameters of a law, and averages over its simulated values.
   type :: law_estimate
      real(wp), allocatable :: g(:)                  !! (0:order) row of G
      real(wp), allocatable :: a(:)                  !! a_q, Eq. (39); by_precision: none
      !> exact law: f of exp(- z'Gz/2 + f sum z); sequential law: conditional mean after zeros
      real(wp) :: field = 0.0_wp
      type(batch_averages) :: batches
      integer :: n_steps = 0                         !! values of a batch
      type(positive_moments) :: moments
   end type law_estimate

contains

   !> Sets the parameters of the law of a point, in units of b0 or (by_precision) of 1/sqrt(G_0).
   pure subroutine set_parameters(self, point, law, is_inside)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      type(law_estimate), intent(inout) :: law   !! a_q, G and field are set
      logical, intent(out) :: is_inside          !! false: there is no process
      real(wp), allocatable :: a(:)
      real(wp) :: kappa(size(law%g) - 1), unused
      logical :: is_positive

      law%field = sinh(max(-outside, min(point(size(point)), outside)))
      is_inside = abs(law%field) < 1.0e6_wp
      select case (self%kind)
      case (by_precision)
         law%g(:) = [1.0_wp, 0.5_wp*couplings(point(:size(kappa)))]
         if (is_inside) is_inside = is_confined_law(law%g)
         return
      case (by_coefficients)
         law%a = couplings(point(:size(kappa)))
         if (is_inside) is_inside = is_confined_sequence(law%a)
      case default
         if (self%kind == by_symbol) then
            call equivalent_process([1.0_wp, exp(min(point(1), outside))*self%direction &
                                     *self%signs_at(point)], a, unused, is_positive)
            kappa = 1.0_wp
            if (is_positive) kappa = reflection_of(a)
         else
            kappa = largest_kappa*tanh(point(:size(kappa)))
         end if
         is_inside = is_inside .and. all(abs(kappa) <= largest_kappa)
         if (is_inside) law%a = coefficients_of(kappa)
      end select
      if (is_inside) law%g(:) = symbol_of_process(law%a, 1.0_wp)
   end subroutine set_parameters

   !> True if the correlation is so weak that noise of the simulation hides how the entropy depends
   !> on its shape.
   pure logical function is_weakly_correlated(self, point)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      real(wp), parameter :: weak = 0.01_wp

      is_weakly_correlated = self%kind == by_reflection .and. norm2(point(:size(point) - 1)) < weak
   end function is_weakly_correlated

   !> True if the correlation of a point is less than twice as strong as the companion's.
   pure logical function is_near_start(self, point)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)

      if (self%kind == by_symbol) then
         is_near_start = point(1) < log(2.0_wp)
      else
         is_near_start = norm2(point(:size(point) - 1)) < 2.0_wp*norm2(self%start)
      end if
   end function is_near_start

   !> s_m at a point, m = 1..m_max (by_symbol).
   pure function signs_at(self, point) result(s)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      real(wp) :: s(size(self%s))

      s = self%s
      s(self%free_lags) = point(2:size(point) - 1)
   end function signs_at

   !> Makes s_m of these lags, and no others, unknowns (by_symbol); |s_m| > 1 becomes 1.
   pure subroutine set_free_lags(self, lags, point)
      class(parameter_family), intent(inout) :: self
      integer, intent(in) :: lags(:)
      real(wp), allocatable, intent(inout) :: point(:)

      self%s = max(-1.0_wp, min(1.0_wp, self%signs_at(point)))
      self%free_lags = lags
      point = [point(1), self%s(lags), point(size(point))]
   end subroutine set_free_lags

   !> Point, without the field, of the process of order 1 with this -a_1 or -G_1/G_0.
   pure function point_of_order_1(self, r, order) result(point)
      class(parameter_family), intent(in) :: self   !! not by_symbol
      real(wp), intent(in) :: r
      integer, intent(in) :: order
      real(wp) :: point(order)

      if (self%kind == by_reflection) then
         point = 0.0_wp
         point(1) = atanh(-r)
      else
         point = 1.0_wp
         point(1) = 1.0_wp - merge(2.0_wp, 1.0_wp, self%kind == by_precision)*r
         point = asinh(sqrt(point - margin))
      end if
   end function point_of_order_1

   !> a_q or 2 G_m/G_0. Values p apart, with all others near 0, drive each other to infinity unless
   !> 1 + a_p + a_2p + ... is positive: it is `margin` + sinh(u_p)^2. The maximum often lies at
   !> u_p = 0, or at coefficients that grow as b0 does.
   pure function couplings(u) result(coupling)
      real(wp), intent(in) :: u(:)
      real(wp) :: coupling(size(u))
      integer :: p

      do p = size(u), 1, -1
         coupling(p) = margin + sinh(max(-outside, min(u(p), outside)))**2 - 1.0_wp &
                       - sum(coupling(2*p::p))
      end do
   end function couplings

   !> True if the sequential law stays finite: x_n = max(0, - sum a_q x_(n-q)) does not grow.
   pure logical function is_confined_sequence(a) result(is_so)
      real(wp), intent(in) :: a(:)   !! a_q, Eq. (39)
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

   !> True if the exact law, Eq. (25), stays finite: descent along one value of a ring after the
   !> other finds no x >= 0 with x'Gx < 0.
   pure logical function is_confined_law(g) result(is_so)
      real(wp), intent(in) :: g(0:)   !! row of G
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

end module process_positive_family
