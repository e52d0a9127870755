!> The tradeoff's file: its group /tradeoff has the costs and errors of settings, sample sizes,
!> spectra and processes.
module io_tradeoff_results
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_hdf5, only: hdf5_file, hdf5_group
   use tradeoff_effects, only: variant_row
   use tradeoff_front, only: error_parts, setting_row, size_row, spectrum_row
   use tradeoff_settings, only: setting_dt
   use tradeoff_task_results, only: band_ratio, psd_mean, psd_percentiles, slip, slip_mean, slip_std
   use tradeoff_tasks, only: tradeoff_type
   use tradeoff_variants, only: order_row
   implicit none(type, external)
   private
   public :: tradeoff_findings, write_tradeoff

   !> Results of a tradeoff; a scene without a structure has the orders alone.
   type :: tradeoff_findings
      type(plan_type) :: plan   !! plan of the scene
      integer :: n_ranks = 1    !! ranks of the run
      type(tradeoff_type) :: tradeoff
      type(setting_row), allocatable :: settings(:)
      type(spectrum_row), allocatable :: spectra(:)
      type(error_parts) :: errors
      type(size_row), allocatable :: sizes(:)
      type(variant_row), allocatable :: variants(:)
      type(order_row), allocatable :: orders(:)
   end type tradeoff_findings

contains

   !> Writes all groups; those of marches only if the scene has a structure.
   subroutine write_tradeoff(file, found, error)
      type(hdf5_file), intent(in) :: file
      type(tradeoff_findings), intent(in) :: found
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_group) :: group

      group%file = file
      if (found%plan%has_structure) then
         call write_settings(group, found%settings, found%plan%integration%dt, &
                             found%tradeoff%plan%integration%n_steps)
         call write_errors(group, found%errors)
         call group%change_to('/tradeoff/sizes')
         associate (rows => found%sizes)
            call group%start_table('size', size(rows), 'samples and steps')
            call group%put('n_samples', rows%n_samples, '1', 'samples of the largest case')
            call group%put('n_steps', real(rows%n_steps, wp), '1', 'steps')
            call group%put('slip_mean', rows%error(slip), '%', &
                           'total error of mean slip fractions, in points')
            call group%put('slip_std', rows%error(slip_std), '%', &
                           'total error of their std, in points')
            call group%put('band_ratio', rows%error(band_ratio), '1', &
                           'total relative error of band ratios')
            call group%put('seconds', rows%seconds, 's', 'processor time of the march')
         end associate
         if (size(found%spectra) > 0) then
            call group%change_to('/tradeoff/spectra')
            call group%start_table('way', size(found%spectra), 'way to form spectra')
            call group%put('every', found%spectra%every, '1', 'steps between values')
            call group%put('segment_length', found%spectra%segment_length, '1', &
                           'steps of a segment')
            call group%put('cost', found%spectra%cost, 'ns', &
                           'processor time of a sample-step, march included')
            call group%put('band_ratio', found%spectra%band_ratio, '1', &
                           'largest relative change of a band ratio from the first way')
         end if
         call write_variants(group, found%tradeoff, found%variants)
      end if
      call write_orders(group, found%orders)
      call group%take_error(error)
   end subroutine write_tradeoff

   !> Writes one row per setting.
   subroutine write_settings(group, rows, dt, n_short)
      type(hdf5_group), intent(inout) :: group
      type(setting_row), intent(in) :: rows(:)
      real(wp), intent(in) :: dt       !! step of the scene [s]
      integer, intent(in) :: n_short   !! steps of the trial marches

      call group%change_to('/tradeoff')
      call group%attribute('n_steps', n_short)
      call group%attribute('reference', 'event, tolerance 1e-12')
      call group%attribute('method_meanings', '0 newmark, 1 event')
      call group%start_table('setting', size(rows), 'setting')
      call group%put('method', merge(1, 0, rows%setting%method == 'event'), '1', &
                     'method: 0 newmark, 1 event')
      call group%put('dt', setting_dt(rows%setting, dt), 's', &
                     'step of the march under the same force')
      call group%put('max_halvings', rows%setting%max_halvings, '1', 'newmark: halvings of a step')
      call group%put('tolerance', rows%setting%tolerance, '1', 'event: tolerance')
      call group%put('cost', rows%cost, 'ns', 'processor time of a sample-step of the scene')
      call group%put('work', rows%work, 'ns', 'processor time expected from counted work')
      call group%put('seconds', rows%seconds, 's', 'processor time of the march of the scene')
      call group%put('slip', rows%error(slip), '%', 'rms error of a slip fraction, in points')
      call group%put('slip_error', 0.5_wp*(rows%error_bound(slip) - rows%error(slip)), '%', &
                     'standard error of slip')
      call group%put('slip_mean', rows%error(slip_mean), '%', &
                     'error of the mean slip fraction, in points')
      call group%put('slip_std', rows%error(slip_std), '%', &
                     'error of the standard deviation of slip fractions, in points')
      call group%put('psd_mean', rows%error(psd_mean), '1', 'relative error of the mean spectrum')
      call group%put('psd_percentiles', rows%error(psd_percentiles), '1', &
                     'relative error of the percentiles of the spectrum')
      call group%put('band_ratio', rows%error(band_ratio), '1', 'relative error of the band ratio')
      call group%put('band_ratio_error', &
                     0.5_wp*(rows%error_bound(band_ratio) - rows%error(band_ratio)), '1', &
                     'standard error of band_ratio')
      call group%put('is_on_front', merge(1, 0, rows%is_on_front), '1', &
                     '1: nothing cheaper has a smaller error of slip')
      call group%put('is_own', merge(1, 0, rows%is_own), '1', '1: the setting of the scene')
   end subroutine write_settings

   !> Writes the components of the error of the scene's results.
   subroutine write_errors(group, errors)
      type(hdf5_group), intent(inout) :: group
      type(error_parts), intent(in) :: errors

      call group%change_to('/tradeoff/parts')
      call put_component('discretisation', errors%discretisation, 'numerical error')
      call put_component('time', errors%time, 'time-average error')
      call put_component('samples', errors%samples, 'Monte Carlo error')

   contains

      subroutine put_component(name, component, long_name)
         character(*), intent(in) :: name, long_name
         real(wp), intent(in) :: component(:)   !! (published number)
         call group%put_value(name//'_slip', component(slip), '%', &
                              long_name//' of mean slip fractions')
         call group%put_value(name//'_slip_std', component(slip_std), '%', &
                              long_name//' of their standard deviation')
         call group%put_value(name//'_psd_mean', component(psd_mean), '1', &
                              long_name//' of mean spectra, relative')
         call group%put_value(name//'_psd_percentiles', component(psd_percentiles), '1', &
                              long_name//' of percentiles of spectra, relative')
         call group%put_value(name//'_ratio', component(band_ratio), '1', &
                              long_name//' of band ratios, relative')
      end subroutine put_component

   end subroutine write_errors

   !> Writes the changes of the results by other orders and fits of the processes.
   subroutine write_variants(group, tradeoff, rows)
      type(hdf5_group), intent(inout) :: group
      type(tradeoff_type), intent(in) :: tradeoff
      type(variant_row), intent(in) :: rows(:)

      if (size(rows) == 0) return
      call group%change_to('/tradeoff/variants')
      call group%attribute('n_samples', tradeoff%n_variant_samples)
      call group%attribute('n_steps', tradeoff%wide%integration%n_steps)
      call group%start_table('variant', size(rows), 'process fitted otherwise')
      associate (own => tradeoff%scope%variants(rows%variant))
         call group%put('process', own%process, '1', 'process of the scene that is varied')
         call group%put('order', own%request%order, '1', 'order M or m_max')
         call group%put('fit_steps', own%request%fit_steps, '1', &
                        'simulated values of a batch of the fit; 0: chosen')
         call group%put('is_of_fit', merge(1, 0, own%is_of_fit), '1', &
                        '1: other lengths of the fit are compared, 0: other orders')
         call group%put('is_own', merge(1, 0, own%is_own), '1', '1: as the scene has it')
      end associate
      call group%put('is_reference', merge(1, 0, rows%is_reference), '1', &
                     '1: the others of this process are compared with it')
      call group%put('seconds', rows%seconds, 's', 'processor time of the fit')
      call put_change('slip_mean', slip, '%', 'change of the mean slip fraction, in points')
      call put_change('slip_std', slip_std, '%', &
                      'change of the standard deviation of slip fractions, in points')
      call put_change('band_ratio', band_ratio, '1', 'relative change of the band ratio')

   contains

      subroutine put_change(name, place, units, long_name)
         character(*), intent(in) :: name, units, long_name
         integer, intent(in) :: place   !! index of the published number

         call group%put(name, rows%change(place), units, long_name)
         call group%put(name//'_error', rows%error(place), units, 'standard error of '//name)
      end subroutine put_change

   end subroutine write_variants

   !> Writes a row for each order of each process.
   subroutine write_orders(group, rows)
      type(hdf5_group), intent(inout) :: group
      type(order_row), intent(in) :: rows(:)
      integer :: i, n

      n = size(rows)
      if (n == 0) return
      call group%change_to('/tradeoff/orders')
      call group%start_table('row', n, 'process and order')
      call group%put('is_direct', [(merge(1, 0, rows(i)%method == 'direct'), i=1, n)], '1', &
                     '0: autoregressive, 1: direct method')
      call group%put('imposes_l1', [(merge(1, 0, rows(i)%correlation == 'L1'), i=1, n)], '1', &
                     'length imposed, 0: L0, 1: L1')
      call group%put('correlation_length', rows%correlation_length, '1', 'length imposed')
      call group%put('order', rows%order, '1', 'order M or m_max')
      call group%put('is_own', merge(1, 0, rows%is_own), '1', '1: an order of the scene')
      call group%put('entropy_lost', rows%entropy_lost, 'nat', &
                     'entropy per point below that of white noise')
      call group%put('other_length', rows%other_length, '1', 'length that is not imposed')
      call group%put('milliseconds', rows%milliseconds, 'ms', 'processor time of the fit')
   end subroutine write_orders

end module io_tradeoff_results
