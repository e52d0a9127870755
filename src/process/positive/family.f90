!> Families of positive processes: how a point, whose last component is asinh of the coordinate for
!> mu, becomes the parameters of a law. All is in units of b0.
!>
!> Positive values may be kept finite though no Gaussian process has their coefficients: large ones,
!> among which neither noise nor field counts, must not grow.
module process_positive_family
   use core_kinds, only: wp
   use process_autoregressive_model, only: coefficients_of, reflection_of
   use process_autoregressive_spectral_factor, only: equivalent_process, symbol_of_process
   use process_positive_moments, only: batch_averages, positive_moments
   implicit none(type, external)
   private
   public :: law_estimate, parameter_family
   public :: by_coefficients, by_precision, by_symbol, free
   public :: is_confined_law, is_confined_sequence

   real(wp), parameter :: largest_kappa = 1.0_wp - 1.0e-6_wp
   real(wp), parameter :: margin = 1.0e-5_wp   !! of a face
   real(wp), parameter :: golden = 0.61803398874989485_wp   !! multiples are spread evenly modulo 1

   !> (ln factor of a symbol, its free s_m, coordinate), (atanh(kappa_1..kappa_order), coordinate),
   !> (asinh(a_1..a_order), coordinate), or (asinh(G_1..G_order over G_0), coordinate): of the last
   !> two no Gaussian process need exist, and coefficients may grow as b0 does, without bound.
   integer, parameter :: by_symbol = 1, free = 2, by_coefficients = 3, by_precision = 4

   !> How points become parameters.
   type :: parameter_family
      integer :: kind = free
      real(wp), allocatable :: start(:)   !! a point of the companion, but for its coordinate
      !> by_symbol: G_m/G_0 of the direct method where s_m = 1
      real(wp), allocatable :: direction(:)
      !> by_symbol: s_m, Eq. (30), and the lags where it stands in a point, after the factor
      real(wp), allocatable :: s(:)
      integer, allocatable :: free(:)
      !> by_coefficients, by_precision: ascending; values so far apart could just grow together, and
      !> coefficients of these lags follow from the others and are not in a point
      integer, allocatable :: faces(:)
   contains
      procedure :: is_near
      procedure :: is_weak
      procedure :: all_signs
      procedure :: set_free
      procedure :: add_face
      procedure :: room
      procedure :: unfold
   end type parameter_family

   !> Parameters of a law, and what the simulated values say of it.
   type :: law_estimate
      real(wp), allocatable :: g(:)                  !! (0:order) row of G
      real(wp), allocatable :: a(:)                  !! a_q, Eq. (39); by_precision: none
      real(wp) :: coordinate = 0.0_wp                !! see `sampled_problem`
      type(batch_averages) :: batches
      type(positive_moments) :: moments
   end type law_estimate

contains

   !> Computes the parameters of a point's law, in units of b0 or, by_precision, of 1/sqrt(G_0).
   pure subroutine unfold(self, point, law, is_inside)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      type(law_estimate), intent(inout) :: law   !! its coefficients, G and coordinate
      logical, intent(out) :: is_inside          !! false: no process is there
      real(wp), parameter :: outside = 40.0_wp   ! of any process: nothing overflows
      real(wp), allocatable :: a(:)
      real(wp) :: kappa(size(law%g) - 1), unused
      logical :: is_positive

      law%coordinate = sinh(max(-outside, min(point(size(point)), outside)))
      is_inside = abs(law%coordinate) < 1.0e6_wp
      if (size(self%faces) > 0) is_inside = is_inside .and. law%coordinate < 0.0_wp   ! or they grow
      select case (self%kind)
      case (by_precision)
         law%g(:) = [1.0_wp, 0.5_wp*couplings(self, point)]
         is_inside = is_inside .and. all(self%room(point) > 0.0_wp)
         if (is_inside) is_inside = is_confined_law(law%g)
         return
      case (by_coefficients)
         law%a = couplings(self, point)
         is_inside = is_inside .and. all(self%room(point) > 0.0_wp)
         if (is_inside) is_inside = is_confined_sequence(law%a)
      case default
         if (self%kind == by_symbol) then
            call equivalent_process([1.0_wp, exp(min(point(1), outside))*self%direction &
                                     *self%all_signs(point)], a, unused, is_positive)
            kappa = 1.0_wp
            if (is_positive) kappa = reflection_of(a)
         else
            kappa = largest_kappa*tanh(point(:size(kappa)))
         end if
         is_inside = is_inside .and. all(abs(kappa) <= largest_kappa)
         if (is_inside) law%a = coefficients_of(kappa)
      end select
      if (is_inside) law%g(:) = symbol_of_process(law%a, 1.0_wp)
   end subroutine unfold

   !> True if the correlation is so weak that the entropy does not feel its shape above the noise of
   !> a sample: that of the unconstrained process is kept.
   pure logical function is_weak(self, point)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      real(wp), parameter :: weak = 0.01_wp

      is_weak = self%kind == free .and. norm2(point(:size(point) - 1)) < weak
   end function is_weak

   !> True if the correlation of a point is not stronger than twice that of the companion.
   pure logical function is_near(self, point)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)

      if (self%kind == by_symbol) then
         is_near = point(1) < log(2.0_wp)
      else
         is_near = norm2(point(:size(point) - 1)) < 2.0_wp*norm2(self%start)
      end if
   end function is_near

   !> by_symbol: s_m of a point, m = 1..m_max.
   pure function all_signs(self, point) result(s)
      class(parameter_family), intent(in) :: self
      real(wp), intent(in) :: point(:)
      real(wp) :: s(size(self%s))

      s = self%s
      s(self%free) = point(2:size(point) - 1)
   end function all_signs

   !> Moves, by_symbol, s_m of these lags, and no others, into a point; one beyond 1 becomes 1.
   pure subroutine set_free(self, lags, point)
      class(parameter_family), intent(inout) :: self
      integer, intent(in) :: lags(:)
      real(wp), allocatable, intent(inout) :: point(:)

      self%s = max(-1.0_wp, min(1.0_wp, self%all_signs(point)))
      self%free = lags
      point = [point(1), self%s(lags), point(size(point))]
   end subroutine set_free

   !> Puts a point onto the face of this lag: its coefficient follows from the others from now on.
   pure subroutine add_face(self, lag, point)
      class(parameter_family), intent(inout) :: self   !! by_coefficients or by_precision
      integer, intent(in) :: lag
      real(wp), allocatable, intent(inout) :: point(:)
      integer :: i

      i = count(self%faces < lag)
      point = [point(:lag - i - 1), point(lag - i + 1:)]
      self%faces = [self%faces(:i), lag, self%faces(i + 1:)]
   end subroutine add_face

   !> a_q, or 2 G_m/G_0, lags 1..order: those of faces from the others.
   pure function couplings(family, point) result(all_lags)
      type(parameter_family), intent(in) :: family
      real(wp), intent(in) :: point(:)
      real(wp), allocatable :: all_lags(:)
      integer :: i

      all_lags = merge(2.0_wp, 1.0_wp, family%kind == by_precision)*sinh(point(:size(point) - 1))
      do i = 1, size(family%faces)
         associate (p => family%faces(i))
            all_lags = [all_lags(:p - 1), 0.0_wp, all_lags(p:)]
         end associate
      end do
      do i = size(family%faces), 1, -1
         associate (p => family%faces(i))
            all_lags(p) = margin - 1.0_wp - sum(all_lags(2*p::p))
         end associate
      end do
   end function couplings

   !> Room, for each p, that is left until values p apart, all others near 0, drive each other to
   !> infinity.
   pure function room(self, point)
      class(parameter_family), intent(in) :: self   !! by_coefficients or by_precision
      real(wp), intent(in) :: point(:)
      real(wp), allocatable :: room(:)
      integer :: p

      associate (coupling => couplings(self, point))
         room = [(1.0_wp + sum(coupling(p::p)) - 0.5_wp*margin, p=1, size(coupling))]
      end associate
   end function room

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

end module process_positive_family
