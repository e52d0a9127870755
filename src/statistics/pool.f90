!> Samples of cases that differ in the law of their friction only: what one of them tells of the
!> response serves all.
module statistics_pool
   use core_kinds, only: wp
   use statistics_estimates, only: estimates_type
   use statistics_law, only: draws_type, keep_draws
   implicit none(type, external)
   private
   public :: pool_type, new_pool, among_all, residual_share

   real(wp), parameter :: trusted = 0.25_wp, useless = 0.45_wp   !! relative residuals

   !> Inputs of all samples, and the laws of the cases.
   type :: pool_type
      real(wp), allocatable :: x(:, :)         !! (sample, input) standardised
      integer, allocatable :: first(:)         !! (case + 1) first samples; behind the last, n + 1
      integer, allocatable :: n_samples(:)     !! (case) of plain statistics, not fewer
      type(draws_type), allocatable :: draws(:)   !! (case) of the laws
      logical, private :: takes_root = .false.    !! inputs are roots of friction values
      real(wp), allocatable, private :: centre(:), scatter(:)   !! (input)
   contains
      procedure :: add_law
   end type pool_type

contains

   !> Creates a pool without laws. Its inputs are the roots of the friction values, or the values
   !> themselves where any is negative, standardised.
   subroutine new_pool(friction, first, n_samples, pool)
      real(wp), intent(in) :: friction(:, :)    !! (sample, point)
      integer, intent(in) :: first(:)           !! as in pool_type
      integer, intent(in) :: n_samples(:)
      type(pool_type), intent(out) :: pool
      integer :: j, n

      pool%first = first
      pool%n_samples = n_samples
      pool%takes_root = minval(friction) >= 0.0_wp
      n = size(friction, 1)
      allocate (pool%draws(size(n_samples)), pool%centre(size(friction, 2)), &
                pool%scatter(size(friction, 2)))
      allocate (pool%x, source=friction)
      if (pool%takes_root) pool%x = sqrt(friction)
      pool%centre(:) = sum(pool%x, 1)/n
      do j = 1, size(pool%x, 2)
         pool%scatter(j) = sqrt(sum((pool%x(:, j) - pool%centre(j))**2)/n)
         if (.not. pool%scatter(j) > 0.0_wp) pool%scatter(j) = 1.0_wp
      end do
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
      integer, intent(in) :: number            !! of the case
      real(wp), intent(in) :: friction(:, :)   !! (draw, point)
      real(wp), intent(in) :: n_independent    !! draws that they are worth
      real(wp), allocatable :: x(:, :)

      allocate (x, source=friction)
      if (self%takes_root) x = sqrt(max(friction, 0.0_wp))
      call standardise(self, x)
      call keep_draws(x, n_independent, self%draws(number))
   end subroutine add_law

   !> Plain estimates of a case's samples in the pool as those of all its samples: its value is
   !> given, its bias falls as 1/n, and the samples that are not in the pool stand behind as rows of
   !> their own, which carry the rest of the variance.
   pure function among_all(pool, number, some, value) result(all_of)
      type(pool_type), intent(in) :: pool
      integer, intent(in) :: number                !! of the case
      type(estimates_type), intent(in) :: some     !! influences of its samples in the pool
      real(wp), intent(in) :: value(:)             !! (output) of all samples
      type(estimates_type) :: all_of
      real(wp) :: share
      integer :: n, n_more

      n = size(pool%x, 1)
      associate (first => pool%first(number), last => pool%first(number + 1) - 1)
         share = real(last - first + 1, wp)/pool%n_samples(number)
         n_more = merge(last - first + 1, 0, share < 1.0_wp)
         allocate (all_of%influence(n + n_more, size(value)), source=0.0_wp)
         all_of%influence(first:last, :) = share*some%influence
         all_of%influence(n + 1:, :) = sqrt(share*(1.0_wp - share))*some%influence(:n_more, :)
      end associate
      all_of%value = value
      all_of%bias = share*some%bias
      if (allocated(some%stretch)) all_of%stretch = some%stretch
   end function among_all

   !> The least share of plain sampling: all where the residuals are above 0.45 of what the case's
   !> samples scatter, none below 0.25 of it.
   pure function residual_share(residual, y) result(share)
      real(wp), intent(in) :: residual(:, :), y(:, :)   !! (sample of the case, output)
      real(wp) :: share(size(y, 2))
      real(wp) :: scatter, relative
      integer :: o

      do o = 1, size(y, 2)
         scatter = sum((y(:, o) - sum(y(:, o))/size(y, 1))**2)
         relative = sqrt(sum(residual(:, o)**2)/max(scatter, tiny(scatter)))
         share(o) = max(0.0_wp, min(1.0_wp, (relative - trusted)/(useless - trusted)))
      end do
   end function residual_share

end module statistics_pool
