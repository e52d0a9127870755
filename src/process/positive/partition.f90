!> Normalizing constant and entropy of the exact law of Eq. (25), by integration over the strength
!> of its correlation.
!>
!> With z = x/b0 the density is exp(- z'Gz/2 + field sum z)/Z, and psi is ln Z per point. Where all
!> entries of G off its diagonal are multiplied by t, psi is known at t = 0, and its derivative is
!> - sum G_k E[z_i z_(i+k)]: averages sampled at Gauss nodes give psi at t = 1. No law on the way is
!> more correlated than the last one.
module process_positive_partition
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_quadrature, only: gauss_legendre
   use process_autoregressive_model, only: autocovariance_of, innovation_std, reflection_of
   use process_autoregressive_spectral_factor, only: factor_symbol, symbol_of_process
   use process_positive_exact, only: sample_exact
   use process_positive_moments, only: batch_averages, estimate_products, new_batches
   use process_positive_truncated_normal, only: lanes, log_acceptance, log_sqrt_two_pi
   implicit none(type, external)
   private
   public :: log_partition, entropy_of_exact_law

   real(wp), parameter :: between_nodes = 1.0e-6_wp   !! error of the integration at L0 = 10

contains

   !> psi = ln sqrt(2 pi) + mu field/2 + ln Lambda (b0 = 1), and its standard error.
   subroutine log_partition(a, field, ring_length, n_burn_in, n_sweeps, stream, psi, standard_error)
      real(wp), intent(in) :: a(:)
      real(wp), intent(in) :: field         !! mu (1 + sum a_q)^2/b0
      integer, intent(in) :: ring_length
      integer, intent(in) :: n_burn_in, n_sweeps   !! sweeps, and sweeps of a batch
      class(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: psi, standard_error
      integer, parameter :: n_nodes = 16
      real(wp) :: error, g(0:size(a)), mu, nodes(n_nodes), slope, symbol(0:size(a)), variance, &
         weights(n_nodes)
      integer :: i

      g = symbol_of_process(a, 1.0_wp)
      mu = max(field, 0.0_wp)/(1.0_wp + sum(a))**2
      psi = log_sqrt_two_pi - 0.5_wp*log(g(0))
      if (field > 0.0_wp) then
         psi = psi + 0.5_wp*mu*field + log_acceptance(mu*sqrt(g(0)))
      else
         psi = psi + 0.5_wp*field**2/g(0) + log_acceptance(field/sqrt(g(0)))
      end if
      variance = 0.0_wp
      ! t = u (2 - u): denser towards t = 1, where a long correlation grows fast
      call gauss_legendre(0.0_wp, 1.0_wp, nodes, weights)
      do i = 1, n_nodes
         symbol = g*nodes(i)*(2.0_wp - nodes(i))
         symbol(0) = g(0)
         call sample_slope(symbol, mu, min(field, 0.0_wp), ring_length, n_burn_in, n_sweeps, &
                           stream, slope, error)
         weights(i) = weights(i)*2.0_wp*(1.0_wp - nodes(i))/(nodes(i)*(2.0_wp - nodes(i)))
         psi = psi + weights(i)*slope
         variance = variance + (weights(i)*error)**2
      end do
      standard_error = norm2([sqrt(variance), between_nodes])
   end subroutine log_partition

   !> - sum G_k E[(z_i - mu)(z_(i+k) - mu)], k > 0, under the law of this G, centred on mu.
   subroutine sample_slope(g, mu, field, ring_length, n_burn_in, n_sweeps, stream, slope, &
                           standard_error)
      real(wp), intent(in) :: g(0:)
      real(wp), intent(in) :: mu             !! not negative
      real(wp), intent(in) :: field          !! a further one, not positive
      integer, intent(in) :: ring_length, n_burn_in, n_sweeps
      class(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: slope, standard_error
      integer, parameter :: n_batches = 8*lanes
      type(batch_averages) :: batches
      real(wp) :: a(ubound(g, 1)), b0, companion(0:ubound(g, 1)), field_here, kappa(ubound(g, 1)), &
         weights(0:ubound(g, 1))
      integer :: order
      logical :: is_positive

      order = ubound(g, 1)
      a = 0.0_wp
      b0 = 1.0_wp/sqrt(g(0))
      call factor_symbol(g, a, b0, is_positive)
      kappa = reflection_of(a)
      companion = autocovariance_of(kappa, order)/innovation_std(kappa, 1.0_wp)**2
      field_here = mu/b0*(1.0_wp + sum(a))**2 + b0*field
      batches = new_batches(order, order, n_batches)
      call sample_exact(a, field_here, a, max(mu/b0, 0.5_wp), ring_length, n_burn_in, n_sweeps, &
                        stream, batches)
      weights = -b0**2*g
      weights(0) = 0.0_wp
      call estimate_products(batches, companion, weights, mu/b0, slope, standard_error)
   end subroutine sample_slope

   !> Entropy per point of x/b0, by E[x_i (G (x - mu))_i] = 1: Eq. (43) with its factor 1/2.
   elemental function entropy_of_exact_law(psi, field, mean) result(entropy)
      real(wp), intent(in) :: psi, field
      real(wp), intent(in) :: mean   !! E[x]/b0
      real(wp) :: entropy

      entropy = psi + 0.5_wp - 0.5_wp*field*mean
   end function entropy_of_exact_law

end module process_positive_partition
