!> Positive processes of first order without sampling: the transfer kernel on Gauss nodes.
!>
!> Under both laws the kernel is symmetric: that of Eq. (25) by itself; that of one-at-a-time
!> rejection because its chain is reversible, whence it is the other one over the root of the
!> acceptances of both values. Moments, sums over all lags and entropies are good to about 1e-10.
!> Everything is in units of b0.
module process_positive_kernel
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: solve_linear_system, solve_positive_definite, &
      solve_symmetric_eigenproblem
   use numerics_quadrature, only: gauss_legendre
   use process_positive_partition, only: entropy_of_exact_law, log_sqrt_two_pi
   use process_positive_truncated_normal, only: hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: first_order_law, new_first_order_law, new_alternating_law

   !> x_n = w_n + mu (1 - r) + r x_(n-1), kept positive by one law or the other.
   type :: first_order_law
      real(wp) :: r = 0.0_wp              !! -a_1, in (0, 1]
      real(wp) :: slack = 1.0_wp          !! 1 - r; at 0 mu is minus infinity, its coordinate finite
      real(wp) :: coordinate = 0.0_wp     !! mu slack^2; sequential law: mu slack
      logical :: is_sequential = .false.
      real(wp) :: mean = 0.0_wp, std = 0.0_wp
      real(wp) :: l0 = 0.0_wp, l1 = 0.0_wp       !! infinite sums
      real(wp) :: entropy = 0.0_wp               !! per point
      real(wp) :: memory = 0.0_wp                !! |K(m + 1)/K(m)| for large m; alternating only
      real(wp) :: log_lambda = 0.0_wp            !! exact law: ln Lambda, Eq. (45)
      !> sequential law: 1/E[1/alpha], E[alpha], exp E[ln alpha]
      real(wp) :: acceptance_ratio = 1.0_wp, acceptance_mean = 1.0_wp, acceptance_geometric = 1.0_wp
      !> K(m) changes its sign with every lag: the kernel is exp(-steepness (x^2 + y^2)/4 - coupling
      !> x y + field (x + y)/2), for the sequential law over the roots of both acceptances; r, slack
      !> and coordinate are not used. Units in which steepness = 1; steepness = 0 where mu is minus
      !> infinity
      logical :: is_alternating = .false.
      real(wp) :: steepness = 1.0_wp, coupling = 0.0_wp, field = 0.0_wp
      real(wp), allocatable :: nodes(:)          !! (node)
      real(wp), allocatable :: ahead(:)          !! (node) alternating: see `model%weights`
      real(wp), allocatable, private :: kernel(:, :)    !! (node, node), its Perron value is 1
      real(wp), allocatable, private :: deviation(:)    !! (node) (x - mean) times Perron's vector
   contains
      procedure :: autocovariance
   end type first_order_law

contains

   !> All that is known of the law of these parameters. Fails where LAPACK does.
   subroutine new_first_order_law(r, slack, coordinate, is_sequential, law, error)
      real(wp), intent(in) :: r, slack, coordinate   !! as in the type
      logical, intent(in) :: is_sequential
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: nodes(:), vector(:), weights(:)
      real(wp) :: perron

      law%r = r
      law%slack = slack
      law%coordinate = coordinate
      law%is_sequential = is_sequential
      call place_nodes(law, nodes, weights)
      law%nodes = nodes
      law%kernel = kernel_of(law, nodes, sqrt(weights))
      if (is_sequential) then
         vector = stationary_vector(law, nodes, sqrt(weights))
         perron = dot_product(vector, matmul(law%kernel, vector))
      else
         call find_perron(law%kernel, vector, perron, error)
         if (allocated(error)) return
      end if
      law%kernel = law%kernel/perron
      call describe_sums(law, nodes, vector, error)
      if (is_sequential) then
         call describe_acceptances(law, law%coordinate + law%r*nodes, vector**2)
      else
         call describe_partition(law, log(perron))
      end if
   end subroutine new_first_order_law

   !> The law whose K(m) alternates. Its G may be indefinite: every coupling > 0 has a law where
   !> steepness > 0, or steepness = 0 and field < 0.
   subroutine new_alternating_law(steepness, coupling, field, is_sequential, law, error)
      real(wp), intent(in) :: steepness, coupling, field   !! see the type
      logical, intent(in) :: is_sequential
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: n_nodes = 128
      real(wp), parameter :: nodes_per_unit = 4.0_wp
      real(wp), allocatable :: part(:), t(:), vector(:), weights(:)
      real(wp) :: log_scale, perron, reach
      integer :: i, n

      law%is_alternating = .true.
      law%is_sequential = is_sequential
      law%steepness = steepness
      law%coupling = coupling
      law%field = field
      reach = reach_of_field(law)
      n = n_nodes + ceiling(nodes_per_unit*min(reach, 100.0_wp))
      allocate (t(n), weights(n))
      call gauss_legendre(0.0_wp, 1.0_wp, t, weights)
      law%nodes = reach*t**3   ! denser towards 0, where every other value is
      weights = 3.0_wp*reach*t**2*weights
      part = 0.5_wp*field*law%nodes - 0.25_wp*steepness*law%nodes**2
      if (is_sequential) then
         vector = part - half_log_hazard(law)
         vector = sqrt(weights)*exp(vector - maxval(vector))
         vector = vector/norm2(vector)
         part = part + half_log_hazard(law)
      end if
      log_scale = maxval(part)
      allocate (law%kernel(n, n))
      do i = 1, n
         law%kernel(:, i) = part - log_scale + (part(i) - log_scale) &
                            - coupling*law%nodes*law%nodes(i)
         law%kernel(:, i) = sqrt(weights*weights(i))*exp(max(law%kernel(:, i), -700.0_wp))
      end do
      if (is_sequential) then
         perron = dot_product(vector, matmul(law%kernel, vector))
      else
         call find_perron(law%kernel, vector, perron, error)
         if (allocated(error)) return
      end if
      law%kernel = law%kernel/perron
      law%ahead = sqrt(weights)*exp(part - log_scale)*max(vector, 0.0_wp)
      call describe_sums(law, law%nodes, vector, error)
      if (allocated(error)) return
      law%memory = decay_of(law, vector)
      if (is_sequential) then
         if (steepness > 0.0_wp) &
            call describe_acceptances(law, field - coupling*law%nodes, vector**2)
      else   ! h = ln Z per point + E[energy]
         associate (k => law%autocovariance(1))   ! of lags 0 and 1
            law%entropy = log(perron) + 2.0_wp*log_scale - field*law%mean + 0.5_wp*steepness* &
                          (k(1) + law%mean**2) + coupling*(k(2) + law%mean**2)
         end associate
      end if
   end subroutine new_alternating_law

   !> Modulus of the second eigenvalue.
   pure function decay_of(law, perron) result(decay)
      type(first_order_law), intent(in) :: law
      real(wp), intent(in) :: perron(:)   !! (node) the first eigenvector, of norm 1
      real(wp) :: decay
      integer, parameter :: n_powers = 60
      real(wp) :: next(size(perron)), vector(size(perron))
      integer :: m

      vector = law%deviation/norm2(law%deviation)
      do m = 1, n_powers
         next = matmul(law%kernel, vector)
         next = next - perron*dot_product(perron, next)
         decay = norm2(next)
         vector = next/decay
      end do
   end function decay_of

   !> No mass to speak of beyond.
   pure function reach_of_field(law) result(reach)
      type(first_order_law), intent(in) :: law
      real(wp) :: reach
      real(wp), parameter :: beyond = 8.5_wp   ! of a normal law [std]
      real(wp), parameter :: far = 45.0_wp     ! -ln of what is left out

      reach = huge(1.0_wp)
      if (law%steepness > 0.0_wp) reach = max(law%field, 0.0_wp)/law%steepness &
                                          + beyond/sqrt(law%steepness)
      if (law%field < 0.0_wp) reach = min(reach, -far/law%field)
   end function reach_of_field

   !> Sequential law: half of ln (phi(c)/Phi(c)), c = field - coupling x; for steepness 0 its limit
   !> but for a constant.
   pure function half_log_hazard(law) result(value)
      type(first_order_law), intent(in) :: law
      real(wp) :: value(size(law%nodes))
      real(wp) :: c(size(law%nodes))

      c = law%field - law%coupling*law%nodes
      if (law%steepness > 0.0_wp) then
         value = 0.5_wp*merge(log(hazard_ratio(min(c, 0.0_wp))), &
                              -0.5_wp*c**2 - log_sqrt_two_pi - log_acceptance(max(c, 0.0_wp)), &
                              c < 0.0_wp)
      else
         value = 0.5_wp*log(-c)
      end if
   end function half_log_hazard

   !> Gauss nodes where the mass is, dense enough for the kernel's width; what is left out is below
   !> 1e-15.
   pure subroutine place_nodes(law, nodes, weights)
      type(first_order_law), intent(in) :: law
      real(wp), allocatable, intent(out) :: nodes(:), weights(:)
      integer, parameter :: fewest = 48
      real(wp), parameter :: density = 1.8_wp   ! of nodes, over the width of the kernel
      real(wp) :: high, low, reach
      integer :: n

      reach = reach_of(law)
      low = max(positive_mu(law) - reach, 0.0_wp)
      high = positive_mu(law) + reach
      n = fewest + ceiling(density*(high - low)*sqrt(law%r))
      allocate (nodes(n), weights(n))
      call gauss_legendre(low, high, nodes, weights)
   end subroutine place_nodes

   !> How far the mass goes beyond mu, or beyond 0 where mu < 0.
   pure function reach_of(law) result(reach)
      type(first_order_law), intent(in) :: law
      real(wp) :: reach
      real(wp), parameter :: beyond = 8.5_wp   ! of a normal law [std]
      real(wp), parameter :: far = 38.0_wp     ! -ln of what is left out
      real(wp) :: strength

      reach = huge(1.0_wp)
      if (law%slack > 0.0_wp) reach = beyond/sqrt(law%slack*(1.0_wp + law%r))
      if (law%coordinate >= 0.0_wp) return
      strength = max(-law%coordinate, far/huge(1.0_wp))
      reach = min(reach, far/strength)
      if (law%is_sequential) then   ! (1 + r) mu slack is the rate, once a value is accepted surely
         reach = min(reach, (far - log_acceptance(-strength))/(strength*(1.0_wp + law%r)))
      else                          ! the square of Airy's function
         reach = min(reach, 10.0_wp/strength**(1.0_wp/3.0_wp))
      end if
   end function reach_of

   !> The symmetric kernel with the roots of the weights; for mu < 0 without exp(-(mu slack)^2/2).
   pure function kernel_of(law, nodes, roots) result(kernel)
      type(first_order_law), intent(in) :: law
      real(wp), intent(in) :: nodes(:), roots(:)   !! (node)
      real(wp) :: kernel(size(nodes), size(nodes))
      real(wp) :: part(size(nodes))
      integer :: i

      part = -0.25_wp*(law%slack*(nodes - positive_mu(law)))**2 + 0.5_wp*negative_field(law)*nodes
      if (law%is_sequential) part = part - 0.5_wp*scaled_acceptance(law, nodes)
      do i = 1, size(nodes)
         kernel(:, i) = roots*roots(i)*exp(max(part + part(i) - 0.5_wp*law%r*(nodes - nodes(i))**2 &
                                               - log_sqrt_two_pi, -700.0_wp))
      end do
   end function kernel_of

   !> mu where it is positive, else 0: what the kernel is centred on.
   elemental function positive_mu(law) result(mu)
      type(first_order_law), intent(in) :: law
      real(wp) :: mu

      mu = 0.0_wp
      if (law%coordinate > 0.0_wp) mu = law%coordinate/law%slack**merge(1, 2, law%is_sequential)
   end function positive_mu

   !> mu slack^2 where it is negative, else 0.
   elemental function negative_field(law) result(field)
      type(first_order_law), intent(in) :: law
      real(wp) :: field

      field = min(law%coordinate, 0.0_wp)*merge(law%slack, 1.0_wp, law%is_sequential)
   end function negative_field

   !> Sequential law: ln alpha after a value, for mu < 0 times exp((mu slack)^2/2).
   elemental function scaled_acceptance(law, x) result(value)
      type(first_order_law), intent(in) :: law
      real(wp), intent(in) :: x
      real(wp) :: value

      value = log_acceptance(law%coordinate + law%r*x) + 0.5_wp*min(law%coordinate, 0.0_wp)**2
   end function scaled_acceptance

   !> Sequential law: the root of the stationary density, which is known.
   pure function stationary_vector(law, nodes, roots) result(vector)
      type(first_order_law), intent(in) :: law
      real(wp), intent(in) :: nodes(:), roots(:)
      real(wp) :: vector(size(nodes))

      vector = (1.0_wp + law%r)*(min(law%coordinate, 0.0_wp)*nodes - 0.5_wp*law%slack* &
                                 (nodes - positive_mu(law))**2) + scaled_acceptance(law, nodes)
      vector = roots*exp(max(0.5_wp*(vector - maxval(vector)), -700.0_wp))
      vector = vector/norm2(vector)
   end function stationary_vector

   !> The largest eigenvalue and its vector, the only one of one sign: inverse iteration, at first
   !> from above (Noda), where no other value is nearer; and all pairs where that ends elsewhere.
   subroutine find_perron(kernel, vector, perron, error)
      real(wp), intent(in) :: kernel(:, :)               !! (n, n) symmetric, positive
      real(wp), allocatable, intent(out) :: vector(:)    !! (n) of norm 1
      real(wp), intent(out) :: perron
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: n_powers = 30, n_above = 3, max_steps = 12
      real(wp), parameter :: settled = 1.0e-13_wp, rounding = 1.0e-10_wp
      real(wp), allocatable :: next(:), shifted(:, :), values(:), vectors(:, :)
      real(wp) :: shift
      integer :: i, step

      allocate (vector(size(kernel, 1)), source=1.0_wp)
      do step = 1, n_powers
         next = matmul(kernel, vector)
         vector = next/norm2(next)
      end do
      next = matmul(kernel, vector)
      perron = dot_product(vector, next)
      do step = 1, max_steps
         shift = perron
         if (step <= n_above) shift = bound_above(next, vector)
         shifted = kernel
         do i = 1, size(vector)
            shifted(i, i) = shifted(i, i) - shift
         end do
         call solve_linear_system(shifted, vector, next, error)
         if (allocated(error)) exit   ! the shift is the eigenvalue itself
         vector = next/sign(norm2(next), sum(next))
         next = matmul(kernel, vector)
         perron = dot_product(vector, next)
         if (norm2(next - perron*vector) <= settled*perron) exit
      end do
      if (allocated(error)) deallocate (error)
      if (all(vector >= -rounding*maxval(vector)) .and. step <= max_steps) return
      shifted = 0.0_wp*kernel
      do i = 1, size(vector)
         shifted(i, i) = 1.0_wp
      end do
      call solve_symmetric_eigenproblem(kernel, shifted, values, vectors, error)
      if (allocated(error)) return
      perron = values(size(values))
      vector = vectors(:, size(values))
      vector = vector*sign(1.0_wp, sum(vector))
   end subroutine find_perron

   !> Of the largest eigenvalue (Collatz, Wielandt), by the components that count.
   pure function bound_above(image, vector) result(bound)
      real(wp), intent(in) :: image(:), vector(:)   !! A v, v
      real(wp) :: bound
      real(wp) :: least

      least = 1.0e-3_wp*maxval(vector)
      bound = maxval(image/max(vector, least), mask=vector >= least)
   end function bound_above

   !> Mean, std and both lengths: with w = (x - mean) v the lags are K(m) = w'A^m w, |K(m)| the same
   !> of -A where they alternate.
   subroutine describe_sums(law, nodes, vector, error)
      type(first_order_law), intent(inout) :: law
      real(wp), intent(in) :: nodes(:), vector(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: matrix(size(nodes), size(nodes)), variance, z(size(nodes), 1)
      integer :: i

      law%mean = sum(nodes*vector**2)
      law%deviation = (nodes - law%mean)*vector
      variance = sum(law%deviation**2)
      law%std = sqrt(variance)
      do i = 1, size(nodes)
         matrix(:, i) = vector*vector(i) &
                        - merge(-1.0_wp, 1.0_wp, law%is_alternating)*law%kernel(:, i)
         matrix(i, i) = matrix(i, i) + 1.0_wp
      end do
      z(:, 1) = law%deviation
      call solve_positive_definite(matrix, z, error)
      if (allocated(error)) return
      law%l0 = dot_product(law%deviation, z(:, 1))/variance - 1.0_wp
      law%l1 = dot_product(z(:, 1), z(:, 1) - law%deviation)/dot_product(law%deviation, z(:, 1))
   end subroutine describe_sums

   !> Exact law: Lambda and the entropy.
   pure subroutine describe_partition(law, log_perron)
      type(first_order_law), intent(inout) :: law
      real(wp), intent(in) :: log_perron
      real(wp) :: psi

      law%log_lambda = log_perron
      if (law%coordinate < 0.0_wp .and. law%slack > 0.0_wp) &
         law%log_lambda = log_perron - 0.5_wp*(law%coordinate/law%slack)**2
      psi = log_sqrt_two_pi + log_perron + 0.5_wp*positive_mu(law)*law%coordinate
      law%entropy = entropy_of_exact_law(psi, law%coordinate, law%mean)
   end subroutine describe_partition

   !> Sequential law: acceptances, and E[ln sqrt(2 pi e) + ln alpha - c phi(c)/(2 alpha)].
   pure subroutine describe_acceptances(law, c, density)
      type(first_order_law), intent(inout) :: law
      real(wp), intent(in) :: c(:)         !! (node) conditional mean of the next value
      real(wp), intent(in) :: density(:)   !! (node) weights included
      real(wp) :: log_alpha(size(c))

      log_alpha = log_acceptance(c)
      law%acceptance_mean = sum(density*exp(max(log_alpha, -700.0_wp)))
      law%acceptance_ratio = 1.0_wp/sum(density*exp(min(-log_alpha, 700.0_wp)))
      law%acceptance_geometric = exp(max(sum(density*log_alpha), -700.0_wp))
      law%entropy = log_sqrt_two_pi + 0.5_wp &
                    + sum(density*(log_alpha - 0.5_wp*c*hazard_ratio(c)))
   end subroutine describe_acceptances

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
