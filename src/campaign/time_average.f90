!> How far averages over a march of finite length are from those over an endless one.
!>
!> The measured part of a march is cut into spans of equal length, and the fraction of time in slip
!> within each is kept: a coarse series, which costs nothing. Its autocovariance tells the error of
!> a sample's slip fraction. What the samples of a case have in common (one record of the force for
!> all) does not average out over samples and is the error of the mean; what each has of its own
!> widens the spread. The autocovariance of all samples, averaged, is that of their mean series plus
!> that of the deviations from it, so one pass over the samples tells both.
module campaign_time_average
   use campaign_plan, only: integration_settings
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use numerics_correlated, only: autocovariance_of, error_of_average
   implicit none(type, external)
   private
   public :: count_spans, end_of_span, fewest_spans, span_collector, time_average_method

   integer, parameter :: most_spans = 64      !! of a march
   integer, parameter :: shortest_span = 32   !! [step]
   integer, parameter :: fewest_spans = 16    !! that an error is estimated from

   character(*), parameter :: time_average_method = &
                             'autocovariance of the slip fractions of equal spans, summed over '// &
                              'the initial monotone sequence (Geyer 1992)'

   !> Takes the series of the samples of a case, in sample order.
   type :: span_collector
      private
      integer :: n_samples = 0
      real(wp), allocatable :: common(:, :)           !! (span, dof) sum over samples
      real(wp), allocatable :: autocovariance(:, :)   !! (lag, dof) sum over samples
   contains
      procedure :: add
      procedure :: finish
   end type span_collector

contains

   !> Spans of a march: fewer where each would be too short to be worth looking at.
   pure function count_spans(integration) result(n)
      type(integration_settings), intent(in) :: integration
      integer :: n

      n = (integration%n_steps - integration%n_discard)/shortest_span
      n = max(1, min(most_spans, n))
   end function count_spans

   !> The step that a span ends with; 0: that before the first. Lengths differ by one step at most.
   pure function end_of_span(integration, span) result(step)
      type(integration_settings), intent(in) :: integration
      integer, intent(in) :: span
      integer :: step

      associate (n => integration%n_steps - integration%n_discard)
         step = integration%n_discard + int(int(n, long)*span/count_spans(integration))
      end associate
   end function end_of_span

   !> The next samples, and the errors of their slip fractions.
   pure subroutine add(self, series, errors)
      class(span_collector), intent(inout) :: self
      real(wp), intent(in) :: series(:, :, :)   !! (dof, span, sample) slip fractions
      real(wp), intent(out) :: errors(:, :)     !! (dof, sample)
      real(wp) :: lags(size(series, 2)/2)
      integer :: dof, i, n

      n = size(series, 2)
      if (.not. allocated(self%common)) then
         allocate (self%common(n, size(series, 1)), source=0.0_wp)
         allocate (self%autocovariance(n/2, size(series, 1)), source=0.0_wp)
      end if
      do i = 1, size(series, 3)
         do dof = 1, size(series, 1)
            lags = autocovariance_of(series(dof, :, i))
            errors(dof, i) = error_of_average(lags, n)
            self%autocovariance(:, dof) = self%autocovariance(:, dof) + lags
            self%common(:, dof) = self%common(:, dof) + series(dof, :, i)
         end do
      end do
      self%n_samples = self%n_samples + size(series, 3)
   end subroutine add

   !> After the last sample: the errors of the mean and of the spread over samples; needs two.
   pure subroutine finish(self, statistics)
      class(span_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: common(size(self%autocovariance, 1)), own(size(self%autocovariance, 1))
      integer :: dof, n

      n = size(self%common, 1)
      allocate (statistics%slip_mean_time_error(size(self%common, 2)), &
                statistics%slip_std_time_part(size(self%common, 2)))
      do dof = 1, size(self%common, 2)
         common = autocovariance_of(self%common(:, dof)/self%n_samples)
         own = (self%autocovariance(:, dof)/self%n_samples - common) &
               *self%n_samples/(self%n_samples - 1.0_wp)
         statistics%slip_mean_time_error(dof) = error_of_average(common, n)
         statistics%slip_std_time_part(dof) = error_of_average(own, n)
      end do
   end subroutine finish

end module campaign_time_average
