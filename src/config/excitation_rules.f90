!> Checks the rules of &excitation for each kind of force, and reads its files.
module config_excitation_rules
   use config_force_file, only: check_force, force_label, read_force_text
   use config_groups, only: scene_type
   use config_groups_motion, only: fewest_measured
   use config_text_reader, only: reader_type
   use core_kinds, only: long, wp
   use core_source, only: is_hdf5_file
   use core_table, only: read_table, table_type
   use core_text, only: rounded_text, to_text
   use dynamics_excitation, only: band_rule
   use numerics_harmonic, only: periods_of_window
   implicit none(type, external)
   private
   public :: check_excitation

   character(*), parameter :: group = 'excitation'
   real(wp), parameter :: steps_per_period = 20.0_wp   !! smallest number for a sine

contains

   !> Checks the rules of &excitation, and reads the file of the force or its spectrum.
   subroutine check_excitation(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      character(:), allocatable :: rule

      associate (excitation => scene%excitation, n_dof => scene%n_dof())
         if (n_dof > 0) call reader%require(excitation%dof <= n_dof, group, 'dof', &
                                            'must not exceed the number of dofs, '//to_text(n_dof))
         call reader%require(.not. (excitation%base .and. reader%was_given(group, 'dof')), group, &
                             'dof', 'must be absent with base = .true.: the ground moves')
         if (excitation%kind == '') return   ! it was refused
         call check_values_of_kind(scene, reader)
         if (.not. scene%integration%dt > 0.0_wp) return   ! it was refused
         select case (excitation%kind)
         case ('file')
            if (excitation%file /= '') call read_force_file(scene, reader)
         case ('sine')
            call check_sines(scene, reader)
         case ('psd')
            if (excitation%psd /= '') call read_density(scene, reader)
         case default
            if (size(excitation%band) < 2) return
            rule = band_rule(excitation%band, scene%integration%dt)
            call reader%require(rule == '', group, 'band', rule, '0.0, 2.5')
         end select
      end associate
   end subroutine check_excitation

   !> Checks that the values of the kind of force are given, and that those of other kinds are not.
   subroutine check_values_of_kind(scene, reader)
      type(scene_type), intent(in) :: scene
      type(reader_type), intent(inout) :: reader

      associate (excitation => scene%excitation)
         call require_with_kind('variance', 'band_limited', size(excitation%variance) > 0)
         call require_with_kind('frequency', 'sine', size(excitation%frequency) > 0)
         call require_with_kind('amplitude', 'sine', size(excitation%amplitude) > 0)
         call require_with_kind('psd', 'psd', excitation%psd /= '')
         call require_with_kind('file', 'file', excitation%file /= '')
         call reader%require(all(abs(excitation%factor - 1.0_wp) <= 0.0_wp) .or. &
                             any(excitation%kind == [character(4) :: 'file', 'psd']), group, &
                             'factor', "must be absent with kind = '"//trim(excitation%kind)//"'")
      end associate

   contains

      !> Checks that a value is given if the force is of its kind, and only then.
      subroutine require_with_kind(name, kind, has_value)
         character(*), intent(in) :: name, kind
         logical, intent(in) :: has_value
         logical :: belongs

         belongs = scene%excitation%kind == kind
         call reader%require(has_value .eqv. belongs, group, name, &
                             'must be '//trim(merge('given ', 'absent', belongs))// &
                             " with kind = '"//trim(scene%excitation%kind)//"'")
      end subroutine require_with_kind

   end subroutine check_values_of_kind

   !> Checks that a period has enough steps, and the march enough periods to show whether they
   !> repeat. Removes spectra from the default of output%quantities: a sine has none.
   subroutine check_sines(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      real(wp), parameter :: largest = 1.0e18_wp   ! number of steps in a message
      real(wp) :: highest, fewest_steps

      call reader%require(.not. scene%excitation%per_sample, group, 'per_sample', &
                          "must be .false. with kind = 'sine'")
      if (.not. reader%was_given('output', 'quantities')) &
         scene%output%quantities = pack(scene%output%quantities, &
                                        scene%output%quantities /= 'spectrum')
      associate (frequency => scene%excitation%frequency, dt => scene%integration%dt, &
                 n_steps => scene%integration%n_steps, n_discard => scene%integration%n_discard)
         if (size(frequency) == 0 .or. n_steps < 1) return
         if (.not. all(frequency > 0.0_wp)) return
         highest = 1.0_wp/(steps_per_period*dt)
         call reader%require(all(frequency <= highest*(1.0_wp + epsilon(1.0_wp))), group, &
                             'frequency', 'must be at most '// &
                             rounded_text(highest, 6, down=.true.)// &
                             ' Hz: a period takes '//to_text(nint(steps_per_period))// &
                             ' steps of integration%dt or more')
         fewest_steps = 2.0_wp*periods_of_window/(minval(frequency)*dt) + fewest_measured
         call reader%require(n_steps - n_discard >= fewest_steps, 'integration', 'n_steps', &
                             'must be at least '// &
                             to_text(n_discard + ceiling(min(fewest_steps, largest), long))// &
                             ': twice '//to_text(periods_of_window)//' periods of the lowest '// &
                             'frequency after n_discard, to see whether they repeat')
      end associate
   end subroutine check_sines

   !> Reads the spectrum of the force and checks its frequencies and densities.
   subroutine read_density(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      type(table_type) :: table
      character(:), allocatable :: path, rule
      integer :: i, n_before

      call reader%find_file(group, 'psd', scene%excitation%psd, path)
      if (path == '') return
      n_before = reader%complaints%n
      call read_table(path, 2, 2, table, reader%complaints)
      if (reader%complaints%n > n_before) return
      do i = 1, table%n_rows
         if (table%value(1, i) < 0.0_wp .or. table%value(1, i)*scene%integration%dt > 0.5_wp) &
            call table%refuse_row(i, 'frequency', to_text(table%value(1, i)), &
                                  'must be from 0 to half the sampling rate, '// &
                                  rounded_text(0.5_wp/scene%integration%dt, 6, down=.true.)// &
                                  ' Hz', reader%complaints)
         if (table%value(2, i) < 0.0_wp) &
            call table%refuse_row(i, 'density', to_text(table%value(2, i)), &
                                  'must be zero or positive', reader%complaints)
         if (i == 1) cycle
         if (.not. table%value(1, i) > table%value(1, i - 1)) &
            call table%refuse_row(i, 'frequency', to_text(table%value(1, i)), 'must ascend', &
                                  reader%complaints)
      end do
      if (table%n_rows < 2 .or. .not. any(table%value(2, :) > 0.0_wp)) &
         call reader%complaints%add_general(path//': must hold two rows or more, and power')
      if (reader%complaints%n > n_before) return
      rule = band_rule(table%value(1, [1, table%n_rows]), scene%integration%dt)
      if (rule /= '') call reader%complaints%add_general(path//': '//rule)
      scene%density = table%value
      scene%force_label = force_label(scene%density)
   end subroutine read_density

   !> Finds the force file, and reads and checks it if it is a text. The driver reads HDF5 files.
   subroutine read_force_file(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: n_before

      call reader%find_file(group, 'file', scene%excitation%file, scene%force_path)
      if (scene%force_path == '') return
      scene%force_is_hdf5 = is_hdf5_file(scene%force_path)
      if (scene%force_is_hdf5) return

      call reader%require(.not. scene%excitation%per_sample, group, 'per_sample', &
                          'needs an HDF5 file with one record per sample')
      if (scene%n_forces() == 0) return
      n_before = reader%complaints%n
      call read_force_text(scene%force_path, scene%n_forces(), scene%integration%dt, scene%force, &
                           reader%complaints)
      if (reader%complaints%n > n_before) return
      call check_force(scene%force_path, scene%force, scene%integration%n_steps, &
                       scene%n_forces(), 0, reader%complaints)
      scene%n_force_values = size(scene%force, 1)
      scene%force_label = force_label(scene%force)
   end subroutine read_force_file

end module config_excitation_rules
