!> Checks the rules between values of a scene. The tables of the groups have those of single values.
module config_rules
   use campaign_time_average, only: fewest_spans, shortest_span
   use config_excitation_rules, only: check_excitation
   use config_groups, only: scene_type
   use config_groups_motion, only: fewest_measured
   use config_groups_process, only: process_group
   use config_structure_rules, only: check_structure, check_values
   use config_text_reader, only: reader_type
   use core_kinds, only: long, wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: check_rules

   integer, parameter :: max_cases = 10000          !! largest number of cases of a scene
   !> Largest number of samples of all cases: with their audits they fit into an integer.
   integer, parameter :: max_samples = 1000000000

contains

   !> Checks all rules between values, and reads the files that the scene names.
   subroutine check_rules(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: i

      if (.not. (scene%has_motion() .or. size(scene%processes) > 0 .or. scene%has_unknown_group)) &
         call reader%complaints%add_general(scene%path// &
                                            ': must have &process, &chain or &structure')
      do i = 1, size(scene%processes)
         call check_process(scene, i, reader)
      end do
      call check_realizations(scene, reader)
      if (scene%has_structure) call check_structure(scene, reader)
      call check_values(scene, reader)
      if (.not. scene%has_motion()) return
      if (.not. (scene%has_structure .or. scene%has_unknown_group)) &
         call reader%require(scene%has_excitation, 'chain', 'n_dof', '&chain needs &excitation', &
                             to_text(scene%chain%n_dof))
      if (scene%has_excitation) call check_excitation(scene, reader)
      call set_deterministic_friction(scene, reader)
      call check_steps(scene, reader)
      call check_statistics(scene, reader)
      call check_number_of_cases(scene, reader)
   end subroutine check_rules

   !> Checks the rules of the i-th &process.
   subroutine check_process(scene, i, reader)
      type(scene_type), intent(in) :: scene
      integer, intent(in) :: i
      type(reader_type), intent(inout) :: reader
      integer, parameter :: highest_ar_order = 200

      associate (this => scene%processes(i), shared => scene%processes(i)%shared, &
                 n_orders => size(scene%processes(i)%orders), &
                 n_lengths => size(scene%processes(i)%lengths))
         if (reader%was_given('process', 'order', i)) then
            if (n_orders > 0 .and. n_lengths > 0) &
               call require(this%pairing /= 'zip' .or. any(n_orders == [1, n_lengths]), 'order', &
                            'must be one for all correlation lengths, or one for each of the '// &
                            to_text(n_lengths)//", with pairing = 'zip'")
         else
            call require(shared%method /= 'direct', 'order', &
                         "must be given with method = 'direct'")
            call require(this%pairing /= 'product', 'order', &
                         "must be given with pairing = 'product'")
         end if
         call require(shared%correlation == 'L1' .or. all(this%range_l0 <= 0.0_wp), 'bound_l0', &
                      'must be absent with L0 imposed')
         call require(shared%correlation == 'L0' .or. all(this%range_l1 <= 0.0_wp), 'bound_l1', &
                      'must be absent with L1 imposed')
         call require_range(this%range_l0, 'bound_l0')
         call require_range(this%range_l1, 'bound_l1')
         if (shared%correlation == 'both') then
            call require(all(this%lengths > 0.0_wp), 'correlation_length', &
                         "must be positive with correlation = 'both'")
            call require(shared%second_length > 0.0_wp, 'second_length', &
                         "must be positive with correlation = 'both'")
            call require(shared%method == 'autoregressive', 'correlation', &
                         "must be 'L0' or 'L1' unless method = 'autoregressive'")
         end if
         if (shared%method == 'direct') then
            call require(shared%inversion_half_width == 0 .or. &
                         all(shared%inversion_half_width >= this%orders), &
                         'inversion_half_width', 'must be 0 or at least order')
         else
            call require(all(this%orders <= highest_ar_order), 'order', 'must be at most '// &
                         to_text(highest_ar_order)//" unless method = 'direct'")
         end if
         if (reader%was_given('process', 'mean', i)) &
            call require(.not. shared%positive .or. shared%mean > 0.0_wp, 'mean', &
                         'must be positive with positive = .true.')
         call require(shared%positive .or. .not. scene%runs_samples(), 'positive', &
                      'must be .true. with motion: no friction coefficient is negative')
      end associate

   contains

      subroutine require(condition, name, rule)
         logical, intent(in) :: condition
         character(*), intent(in) :: name, rule

         call reader%require(condition, 'process', name, rule, number=i)
      end subroutine require

      !> Checks that a bound is one value, or a lower and an upper one.
      subroutine require_range(bound, name)
         real(wp), intent(in) :: bound(:)
         character(*), intent(in) :: name

         call require(any(size(bound) == [1, 2]), name, &
                      'must be one bound, or a lower and an upper one')
         if (size(bound) == 2) call require(bound(1) > 0.0_wp .and. bound(1) < bound(2), name, &
                                            'must be positive and ascending where it is a range')
      end subroutine require_range

   end subroutine check_process

   !> Checks the number of points and realizations, which must be the same in all &process.
   subroutine check_realizations(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader

      call check_same('n_points', scene%processes%n_points, reader)
      call check_same('n_realizations', scene%processes%n_realizations, reader)
      call reader%require(any(scene%processes%n_realizations > 0) .or. &
                          .not. scene%output%keeps('realizations'), 'output', 'quantities', &
                          "'realizations' needs process%n_realizations")
   end subroutine check_realizations

   !> Checks that a value is the same in every &process that gives it; sets it in the others.
   subroutine check_same(name, values, reader)
      character(*), intent(in) :: name
      integer, intent(inout) :: values(:)   !! (&process)
      type(reader_type), intent(inout) :: reader
      logical :: is_given(size(values))
      integer :: first, i

      is_given = [(reader%was_given('process', name, i), i=1, size(values))]
      first = findloc(is_given, .true., dim=1)
      if (first == 0) return
      do i = first + 1, size(values)
         if (is_given(i)) call reader%require(values(i) == values(first), 'process', name, &
                                              'must be the same in every &process', &
                                              to_text(values(i)), i)
      end do
      where (.not. is_given) values = values(first)
   end subroutine check_same

   !> Sets the friction of the deterministic cases of a chain, if it is not given, to the mean that
   !> all processes share.
   subroutine set_deterministic_friction(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader

      if (.not. scene%runs_deterministic() .or. reader%was_given('chain', 'friction') .or. &
          scene%has_structure) return
      associate (means => scene%processes%shared%mean)
         call reader%require(size(means) > 0 .or. scene%has_unknown_group, 'chain', 'friction', &
                             'must be given: there is no &process whose mean it could take')
         if (size(means) == 0) return
         call reader%require(all(abs(means - means(1)) <= 0.0_wp), 'chain', 'friction', &
                             'must be given with campaign%deterministic = .true.: '// &
                             'the means of &process differ')
         scene%chain%friction = means(:1)
         scene%friction_is_mean = .true.
      end associate
   end subroutine set_deterministic_friction

   !> Checks the number of steps of the march and of the spectra.
   subroutine check_steps(scene, reader)
      type(scene_type), intent(in) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: n_steps

      associate (integration => scene%integration, every => scene%output%spectrum_every)
         call reader%require(integration%n_steps > 0 .or. scene%excitation%kind == 'file', &
                             'integration', 'n_steps', &
                             "must be positive, except with excitation%kind = 'file'")
         n_steps = integration%n_steps
         if (n_steps == 0) n_steps = scene%n_force_values - 1
         if (n_steps < 1) return
         call reader%require(n_steps > 1, 'integration', 'n_steps', 'must be two or more', &
                             to_text(n_steps))
         call reader%require(integration%n_discard == 0 .or. &
                             integration%n_discard <= n_steps - fewest_measured, 'integration', &
                             'n_discard', 'must leave '//to_text(fewest_measured)// &
                             ' steps or more of the '//to_text(n_steps))
         n_steps = max(n_steps - integration%n_discard, 0)
         call reader%require(every <= n_steps/8, 'output', 'spectrum_every', &
                             'leaves too few of the '//to_text(n_steps)//' steps for a spectrum')
         call reader%require(n_steps >= fewest_spans*shortest_span .or. &
                             scene%accuracy%target_statistical <= 0.0_wp, 'accuracy', &
                             'target_statistical', 'needs a march of '// &
                             to_text(fewest_spans*shortest_span)//' steps or more behind '// &
                             'integration%n_discard, not of '//to_text(n_steps))
      end associate
   end subroutine check_steps

   !> Checks dofs, percentiles and targets of the statistics over samples.
   subroutine check_statistics(scene, reader)
      type(scene_type), intent(in) :: scene
      type(reader_type), intent(inout) :: reader

      associate (dofs => scene%output%dofs)
         call reader%require(all(dofs(2:) > dofs(:size(dofs) - 1)), 'output', 'dofs', 'must ascend')
         if (scene%n_dof() > 0) &
            call reader%require(all(dofs <= scene%n_dof()) .and. &
                                (all(dofs > 0) .or. size(dofs) == 1), 'output', 'dofs', &
                                'must be from 1 to '//to_text(scene%n_dof())// &
                                ', the number of dofs, or 0')
      end associate
      associate (p => scene%output%percentiles, accuracy => scene%accuracy)
         call reader%require(all(p(2:) > p(:size(p) - 1)), 'output', 'percentiles', &
                             'must ascend')
         call reader%require(any(p > 1.0_wp), 'output', 'percentiles', &
                             'are in %: 5 and 95, not 0.05 and 0.95')
         if (accuracy%sample_until_met) then
            call reader%require(accuracy%target_statistical > 0.0_wp, 'accuracy', &
                                'sample_until_met', 'needs a target_statistical')
            call reader%require(.not. (scene%excitation%per_sample .and. &
                                       scene%excitation%kind == 'file'), 'accuracy', &
                                'sample_until_met', 'needs an unlimited number of force '// &
                                'records: a file has a fixed number')
         end if
         call reader%require(accuracy%target_band_ratio <= 0.0_wp .or. scene%runs_samples() .and. &
                             scene%output%keeps('spectrum') .and. size(p) > 1, 'accuracy', &
                             'target_band_ratio', "needs 'spectrum' among output%quantities, "// &
                             'two output%percentiles or more, and samples with drawn friction')
         if (.not. accuracy%target_statistical > 0.0_wp) return
         call reader%require(scene%output%keeps('slip'), 'accuracy', 'target_statistical', &
                             "needs 'slip' among output%quantities")
         call reader%require(scene%runs_samples() .and. scene%campaign%n_samples > 1, 'accuracy', &
                             'target_statistical', 'needs two samples with drawn friction or more')
      end associate
   end subroutine check_statistics

   !> Checks the number of cases and samples that the lists of the scene make.
   subroutine check_number_of_cases(scene, reader)
      type(scene_type), intent(in) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: n_levels
      integer(long) :: n

      n_levels = size(scene%excitation%levels())
      n = (1 + sum(n_processes(scene%processes)))*n_levels
      call reader%require(n <= max_cases, 'excitation', scene%excitation%level_name(), &
                          'the scene makes '//to_text(n)//' cases: must be at most '// &
                          to_text(max_cases))
      if (n > max_cases .or. .not. scene%runs_samples()) return
      n = (n - n_levels)*scene%campaign%n_samples
      call reader%require(n <= max_samples, 'campaign', 'n_samples', 'the scene makes '// &
                          to_text(n)//' samples: must be at most '//to_text(max_samples))
   end subroutine check_number_of_cases

   !> Number of processes that a group asks for: combinations of length, order and std.
   elemental integer(long) function n_processes(process)
      type(process_group), intent(in) :: process

      n_processes = size(process%lengths, kind=long)*size(process%stds)
      if (process%pairing == 'product') n_processes = n_processes*size(process%orders)
   end function n_processes

end module config_rules
