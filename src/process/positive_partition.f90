!> Normalizing constant and entropy of the exact law of Eq. (25), by integration over mu.
!>
!> With z = x/b0 the density is exp(- z'Gz/2 + field sum z)/Z, and psi is ln Z per point. Since
!> d psi/d field = E[z] and d ln Lambda/d mu = p_X(0), averages sampled at Gauss nodes on the way from
!> the Gaussian law, where psi is known, give psi.
module process_positive_partition
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_quadrature, only: gauss_legendre
   use process_ar_model, only: autocovariance_of, innovation_std, reflection_of
   use process_positive_exact, only: sample_exact
   use process_positive_moments, only: batch_averages, estimate_moments, new_batches, &
      positive_moments
   use process_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: log_partition, entropy_of_exact_law

   real(wp), parameter, public :: log_sqrt_two_pi = 0.91893853320467274_wp
   !> mu over the Gaussian std; p_X(0) is below 1e-11 there
   real(wp), parameter :: nowhere_near_zero = 7.0_wp

contains

   !> psi = ln sqrt(2 pi) + mu field/2 + ln Lambda (b0 = 1), and its standard error.
   subroutine log_partition(a, field, ring_length, n_burn_in, n_sweeps, stream, psi, standard_error)
      real(wp), intent(in) :: a(:)
      real(wp), intent(in) :: field         !! mu (1 + sum a_q)^2/b0
      integer, intent(in) :: ring_length
      integer, intent(in) :: n_burn_in, n_sweeps   !! sweeps, and sweeps of a batch
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: psi, standard_error
      integer, parameter :: n_nodes = 12, n_batches = 8*lanes
      real(wp) :: flat, location, nodes(n_nodes), top, variance, weights(n_nodes)
      type(positive_moments) :: moments
      integer :: i

      flat = (1.0_wp + sum(a))**2
      location = field/flat
      top = nowhere_near_zero/innovation_std(reflection_of(a), 1.0_wp)
      psi = log_sqrt_two_pi + 0.5_wp*max(location, 0.0_wp)*field
      variance = 0.0_wp
      if (location < top) then
         call gauss_legendre(max(location, 0.0_wp), top, nodes, weights)
         do i = 1, n_nodes
            call sample_node(nodes(i)*flat)
            if (moments%mean_error*flat < moments%at_zero_error) then
               psi = psi - weights(i)*(moments%mean - nodes(i))*flat
               variance = variance + (weights(i)*moments%mean_error*flat)**2
            else
               psi = psi - weights(i)*moments%at_zero
               variance = variance + (weights(i)*moments%at_zero_error)**2
            end if
         end do
      end if
      if (location < 0.0_wp) then
         call gauss_legendre(field, 0.0_wp, nodes, weights)
         do i = 1, n_nodes
            call sample_node(nodes(i))
            psi = psi - weights(i)*moments%mean
            variance = variance + (weights(i)*moments%mean_error)**2
         end do
      end if
      standard_error = sqrt(variance)

   contains

      subroutine sample_node(field_here)
         real(wp), intent(in) :: field_here
         type(batch_averages) :: batches

         batches = new_batches(1, n_batches)
         call sample_exact(a, field_here, a, max(field_here/flat, 0.5_wp), ring_length, n_burn_in, &
                           1, n_sweeps, &
                           stream, batches)
         moments = estimate_moments(batches, autocovariance_of(reflection_of(a), 1)/ &
                                    innovation_std(reflection_of(a), 1.0_wp)**2, 1, 0.0_wp, 0.0_wp)
      end subroutine sample_node

   end subroutine log_partition

   !> Entropy per point of x/b0, by E[x_i (G (x - mu))_i] = 1: Eq. (43) with its factor 1/2.
   elemental function entropy_of_exact_law(psi, field, mean) result(entropy)
      real(wp), intent(in) :: psi, field
      real(wp), intent(in) :: mean   !! E[x]/b0
      real(wp) :: entropy

      entropy = psi + 0.5_wp - 0.5_wp*field*mean
   end function entropy_of_exact_law

end module process_positive_partition
