!> Statistics of a response over a friction law, from a fit to few samples and many points of the
!> law.
!>
!> Every estimate knows what leaving out a sample does to it. Leaving out sample i is replacing y_i
!> by its leave-one-out prediction, so G(x) changes by c_i(x) e_i, c_i(x) = 1/n + sum_k V_ik s_k
!> phi_k(x): the influence of sample i on a mean of G is e_i times the same mean of c_i. The
!> formulas are derived and measured in docs/accuracy.md.
!>
!> Influences overstate an error that falls faster than 1/sqrt(n). An estimate is a sum of parts,
!> each of which takes k samples together (Hoeffding); v_k are their variances. The squares of the
!> influences add up to J = sum of k v_k (Efron and Stein 1981). Leaving out samples i and j changes
!> the estimate by what either does alone and by Q_ij beyond; the squares of all Q_ij add up to
!> P = sum of k(k - 1)/2 v_k. With kappa = 1 + 2P/J the variance lies between J/kappa (Cauchy and
!> Schwarz) and J. We take their geometric mean, J/sqrt(kappa).
module statistics_regression
   use core_kinds, only: wp
   use numerics_lapack, only: multiply
   use statistics_estimates, only: estimates_type
   use statistics_law, only: law_type
   use statistics_percentiles, only: find_quantile
   use statistics_surrogate, only: average_features, fit_type, rows_of, surrogate_type
   implicit none(type, external)
   private
   public :: view_type, law_deviation, law_mean, law_mean_of_exponential, law_percentile, &
             state_by_pairs, view_law

   real(wp), parameter :: window = 0.01_wp         !! of ranks about a percentile
   real(wp), parameter :: share_of_near = 0.08_wp  !! of a case's samples, on either side
   integer, parameter :: least_near = 4
   integer, parameter :: most_in_window = 24       !! points whose features are averaged
   real(wp), parameter :: largest_excess = 2.0_wp
   integer, parameter :: thinning = 4   !! of the points for influences of a mean of exponentials

   !> A law as a surrogate sees it, and which of the samples were drawn from it.
   type :: view_type
      real(wp), allocatable :: rows(:, :)       !! (landmark, point) of the kernel
      real(wp), allocatable :: weight(:)        !! (point)
      integer :: first = 0, last = 0            !! samples of the law
   end type view_type

contains

   !> The kernel of a surrogate at the points of a law.
   subroutine view_law(surrogate, law, first, last, view)
      type(surrogate_type), intent(in) :: surrogate
      type(law_type), intent(in) :: law
      integer, intent(in) :: first, last
      type(view_type), intent(out) :: view

      call rows_of(surrogate, law%x, view%rows)
      view%weight = law%weight
      view%first = first
      view%last = last
   end subroutine view_law

   !> Mean of G.
   subroutine law_mean(surrogate, fit, view, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:, :)    !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: average_row(size(view%rows, 1), 1)
      real(wp) :: average(size(surrogate%eigenvalue), size(fit%mean))
      integer :: o

      average_row(:, 1) = matmul(view%rows, view%weight)
      call average_features(surrogate, average_row, 1.0_wp, average(:, 1:1))
      average = spread(average(:, 1), 2, size(average, 2))
      estimate%value = fit%mean + matmul(average(:, 1), fit%coefficient)
      allocate (estimate%bias(size(fit%mean)), source=0.0_wp)
      estimate%excess = [(excess_of_law(view, values(:, o), &
                                        fit%predicted(view%first:view%last, o)), &
                          o=1, size(fit%mean))]
      call find_influence(surrogate, fit, average, 1.0_wp, .true., estimate%influence)
   end subroutine law_mean

   !> How much more a function of the response scatters over the law than over the case's samples,
   !> by predictions of both; at least 1, at most 2. Samples that lack a tail make errors look
   !> small.
   pure real(wp) function excess_of_law(view, values, predicted) result(excess)
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:)       !! (point)
      real(wp), intent(in) :: predicted(:)    !! (own sample)
      real(wp) :: mean, over_law, over_samples
      integer :: m

      mean = 0.0_wp
      over_law = 0.0_wp
      !$omp simd reduction(+:mean, over_law)
      do m = 1, size(values)
         mean = mean + view%weight(m)*values(m)
         over_law = over_law + view%weight(m)*values(m)**2
      end do
      over_law = over_law - mean**2
      over_samples = sum((predicted - sum(predicted)/size(predicted))**2)/(size(predicted) - 1)
      excess = 1.0_wp
      if (over_law > over_samples .and. over_samples > 0.0_wp) &
         excess = min(sqrt(over_law/over_samples), largest_excess)
   end function excess_of_law

   !> e_i (constant/n + sum_k V_ik s_k average_k), divided by what pairs of samples tell.
   subroutine find_influence(surrogate, fit, average, constant, by_pairs, influence)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      real(wp), intent(in) :: average(:, :)    !! (feature, output) of phi
      real(wp), intent(in) :: constant         !! the same average of 1
      logical, intent(in) :: by_pairs          !! for averages: other numbers take pairs as they are
      real(wp), allocatable, intent(out) :: influence(:, :)   !! (sample, output)
      real(wp) :: shrunk(size(average, 1), size(average, 2))

      allocate (influence(size(fit%residual, 1), size(average, 2)))
      shrunk = fit%shrink*average
      call multiply(surrogate%feature, shrunk, influence)
      influence = influence + constant/size(influence, 1)
      if (by_pairs) call state_by_pairs(fit, influence)
      influence = fit%residual*influence
   end subroutine find_influence

   !> Divides the weights of the samples in averages of G by kappa^(1/4). kappa is that of the last
   !> judged output up to each.
   pure subroutine state_by_pairs(fit, weight)
      type(fit_type), intent(in) :: fit
      real(wp), intent(inout) :: weight(:, :)   !! (sample, output)
      real(wp) :: share(size(fit%judged))       ! 2P/J
      integer :: k, o

      do k = 1, size(fit%judged)
         share(k) = share_of_pairs(fit, k, weight(:, fit%judged(k)))
      end do
      k = 1
      do o = 1, size(weight, 2)
         if (k < size(fit%judged)) then
            if (o >= fit%judged(k + 1)) k = k + 1
         end if
         weight(:, o) = weight(:, o)/sqrt(sqrt(1.0_wp + share(k)))
      end do
   end subroutine state_by_pairs

   !> 2P/J from the pairs of some samples with all: with h the leverages, e_i is
   !> (e_i + h_ij e_j/(1 - h_i))/(1 - h_ij^2/((1 - h_i)(1 - h_j))) when j is left out too, and
   !> Q_ij what that changes in w_i e_i + w_j e_j.
   pure real(wp) function share_of_pairs(fit, k, weight)
      type(fit_type), intent(in) :: fit
      integer, intent(in) :: k              !! of the judged outputs
      real(wp), intent(in) :: weight(:)     !! (sample) w
      real(wp) :: e(size(weight)), left(size(weight)), of_one(size(weight))
      real(wp) :: both, change, other, pairs
      integer :: i, j, m

      e = fit%residual(:, fit%judged(k))
      left = 1.0_wp - fit%leverage(:, k)
      of_one = weight*e
      pairs = 0.0_wp
      do m = 1, size(fit%some)
         i = fit%some(m)
         associate (h => fit%pair_leverage(:, m, k))
            !$omp simd reduction(+:pairs)
            do j = 1, size(e)
               both = 1.0_wp/(1.0_wp - h(j)**2/(left(i)*left(j)))
               change = both*(e(i) + h(j)*e(j)/left(i)) - e(i)
               other = both*(e(j) + h(j)*e(i)/left(j)) - e(j)
               pairs = pairs + merge(0.0_wp, (weight(i)*change + weight(j)*other)**2, i == j)
            end do
         end associate
      end do
      share_of_pairs = 0.0_wp
      if (any(abs(of_one) > 0.0_wp)) &
         share_of_pairs = pairs*size(e)/(size(fit%some)*sum(of_one**2))
   end function share_of_pairs

   !> Standard deviation: that of G and of the case's own residuals; half of what they add is
   !> allowed for as bias.
   subroutine law_deviation(surrogate, fit, view, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:, :)    !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: of_rows(size(view%rows, 1), size(values, 2))
      real(wp) :: covariance(size(surrogate%eigenvalue), size(values, 2))
      real(wp) :: of_values(size(values, 2)), of_residuals(size(values, 2))
      real(wp) :: centred(size(values, 1)), residual(view%last - view%first + 1)
      integer :: o

      do o = 1, size(values, 2)
         centred = view%weight*(values(:, o) - dot_product(view%weight, values(:, o)))
         of_values(o) = dot_product(centred, values(:, o))
         of_rows(:, o) = matmul(view%rows, centred)
      end do
      call average_features(surrogate, of_rows, 0.0_wp, covariance)
      call find_influence(surrogate, fit, covariance, 0.0_wp, .false., estimate%influence)
      allocate (estimate%value(size(values, 2)))
      allocate (estimate%bias, estimate%excess, mold=estimate%value)
      do o = 1, size(values, 2)
         associate (own => fit%predicted(view%first:view%last, o))
            estimate%excess(o) = excess_of_law(view, &
                                   (values(:, o) - dot_product(view%weight, values(:, o)))**2, &
                                   (own - sum(own)/size(own))**2)
         end associate
         residual = fit%residual(view%first:view%last, o)
         residual = (residual - sum(residual)/size(residual))**2
         of_residuals(o) = sum(residual)/size(residual)
         estimate%value(o) = sqrt(max(of_values(o) + of_residuals(o), tiny(1.0_wp)))
         estimate%bias(o) = 0.5_wp*(estimate%value(o) - sqrt(max(of_values(o), 0.0_wp)))
         associate (own => estimate%influence(view%first:view%last, o))
            own = own + 0.5_wp*(residual - of_residuals(o))/size(residual)
         end associate
         estimate%influence(:, o) = estimate%influence(:, o)/estimate%value(o)
      end do
   end subroutine law_deviation

   !> Percentile: half way between that of G and that of G plus residuals of samples predicted near
   !> it; half of their difference is allowed for as bias.
   subroutine law_percentile(surrogate, fit, view, values, p, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:, :)    !! (point, output) G
      real(wp), intent(in) :: p               !! share of the law below
      type(estimates_type), intent(out) :: estimate
      real(wp) :: average_row(size(view%rows, 1), size(values, 2))
      real(wp) :: average(size(surrogate%eigenvalue), size(values, 2)), smeared(size(values, 1))
      integer :: near(2*half_of_near(view), size(values, 2)), o
      real(wp) :: residual(size(near, 1)), bare, full
      integer, allocatable :: around(:)

      allocate (estimate%value(size(values, 2)), estimate%bias(size(values, 2)))
      do o = 1, size(values, 2)
         call find_quantile(values(:, o), view%weight, p, window, bare, around)
         average_row(:, o) = mean_of_some(view%rows, around)
         near(:, o) = samples_near(fit%predicted(:, o), bare, size(near, 1))
         associate (own => fit%residual(view%first:view%last, o))
            residual = fit%residual(near(:, o), o) - sum(own)/size(own)
         end associate
         smeared = plus_in_turn(values(:, o), residual)
         call find_quantile(smeared, view%weight, p, 0.0_wp, full, around)
         estimate%value(o) = 0.5_wp*(bare + full)
         estimate%bias(o) = 0.5_wp*(full - bare)
      end do
      call average_features(surrogate, average_row, 1.0_wp, average)
      call find_influence(surrogate, fit, average, 1.0_wp, .true., estimate%influence)
      do o = 1, size(values, 2)
         residual = fit%residual(near(:, o), o)
         residual = (residual - sum(residual)/size(residual))/(2*size(residual))
         estimate%influence(near(:, o), o) = estimate%influence(near(:, o), o) + residual
      end do
   end subroutine law_percentile

   !> Values plus residuals, which are taken in turn.
   pure function plus_in_turn(values, residual) result(smeared)
      real(wp), intent(in) :: values(:), residual(:)
      real(wp) :: smeared(size(values))
      integer :: first, n

      do first = 1, size(values), size(residual)
         n = min(size(residual), size(values) - first + 1)
         smeared(first:first + n - 1) = values(first:first + n - 1) + residual(:n)
      end do
   end function plus_in_turn

   pure integer function half_of_near(view)
      type(view_type), intent(in) :: view

      half_of_near = max(least_near, nint(share_of_near*(view%last - view%first + 1)))
   end function half_of_near

   !> Mean of columns, of as many as matter.
   pure function mean_of_some(columns, places) result(mean)
      real(wp), intent(in) :: columns(:, :)
      integer, intent(in) :: places(:)
      real(wp) :: mean(size(columns, 1))
      integer :: i, n

      n = min(size(places), most_in_window)
      mean = 0.0_wp
      do i = 1, n
         mean = mean + columns(:, places(1 + ((i - 1)*size(places))/n))
      end do
      mean = mean/n
   end function mean_of_some

   !> The samples whose predictions are next in rank to a value, as many on either side where there
   !> are as many.
   pure function samples_near(predicted, value, n_near) result(near)
      real(wp), intent(in) :: predicted(:)   !! (sample)
      real(wp), intent(in) :: value
      integer, intent(in) :: n_near
      integer :: near(n_near)
      integer :: n_below, n_from_below

      n_below = count(predicted < value)
      n_from_below = max(min(n_near/2, n_below), n_near - (size(predicted) - n_below))
      near(:n_from_below) = places_of_least(value - predicted, predicted < value, n_from_below)
      near(n_from_below + 1:) = places_of_least(predicted - value, predicted >= value, &
                                        n_near - n_from_below)
   end function samples_near

   !> The places of the least values among some, the least first.
   pure function places_of_least(values, is_meant, n) result(places)
      real(wp), intent(in) :: values(:)
      logical, intent(in) :: is_meant(:)   !! n or more
      integer, intent(in) :: n
      integer :: places(n)
      integer :: found, i, k

      found = 0
      do i = 1, size(values)
         if (.not. is_meant(i)) cycle
         if (found == n) then
            if (n == 0) return
            if (values(i) >= values(places(n))) cycle
         else
            found = found + 1
         end if
         k = found
         do while (k > 1)
            if (values(places(k - 1)) <= values(i)) exit
            places(k) = places(k - 1)
            k = k - 1
         end do
         places(k) = i
      end do
   end function places_of_least

   !> Mean of y = exp(output): between the mean of exp(G) and the ratio estimate from it, with half
   !> of their difference as bias.
   subroutine law_mean_of_exponential(surrogate, fit, view, values, y, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in) :: values(:, :)    !! (point, output) G
      real(wp), intent(in) :: y(:, :)         !! (own sample, output)
      type(estimates_type), intent(out) :: estimate
      real(wp), allocatable :: some(:, :), weighted(:, :), average_row(:, :), average(:, :)
      real(wp), allocatable :: of_samples(:, :), average_of_samples(:, :)
      real(wp) :: each(size(values, 1)), mean, ratio
      integer :: o

      some = view%rows(:, ::thinning)
      allocate (weighted(size(some, 2), size(values, 2)))
      allocate (average_row(size(view%rows, 1), size(values, 2)))
      allocate (average(size(surrogate%eigenvalue), size(values, 2)))
      allocate (average_of_samples, mold=average)
      allocate (estimate%value(size(values, 2)))
      allocate (estimate%bias, estimate%excess, mold=estimate%value)
      of_samples = exp(fit%predicted(view%first:view%last, :))
      do o = 1, size(values, 2)
         each = exp(values(:, o))
         estimate%excess(o) = excess_of_law(view, each, of_samples(:, o))
         each = view%weight*each
         mean = sum(each)
         weighted(:, o) = each(::thinning)/sum(each(::thinning))
         ratio = sum(y(:, o))/sum(of_samples(:, o))
         estimate%value(o) = mean*sqrt(ratio)
         estimate%bias(o) = 0.5_wp*mean*(ratio - 1.0_wp)
         of_samples(:, o) = of_samples(:, o)/sum(of_samples(:, o))
      end do
      call multiply(some, weighted, average_row)
      call average_features(surrogate, average_row, 1.0_wp, average)
      call multiply(surrogate%feature(view%first:view%last, :), of_samples, average_of_samples, &
                    transposes_a=.true.)
      average = average - 0.5_wp*average_of_samples
      call find_influence(surrogate, fit, average, 0.5_wp, .false., estimate%influence)
      do o = 1, size(values, 2)
         associate (own => estimate%influence(view%first:view%last, o))
            own = own + 0.5_wp*(y(:, o)/sum(y(:, o)) - of_samples(:, o))
         end associate
         estimate%influence(:, o) = estimate%influence(:, o)*estimate%value(o)
      end do
   end subroutine law_mean_of_exponential

end module statistics_regression
