!> Entropy per point of Gaussian processes, in nats (Secs. 2.2, 2.3).
module process_entropy
   use core_kinds, only: two_pi, wp
   implicit none(type, external)
   private
   public :: gaussian_entropy

   real(wp), parameter :: log_two_pi_e = 1.0_wp + log(two_pi)

contains

   !> Entropy rate of a Gaussian process, 0.5 ln(2 pi e b0^2): limit of Eq. (37) per point. With
   !> b0 = sigma_X it is that of white noise, Eq. (42), the largest one for this std.
   elemental function gaussian_entropy(b0) result(entropy)
      real(wp), intent(in) :: b0   !! std of the innovations [unit of X]
      real(wp) :: entropy

      entropy = 0.5_wp*log_two_pi_e + log(b0)
   end function gaussian_entropy

end module process_entropy
