!> What settings cost and what they buy, as the group /tradeoff of a file of its own.
module io_tradeoff_results
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: wp
   use ensemble_plan, only: plan_type
   use ensemble_tradeoff_effects, only: variant_row
   use ensemble_tradeoff_front, only: error_parts, setting_row, size_row, spectrum_row
   use ensemble_tradeoff_process, only: order_row
   use ensemble_tradeoff_settings, only: setting_dt
   use ensemble_tradeoff_variants, only: variant_type
   use io_files, only: exists
   use io_group, only: counted, group_type, new_group
   use io_hdf5, only: hdf5_file, label_type, open_hdf5
   use io_results, only: results_writer
   implicit none(type, external)
   private
   public :: check_no_campaign, write_orders, write_parts, write_settings, write_sizes, &
             write_spectra, write_variants

contains

   !> A file of that name must not be there, or be an earlier tradeoff, which is replaced.
   subroutine check_no_campaign(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      if (.not. exists(path)) return
      call open_hdf5(path, file, error)
      if (allocated(error)) return
      if (.not. file%has('/tradeoff')) &
         call raise(error, exit_file, path//': holds something else than a tradeoff: give '// &
                    'another --output')
      call file%abandon()
   end subroutine check_no_campaign

   !> One row per setting.
   subroutine write_settings(writer, plan, rows, n_short, seconds_per_ns, error)
      type(results_writer), intent(in) :: writer
      type(plan_type), intent(in) :: plan
      type(setting_row), intent(in) :: rows(:)
      integer, intent(in) :: n_short               !! steps that were marched
      real(wp), intent(in) :: seconds_per_ns       !! of the whole scene for a sample-step's cost
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(writer%file, '/tradeoff')
      call group%attribute('n_steps', n_short)
      call group%attribute('reference', 'event, tolerance 1e-12')
      call group%attribute('method_meanings', '0 newmark, 1 event')
      call group%put('setting', counted(size(rows)), label_type('1', 'setting', 'setting'))
      call put_integers('method', merge(1, 0, rows%setting%method == 'event'), &
                        'method: 0 newmark, 1 event')
      call put('dt', setting_dt(rows%setting, plan%integration%dt), 's', &
               'step of the march under the same force')
      call put_integers('max_halvings', rows%setting%max_halvings, 'newmark: halvings of a step')
      call put('tolerance', rows%setting%tolerance, '1', 'event: tolerance')
      call put('cost', rows%cost, 'ns', 'processor time of a sample-step of the scene')
      call put('work', rows%work, 'ns', 'the same expected from counted work')
      call put('seconds', seconds_per_ns*rows%cost, 's', 'processor time of the march of the scene')
      call put('slip', rows%slip, '%', 'rms error of a slip fraction, in points')
      call put('slip_error', rows%slip_error, '%', 'standard error of slip')
      call put('slip_mean', rows%slip_mean, '%', 'error of the mean slip fraction, in points')
      call put('slip_std', rows%slip_std, '%', &
               'error of the standard deviation of slip fractions, in points')
      call put('psd_mean', rows%psd_mean, '1', 'relative error of the mean spectrum')
      call put('psd_percentiles', rows%psd_percentiles, '1', &
               'relative error of the percentiles of the spectrum')
      call put('band_ratio', rows%band_ratio, '1', 'relative error of the band ratio')
      call put('band_ratio_error', rows%band_ratio_error, '1', 'standard error of band_ratio')
      call put_integers('is_on_front', merge(1, 0, rows%is_on_front), &
                        '1: nothing cheaper has a smaller error of slip')
      call put_integers('is_own', merge(1, 0, rows%is_own), '1: the setting of the scene')
      call group%take_error(error)

   contains

      subroutine put(name, values, units, long_name)
         character(*), intent(in) :: name, units, long_name
         real(wp), intent(in) :: values(:)

         call group%put(name, values, label_type(units, long_name, 'setting'))
      end subroutine put

      subroutine put_integers(name, values, long_name)
         character(*), intent(in) :: name, long_name
         integer, intent(in) :: values(:)

         call group%put(name, values, label_type('1', long_name, 'setting'))
      end subroutine put_integers

   end subroutine write_settings

   !> What the error of the scene's own results is made of.
   subroutine write_parts(writer, parts, error)
      type(results_writer), intent(in) :: writer
      type(error_parts), intent(in) :: parts
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(writer%file, '/tradeoff/parts')
      call group%put_value('discretisation_slip', parts%discretisation_slip, '%', &
                           'error of slip fractions by the setting, in points')
      call group%put_value('time_slip', parts%time_slip, '%', &
                           'standard error of mean slip fractions for the length of the march')
      call group%put_value('samples_slip', parts%samples_slip, '%', &
                           'standard error of mean slip fractions for the number of samples')
      call group%put_value('samples_slip_std', parts%samples_slip_std, '%', &
                           'the same of their standard deviation')
      call group%put_value('discretisation_ratio', parts%discretisation_ratio, '1', &
                           'relative error of band ratios by the setting')
      call group%put_value('time_ratio', parts%time_ratio, '1', &
                           'relative standard error of band ratios for the length of the march')
      call group%put_value('samples_ratio', parts%samples_ratio, '1', &
                           'relative standard error of band ratios for the number of samples')
      call group%take_error(error)
   end subroutine write_parts

   !> Ways to form spectra.
   subroutine write_spectra(writer, rows, error)
      type(results_writer), intent(in) :: writer
      type(spectrum_row), intent(in) :: rows(:)
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      if (size(rows) == 0) return
      group = new_group(writer%file, '/tradeoff/spectra')
      call group%put('way', counted(size(rows)), label_type('1', 'way to form spectra', 'way'))
      call group%put('every', rows%every, label_type('1', 'steps between values', 'way'))
      call group%put('segment_length', rows%segment_length, &
                     label_type('1', 'steps of a segment', 'way'))
      call group%put('cost', rows%cost, label_type('ns', &
                     'processor time of a sample-step, march included', 'way'))
      call group%put('band_ratio', rows%band_ratio, label_type('1', &
                     'largest relative change of a band ratio from the first way', 'way'))
      call group%take_error(error)
   end subroutine write_spectra

   !> Other numbers of samples and steps.
   subroutine write_sizes(writer, rows, error)
      type(results_writer), intent(in) :: writer
      type(size_row), intent(in) :: rows(:)
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(writer%file, '/tradeoff/sizes')
      call group%put('size', counted(size(rows)), label_type('1', 'samples and steps', 'size'))
      call group%put('n_samples', rows%n_samples, &
                     label_type('1', 'samples of the largest case', 'size'))
      call group%put('n_steps', real(rows%n_steps, wp), label_type('1', 'steps', 'size'))
      call group%put('slip_mean', rows%slip_mean, &
                     label_type('%', 'error of mean slip fractions, all parts, in points', 'size'))
      call group%put('slip_std', rows%slip_std, &
                     label_type('%', 'the same of their standard deviation', 'size'))
      call group%put('band_ratio', rows%band_ratio, &
                     label_type('1', 'relative error of band ratios, all parts', 'size'))
      call group%put('seconds', rows%seconds, &
                     label_type('s', 'processor time of the march', 'size'))
      call group%take_error(error)
   end subroutine write_sizes

   !> Processes with other orders and fits.
   subroutine write_variants(writer, variants, rows, n_samples, n_steps, error)
      type(results_writer), intent(in) :: writer
      type(variant_type), intent(in) :: variants(:)
      type(variant_row), intent(in) :: rows(:)
      integer, intent(in) :: n_samples, n_steps   !! that were marched
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      if (size(rows) == 0) return
      group = new_group(writer%file, '/tradeoff/variants')
      call group%attribute('n_samples', n_samples)
      call group%attribute('n_steps', n_steps)
      call group%put('variant', counted(size(rows)), &
                     label_type('1', 'process fitted otherwise', 'variant'))
      associate (own => variants(rows%variant))
         call put_integers('process', own%process, 'process of the scene that is varied')
         call put_integers('order', own%request%order, 'order M or m_max')
         call put_integers('fit_steps', own%request%fit_steps, &
                           'simulated values of a batch of the fit; 0: chosen')
         call put_integers('is_of_fit', merge(1, 0, own%is_of_fit), &
                           '1: other lengths of the fit are compared, 0: other orders')
         call put_integers('is_own', merge(1, 0, own%is_own), '1: as the scene has it')
      end associate
      call put_integers('is_reference', merge(1, 0, rows%is_reference), &
                        '1: the others of this process are compared with it')
      call put('seconds', rows%seconds, 's', 'processor time of the fit')
      call put('slip_mean', rows%slip_mean, '%', 'change of the mean slip fraction, in points')
      call put('slip_mean_error', rows%slip_mean_error, '%', 'standard error of slip_mean')
      call put('slip_std', rows%slip_std, '%', &
               'change of the standard deviation of slip fractions, in points')
      call put('slip_std_error', rows%slip_std_error, '%', 'standard error of slip_std')
      call put('band_ratio', rows%band_ratio, '1', 'relative change of the band ratio')
      call put('band_ratio_error', rows%band_ratio_error, '1', 'standard error of band_ratio')
      call group%take_error(error)

   contains

      subroutine put(name, values, units, long_name)
         character(*), intent(in) :: name, units, long_name
         real(wp), intent(in) :: values(:)

         call group%put(name, values, label_type(units, long_name, 'variant'))
      end subroutine put

      subroutine put_integers(name, values, long_name)
         character(*), intent(in) :: name, long_name
         integer, intent(in) :: values(:)

         call group%put(name, values, label_type('1', long_name, 'variant'))
      end subroutine put_integers

   end subroutine write_variants

   !> Orders of the processes.
   subroutine write_orders(writer, rows, error)
      type(results_writer), intent(in) :: writer
      type(order_row), intent(in) :: rows(:)
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group
      integer :: i, n

      n = size(rows)
      if (n == 0) return
      group = new_group(writer%file, '/tradeoff/orders')
      call group%put('row', counted(n), label_type('1', 'process and order', 'row'))
      call group%put('is_direct', [(merge(1, 0, rows(i)%method == 'direct'), i=1, n)], &
                     label_type('1', '0: autoregressive, 1: direct method', 'row'))
      call group%put('imposes_l1', [(merge(1, 0, rows(i)%correlation == 'L1'), i=1, n)], &
                     label_type('1', 'length imposed, 0: L0, 1: L1', 'row'))
      call group%put('correlation_length', rows%correlation_length, &
                     label_type('1', 'length imposed', 'row'))
      call group%put('order', rows%order, label_type('1', 'order M or m_max', 'row'))
      call group%put('is_own', merge(1, 0, rows%is_own), &
                     label_type('1', '1: an order of the scene', 'row'))
      call group%put('entropy_lost', rows%entropy_lost, &
                     label_type('nat', 'entropy per point below that of white noise', 'row'))
      call group%put('other_length', rows%other_length, &
                     label_type('1', 'length that is not imposed', 'row'))
      call group%put('milliseconds', rows%milliseconds, &
                     label_type('ms', 'processor time of the fit', 'row'))
      call group%take_error(error)
   end subroutine write_orders

end module io_tradeoff_results
