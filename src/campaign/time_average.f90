!> Time-average errors of slip fractions.
!>
!> The measured part of a march is divided into spans of equal length, and the slip fraction in each
!> span is kept. The autocovariance of this series gives the time-average error of the slip fraction
!> of a sample.
!>
!> The series of a sample is the mean series of its case plus a deviation. The mean series is what
!> all samples have in common (one force record): its error does not average out and is the
!> time-average error of the mean. The deviations increase the standard deviation over samples. The
!> mean autocovariance of the samples is that of the mean series plus that of the deviations, so one
!> pass over the samples gives both. Ranks may add different groups of samples: the sums of a
!> collector are then summed over the ranks.
module campaign_time_average
   use campaign_plan, only: integration_settings
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use numerics_correlated, only: autocovariance_of, error_of_average
   implicit none(type, external)
   private
   public :: count_spans, end_of_span, errors_of_averages, fewest_spans, shortest_span, &
             span_collector, start_spans, time_average_method

   integer, parameter :: most_spans = 64      !! largest number of spans
   integer, parameter :: shortest_span = 32   !! [step]
   integer, parameter :: fewest_spans = 16    !! number of spans below which no error is estimated

   character(*), parameter :: time_average_method = &
                             'autocovariance of the slip fractions of equal spans, summed over '// &
                              'the initial monotone sequence (Geyer 1992)'

   !> Sums over the series of the samples of a case.
   type :: span_collector
      real(wp), allocatable :: common(:, :, :)          !! (span, joint, group) sum over samples
      real(wp), allocatable :: autocovariance(:, :, :)  !! (lag, joint, group) sum over samples
   contains
      procedure :: add
      procedure :: finish
   end type span_collector

contains

   !> Number of spans of a march: at most 64, each of at least 32 steps.
   pure integer function count_spans(integration) result(n)
      type(integration_settings), intent(in) :: integration

      n = (integration%n_steps - integration%n_discard)/shortest_span
      n = max(1, min(most_spans, n))
   end function count_spans

   !> Last step of a span. Lengths differ by one step at most.
   pure integer function end_of_span(integration, span) result(step)
      type(integration_settings), intent(in) :: integration
      integer, intent(in) :: span   !! 0: the transient

      associate (n => integration%n_steps - integration%n_discard)
         step = integration%n_discard + int(int(n, long)*span/count_spans(integration))
      end associate
   end function end_of_span

   !> Time-average errors of the slip fractions of samples.
   pure function errors_of_averages(series) result(errors)
      real(wp), intent(in) :: series(:, :, :)   !! (joint, span, sample) slip fractions
      real(wp) :: errors(size(series, 1), size(series, 3))
      integer :: i, joint

      do i = 1, size(series, 3)
         do joint = 1, size(series, 1)
            errors(joint, i) = error_of_average(autocovariance_of(series(joint, :, i)), &
                                                size(series, 2))
         end do
      end do
   end function errors_of_averages

   !> Prepares a collector.
   pure subroutine start_spans(n_spans, n_joints, n_groups, spans)
      integer, intent(in) :: n_spans, n_joints, n_groups
      type(span_collector), intent(out) :: spans

      allocate (spans%common(n_spans, n_joints, n_groups), &
                spans%autocovariance(n_spans/2, n_joints, n_groups), source=0.0_wp)
   end subroutine start_spans

   !> Adds the next samples of a group.
   pure subroutine add(self, group, series)
      class(span_collector), intent(inout) :: self
      integer, intent(in) :: group
      real(wp), intent(in) :: series(:, :, :)   !! (joint, span, sample) slip fractions
      integer :: i, joint

      do i = 1, size(series, 3)
         do joint = 1, size(series, 1)
            associate (lags => self%autocovariance(:, joint, group), &
                       common => self%common(:, joint, group))
               lags = lags + autocovariance_of(series(joint, :, i))
               common = common + series(joint, :, i)
            end associate
         end do
      end do
   end subroutine add

   !> Computes the time-average errors of the mean and of the standard deviation over two or more
   !> samples.
   pure subroutine finish(self, n_samples, statistics)
      class(span_collector), intent(in) :: self
      integer, intent(in) :: n_samples
      type(case_statistics), intent(inout) :: statistics
      ! autocovariances of the mean series and of the deviations from it
      real(wp), dimension(size(self%autocovariance, 1)) :: common, own
      integer :: joint, n

      n = size(self%common, 1)
      allocate (statistics%slip_mean_time_error(size(self%common, 2)), &
                statistics%slip_std_time_part(size(self%common, 2)))
      do joint = 1, size(self%common, 2)
         common = autocovariance_of(sum(self%common(:, joint, :), 2)/n_samples)
         own = (sum(self%autocovariance(:, joint, :), 2)/n_samples - common) &
               *n_samples/(n_samples - 1.0_wp)
         statistics%slip_mean_time_error(joint) = error_of_average(common, n)
         statistics%slip_std_time_part(joint) = error_of_average(own, n)
      end do
   end subroutine finish

end module campaign_time_average
