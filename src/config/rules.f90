!> Rules between the values of a scene. What one value must keep alone stands in its group's table.
module config_rules
   use config_force_file, only: check_force, is_hdf5_file, read_force_text
   use config_groups, only: scene_type
   use config_process, only: process_group
   use config_reader, only: reader_type
   use core_kinds, only: long, wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: block_numbers, check_rules, max_cases

   integer, parameter :: max_cases = 10000   !! processes, and cases, of one scene

   !> Where each group stands in the document; 0: absent.
   type :: block_numbers
      integer :: heading = 0, chain = 0, excitation = 0, integration = 0, campaign = 0, &
                 accuracy = 0, output = 0
      integer, allocatable :: processes(:)
   end type block_numbers

contains

   !> Every rule, each with its own complaint. `was_read`: every value alone is as it must be.
   subroutine check_rules(scene, blocks, reader)
      type(scene_type), intent(inout) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      integer :: i

      call reader%require(scene%has_chain .or. size(scene%processes) > 0, 0, '&process or &chain', '', &
                          'a scene must have one of them')
      do i = 1, size(scene%processes)
         call check_process(scene, i, blocks, reader)
      end do
      call check_realizations(scene, blocks, reader)
      if (.not. scene%has_chain) return
      call reader%require(scene%has_excitation, blocks%chain, 'n_dof', to_text(scene%chain%n_dof), &
                          '&chain needs &excitation')
      if (scene%has_excitation) call check_excitation(scene, blocks, reader)
      call check_steps(scene, blocks, reader)
      call check_output(scene, blocks, reader)
      call check_number_of_cases(scene, blocks, reader)
   end subroutine check_rules

   subroutine check_process(scene, i, blocks, reader)
      type(scene_type), intent(in) :: scene
      integer, intent(in) :: i
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader

      associate (process => scene%processes(i), block => blocks%processes(i))
         if (size(process%order) > 0 .and. size(process%correlation_length) > 0) &
            call reader%require(process%pairing /= 'zip' .or. size(process%order) == 1 .or. &
                                size(process%order) == size(process%correlation_length), &
                                block, 'order', '2, 5, 10', 'must be one order for each of the '// &
                                to_text(size(process%correlation_length))// &
                                " correlation lengths, or one for all, with pairing = 'zip'")
         call reader%require(.not. process%positive .or. process%mean > 0.0_wp, block, 'mean', &
                             to_text(process%mean), 'must be positive with positive = .true.')
         call reader%require(process%positive .or. .not. scene%runs_samples(), block, 'positive', &
                             '.false.', 'must be .true. with &chain: a friction coefficient is not negative')
      end associate
   end subroutine check_process

   !> The results file has one length and one number of realizations.
   subroutine check_realizations(scene, blocks, reader)
      type(scene_type), intent(in) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      integer :: i

      do i = 2, size(scene%processes)
         associate (process => scene%processes(i), first => scene%processes(1))
            call reader%require(process%n_points == first%n_points, blocks%processes(i), 'n_points', &
                                to_text(process%n_points), 'must be the same in every &process')
            call reader%require(process%n_realizations == first%n_realizations, blocks%processes(i), &
                                'n_realizations', to_text(process%n_realizations), &
                                'must be the same in every &process')
         end associate
      end do
      if (.not. scene%output%keeps('realizations')) return
      if (size(scene%processes) == 0) then
         call reader%require(.false., blocks%output, 'quantities', '', "'realizations' needs &process")
      else
         call reader%require(scene%processes(1)%n_realizations > 0, blocks%output, 'quantities', '', &
                             "'realizations' needs process%n_realizations")
      end if
   end subroutine check_realizations

   subroutine check_excitation(scene, blocks, reader)
      type(scene_type), intent(inout) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      real(wp) :: nyquist

      associate (excitation => scene%excitation, block => blocks%excitation)
         if (scene%chain%n_dof > 0) &
            call reader%require(excitation%dof <= scene%chain%n_dof, block, 'dof', to_text(excitation%dof), &
                             'must not exceed chain%n_dof = '//to_text(scene%chain%n_dof))
         if (excitation%kind == 'file') then
            call reader%require(size(excitation%variance) == 0, block, 'variance', '', &
                                "must be absent with kind = 'file'")
            call reader%require(excitation%file /= '', block, 'file', '', "must be given with kind = 'file'")
            if (excitation%file /= '') call check_force_file(scene, blocks, reader)
            return
         end if
         call reader%require(excitation%file == '', block, 'file', '', &
                             "must be absent with kind = 'band_limited'")
         call reader%require(size(excitation%variance) > 0 .or. reader%was_given(block, 'variance'), &
                             block, 'variance', '', "must be given with kind = 'band_limited'")
         if (size(excitation%band) < 2 .or. .not. scene%integration%dt > 0.0_wp) return
         call reader%require(excitation%band(1) < excitation%band(2), block, 'band', '0.0, 2.5', &
                             'must ascend')
         nyquist = 0.5_wp/scene%integration%dt
         call reader%require(excitation%band(2) <= nyquist, block, 'band', '0.0, 2.5', &
                             'must not exceed '//to_text(real(nint(nyquist*1.0e3_wp, long), wp)/1.0e3_wp)// &
                             ' Hz, half the sampling rate of integration%dt')
      end associate
   end subroutine check_excitation

   !> A text file is read here and now; whoever can read HDF5 reads such a file.
   subroutine check_force_file(scene, blocks, reader)
      type(scene_type), intent(inout) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      real(wp), allocatable :: force(:)
      logical :: exists
      integer :: n_before

      scene%force_path = scene%path(:index(scene%path, '/', back=.true.))//scene%excitation%file
      if (scene%excitation%file(1:1) == '/') scene%force_path = scene%excitation%file
      inquire (file=scene%force_path, exist=exists)
      if (.not. exists) then
         scene%force_path = scene%excitation%file
         inquire (file=scene%force_path, exist=exists)
      end if
      call reader%require(exists, blocks%excitation, 'file', scene%excitation%file, 'no such file')
      if (.not. exists) return
      scene%force_is_hdf5 = is_hdf5_file(scene%force_path)
      if (scene%force_is_hdf5) return
      call reader%require(.not. scene%excitation%per_sample, blocks%excitation, 'per_sample', '.true.', &
                          'needs an HDF5 file with one record per sample')
      n_before = reader%complaints%n
      call read_force_text(scene%force_path, force, reader%complaints)
      if (reader%complaints%n > n_before) return
      call check_force(scene%force_path, reshape(force, [size(force), 1]), scene%integration%n_steps, 1, &
                       reader%complaints)
      scene%n_force_values = size(force)
   end subroutine check_force_file

   subroutine check_steps(scene, blocks, reader)
      type(scene_type), intent(in) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      integer :: n_steps

      associate (integration => scene%integration)
         n_steps = integration%n_steps
         if (n_steps == 0) n_steps = scene%n_force_values - 1
         call reader%require(integration%n_steps > 0 .or. scene%excitation%kind == 'file', &
                             blocks%integration, 'n_steps', to_text(integration%n_steps), &
                             "must be positive, except with excitation%kind = 'file'")
         if (n_steps > 0) call reader%require(integration%n_discard < n_steps, blocks%integration, &
                                              'n_discard', to_text(integration%n_discard), &
                                              'must be less than the number of steps, '//to_text(n_steps))
         if (n_steps > 0) call reader%require(scene%output%spectrum_every <= n_steps/8, blocks%output, &
                                              'spectrum_every', to_text(scene%output%spectrum_every), &
                                              'leaves too few steps for a spectrum')
      end associate
   end subroutine check_steps

   subroutine check_output(scene, blocks, reader)
      type(scene_type), intent(in) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader

      associate (p => scene%output%percentiles)
         call reader%require(all(p(2:) > p(:size(p) - 1)), blocks%output, 'percentiles', '', 'must ascend')
         call reader%require(scene%accuracy%target_statistical > 0.0_wp .or. &
                             .not. scene%accuracy%sample_until_met, blocks%accuracy, &
                             'sample_until_met', '.true.', 'needs accuracy%target_statistical')
      end associate
   end subroutine check_output

   subroutine check_number_of_cases(scene, blocks, reader)
      type(scene_type), intent(in) :: scene
      type(block_numbers), intent(in) :: blocks
      type(reader_type), intent(inout) :: reader
      integer(long) :: n
      integer :: i

      n = 1
      do i = 1, size(scene%processes)
         n = n + n_processes(scene%processes(i))
      end do
      n = n*max(1, size(scene%excitation%variance))
      call reader%require(n <= max_cases, blocks%excitation, 'variance', '', 'makes '//to_text(n)// &
                          ' cases: must be at most '//to_text(max_cases))
   end subroutine check_number_of_cases

   !> Combinations that a group asks for.
   pure integer(long) function n_processes(process)
      type(process_group), intent(in) :: process

      n_processes = size(process%correlation_length, kind=long)*size(process%std)
      if (process%pairing == 'product') n_processes = n_processes*size(process%order)
   end function n_processes

end module config_rules
