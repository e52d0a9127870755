!> Pool of the samples of several cases that differ in the law of the friction only, so that one fit
!> of the response serves all of them: formulas (1), (9) and (12) of docs/regression.md.
module statistics_pool
   use core_kinds, only: wp
   use statistics_estimates, only: estimates_type
   use statistics_law, only: draws_type, keep_draws
   implicit none(type, external)
   private
   public :: pool_type, new_pool, over_all_samples, least_plain_share

   !> relative residuals between which the least weight of plain sampling rises from 0 to 1
   real(wp), parameter :: small_residual = 0.25_wp, large_residual = 0.45_wp

   !> Inputs of all samples, and the laws of the cases.
   type :: pool_type
      real(wp), allocatable :: x(:, :)         !! (sample, input) standardised
      !> (case) its first and last sample; those of the pool if it has none
      integer, allocatable :: first(:), last(:)
      logical, allocatable :: has_samples(:)   !! (case)
      integer, allocatable :: n_samples(:)     !! (case) its samples in the pool and beyond
      type(draws_type), allocatable :: draws(:)   !! (case) draws of its law
      logical, private :: uses_roots = .false.    !! inputs are roots of friction values
      real(wp), allocatable, private :: centre(:), scatter(:)   !! (input)
   contains
      procedure :: add_law
   end type pool_type

contains

   !> Creates a pool without laws. Its inputs are the standardised roots of the friction values, or
   !> the standardised values if any is negative.
   subroutine new_pool(friction, first, n_samples, pool)
      real(wp), intent(in) :: friction(:, :)    !! (sample, point)
      integer, intent(in) :: first(:)           !! (case + 1) its first sample; at the end n + 1
      integer, intent(in) :: n_samples(:)       !! (case) its samples, in the pool and beyond
      type(pool_type), intent(out) :: pool
      integer :: n

      n = size(friction, 1)
      pool%has_samples = first(2:) > first(:size(n_samples))
      pool%first = merge(first(:size(n_samples)), 1, pool%has_samples)
      pool%last = merge(first(2:) - 1, n, pool%has_samples)
      pool%n_samples = merge(n_samples, n, pool%has_samples)
      pool%uses_roots = minval(friction) >= 0.0_wp
      allocate (pool%draws(size(n_samples)), pool%centre(size(friction, 2)), &
                pool%scatter(size(friction, 2)))
      allocate (pool%x, source=friction)
      if (pool%uses_roots) pool%x = sqrt(friction)
      pool%centre(:) = sum(pool%x, 1)/n
      pool%scatter(:) = sqrt(sum((pool%x - spread(pool%centre, 1, n))**2, 1)/n)
      where (.not. pool%scatter > 0.0_wp) pool%scatter = 1.0_wp
      call standardise(pool, pool%x)
   end subroutine new_pool

   pure subroutine standardise(pool, x)
      type(pool_type), intent(in) :: pool
      real(wp), intent(inout) :: x(:, :)   !! (sample or draw, input)
      integer :: j

      do j = 1, size(x, 2)
         x(:, j) = (x(:, j) - pool%centre(j))/pool%scatter(j)
      end do
   end subroutine standardise

   !> Adds draws of the law of a case.
   subroutine add_law(self, number, friction, n_independent)
      class(pool_type), intent(inout) :: self
      integer, intent(in) :: number            !! number of the case
      real(wp), intent(in) :: friction(:, :)   !! (draw, point)
      real(wp), intent(in) :: n_independent    !! independent draws with the same error of a mean
      real(wp), allocatable :: x(:, :)

      allocate (x, source=friction)
      if (self%uses_roots) x = sqrt(max(friction, 0.0_wp))
      call standardise(self, x)
      call keep_draws(x, n_independent, self%draws(number))
   end subroutine add_law

   !> Plain estimates from all samples of a case, scaled from those of its samples in the pool. The
   !> value is given; the bias falls as 1/n. Influences have a row for each of its samples in the
   !> pool; further rows, for the samples beyond the pool, add the rest of the variance.
   pure function over_all_samples(pool, number, pooled, value) result(estimates)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: number                !! number of the case
      type(estimates_type), intent(in) :: pooled   !! estimates from its samples in the pool
      real(wp), intent(in) :: value(:)             !! (output) from all its samples
      type(estimates_type) :: estimates
      real(wp) :: share
      integer :: n, n_more

      n = size(pooled%influence, 1)
      share = real(n, wp)/pool%n_samples(number)
      n_more = merge(n, 0, share < 1.0_wp)
      allocate (estimates%influence(n + n_more, size(value)))
      estimates%influence(:n, :) = share*pooled%influence
      estimates%influence(n + 1:, :) = sqrt(share*(1.0_wp - share))*pooled%influence(:n_more, :)
      estimates%value = value
      estimates%bias = share*pooled%bias
      if (allocated(pooled%stretch)) estimates%stretch = pooled%stretch
   end function over_all_samples

   !> Least weight of plain sampling: 0 up to residuals of 0.25 of the scatter of the case's
   !> samples, 1 from 0.45 on, linear between.
   pure function least_plain_share(residual, y) result(share)
      real(wp), intent(in) :: residual(:, :), y(:, :)   !! (sample of the case, output)
      real(wp) :: share(size(y, 2))
      real(wp) :: scatter, relative
      integer :: o

      do o = 1, size(y, 2)
         scatter = sum((y(:, o) - sum(y(:, o))/size(y, 1))**2)
         relative = sqrt(sum(residual(:, o)**2)/max(scatter, tiny(scatter)))
         share(o) = (relative - small_residual)/(large_residual - small_residual)
         share(o) = max(0.0_wp, min(1.0_wp, share(o)))
      end do
   end function least_plain_share

end module statistics_pool
