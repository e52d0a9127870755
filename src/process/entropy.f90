!> Entropies per point of Gaussian processes, in nats (Secs. 2.2, 2.3).
module process_entropy
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: gaussian_entropy, white_noise_entropy

   real(wp), parameter :: log_two_pi_e = 1.0_wp + log(8.0_wp*atan(1.0_wp))

contains

   !> Entropy rate of a Gaussian process, 0.5 ln(2 pi e b0^2): Eq. (37) per point as P grows.
   elemental function gaussian_entropy(b0) result(entropy)
      real(wp), intent(in) :: b0   !! std of the part that the past does not foretell [unit of X]
      real(wp) :: entropy

      entropy = 0.5_wp*log_two_pi_e + log(b0)
   end function gaussian_entropy

   !> Eq. (42) per point: no process of this std has more, and only white noise has as much.
   elemental function white_noise_entropy(std) result(entropy)
      real(wp), intent(in) :: std   !! sigma_X [unit of X]
      real(wp) :: entropy

      entropy = gaussian_entropy(std)
   end function white_noise_entropy

end module process_entropy
