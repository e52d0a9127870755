!> Statistics of a case in its group of the results file: the best estimates, plain sampling's in
!> `plain/`, and in `error_ratio/` how much larger the errors of those are.
module io_case_statistics
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use campaign_estimates, only: case_estimates
   use campaign_plan, only: plan_type
   use campaign_results, only: case_statistics, joint_statistics, of_amplitude, of_dissipation, &
      of_distance, of_slip
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_phrases, only: numbered
   use io_blocks, only: kept_axis
   use io_group, only: group_type, new_group
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: write_estimates

   !> Writes each statistic that it visits; or the ratio of errors that stands in its place, noting
   !> with the estimate how it came about and what that gains.
   type :: statistics_visitor
      type(group_type) :: group
      character(:), allocatable :: dof         !! the axis of the dofs whose spectra are kept
      type(group_type), allocatable :: best    !! group of the estimates, where ratios are written
      character(:), allocatable :: estimator, pooled_with   !! of these
   contains
      procedure :: visit
   end type statistics_visitor

contains

   !> Takes the first error of all.
   subroutine write_estimates(group, plan, plain, found, error)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: plain
      type(case_estimates), intent(in) :: found
      type(error_type), allocatable, intent(out) :: error

      call write_statistics(group, plan, found%best, found%estimator /= 'plain')
      call write_time_errors(group, plan, plain)
      if (allocated(plain%numbers(of_slip)%mean)) then
         call group%attribute('estimator', trim(found%estimator))
         if (len(found%reason) > 0) call group%attribute('plain_reason', found%reason)
      end if
      if (found%estimator /= 'plain') then
         call write_sensitivities(group, found)
         call write_beside(group, plan, plain, found)
      end if
      call group%take_error(error)
   end subroutine write_estimates

   subroutine write_sensitivities(group, found)
      type(group_type), intent(inout) :: group
      type(case_estimates), intent(in) :: found

      call group%put('friction_point', found%friction_points, '1', &
                     'point of the process, of the friction of one joint or more', 'friction_point')
      call group%put('sensitivity', found%sensitivity, '1', &
                     'share of the variance of slip_fraction due to one friction value', &
                     'joint friction_point')
      call group%put('sensitivity_error', found%sensitivity_error, '1', &
                     'standard error of sensitivity', 'joint friction_point')
   end subroutine write_sensitivities

   !> Writes the groups `plain` (plain estimates) and `error_ratio`, and the attributes that say
   !> what each best estimate gains.
   subroutine write_beside(group, plan, plain, found)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: plain
      type(case_estimates), intent(in) :: found
      type(group_type) :: beside
      type(statistics_visitor) :: v
      integer :: i

      if (allocated(group%error)) return
      beside = new_group(group%file, group%path//'/plain')
      call write_statistics(beside, plan, plain, .false.)
      call beside%take_error(group%error)
      if (allocated(group%error)) return
      v%dof = kept_axis(plan)
      v%best = group
      v%estimator = trim(found%estimator)
      v%pooled_with = ''
      do i = 1, size(found%pooled_with)
         v%pooled_with = v%pooled_with//' '//numbered('c', found%pooled_with(i))
      end do
      v%pooled_with = trim(adjustl(v%pooled_with))
      v%group = new_group(group%file, group%path//'/error_ratio')
      call visit_statistics(v, found%error_ratio)
      call v%group%take_error(group%error)
   end subroutine write_beside

   subroutine write_statistics(group, plan, statistics, is_regression)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      logical, intent(in) :: is_regression
      type(statistics_visitor) :: v

      if (.not. allocated(statistics%numbers(of_slip)%mean)) return
      call write_methods(group, is_regression, allocated(statistics%psd_mean))
      v%group = group
      v%dof = kept_axis(plan)
      call visit_statistics(v, statistics)
      call v%group%take_error(group%error)
   end subroutine write_statistics

   subroutine write_methods(group, is_regression, has_bands)
      type(group_type), intent(inout) :: group
      logical, intent(in) :: is_regression, has_bands

      call put('slip_mean_error_method', 'standard deviation over root of n_samples')
      call put('slip_std_error_method', 'fourth central moment, any law')
      call put('slip_percentiles_interval_method', 'order statistics, binomial, 95 %')
      if (.not. has_bands) return
      call put('psd_percentiles_interval_method', 'order statistics, binomial, 95 %')
      call put('band_ratio_interval_method', 'bootstrap over samples, of the logarithm, 95 %')
      call put('pseudo_variance_percentiles_error_method', 'bootstrap over samples')

   contains

      subroutine put(name, of_plain)
         character(*), intent(in) :: name, of_plain

         if (is_regression) then
            call group%attribute(name, &
                                 'leave-one-out residuals of the regression, Student, 95 %')
         else
            call group%attribute(name, of_plain)
         end if
      end subroutine put

   end subroutine write_methods

   !> Visits what the samples of a case tell of all: quantities of joints, amplitudes, bands.
   subroutine visit_statistics(v, statistics)
      type(statistics_visitor), intent(inout) :: v
      type(case_statistics), intent(in) :: statistics
      character(*), parameter :: by_dof = 'kept', by_percentile = 'percentile kept', &
                                 by_frequency = 'frequency kept', &
                                 by_both = 'percentile frequency kept'

      associate (s => statistics)
         call visit_numbers('slip', '1', 'slip_fraction', 'joint', s%numbers(of_slip))
         call visit_numbers('slip_distance', 'm', 'slip_distance', 'joint', &
                            s%numbers(of_distance))
         call visit_numbers('dissipation', 'J', 'dissipation', 'joint', s%numbers(of_dissipation))
         call visit_numbers('harmonic_amplitude', 'm', 'harmonic_amplitude', 'dof', &
                            s%numbers(of_amplitude))
         call v%visit('psd_mean', 'm^2/Hz', by_frequency, 'mean of psd', s%psd_mean)
         call v%visit('psd_mean_error', 'm^2/Hz', by_frequency, 'standard error of psd_mean', &
                      s%psd_mean_error)
         call v%visit('psd_percentiles', 'm^2/Hz', by_both, 'percentiles of psd', &
                      s%psd_percentiles)
         call v%visit('psd_percentiles_low', 'm^2/Hz', by_both, 'lower end of the 95 % interval', &
                      s%psd_percentiles_low)
         call v%visit('psd_percentiles_high', 'm^2/Hz', by_both, 'upper end of the 95 % interval', &
                      s%psd_percentiles_high)
         call v%visit('pseudo_variance_mean', 'm^2', by_dof, &
                      'integral of psd_mean over frequency, Eq. (46)', s%pseudo_variance_mean)
         call v%visit('pseudo_variance_mean_error', 'm^2', by_dof, &
                      'standard error of pseudo_variance_mean', s%pseudo_variance_mean_error)
         call v%visit('pseudo_variance_percentiles', 'm^2', by_percentile, &
                      'integral of each percentile, Eq. (46)', s%pseudo_variance_percentiles)
         call v%visit('pseudo_variance_percentiles_error', 'm^2', by_percentile, &
                      'standard error of pseudo_variance_percentiles', &
                      s%pseudo_variance_percentiles_error)
         call v%visit('band_ratio', '1', by_dof, &
                      'pseudo-variance of the last over the first percentile', s%band_ratio)
         call v%visit('band_ratio_low', '1', by_dof, &
                      'lower end of the 95 % interval of band_ratio', s%band_ratio_low)
         call v%visit('band_ratio_high', '1', by_dof, &
                      'upper end of the 95 % interval of band_ratio', s%band_ratio_high)
         call v%visit('band_ratio_bias', '1', by_dof, &
                      'relative bias of band_ratio, by bootstrap', s%band_ratio_bias)
      end associate

   contains

      !> Visits the statistics of a quantity of the joints or dofs with their errors.
      subroutine visit_numbers(name, units, quantity, axis, of)
         character(*), intent(in) :: name, units
         character(*), intent(in) :: quantity   !! dataset of the samples
         character(*), intent(in) :: axis       !! 'joint' or 'dof'
         type(joint_statistics), intent(in) :: of

         call v%visit(name//'_mean', units, axis, 'mean of '//quantity, of%mean)
         call v%visit(name//'_mean_error', units, axis, 'standard error of '//name//'_mean', &
                      of%mean_error)
         call v%visit(name//'_std', units, axis, 'standard deviation of '//quantity, of%std)
         call v%visit(name//'_std_error', units, axis, 'standard error of '//name//'_std', &
                      of%std_error)
         call v%visit(name//'_percentiles', units, 'percentile '//axis, &
                      'percentiles of '//quantity, of%percentiles)
         call v%visit(name//'_percentiles_low', units, 'percentile '//axis, &
                      'lower end of the 95 % interval', of%low)
         call v%visit(name//'_percentiles_high', units, 'percentile '//axis, &
                      'upper end of the 95 % interval', of%high)
      end subroutine visit_numbers

   end subroutine visit_statistics

   !> Writes the errors that the finite length of the march adds, whatever the estimator.
   subroutine write_time_errors(group, plan, statistics)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      character(*), parameter :: not_lowered = ' that more samples do not lower: the march is '// &
                                 'finite'
      type(statistics_visitor) :: v

      v%group = group
      v%dof = kept_axis(plan)
      associate (s => statistics)
         if (allocated(s%band_ratio_time_error)) &
            call v%group%attribute('band_ratio_time_error_method', &
                                   'scatter of consecutive batches of the march')
         call v%visit('slip_mean_time_error', '1', 'joint', &
                      'standard error of slip_mean'//not_lowered, s%slip_mean_time_error)
         call v%visit('slip_std_time_part', '1', 'joint', &
                      'part of slip_std that the finite march adds', s%slip_std_time_part)
         call v%visit('pseudo_variance_mean_time_error', 'm^2', 'kept', &
                      'standard error of pseudo_variance_mean'//not_lowered, &
                      s%pseudo_variance_mean_time_error)
         call v%visit('pseudo_variance_percentiles_time_error', 'm^2', 'percentile kept', &
                      'standard error of pseudo_variance_percentiles'//not_lowered, &
                      s%pseudo_variance_percentiles_time_error)
         call v%visit('band_ratio_time_error', '1', 'kept', &
                      'standard error of band_ratio'//not_lowered, s%band_ratio_time_error)
      end associate
      call v%group%take_error(group%error)
   end subroutine write_time_errors

   !> Visits a statistic, where it is there.
   recursive subroutine visit(self, name, units, axes, about, values)
      class(statistics_visitor), intent(inout) :: self
      character(*), intent(in) :: name, units
      character(*), intent(in) :: axes    !! in Python's order; 'kept': that of the kept dofs
      character(*), intent(in) :: about
      real(wp), intent(in), contiguous, optional, target :: values(..)
      real(wp), pointer :: row(:)
      integer :: last

      if (.not. present(values)) return
      last = index(axes, ' ', back=.true.)
      if (axes(last + 1:) == 'kept') then
         call self%visit(name, units, axes(:last)//self%dof, about, values)
      else if (allocated(self%best)) then
         call self%group%put(name, values, '1', &
                             'standard error of plain sampling over that of the estimate', axes)
         call c_f_pointer(c_loc(values), row, [size(values)])
         call note_gain(self, name, row)
      else
         call self%group%put(name, values, units, about, axes)
      end if
   end subroutine visit

   !> Notes with a best estimate how it came about and what that gains.
   subroutine note_gain(self, name, ratio)
      class(statistics_visitor), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(in) :: ratio(:)   !! plain sampling's errors over the estimate's
      type(group_type) :: dataset
      integer :: order(size(ratio))

      if (allocated(self%group%error)) return
      dataset = self%best
      dataset%path = self%best%path//'/'//name
      order = sort_order(ratio)
      call dataset%attribute('error_ratio', ratio(order((size(order) + 1)/2)))
      if (maxval(ratio) > 1.0_wp) then
         call dataset%attribute('estimator', self%estimator)
         if (self%pooled_with /= '') call dataset%attribute('pooled_with', self%pooled_with)
      else
         call dataset%attribute('estimator', 'plain')
         call dataset%attribute('plain_reason', 'the regression explains too little')
      end if
      call dataset%take_error(self%group%error)
   end subroutine note_gain

end module io_case_statistics
