!> Positive processes of order 1 by quadrature: their transfer kernel on Gauss nodes.
!>
!> With x_n = w_n + offset + r x_(n-1) both laws have a symmetric kernel. That of one-at-a-time
!> rejection, whose chain is reversible, is that of Eq. (25) over the root of the acceptances of
!> both values. r > 0: K(m) >= 0; r < 0: K(m) alternates, and -r may be larger than in any
!> stationary Gaussian process. Moments, sums over all lags and entropies are good to about 1e-10.
module process_positive_kernel
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use numerics_lapack, only: solve_linear_system, solve_positive_definite
   use numerics_quadrature, only: gauss_legendre
   use process_model, only: process_moments
   use process_positive_truncated_normal, only: hazard_ratio, log_acceptance, log_sqrt_two_pi
   implicit none(type, external)
   private
   public :: first_order_law, new_first_order_law

   !> The kernel of two neighbours x, y is exp(-s (x^2 + y^2)/4 + r x y + f (x + y)/2): r > 0 in
   !> units of b0, s = 1 + r^2; r < 0 in units of 1/sqrt(s), s = 1. For the sequential law s = 1,
   !> over the roots of both acceptances. The entropy is that of x/std; Lambda is known if r > 0.
   type, extends(process_moments) :: first_order_law
      logical :: is_sequential = .false.
      real(wp) :: r = 0.0_wp              !! -a_1; K(m) has the signs of r^m
      real(wp) :: slack = 1.0_wp          !! 1 - r
      real(wp) :: steepness = 1.0_wp      !! r < 0: s
      real(wp) :: field = 0.0_wp          !! exact law: f; sequential law: the offset
      real(wp) :: memory = 0.0_wp                !! |K(m + 1)/K(m)| for large m; r < 0 only
      real(wp), allocatable :: nodes(:)          !! (node)
      real(wp), allocatable :: next_weights(:)   !! (node) see `model%weights`
      !> (node, node) kernel over its Perron value, less its Perron part
      real(wp), allocatable, private :: kernel(:, :)
      real(wp), allocatable, private :: deviation(:)    !! (node) (x - mean) times Perron's vector
   contains
      procedure :: autocovariance
   end type first_order_law

   real(wp), parameter :: beyond = 8.5_wp   !! distance in std where a normal law ends, to 1e-16

contains

   !> Computes the law of these parameters with its moments and entropy. Fails if the nodes do not
   !> resolve it.
   subroutine new_first_order_law(r, slack, steepness, field, is_sequential, law, error)
      real(wp), intent(in) :: r, slack, steepness, field   !! see the type
      logical, intent(in) :: is_sequential
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: large = 60   ! lag
      real(wp), allocatable :: log_factor(:), vector(:), weights(:)
      real(wp) :: k(0:large), log_perron, log_scale, perron
      integer :: i

      law = first_order_law(is_sequential=is_sequential, r=r, slack=slack, steepness=steepness, &
                            field=field)
      call place_nodes(law, weights, log_factor, vector)
      log_scale = maxval(log_factor)
      log_factor = log_factor - log_scale
      associate (x => law%nodes)
         allocate (law%kernel(size(x), size(x)))
         do i = 1, size(x)
            law%kernel(:, i) = log_factor + log_factor(i) &
                               + merge(-0.5_wp*r*(x - x(i))**2, r*x*x(i), r > 0.0_wp)
            law%kernel(:, i) = sqrt(weights*weights(i))*exp(max(law%kernel(:, i), -700.0_wp))
         end do
      end associate
      if (is_sequential) then
         vector = sqrt(weights)*exp(max(vector - maxval(vector), -700.0_wp))
         vector = vector/norm2(vector)
         perron = dot_product(vector, matmul(law%kernel, vector))
      else
         call find_perron(law%kernel, vector, perron, error)
         if (allocated(error)) return
      end if
      law%kernel = law%kernel/perron
      law%next_weights = sqrt(weights)*exp(log_factor)*max(vector, 0.0_wp)
      do i = 1, size(vector)
         law%kernel(:, i) = law%kernel(:, i) - vector*vector(i)
      end do
      call compute_sums(law, vector, error)
      if (allocated(error)) return
      if (r < 0.0_wp) then
         k = law%autocovariance(large)
         law%memory = abs(k(large))/max(abs(k(large - 1)), tiny(k))
      end if
      log_perron = log(perron) + 2.0_wp*log_scale   ! ln Z per point
      if (is_sequential) then
         call compute_acceptances(law, field + r*law%nodes, vector**2)
      else   ! E[x_i dE/dx_i] = 1, E the exponent of the density
         law%entropy = log_perron + 0.5_wp - 0.5_wp*field*law%mean - log(law%std)
         if (r > 0.0_wp) law%lambda = exp(max(log_perron - log_sqrt_two_pi - &
                                              0.5_wp*(field/slack)**2, log(tiny(1.0_wp))))
      end if
   end subroutine new_first_order_law

   !> Distance from mu (mu < 0: from 0) beyond which there is no mass [b0].
   pure real(wp) function half_range_of(law) result(half_range)
      type(first_order_law), intent(in) :: law
      real(wp), parameter :: far = 38.0_wp     ! -ln of the mass that is left out
      real(wp) :: strength

      half_range = beyond/sqrt(law%slack*(1.0_wp + law%r))
      if (law%field >= 0.0_wp) return
      strength = max(-law%field, far/huge(1.0_wp))
      half_range = min(half_range, far/strength)
      if (law%is_sequential) then   ! (1 + r) mu slack is the rate, once a value is accepted surely
         half_range = min(half_range, (far - log_acceptance(-strength))/(strength*(1.0_wp + law%r)))
      else                          ! the square of Airy's function
         half_range = min(half_range, 10.0_wp/strength**(1.0_wp/3.0_wp))
      end if
   end function half_range_of

   !> Places Gauss nodes; the mass left out is below 1e-15. For r > 0 they are dense enough for the
   !> width of the kernel, for r < 0 denser near 0, where every other value is. Computes ln of each
   !> node's factor in the kernel, beside exp(-r (x - y)^2/2) or, for r < 0, exp(r x y); and for the
   !> sequential law ln of the root of the stationary density.
   pure subroutine place_nodes(law, weights, log_factor, vector)
      type(first_order_law), intent(inout) :: law
      real(wp), allocatable, intent(out) :: weights(:), log_factor(:), vector(:)   !! (node)
      integer, parameter :: fewest(2) = [48, 128]            ! nodes for r > 0, r < 0
      real(wp), parameter :: density(2) = [1.8_wp, 4.0_wp]   ! nodes per width of the kernel, per x
      real(wp), parameter :: far = 45.0_wp                   ! -ln of the mass that is left out
      real(wp), allocatable :: acceptance(:), c(:), t(:)
      real(wp) :: half_range, high, low, mu, r, slack   ! r, slack: 0, 1 for r < 0
      integer :: n, power

      r = max(law%r, 0.0_wp)
      slack = 1.0_wp
      if (law%r > 0.0_wp) then
         slack = law%slack
         mu = max(law%field, 0.0_wp)/slack**merge(1, 2, law%is_sequential)
         half_range = half_range_of(law)
         low = max(mu - half_range, 0.0_wp)
         high = mu + half_range
         n = fewest(1) + ceiling(density(1)*(high - low)*sqrt(r))
         power = 1
      else
         low = 0.0_wp
         high = max(law%field, 0.0_wp)/law%steepness + beyond/sqrt(law%steepness)
         if (law%field < 0.0_wp) high = min(high, -far/law%field)
         n = fewest(2) + ceiling(density(2)*min(high, 100.0_wp))
         power = 3
      end if
      allocate (t(n), weights(n))
      call gauss_legendre(0.0_wp, 1.0_wp, t, weights)
      law%nodes = low + (high - low)*t**power
      weights = power*(high - low)*t**(power - 1)*weights
      associate (x => law%nodes, f => law%field)
         if (.not. law%is_sequential) then
            log_factor = 0.5_wp*f*x - 0.25_wp*merge(slack**2, law%steepness, law%r > 0.0_wp)*x**2
            return
         end if
         c = f + law%r*x
         acceptance = 0.5_wp*log_acceptance(c)
         if (law%r < 0.0_wp) acceptance = -0.5_wp* &
               merge(log(hazard_ratio(min(c, 0.0_wp))), &
                     -0.5_wp*c**2 - log_sqrt_two_pi - log_acceptance(max(c, 0.0_wp)), c < 0.0_wp)
         log_factor = slack*(0.5_wp*f*x - 0.25_wp*slack*x**2) - acceptance
         vector = (1.0_wp + r)*(0.5_wp*f*x - 0.25_wp*slack*x**2) + acceptance
      end associate
   end subroutine place_nodes

   !> Finds the largest eigenvalue and its vector by power iteration, then by inverse iteration with
   !> shifts above the eigenvalue. Fails if the kernel is not finite.
   subroutine find_perron(kernel, vector, perron, error)
      real(wp), intent(in) :: kernel(:, :)               !! (n, n) symmetric, positive
      real(wp), allocatable, intent(out) :: vector(:)    !! (n) of norm 1
      real(wp), intent(out) :: perron
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: n_powers = 30, max_steps = 12
      real(wp), parameter :: settled = 1.0e-13_wp
      real(wp), allocatable :: next(:), shifted(:, :)
      real(wp) :: residual
      integer :: i, step

      allocate (vector(size(kernel, 1)), source=1.0_wp)
      do step = 1, n_powers
         next = matmul(kernel, vector)
         vector = next/norm2(next)
      end do
      do step = 0, max_steps
         next = matmul(kernel, vector)
         perron = dot_product(vector, next)
         residual = norm2(next - perron*vector)
         if (residual <= settled*perron) return
         shifted = kernel
         do i = 1, size(vector)
            shifted(i, i) = shifted(i, i) - (perron + residual)
         end do
         call solve_linear_system(shifted, vector, next, error)
         if (allocated(error)) return
         vector = next/sign(norm2(next), sum(next))
      end do
      call raise(error, exit_no_solution, 'positive process of order 1: nodes do not resolve it')
   end subroutine find_perron

   !> Computes mean, std and both lengths. With w = (x - mean) v, K(m) = w'A^m w; alternating |K(m)|
   !> are those of -A.
   subroutine compute_sums(law, vector, error)
      type(first_order_law), intent(inout) :: law
      real(wp), intent(in) :: vector(:)   !! (node)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: matrix(size(vector), size(vector)), variance, z(size(vector), 1)
      integer :: i

      law%mean = sum(law%nodes*vector**2)
      law%deviation = (law%nodes - law%mean)*vector
      variance = sum(law%deviation**2)
      law%std = sqrt(variance)
      do i = 1, size(vector)
         matrix(:, i) = -sign(1.0_wp, law%r)*law%kernel(:, i)
         matrix(i, i) = matrix(i, i) + 1.0_wp
      end do
      z(:, 1) = law%deviation
      call solve_positive_definite(matrix, z, error)
      if (allocated(error)) return
      law%l0 = dot_product(law%deviation, z(:, 1))/variance - 1.0_wp
      law%l1 = dot_product(z(:, 1), z(:, 1) - law%deviation)/dot_product(law%deviation, z(:, 1))
   end subroutine compute_sums

   !> Computes acceptances and entropy of the sequential law, E[ln sqrt(2 pi e) + ln alpha
   !> - c phi(c)/(2 alpha)].
   pure subroutine compute_acceptances(law, c, density)
      type(first_order_law), intent(inout) :: law
      real(wp), intent(in) :: c(:)         !! (node) conditional mean of the next value
      real(wp), intent(in) :: density(:)   !! (node) stationary density times weight
      real(wp) :: log_alpha(size(c))

      log_alpha = log_acceptance(c)
      law%acceptance_mean = sum(density*exp(max(log_alpha, -700.0_wp)))
      law%acceptance_ratio = 1.0_wp/sum(density*exp(min(-log_alpha, 700.0_wp)))
      law%acceptance_geometric = exp(max(sum(density*log_alpha), -700.0_wp))
      law%entropy = log_sqrt_two_pi + 0.5_wp - log(law%std) &
                    + sum(density*(log_alpha - 0.5_wp*c*hazard_ratio(c)))
   end subroutine compute_acceptances

   !> K(m), m = 0..n_lags.
   pure function autocovariance(self, n_lags) result(k)
      class(first_order_law), intent(in) :: self
      integer, intent(in) :: n_lags
      real(wp) :: k(0:n_lags)
      real(wp) :: moving(size(self%deviation))
      integer :: m

      moving = self%deviation
      do m = 0, n_lags
         k(m) = dot_product(self%deviation, moving)
         moving = matmul(self%kernel, moving)
      end do
   end function autocovariance

end module process_positive_kernel
