!> A process as a group of the results file: the request and the solution.
module io_process_results
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use io_group, only: counted, group_type, new_group
   use io_hdf5, only: hdf5_file, label_type, read_attribute, read_dataset, read_extent
   use io_results, only: results_writer
   use process_model, only: process_model_type, process_request
   use process_packing, only: pack_model, unpack_model
   use process_reference, only: has_one_value, law_name
   implicit none(type, external)
   private
   public :: process_name, read_process, write_process

contains

   !> p001, p002, ...; 'none' for 0.
   pure function process_name(number) result(name)
      integer, intent(in) :: number
      character(:), allocatable :: name
      character(16) :: buffer

      write (buffer, '(a, i0.3)') 'p', number
      name = trim(buffer)
      if (number == 0) name = 'none'
   end function process_name

   !> A solved process, or a refused one with its reason.
   subroutine write_process(writer, number, model, error, realizations)
      type(results_writer), intent(in) :: writer
      integer, intent(in) :: number
      type(process_model_type), intent(in) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), contiguous, optional :: realizations(:, :)   !! (point, realization)
      type(group_type) :: group

      group = new_group(writer%file, '/process/'//process_name(number))
      call write_request(group, model%request)
      call group%attribute('status', trim(merge('solved    ', 'infeasible', model%is_solved)))
      if (allocated(model%reason)) call group%attribute('reason', model%reason)
      if (model%request%method == 'values') then
         call write_moments(group, model)
      else if (model%is_solved) then
         if (allocated(model%g)) then
            call write_precision(group, model)
         else
            call write_recursion(group, model)
         end if
         if (allocated(model%branch)) call write_branch(group, model)
         call write_correlation(group, model)
         if (.not. has_one_value(model%request)) call write_entropies(group, model)
         if (model%other_std > 0.0_wp) call write_other_law(group, model)
         if (allocated(model%signs)) call write_direct(group, model)
         if (model%inversion%half_width > 0) call write_inversion(group, model)
      end if
      call write_packed(group, model)
      if (present(realizations)) call write_realizations(group, realizations)
      call group%take_error(error)
   end subroutine write_process

   !> All that write_process was given of a process, but for the request, if the file has it.
   subroutine read_process(file, number, model, is_there, error)
      type(hdf5_file), intent(in) :: file
      integer, intent(in) :: number
      type(process_model_type), intent(out) :: model
      logical, intent(out) :: is_there
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: group
      real(wp), allocatable :: row(:)
      integer(long), allocatable :: n(:)
      logical :: is_sound

      group = '/process/'//process_name(number)
      is_there = file%has(group//'/packed')
      if (.not. is_there) return
      call read_extent(file, group//'/packed', 1, n, error)
      if (allocated(error)) return
      allocate (row(n(1)))
      call read_dataset(file, group//'/packed', row, error)
      if (allocated(error)) return
      call unpack_model(row, model, is_sound)
      if (.not. is_sound) call raise(error, exit_file, file%path//': '//group//'/packed is '// &
                                     'damaged: it does not hold a process')
      if (allocated(error)) return
      if (model%inversion%half_width == 0) return
      call read_attribute(file, group, 'inversion_seconds', model%inversion%seconds, error)
      if (allocated(error)) return
      call read_attribute(file, group, 'direct_seconds', model%inversion%seconds_of_fit, error)
   end subroutine read_process

   subroutine write_request(group, request)
      type(group_type), intent(inout) :: group
      type(process_request), intent(in) :: request

      call group%attribute('law', law_name(request))
      call group%attribute('method', request%method)
      call group%attribute('correlation', request%correlation)
      call group%attribute('correlation_length', request%correlation_length)
      if (request%correlation == 'both') &
         call group%attribute('second_length', request%second_length)
      call group%attribute('order', request%order)
      call group%attribute('mean', request%mean)
      call group%attribute('std', request%std)
      call group%attribute('positive', request%positive)
      call group%attribute('sampler', request%sampler)
      if (request%positive) call group%attribute('branch_asked', trim(request%branch))
      if (.not. request%positive) call group%attribute('simulation', trim(request%simulation))
      if (request%order > 0) return
      call group%attribute('bound_l0', request%bound_l0)
      call group%attribute('bound_l1', request%bound_l1)
      if (request%upper_bound > 0.0_wp) call group%attribute('upper_bound', request%upper_bound)
      call group%attribute('bound_side', trim(request%bound_side))
      call group%attribute('max_order', request%max_order)
   end subroutine write_request

   !> Eq. (39): a, b0, mu, and the poles of Eq. (40).
   subroutine write_recursion(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      call group%put('order', counted(model%order), &
                     label_type('1', 'number of the coefficient', 'order'))
      call group%put('a', model%a, label_type('1', 'a_q of z_n = b0 w_n - sum a_q z_(n-q)', &
                                              'order'))
      call group%put_value('b0', model%b0, 'unit of x', 'scale of the innovations')
      call group%put_value('mu', model%mu, 'unit of x', 'mean of the underlying Gaussian process')
      if (.not. allocated(model%poles)) return
      call group%put('poles_real', real(model%poles, wp), &
                     label_type('1', 'real part of the poles', 'order'))
      call group%put('poles_imag', aimag(model%poles), &
                     label_type('1', 'imaginary part of the poles', 'order'))
   end subroutine write_recursion

   !> The exact law where K(m) alternates: G of Eq. (25), which may be indefinite.
   subroutine write_precision(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      call group%put('g_lag', counted(size(model%g)) - 1, label_type('1', 'lag of G', 'g_lag'))
      call group%put('g', model%g, label_type('1/unit of x squared', &
                                              'row of the matrix G, Eq. (25)', 'g_lag'))
      call group%put_value('centre', model%mu, 'unit of x', &
                           'value c of the density exp(-(x - c)'' G (x - c)/2) on x > 0')
   end subroutine write_precision

   !> Signs of the autocovariance of a positive process.
   subroutine write_branch(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      call group%attribute('branch', model%branch)
      call group%attribute('sign_of_first_lag', nint(sign(1.0_wp, model%autocovariance(1))))
      if (abs(model%nonnegative_entropy) > 0.0_wp) &
         call group%put_value('nonnegative_entropy', model%nonnegative_entropy, 'nat', &
                              'entropy per point of the other law''s process with K(m) >= 0, a '// &
                              'larger one')
   end subroutine write_branch

   !> True if the process is positive and its K(m) change their sign with every lag.
   pure logical function alternates(model)
      type(process_model_type), intent(in) :: model

      alternates = .false.
      if (allocated(model%branch)) alternates = model%branch == 'alternating'
   end function alternates

   !> Moments as achieved, with the standard errors of those that were sampled.
   subroutine write_correlation(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      if (allocated(model%autocovariance)) then
         call group%put('lag', counted(size(model%autocovariance)) - 1, &
                        label_type('1', 'lag', 'lag'))
         call group%put('autocovariance', model%autocovariance, &
                        label_type('unit of x squared', 'autocovariance K_XX', 'lag'))
      end if
      call group%put_allocated('autocovariance_error', model%autocovariance_error, &
                               label_type('unit of x squared', &
                                          'standard error of the autocovariance', 'lag'))
      call write_moments(group, model)
      call group%put_value('L0', model%l0, 'lag', 'correlation length, Eq. (8), infinite sum', &
                           model%l0_error)
      call group%put_value('L1', model%l1, 'lag', 'correlation length, Eq. (9), infinite sum', &
                           model%l1_error)
      call group%put_value('L0_cut', model%l0_cut, 'lag', &
                           'correlation length, Eq. (8), cut at the order')
      call group%put_value('L1_cut', model%l1_cut, 'lag', &
                           'correlation length, Eq. (9), cut at the order')
   end subroutine write_correlation

   subroutine write_moments(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      call group%put_value('mean_found', model%mean, 'unit of x', 'mean achieved', model%mean_error)
      call group%put_value('std_found', model%std, 'unit of x', 'standard deviation achieved', &
                           model%std_error)
   end subroutine write_moments

   subroutine write_entropies(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      call group%put_value('entropy', model%entropy, 'nat', 'entropy per point', &
                           model%entropy_error)
      call group%put_value('entropy_bound', model%entropy_bound, 'nat', &
                           'entropy per point of white noise of the same variance, Eq. (42)')
      call group%put_value('optimality', model%optimality, '1', &
                           'largest residual of the optimality conditions')
      if (allocated(model%g)) return
      if (.not. alternates(model)) &
         call group%put_value('lambda', model%lambda, '1', &
                              'limit of the acceptance of one more point, Eq. (45), of the '// &
                              'exact law with these a, b0 and mu', &
                              model%lambda_error)
      call group%put_value('acceptance_ratio', model%acceptance_ratio, '1', &
                           'points accepted of those proposed')
      call group%put_value('acceptance_mean', model%acceptance_mean, '1', &
                           'mean over the past of the probability to accept')
      call group%put_value('acceptance_geometric', model%acceptance_geometric, '1', &
                           'geometric mean over the past of the probability to accept')
   end subroutine write_entropies

   !> How far the other law is from the one asked for: what the same parameters give under it, where
   !! that is known.
   subroutine write_other_law(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model
      character(*), parameter :: same = ' of the other law with the same a, b0 and mu'

      call group%put_value('other_mean', model%other_mean, 'unit of x', 'mean'//same)
      call group%put_value('other_std', model%other_std, 'unit of x', 'standard deviation'//same)
      call group%put_value('other_L0', model%other_l0, 'lag', 'correlation length'//same)
      call group%put_value('other_entropy', model%other_entropy, 'nat', 'entropy per point'//same)
   end subroutine write_other_law

   !> Multipliers of the direct method, and all solutions that its sign search found.
   subroutine write_direct(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model
      integer :: i, n

      call group%put('sign', counted(size(model%signs)), label_type('1', 'lag of the sign', 'sign'))
      call group%put('signs', model%signs, &
                     label_type('1', 'sign s_m of the autocovariance', 'sign'))
      call group%put_value('delta', model%delta, '1', 'multiplier lambda_2/lambda_3')
      call group%put_value('lambda_3', model%lambda_3, '1', 'multiplier of the variance')
      if (allocated(model%search)) call group%attribute('search', model%search)
      call group%attribute('n_examined', model%n_examined)
      call group%attribute('n_consistent', model%n_consistent)
      if (.not. model%request%positive) &
         call group%put_value('entropy_ceiling', model%entropy_ceiling, 'nat', &
                              'entropy per point that no sign sequence exceeds')
      if (.not. allocated(model%solutions)) return
      n = size(model%solutions)
      call group%put('solution', counted(n), label_type('1', 'number of the solution', 'solution'))
      call group%put('solutions_signs', &
                     reshape([(model%solutions(i)%signs, i=1, n)], [size(model%signs), n]), &
                     label_type('1', 'signs of each solution', 'solution sign'))
      call group%put('solutions_delta', model%solutions%delta, &
                     label_type('1', 'delta of each', 'solution'))
      call group%put('solutions_lambda_3', model%solutions%lambda_3, &
                     label_type('1', 'lambda_3 of each', 'solution'))
      call group%put('solutions_entropy', model%solutions%entropy, &
                     label_type('nat', 'entropy per point of each', 'solution'))
   end subroutine write_direct

   !> The paper's finite matrix beside the direct method: how far off, and at what cost.
   subroutine write_inversion(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model

      associate (check => model%inversion)
         call group%attribute('inversion_half_width', check%half_width)
         call group%attribute('inversion_seconds', check%seconds)
         call group%attribute('direct_seconds', check%seconds_of_fit)
         call group%put('inversion_lag', counted(size(check%autocovariance)) - 1, &
                        label_type('1', 'lag', 'inversion_lag'))
         call group%put('inversion_autocovariance', check%autocovariance, &
                        label_type('unit of x squared', 'K_XX by inversion, Eq. (35)', &
                                   'inversion_lag'))
         call group%put_value('inversion_error', check%error, '1', &
                              'largest error of the inversion, over K_XX(0)')
         call group%put_value('inversion_expected_error', check%expected_error, '1', &
                              'largest pole to the power of twice the half-width')
      end associate
   end subroutine write_inversion

   !> For read_process. Times are the run's, not the process's: they stand in attributes alone.
   subroutine write_packed(group, model)
      type(group_type), intent(inout) :: group
      type(process_model_type), intent(in) :: model
      type(process_model_type) :: timeless

      timeless = model
      timeless%seconds = 0.0_wp
      timeless%inversion%seconds = 0.0_wp
      timeless%inversion%seconds_of_fit = 0.0_wp
      call group%put('packed', pack_model(timeless), &
                     label_type('1', 'all of the above in a row, for a run that goes on from '// &
                                'this file', 'packed'))
   end subroutine write_packed

   subroutine write_realizations(group, realizations)
      type(group_type), intent(inout) :: group
      real(wp), intent(in), contiguous :: realizations(:, :)   !! (point, realization)

      call group%put('point', counted(size(realizations, 1)), label_type('1', 'point', 'point'))
      call group%put('realization', counted(size(realizations, 2)), &
                     label_type('1', 'realization', 'realization'))
      call group%put('realizations', realizations, &
                     label_type('unit of x', 'realizations of the process', 'realization point'))
   end subroutine write_realizations

end module io_process_results
