!> A small campaign whose numbers are formulas of case, sample and dof, so that nothing needs to be
!> marched.
module io_campaign
   use campaign_comparison, only: compare_slip, compare_spectra, numerical_error
   use campaign_plan, only: add_audits, plan_type
   use campaign_results, only: block_result, case_estimates, case_statistics, spectrum_layout
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: to_text
   use io_blocks, only: write_block
   use io_case_statistics, only: write_audit, write_estimates
   use io_files, only: make_folder, process_id
   use io_lock, only: lock_type, take_lock
   use io_process_results, only: write_process
   use io_hdf5, only: hdf5_file, hdf5_group, hdf5_object
   use io_results, only: begin_case, finish_case, finish_results, write_structure
   use io_shards, only: list_shards, sort_shards, shard_type, stored_samples, write_shard
   use io_store, only: create_unfinished, discard_file, identity_type, shard_store
   use process_model, only: process_model_type
   use statistics_estimates, only: statistic_type
   use structure_chain, only: build_chain
   implicit none(type, external)
   private
   public :: ask_all, fresh_folder, keep_block, made_audit_block, made_block, made_identity, made_model, &
             write_made_results, write_made_shards

   integer, parameter, public :: n_dof = 3, n_frequencies = 130, n_steps = 20
   integer, parameter, public :: n_places = 96   !! batches of ranges of frequencies
   integer, parameter, public :: n_samples = 5   !! samples of case 2; case 1 has one

contains

   !> Path of a new folder for a test and process.
   function fresh_folder(name) result(folder)
      character(*), intent(in) :: name
      character(:), allocatable :: folder
      type(error_type), allocatable :: error

      folder = '/tmp/entroslip_test_io/'//name//'_'//to_text(process_id())
      call execute_command_line('rm -rf '//folder)
      call make_folder(folder, error)
      if (allocated(error)) error stop 'fresh_folder'
   end function fresh_folder

   function made_identity() result(identity)
      type(identity_type) :: identity

      identity%settings = 'scene%seed = 7'//new_line('a')//'process%std = 0.1'//new_line('a')// &
                          'process%order = 2'//new_line('a')
      identity%fingerprint = '00ab00cd'
      identity%version = '0.1.0'
      identity%architecture = 'x86-64, gfortran'
      identity%command = 'run'
   end function made_identity

   !> Case 1: none, one sample; case 2: process 1. Everything is asked for.
   function made_plan() result(plan)
      type(plan_type) :: plan
      type(error_type), allocatable :: error
      real(wp) :: one(n_dof)

      one = 1.0_wp
      call build_chain(one, 25.0_wp*one, 50.0_wp*one, 10.0_wp*one, 0.005_wp*one, plan%structure, error)
      if (allocated(error)) error stop 'made_plan'
      plan%title = 'made'
      allocate (plan%processes(1), plan%cases(2))
      plan%processes(1)%correlation_length = 0.3_wp
      plan%processes(1)%std = 0.067_wp
      plan%cases%n_samples = [1, n_samples]
      plan%cases%process = [0, 1]
      plan%cases%strength = [3.7_wp, 41.1_wp]
      plan%integration%n_steps = n_steps
      plan%integration%dt = 0.01_wp
      plan%integration%method = 'event'
      plan%friction_from = 'chain%friction'
      plan%output%slip = .true.
      plan%output%spectrum = .true.
      plan%output%energy = .true.
      plan%output%history = .true.
      plan%output%transitions = .true.
      plan%output%percentiles = [5.0_wp, 95.0_wp]
      plan%has_structure = .true.
   end function made_plan

   function made_layout() result(layout)
      type(spectrum_layout) :: layout
      integer :: i

      layout%segment_length = 2*(n_frequencies - 1)
      layout%overlap = n_frequencies - 1
      layout%n_segments = 7
      layout%frequency = [(0.1_wp*i, i=0, n_frequencies - 1)]
      layout%follows_power = .true.
   end function made_layout

   !> Samples first..last of a case; sample s has s transitions.
   function made_block(case_number, first, last) result(block)
      integer, intent(in) :: case_number, first, last
      type(block_result) :: block
      integer :: d, f, i, s, n

      n = last - first + 1
      block%case_number = case_number
      block%first_sample = first
      block%n_samples = n
      block%friction = reshape([((value(1, d, s), d=1, n_dof), s=first, last)], [n_dof, n])
      block%slip_fraction = reshape([((value(2, d, s), d=1, n_dof), s=first, last)], [n_dof, n])
      block%slip_series = reshape(0.5_wp*block%slip_fraction, [n_dof, 1, n])
      block%slip_starts = reshape([((5.0e9_wp + 10*s + d, d=1, n_dof), s=first, last)], &
                                  [n_dof, n])
      block%stick_starts = block%slip_starts + 1.0_wp
      block%slip_distance = 3.0_wp*block%slip_fraction
      block%dissipation = 0.25_wp*block%slip_distance
      block%energy_input = [(value(3, 1, s), s=first, last)]
      block%energy_viscous = [(value(3, 2, s), s=first, last)]
      block%energy_friction = [(value(3, 3, s), s=first, last)]
      block%energy_stored = [(value(3, 4, s), s=first, last)]
      block%energy_defect = [(value(3, 5, s), s=first, last)]
      block%psd = reshape([(((value(10 + f, d, s), d=1, n_dof), f=1, n_frequencies), s=first, &
                            last)], [n_dof, n_frequencies, n])
      block%power_series = reshape([(((value(200 + f, d, s), d=1, n_dof), f=1, n_places), s=first, &
                                     last)], [n_dof, n_places, n])
      block%displacement = reshape([(((value(f, d, -s), d=1, n_dof), f=0, n_steps), s=first, &
                                     last)], [n_dof, n_steps + 1, n])
      block%velocity = -2.0_wp*block%displacement
      allocate (block%transitions(n))
      do s = first, last
         do i = 1, s
            call block%transitions(s - first + 1)%append(0.1_wp*i, 1 + mod(i, n_dof), mod(i, 3) - 1)
         end do
      end do

   contains

      pure function value(what, dof, sample)
         integer, intent(in) :: what, dof, sample
         real(wp) :: value

         value = 1.0_wp/(case_number + 3*what + 7*dof + 1000*sample)
      end function value

   end function made_block

   !> The audit of case 2, fourth of all cases: its first three samples, a little different.
   function made_audit_block() result(block)
      type(block_result) :: block

      block = made_block(2, 1, 3)
      block%case_number = 4
      block%slip_fraction = block%slip_fraction + 0.001_wp
      block%psd = 1.01_wp*block%psd
      deallocate (block%slip_series, block%power_series, block%displacement, block%velocity, &
                  block%transitions)
   end function made_audit_block

   function made_statistics() result(statistics)
      type(case_statistics) :: statistics
      integer :: d

      statistics%n_samples = n_samples
      statistics%n_joints = n_dof
      allocate (statistics%numbers(3*n_dof, 4))   ! mean, percentiles, standard deviation
      associate (slip => statistics%numbers(:n_dof, :))
         slip(:, 1)%value = [(0.1_wp*d, d=1, n_dof)]
         slip(:, 1)%error = 0.01_wp*slip(:, 1)%value
         slip(:, 4)%value = 0.1_wp*slip(:, 1)%value
         slip(:, 4)%error = 0.01_wp*slip(:, 4)%value
         statistics%slip_mean_time_error = 0.02_wp*slip(:, 1)%value
      end associate
      allocate (statistics%psd(n_dof, n_frequencies, 3), source=statistic_type(2.5_wp))
      statistics%psd(:, :, 1)%value = 1.5_wp
      allocate (statistics%pseudo_variances(n_dof, 4), source=statistic_type(3.5_wp))
   end function made_statistics

   function made_model() result(model)
      type(process_model_type) :: model

      model%request%method = 'autoregressive'
      model%request%correlation = 'L0'
      model%request%sampler = 'sequential'
      model%request%correlation_length = 0.3_wp
      model%request%order = 2
      model%request%mean = 0.2_wp
      model%request%std = 0.067_wp
      model%request%positive = .true.
      model%request%inversion_half_width = 4
      model%is_solved = .true.
      model%order = 2
      model%a = [-0.25_wp, 0.0625_wp]
      model%b0 = 0.5_wp
      model%poles = [cmplx(0.1_wp, 0.2_wp, wp), cmplx(0.1_wp, -0.2_wp, wp)]
      model%autocovariance = [1.0_wp, 0.5_wp, 0.25_wp]
      model%autocovariance_error = [0.0_wp, 0.01_wp, 0.02_wp]
      model%l0 = 0.3_wp
      model%l0_error = 0.001_wp
      model%inversion%half_width = 4
      model%inversion%autocovariance = [1.0_wp, 0.5_wp]
      model%inversion%seconds = 0.75_wp
      model%inversion%seconds_of_fit = 0.125_wp
   end function made_model

   !> All requests are that of made_model.
   subroutine ask_all(models)
      type(process_model_type), intent(inout) :: models(:)
      type(process_model_type) :: asked
      integer :: i

      asked = made_model()
      do i = 1, size(models)
         models(i)%request = asked%request
      end do
   end subroutine ask_all

   !> One block as a shard.
   subroutine keep_block(store, block, error)
      type(shard_store), intent(in) :: store
      type(block_result), intent(in) :: block
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: blocks(1)

      blocks(1) = block
      call write_shard(store, blocks, error)
   end subroutine keep_block

   !> Case 1 in one shard, case 2 in two.
   subroutine write_made_shards(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: case_number(3) = [1, 2, 2], first(3) = [1, 1, 4], &
                            last(3) = [1, 3, n_samples]
      type(block_result) :: block
      integer :: i

      do i = 1, 3
         block = made_block(case_number(i), first(i), last(i))
         call keep_block(store, block, error)
         if (allocated(error)) return
      end do
   end subroutine write_made_shards

   !> Writes the results file of the shards as a run does, with an audit of case 2 if asked.
   subroutine write_made_results(path, store, error, has_audit)
      character(*), intent(in) :: path
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      logical, intent(in), optional :: has_audit
      type(shard_type), allocatable :: shards(:)
      type(error_type), allocatable :: ignored
      type(lock_type) :: lock
      type(hdf5_file) :: file
      type(hdf5_object) :: object

      call list_shards(store, shards, error)
      if (.not. allocated(error)) call take_lock(path, lock, error)
      if (allocated(error)) return
      call create_unfinished(path, made_identity(), file, error)
      if (.not. allocated(error)) then
         object = hdf5_object(file, '/')
         call object%attribute('title', 'made')
         call object%take_error(error)
      end if
      if (.not. allocated(error)) then
         call fill_made_results(file, store, shards, error, has_audit)
         if (.not. allocated(error)) call finish_results(file, lock, 1.0_wp, error)
         if (allocated(error)) call discard_file(file)
      end if
      call lock%release(ignored)
   end subroutine write_made_results

   subroutine fill_made_results(file, store, shards, error, has_audit)
      type(hdf5_file), intent(in) :: file
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(error_type), allocatable, intent(out) :: error
      logical, intent(in), optional :: has_audit
      type(stored_samples) :: stored
      type(plan_type) :: plan
      type(block_result) :: samples
      type(hdf5_group) :: group
      type(case_estimates) :: estimates
      real(wp) :: force(n_steps + 1, 1)
      integer :: dof, i

      force = 1.0_wp
      plan = made_plan()
      call sort_shards(store, shards, stored)
      call write_process(file, 1, made_model(), error, realizations=force)
      if (.not. allocated(error)) call write_structure(file, plan, error)
      do i = 1, 2
         if (allocated(error)) exit
         call begin_case(file, plan, i, made_layout(), [(0.001_wp, dof=1, n_dof)], group, force)
         call stored%read(i, 1, plan%cases(i)%n_samples, samples, error)
         if (allocated(error)) exit
         call write_block(group, plan, samples)
         call finish_case(group, plan, i, stored, error)
         if (allocated(error)) exit
         if (plan%cases(i)%n_samples == 1) cycle   ! without statistics
         estimates%best = made_statistics()
         estimates%reason = ''
         call write_estimates(group, estimates%best, estimates, error)
      end do
      if (.not. present(has_audit) .or. allocated(error)) return
      plan%accuracy%audit = 0.6_wp
      call add_audits(plan)
      call write_made_audit(file, plan, samples, store, error)
   end subroutine fill_made_results

   subroutine write_made_audit(file, plan, samples, store, error)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: samples   !! samples of case 2
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      type(stored_samples) :: stored
      type(block_result) :: block
      type(numerical_error) :: errors

      block = made_audit_block()
      call keep_block(store, block, error)
      if (.not. allocated(error)) call list_shards(store, shards, error)
      if (allocated(error)) return
      call sort_shards(store, shards, stored)
      call stored%read(4, 1, 3, block, error)
      if (allocated(error)) return
      call compare_slip(samples%slip_fraction(:, :3), block%slip_fraction, 5, errors)
      call compare_spectra(made_audit_psd()/1.01_wp, made_audit_psd(), plan%output%percentiles, 5, &
                           errors)
      call write_audit(file, plan, 4, block, made_layout(), errors, stored, error)

   contains

      function made_audit_psd() result(psd)
         real(wp), allocatable :: psd(:, :, :)
         type(block_result) :: made

         made = made_audit_block()
         psd = made%psd
      end function made_audit_psd

   end subroutine write_made_audit

end module io_campaign
