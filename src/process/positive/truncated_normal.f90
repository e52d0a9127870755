!> The normal law N(m, b^2) truncated at 0: moments, probability of acceptance, draws, fit.
!>
!> Everything is a function of c = m/b, accurate to c = -1000 and beyond, at a cost that does not
!> grow there. Kernels have no branches and an exponential of their own, so that loops over lanes
!> become vector instructions.
module process_positive_truncated_normal
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: rounded_text
   use numerics_elementary, only: log_one_plus
   use numerics_roots, only: root_search
   implicit none(type, external)
   private
   public :: lanes, draw_truncated, draw_truncated_lanes, reciprocal_std, smallest_of
   public :: add_logarithms, scale_below
   public :: log_acceptance, hazard_ratio
   public :: fit_truncated_normal

   !> chains simulated side by side
   integer, parameter :: lanes = 32

   real(wp), parameter :: sqrt_two_pi = 2.5066282746310005_wp
   real(wp), parameter, public :: log_sqrt_two_pi = 0.91893853320467274_wp
   real(wp), parameter :: ln2 = 0.693147180559945309_wp

contains

   !> Draws x > 0 in units of b, where the truncated distribution function is 1 - u.
   !>
   !> Phi(c), the probability of acceptance, is factor exp(-max(-c, 0)^2/2); hazard: phi(c)/Phi(c).
   elemental subroutine draw_truncated(c, u, x, hazard, factor)
      real(wp), intent(in) :: c   !! conditional mean over b
      real(wp), intent(in) :: u   !! uniform on (0, 1)
      real(wp), intent(out) :: x, hazard, factor
      real(wp) :: beyond, density, excess, lower, mills, rest, tail, upper

      beyond = max(-c, 0.0_wp)
      tail = abs(c)
      mills = mills_ratio(tail)
      density = exp_in_range(-0.5_wp*min(tail, 37.0_wp)**2)/sqrt_two_pi
      rest = mills*density   ! the mass beyond |c|, where c > 0
      factor = merge(mills/sqrt_two_pi, 1.0_wp - rest, c < 0.0_wp)
      hazard = merge(1.0_wp, density, c < 0.0_wp)/merge(mills, 1.0_wp - rest, c < 0.0_wp)
      ! c < 0: distance beyond -c; c > 0: distance from the mode, on the side of x
      upper = u*(1.0_wp - rest)
      lower = (1.0_wp - u) + u*rest
      excess = tail_excess(beyond, merge(mills, 0.5_wp*sqrt_two_pi, c < 0.0_wp), &
                           merge(hazard, 2.0_wp/sqrt_two_pi, c < 0.0_wp), &
                           merge(u, 2.0_wp*min(upper, lower), c < 0.0_wp))
      x = merge(excess, merge(c + excess, max(c - excess, 0.0_wp), upper < lower), c < 0.0_wp)
   end subroutine draw_truncated

   !> Draws as `draw_truncated` on all lanes: by the quantile of the normal law, in a fifth of the
   !> time, and again where one of eight lanes lies in a tail. Three short loops keep the processor
   !> busier than one long chain of operations.
   pure subroutine draw_truncated_lanes(c, u, x, hazard, factor)
      real(wp), intent(in) :: c(lanes), u(lanes)
      real(wp), intent(out) :: x(lanes), hazard(lanes), factor(lanes)
      integer, parameter :: group = 8
      real(wp), parameter :: least = 5.0e-4_wp   ! mass of a tail where `quantile_over` is accurate
      real(wp), dimension(lanes) :: excess, logarithm, product
      real(wp) :: accepted, density, lower, mills, refused, rest, smallest, upper
      integer :: first, lane

      !$omp simd private(accepted, density, lower, mills, refused, rest, upper)
      do lane = 1, lanes
         mills = mills_ratio(abs(c(lane)))
         density = exp_in_range(-0.5_wp*min(abs(c(lane)), 37.0_wp)**2)*(1.0_wp/sqrt_two_pi)
         rest = mills*density
         accepted = merge(rest, 1.0_wp - rest, c(lane) < 0.0_wp)
         refused = merge(1.0_wp - rest, rest, c(lane) < 0.0_wp)
         factor(lane) = merge(mills*(1.0_wp/sqrt_two_pi), accepted, c(lane) < 0.0_wp)
         hazard(lane) = density/accepted
         upper = u(lane)*accepted   ! masses above and below x without truncation
         lower = (1.0_wp - u(lane)) + u(lane)*refused
         excess(lane) = lower - upper
         product(lane) = upper*lower
      end do
      !$omp simd
      do lane = 1, lanes
         logarithm(lane) = log_in_range(4.0_wp*max(product(lane), 0.5_wp*least))
      end do
      !$omp simd
      do lane = 1, lanes
         x(lane) = max(c(lane) + excess(lane)*quantile_over(logarithm(lane)), 0.0_wp)
      end do
      do first = 1, lanes, group
         smallest = 1.0_wp
         !$omp simd reduction(min:smallest)
         do lane = first, first + group - 1
            smallest = min(smallest, product(lane))
         end do
         if (smallest >= least) cycle   ! P Q >= least: so are P and Q
         !$omp simd
         do lane = first, first + group - 1
            call draw_truncated(c(lane), u(lane), x(lane), hazard(lane), factor(lane))
         end do
      end do
   end subroutine draw_truncated_lanes

   !> Quantile z of the normal law over P(z) - Q(z), its masses below and above z, to 2e-15 if both
   !> hold more than 4.9e-4: a polynomial in ln(4 P Q) (Giles, 2010, double precision, times
   !> sqrt(2)), whose even and odd powers are summed apart.
   elemental real(wp) function quantile_over(logarithm) result(ratio)
      real(wp), intent(in) :: logarithm   !! ln(4 P Q)
      real(wp) :: even, odd, w, w2

      w = -logarithm - 3.125_wp
      w2 = w**2
      even = 1.81846378190284969e-18_wp + w2*(-5.15397696781012493e-21_wp)
      even = 9.38703787173438966e-15_wp + w2*(-1.88538944658049627e-16_wp + w2*even)
      even = -1.8349609420632127e-11_wp + w2*(-1.15285759018266929e-13_wp + w2*even)
      even = -4.11117114576401115e-8_wp + w2*(1.48663865386436384e-9_wp + w2*even)
      even = 0.000264082049560762567_wp + w2*(-1.93106506176078158e-6_wp + w2*even)
      even = 2.33862071002659333_wp + w2*(-0.00853289917727200786_wp + w2*even)
      odd = 1.57796219395632292e-17_wp + w2*(-2.38303348661772711e-19_wp)
      odd = -5.73402261278207024e-14_wp + w2*(2.96599727706975096e-17_wp + w2*odd)
      odd = -7.65854917302220659e-11_wp + w2*(3.72434459034478561e-12_wp + w2*odd)
      odd = 5.9888943161980891e-7_wp + w2*(-5.81614275208314919e-9_wp + w2*odd)
      odd = -0.00104751156950205557_wp + w2*(-0.0000196328528196139709_wp + w2*odd)
      odd = 0.339634958701140721_wp + w2*odd
      ratio = even + w*odd
   end function quantile_over

   !> 1/std of the truncated law, times b, to 1e-10; far in the tail, where the variance cancels, of
   !> a lower bound of it with the same first two terms in 1/c^2.
   pure function reciprocal_std(c, hazard)
      real(wp), intent(in) :: c(lanes), hazard(lanes)   !! see `draw_truncated`
      real(wp) :: reciprocal_std(lanes)
      real(wp), parameter :: far = -30.0_wp
      real(wp) :: variance(lanes)
      integer :: lane

      variance = 1.0_wp - hazard*(c + hazard)
      if (smallest_of(c) < far) variance = max(variance, 1.0_wp/(c**2 + 6.0_wp))
      !$omp simd
      do lane = 1, lanes
         reciprocal_std(lane) = reciprocal_root(variance(lane))
      end do
   end function reciprocal_std

   !> 1/sqrt(x) to 1e-10, in a quarter of the time of a root and a division: Newton steps after
   !> halving the exponent (Lomont, 2003, of least error over all x: 3.4e-2).
   elemental real(wp) function reciprocal_root(x) result(root)
      real(wp), intent(in) :: x   !! normal, positive
      integer(long), parameter :: start = int(z'5FE6EB50C7B537A9', long)

      root = transfer(start - ishft(transfer(x, 1_long), -1), root)
      root = root*(1.5_wp - 0.5_wp*x*root**2)   ! to 1.8e-3
      root = root*(1.5_wp - 0.5_wp*x*root**2)   ! to 4.7e-6
      root = root*(1.5_wp - 0.5_wp*x*root**2)
   end function reciprocal_root

   !> Smallest value of all lanes, by vector instructions.
   pure real(wp) function smallest_of(x) result(smallest)
      real(wp), intent(in) :: x(lanes)
      integer :: lane

      smallest = x(1)
      !$omp simd reduction(min:smallest)
      do lane = 1, lanes
         smallest = min(smallest, x(lane))
      end do
   end function smallest_of

   !> Multiplies the factor of `draw_truncated` by exp(-c^2/2) if c < 0, which gives the probability
   !> of acceptance, but not below exp(-600). Adds the exponents to `sums`.
   pure subroutine scale_below(c, acceptance, sums)
      real(wp), intent(in) :: c(lanes)
      real(wp), intent(inout) :: acceptance(lanes), sums(lanes)
      real(wp) :: excess
      integer :: lane

      !$omp simd private(excess)
      do lane = 1, lanes
         excess = -0.5_wp*min(c(lane), 0.0_wp)**2
         sums(lane) = sums(lane) + excess
         acceptance(lane) = acceptance(lane)*exp_in_range(max(excess, -600.0_wp))
      end do
   end subroutine scale_below

   !> Adds ln x to `sums` on all lanes.
   pure subroutine add_logarithms(x, sums)
      real(wp), intent(in) :: x(lanes)
      real(wp), intent(inout) :: sums(lanes)
      integer :: lane

      !$omp simd
      do lane = 1, lanes
         sums(lane) = sums(lane) + log_in_range(x(lane))
      end do
   end subroutine add_logarithms

   !> ln Phi(c): logarithm of the probability of acceptance.
   elemental real(wp) function log_acceptance(c) result(value)
      real(wp), intent(in) :: c

      if (c < 0.0_wp) then
         value = log(mills_ratio(-c)) - 0.5_wp*c**2 - log_sqrt_two_pi
      else
         value = log_one_plus(-0.5_wp*erfc(c/sqrt(2.0_wp)))
      end if
   end function log_acceptance

   !> phi(c)/Phi(c): mean of the truncated law over b, less c.
   elemental real(wp) function hazard_ratio(c) result(hazard)
      real(wp), intent(in) :: c

      if (c < 0.0_wp) then
         hazard = 1.0_wp/mills_ratio(-c)
      else
         hazard = exp(-0.5_wp*min(c, 37.0_wp)**2)/sqrt_two_pi/(1.0_wp - 0.5_wp*erfc(c/sqrt(2.0_wp)))
      end if
   end function hazard_ratio

   !> Computes mean and variance of the truncated law in units of b and b^2, to 1e-10 relatively.
   !> Far below 0, where 1/hazard = 1/(x + 1/(x + 2/(x + ...))) at x = -c, nothing cancels.
   elemental subroutine relative_moments(c, mean, variance)
      real(wp), intent(in) :: c
      real(wp), intent(out) :: mean, variance
      real(wp), parameter :: far = -20.0_wp
      integer, parameter :: n_fractions = 16
      real(wp) :: rest
      integer :: k

      if (c > far) then
         mean = c + hazard_ratio(c)
         variance = 1.0_wp - (mean - c)*mean
      else
         rest = 0.0_wp
         do k = n_fractions, 2, -1
            rest = k/(rest - c)
         end do
         mean = 1.0_wp/(rest - c)
         variance = mean*(rest - mean)
      end if
   end subroutine relative_moments

   !> Fits the truncated normal law of this mean and std. It exists if 0 < std < mean; at std = mean
   !> it becomes the exponential law, with mu = -infinity.
   pure subroutine fit_truncated_normal(mean, std, mu, sigma, error)
      real(wp), intent(in) :: mean, std
      real(wp), intent(out) :: mu, sigma
      type(error_type), allocatable, intent(out) :: error
      type(root_search) :: search
      real(wp) :: c, last, m, v
      integer :: i

      mu = 0.0_wp
      sigma = 0.0_wp
      if (.not. (std > 0.0_wp .and. std < mean)) then
         call raise(error, exit_no_solution, 'positive law with std/mean = '// &
                    rounded_text(std/mean, 6)//': needs 0 < std < mean, '// &
                    'the limit of the exponential law')
         return
      end if
      c = mean/std   ! 1/c is about std/mean, which falls with c, for c >> 1
      do i = 1, 200
         last = c
         call relative_moments(c, m, v)
         call search%advance(c, log(std*m/(sqrt(v)*mean)))
         if (.not. abs(c - last) > spacing(last)) exit
      end do
      sigma = mean/m
      mu = last*sigma
   end subroutine fit_truncated_normal

   !> Distance t >= 0 with Q(k + t) = u Q(k), Q the upper tail of the normal law, mills =
   !> Q(k)/phi(k), hazard = 1/mills. Two Halley steps reach 1e-12 of t for every k >= 0.
   elemental real(wp) function tail_excess(k, mills, hazard, u) result(t)
      real(wp), intent(in) :: k, mills, hazard, u
      real(wp) :: exponent, slope

      ! first guess: -ln u is the integral of the hazard, which is nearly linear
      exponent = max(-log_in_range(u), 0.0_wp)
      slope = min(max(hazard*(hazard - k), 0.6_wp), 1.0_wp)
      slope = (slope + 0.06_wp*exponent)/(1.0_wp + 0.06_wp*exponent)
      t = 2.0_wp*exponent/(hazard + sqrt(hazard**2 + 2.0_wp*slope*exponent))
      t = halley_step(t, k, u*mills)
      t = max(halley_step(t, k, u*mills), 0.0_wp)
   end function tail_excess

   !> t after one Halley step on ln Q(k + t) = ln u + ln Q(k).
   elemental real(wp) function halley_step(t, k, target) result(next)
      real(wp), intent(in) :: t, k
      real(wp), intent(in) :: target   !! u Q(k)/phi(k)
      real(wp) :: mills, residual, s, wanted

      mills = mills_ratio(k + t)
      wanted = target*exp_in_range(t*(k + 0.5_wp*t))
      s = (wanted - mills)/(wanted + mills)
      ! ln(wanted/mills)
      residual = 2.0_wp*s*(1.0_wp + s**2*(1.0_wp/3.0_wp + s**2*(0.2_wp + s**2/7.0_wp)))
      next = t - mills*residual/(1.0_wp - 0.5_wp*residual*(1.0_wp - (k + t)*mills))
   end function halley_step

   !> Q(x)/phi(x) for x >= 0, to 4e-16: (1 + x) Q/phi as a Chebyshev series in (x - 5)/(x + 5),
   !> computed in 40 digits and written in powers, even and odd ones apart.
   elemental real(wp) function mills_ratio(x) result(ratio)
      real(wp), intent(in) :: x
      real(wp) :: even, inverse, odd, y, y2

      inverse = 1.0_wp/((x + 5.0_wp)*(x + 1.0_wp))
      y = (x - 5.0_wp)*(x + 1.0_wp)*inverse
      y2 = y**2
      even = 9.09247613401914649e-9_wp + y2*(-7.07389857556158864e-10_wp)
      even = 3.20543166525895722e-7_wp + y2*(-6.58897449110895375e-8_wp + y2*even)
      even = -0.0000248058384519231898_wp + y2*(-1.76332392657367463e-7_wp + y2*even)
      even = -0.00420129032918730683_wp + y2*(0.000457043923579536555_wp + y2*even)
      even = -0.0661776007790963056_wp + y2*(-0.0380265921858413864_wp + y2*even)
      even = 1.15684862829189458_wp + y2*(0.0777815988687376876_wp + y2*even)
      odd = 1.10320711515743365e-8_wp + y2*(-9.56483293471255114e-10_wp)
      odd = 4.91996233147834049e-7_wp + y2*(-7.75852023678634269e-8_wp + y2*odd)
      odd = 0.0000227096127092376818_wp + y2*(-3.2772876332088651e-6_wp + y2*odd)
      odd = 0.0000195306383707907867_wp + y2*(-0.000134374278557113508_wp + y2*odd)
      odd = 0.0615050458401864988_wp + y2*(0.016348231281029381_wp + y2*odd)
      odd = -0.229487538252113159_wp + y2*(0.0250721793016388_wp + y2*odd)
      ratio = (even + y*odd)*(x + 5.0_wp)*inverse
   end function mills_ratio

   !> exp(x) for |x| < 700, to a unit in the last place or two.
   elemental real(wp) function exp_in_range(x) result(value)
      real(wp), intent(in) :: x
      real(wp), parameter :: ln2_high = 0.693147180369123816490_wp, &
         ln2_low = 1.90821492927058770002e-10_wp
      real(wp), parameter :: rounder = 6755399441055744.0_wp   ! 1.5 2^52: adding it rounds
      integer :: i
      real(wp), parameter :: c(2:13) = 1.0_wp/[(gamma(i + 1.0_wp), i=2, 13)]   ! 1/i!
      real(wp) :: n, r

      n = x*1.44269504088896341_wp + rounder
      r = (x - (n - rounder)*ln2_high) - (n - rounder)*ln2_low
      value = c(8) + r*(c(9) + r*(c(10) + r*(c(11) + r*(c(12) + r*c(13)))))
      value = c(3) + r*(c(4) + r*(c(5) + r*(c(6) + r*(c(7) + r*value))))
      value = 1.0_wp + r*(1.0_wp + r*(c(2) + r*value))
      value = transfer(transfer(value, 1_long) + ishft(transfer(n, 1_long), 52), value)
   end function exp_in_range

   !> ln x for normal x > 0, to a unit in the last place or two of max(|ln x|, 1).
   elemental real(wp) function log_in_range(x) result(value)
      real(wp), intent(in) :: x
      real(wp) :: power, s, t

      call split(x, power, s)
      t = s**2
      value = 1.0_wp/17.0_wp + t*(1.0_wp/19.0_wp + t/21.0_wp)
      value = 1.0_wp/11.0_wp + t*(1.0_wp/13.0_wp + t*(1.0_wp/15.0_wp + t*value))
      value = 0.2_wp + t*(1.0_wp/7.0_wp + t*(1.0_wp/9.0_wp + t*value))
      value = power*ln2 + 2.0_wp*s*(1.0_wp + t*(1.0_wp/3.0_wp + t*value))
   end function log_in_range

   !> Splits x = m 2^power with m in [sqrt(1/2), sqrt(2)), and s = (m - 1)/(m + 1).
   elemental subroutine split(x, power, s)
      real(wp), intent(in) :: x
      real(wp), intent(out) :: power, s
      integer(long), parameter :: root_half = int(z'3FE6A09E667F3BCD', long)
      integer(long), parameter :: bias = int(z'3FF0000000000000', long)
      real(wp), parameter :: two52 = 4503599627370496.0_wp
      integer(long) :: biased
      real(wp) :: m

      biased = ishft(transfer(x, 1_long) - root_half + bias, -52)
      power = transfer(ior(biased, transfer(two52, 1_long)), x) - two52 - 1023.0_wp
      m = transfer(transfer(x, 1_long) - ishft(biased, 52) + bias, x)
      s = (m - 1.0_wp)/(m + 1.0_wp)
   end subroutine split

end module process_positive_truncated_normal
