!> Results of the samples of a case, in its group of the results file: small data by groups of
!> samples, spectra, histories and transitions shard by shard, so that memory does not grow with the
!> number of samples.
module io_case_samples
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use campaign_plan, only: kept_dofs, output_settings, plan_type
   use campaign_results, only: block_result, spectrum_layout
   use campaign_time_average, only: count_spans, fewest_spans, time_average_method
   use core_kinds, only: long, wp
   use dynamics_response, only: transition_list
   use io_blocks, only: sample_label
   use io_gathering, only: count_transitions
   use io_group, only: counted, group_type
   use io_hdf5, only: label_type
   use io_shards, only: read_shard, shard_type
   use io_store, only: shard_store
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   implicit none(type, external)
   private
   public :: energy_terms
   public :: batch_frequencies, kept_axis, make_samples, put_samples, write_dofs, write_long

   !> Datasets of the energy ledger, in the order of its terms.
   character(*), parameter :: energy_terms(*) = [character(15) :: 'energy_input', &
                                                              'energy_viscous', 'energy_friction', &
                                                                   'energy_stored', 'energy_defect']

contains

   !> The dofs, and those of the spectra and histories where they are not all.
   subroutine write_dofs(group, plan)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: kept

      call group%put('dof', counted(plan%structure%n_dof), &
                     label_type('1', 'degree of freedom; of a chain: mass, from the wall', 'dof'))
      call group%put('joint', counted(plan%structure%n_joints), &
                     label_type('1', 'joint; of a chain: that of the mass of this number', 'joint'))
      kept = kept_axis(plan)
      if (kept /= 'dof') &
         call group%put(kept, kept_dofs(plan), &
                        label_type('1', 'dof whose spectra and histories are kept', kept))
   end subroutine write_dofs

   !> The highest frequency [Hz] of the range of each place in a power series.
   pure function batch_frequencies(layout) result(highest)
      type(spectrum_layout), intent(in) :: layout
      real(wp), allocatable :: highest(:)
      integer :: i

      associate (last => last_of_ranges(size(layout%frequency)))
         highest = [(spread(layout%frequency(last(i)), 1, n_batches), i=1, size(last))]
      end associate
   end function batch_frequencies

   !> The axis of the dofs whose spectra and histories are kept.
   pure function kept_axis(plan) result(name)
      type(plan_type), intent(in) :: plan
      character(:), allocatable :: name

      name = 'dof'
      if (size(kept_dofs(plan)) < plan%structure%n_dof) name = 'kept_dof'
   end function kept_axis

   !> Room for the small data of all samples.
   subroutine make_samples(group, plan, kept, n_samples)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(output_settings), intent(in) :: kept   !! of the case
      integer, intent(in) :: n_samples
      character(*), parameter :: meaning(*) = [character(40) :: 'work of the force', &
                                                                    'work of the viscous damping', &
                                                                           'work of the friction', &
                                                           'kinetic and strain energy at the end', &
                                                               'what the balance of energies lacks']
      character(:), allocatable :: long_name
      integer :: extents(2), i

      extents = [plan%structure%n_joints, n_samples]
      call group%make('friction', 0.0_wp, extents, sample_label('friction'))
      call group%make('slip_fraction', 0.0_wp, extents, sample_label('slip_fraction'))
      call group%make('slip_starts', 0_long, extents, sample_label('slip_starts'))
      call group%make('stick_starts', 0_long, extents, sample_label('stick_starts'))
      call group%make('slip_distance', 0.0_wp, extents, sample_label('slip_distance'))
      call group%make('dissipation', 0.0_wp, extents, sample_label('dissipation'))
      if (kept%spectrum) call group%make('joint_displacement_max', 0.0_wp, extents, &
                                         sample_label('joint_displacement_max'))
      if (kept%slip .and. count_spans(plan%integration) >= fewest_spans) then
         call group%attribute('time_average_method', time_average_method)
         call group%make('slip_fraction_error', 0.0_wp, extents, &
                         label_type('1', 'standard error of slip_fraction: the march is finite', &
                                    'sample joint'))
      end if
      if (kept%harmonic) then
         call group%make('harmonic_amplitude', 0.0_wp, [plan%structure%n_dof, n_samples], &
                         sample_label('harmonic_amplitude'))
         call group%make('harmonic_phase', 0.0_wp, [plan%structure%n_dof, n_samples], &
                         sample_label('harmonic_phase'))
         call group%make('steady_since', 0.0_wp, [n_samples], sample_label('steady_since'))
         call group%make('steady', 0, [n_samples], &
                         label_type('1', '1: the last two windows of ten periods agree to 1e-3', &
                                    'sample'))
      end if
      if (.not. kept%energy) return
      do i = 1, size(energy_terms)
         long_name = trim(meaning(i))   ! gfortran would not free it inside of the constructor
         call group%make(trim(energy_terms(i)), 0.0_wp, [n_samples], &
                         label_type('J', long_name, 'sample'))
      end do
   end subroutine make_samples

   !> Small data of some samples.
   subroutine put_samples(group, samples, slip_fraction_error)
      type(group_type), intent(inout) :: group
      type(block_result), intent(in) :: samples
      real(wp), allocatable, intent(in) :: slip_fraction_error(:, :)   !! (joint, sample)
      real(wp), allocatable :: term(:)
      integer :: i

      associate (first => samples%first_sample)
         call group%put_part('friction', [1, first], samples%friction)
         call group%put_part('slip_fraction', [1, first], samples%slip_fraction)
         call group%put_part('slip_starts', [1, first], samples%slip_starts)
         call group%put_part('stick_starts', [1, first], samples%stick_starts)
         call group%put_part('slip_distance', [1, first], samples%slip_distance)
         call group%put_part('dissipation', [1, first], samples%dissipation)
         if (allocated(samples%joint_displacement_max)) &
            call group%put_part('joint_displacement_max', [1, first], &
                                samples%joint_displacement_max)
         if (allocated(slip_fraction_error)) &
            call group%put_part('slip_fraction_error', [1, first], slip_fraction_error)
         if (allocated(samples%steady_since)) then
            call group%put_part('harmonic_amplitude', [1, first], samples%harmonic_amplitude)
            call group%put_part('harmonic_phase', [1, first], samples%harmonic_phase)
            call group%put_part('steady_since', [first], samples%steady_since)
            call group%put_part('steady', [first], merge(0, 1, ieee_is_nan(samples%steady_since)))
         end if
         if (.not. allocated(samples%energy)) return
         do i = 1, size(energy_terms)
            term = samples%energy(i, :)
            call group%put_part(trim(energy_terms(i)), [first], term)
         end do
      end associate
   end subroutine put_samples

   !> Series, spectra, histories and transitions, one shard after the other.
   subroutine write_long(group, plan, kept, layout, n_samples, store, shards)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(output_settings), intent(in) :: kept   !! of the case
      type(spectrum_layout), intent(in) :: layout
      integer, intent(in) :: n_samples
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of this case
      type(block_result) :: block
      integer :: first, i, n, n_rows

      n_rows = 0
      call make_long(group, plan, kept, layout, n_samples, shards)
      do i = 1, size(shards)
         if (allocated(group%error)) return
         call read_shard(store, shards(i), block, group%error)
         if (allocated(group%error)) return
         first = block%first_sample
         n = min(block%n_samples, n_samples - first + 1)
         if (kept%slip) &
            call group%put_part('slip_series', [1, 1, first], block%slip_series(:, :, :n))
         if (kept%keeps_spectra(n_samples)) then
            call group%put_part('psd', [1, 1, first], block%psd(:, :, :n))
            if (allocated(block%power_series)) &
               call group%put_part('power_series', [1, 1, first], block%power_series(:, :, :n))
         end if
         if (kept%history) then
            call group%put_part('displacement', [1, 1, first], block%displacement(:, :, :n))
            call group%put_part('velocity', [1, 1, first], block%velocity(:, :, :n))
         end if
         if (kept%transitions) then
            call put_transitions(group, plan%cases(block%case_number)%first_sample - 1 + first, &
                                 block%transitions(:n), n_rows)
         end if
      end do
   end subroutine write_long

   subroutine make_long(group, plan, kept, layout, n_samples, shards)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(output_settings), intent(in) :: kept   !! of the case
      type(spectrum_layout), intent(in) :: layout
      integer, intent(in) :: n_samples
      type(shard_type), intent(in) :: shards(:)
      integer :: n_kept, n_rows, n_steps

      n_kept = size(kept_dofs(plan))
      n_steps = plan%integration%n_steps + 1
      if (kept%slip) then
         call group%make('slip_series', 0.0_wp, &
                         [plan%structure%n_joints, count_spans(plan%integration), n_samples], &
                         sample_label('slip_series'))
      end if
      if (kept%keeps_spectra(n_samples)) then
         call group%make('psd', 0.0_wp, [n_kept, size(layout%frequency), n_samples], &
                         label_of_kept('psd'))
      end if
      if (kept%keeps_spectra(n_samples) .and. layout%follows_power) then
         call group%make('power_series', 0.0_wp, &
                         [n_kept, size(batch_frequencies(layout)), n_samples], &
                         label_of_kept('power_series'))
      end if
      if (kept%history) then
         call group%make('displacement', 0.0_wp, [n_kept, n_steps, n_samples], &
                         label_of_kept('displacement'))
         call group%make('velocity', 0.0_wp, [n_kept, n_steps, n_samples], &
                         label_of_kept('velocity'))
      end if
      if (kept%transitions .and. .not. allocated(group%error)) then
         call count_transitions(shards, n_samples, n_rows, group%error)
         call group%put('transition', counted(n_rows), label_type('1', 'transition', 'transition'))
         call group%make('transition_sample', 0, [n_rows], &
                         label_type('1', 'sample of the transition', 'transition'))
         call group%make('transition_time', 0.0_wp, [n_rows], &
                         label_type('s', 'time of the transition', 'transition'))
         call group%make('transition_joint', 0, [n_rows], &
                         label_type('1', 'joint of the transition', 'transition'))
         call group%make('transition_kind', 0, [n_rows], &
                         label_type('1', '+1, -1: slip starts in that direction; 0: sticks', &
                                    'transition'))
      end if

   contains

      !> The last axis is that of the dofs.
      function label_of_kept(name) result(label)
         character(*), intent(in) :: name
         type(label_type) :: label

         label = sample_label(name)
         label%axes = label%axes(:index(label%axes, ' ', back=.true.))//kept_axis(plan)
      end function label_of_kept

   end subroutine make_long

   !> The transitions of some samples, below the rows that are filled already.
   subroutine put_transitions(group, first_sample, transitions, n_rows)
      type(group_type), intent(inout) :: group
      integer, intent(in) :: first_sample
      type(transition_list), intent(in) :: transitions(:)
      integer, intent(inout) :: n_rows
      integer :: i

      do i = 1, size(transitions)
         associate (list => transitions(i), row => [n_rows + 1])
            if (list%n == 0) cycle
            call group%put_part('transition_sample', row, spread(first_sample + i - 1, 1, list%n))
            call group%put_part('transition_time', row, list%time(:list%n))
            call group%put_part('transition_joint', row, list%joint(:list%n))
            call group%put_part('transition_kind', row, list%kind(:list%n))
         end associate
         n_rows = n_rows + transitions(i)%n
      end do
   end subroutine put_transitions

end module io_case_samples
