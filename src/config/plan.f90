!> Makes the plan of a scene: processes to fit, structure, cases, and settings of the march.
module config_plan
   use campaign_plan, only: case_type, plan_type
   use config_groups, only: scene_type
   use config_groups_motion, only: fewest_measured
   use config_groups_process, only: process_group
   use core_complaints, only: complaint_list
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: to_text
   use dynamics_exact_march, only: check_exact
   use dynamics_newmark_march, only: check_newmark
   use process_model, only: process_request
   use process_reference, only: is_reference
   use structure_chain, only: build_chain
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: build_plan, scene_name

contains

   !> Makes the plan of a scene without complaints. An HDF5 force file must have been read before.
   subroutine build_plan(scene, plan, complaints)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(out) :: plan
      type(complaint_list), intent(inout) :: complaints
      integer :: i, n_before

      n_before = complaints%n
      plan%title = scene%heading%title
      if (plan%title == '') plan%title = scene_name(scene%path)
      plan%seed = scene%heading%seed
      allocate (plan%processes(0), plan%cases(0))
      do i = 1, size(scene%processes)
         call expand_process(scene%processes(i), plan%processes)
      end do
      if (size(scene%processes) > 0) then
         plan%n_points = scene%processes(1)%n_points
         plan%n_realizations = scene%processes(1)%n_realizations
      end if
      plan%estimator = scene%campaign%estimator
      plan%walltime = scene%campaign%walltime
      plan%accuracy = scene%accuracy
      plan%has_structure = scene%has_motion()
      if (.not. scene%has_motion()) return
      if (scene%has_structure) then
         plan%structure = scene%structure
         plan%friction = plan%structure%joint_friction
         plan%friction_from = 'structure%joints'
      else
         call plan_chain(scene, plan, complaints)
         if (complaints%n > n_before) return
      end if
      if (size(scene%processes) > 0) plan%n_points = plan%structure%n_points
      if (allocated(scene%values)) plan%values = scene%values
      if (scene%excitation%base) call set_ground_load(scene, plan%structure)
      call plan_march(scene, plan)
      call plan_cases(scene, plan)
      call check_march(scene, plan, complaints)
   end subroutine build_plan

   !> Appends the processes of a group; std varies fastest, then order, then correlation_length.
   pure subroutine expand_process(group, processes)
      type(process_group), intent(in) :: group
      type(process_request), allocatable, intent(inout) :: processes(:)
      type(process_request) :: process, appended
      integer, allocatable :: orders(:)
      integer :: i, j, k

      process = group%shared
      if (process%correlation /= 'both') process%second_length = 0.0_wp
      if (process%positive) process%inversion_half_width = 0
      if (process%correlation == 'L0') process%bounds(:size(group%range_l1)) = group%range_l1
      if (process%correlation == 'L1') process%bounds(:size(group%range_l0)) = group%range_l0
      if (group%values /= '') process%method = 'values'
      do i = 1, size(group%lengths)
         process%correlation_length = group%lengths(i)
         orders = group%orders
         if (group%pairing == 'zip' .and. size(orders) > 1) orders = group%orders(i:i)
         do j = 1, size(orders)
            process%order = orders(j)
            do k = 1, size(group%stds)
               process%std = group%stds(k)
               appended = process
               if (is_reference(appended)) then   ! has neither order nor sampler
                  appended%order = 1
                  appended%sampler = 'sequential'
               end if
               processes = [processes, appended]
            end do
         end do
      end do
   end subroutine expand_process

   !> Builds the structure of &chain, and the friction of its deterministic cases.
   subroutine plan_chain(scene, plan, complaints)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(inout) :: plan
      type(complaint_list), intent(inout) :: complaints
      type(error_type), allocatable :: error

      associate (chain => scene%chain)
         call build_chain(per_dof(chain%mass), per_dof(chain%coupling_stiffness), &
                          per_dof(chain%contact_stiffness), per_dof(chain%normal_load), &
                          per_dof(chain%damping_ratio), plan%structure, error)
         if (allocated(error)) call complaints%add_general(scene%path//': '//error%message)
         plan%friction = per_dof([0.0_wp])   ! unused without deterministic cases
         if (scene%runs_deterministic()) plan%friction = per_dof(chain%friction)
         plan%friction_from = trim(merge('process%mean  ', 'chain%friction', &
                                         scene%friction_is_mean))
         if (scene%excitation%dof == 0) return
         plan%structure%load = 0.0_wp
         plan%structure%load(scene%excitation%dof, 1) = 1.0_wp
      end associate

   contains

      !> Value for each dof.
      pure function per_dof(values)
         real(wp), intent(in) :: values(:)   !! one for all dofs, or one per dof
         real(wp) :: per_dof(scene%chain%n_dof)
         integer :: i

         per_dof = values([(min(i, size(values)), i=1, size(per_dof))])
      end function per_dof

   end subroutine plan_chain

   !> Sets the load of a ground acceleration, b = -M r. The influence vector r is structure%load if
   !> that is given, else 1 at every dof.
   pure subroutine set_ground_load(scene, structure)
      type(scene_type), intent(in) :: scene
      type(structure_type), intent(inout) :: structure

      if (scene%structure_files%load /= '') then
         structure%load = -matmul(structure%mass, structure%load)
      else
         structure%load = reshape(-sum(structure%mass, 2), [structure%n_dof, 1])
      end if
   end subroutine set_ground_load

   !> Sets excitation, integration and output of the plan.
   pure subroutine plan_march(scene, plan)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(inout) :: plan

      associate (excitation => scene%excitation, integration => scene%integration, &
                 output => scene%output)
         plan%excitation = excitation%excitation_settings
         if (excitation%dof == 0) plan%excitation%dof = plan%structure%n_dof
         plan%excitation%file = ''
         if (allocated(scene%force_path)) plan%excitation%file = scene%force_path
         if (allocated(scene%density)) plan%excitation%density = scene%density

         plan%integration = integration
         if (integration%n_steps == 0) plan%integration%n_steps = scene%n_force_values - 1

         plan%output = output%output_settings
         plan%output%slip = output%keeps('slip')
         plan%output%spectrum = output%keeps('spectrum')
         plan%output%energy = output%keeps('energy')
         plan%output%history = output%keeps('history')
         plan%output%harmonic = excitation%kind == 'sine'
         plan%output%transitions = output%keeps('transitions')
         plan%output%dofs = pack(output%dofs, output%dofs > 0)
         plan%output%segment_length = min(output%segment_length, &
                                          plan%integration%n_steps - integration%n_discard)
      end associate
   end subroutine plan_march

   !> Checks the integration settings, given the structure and the length of the force file.
   subroutine check_march(scene, plan, complaints)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      type(complaint_list), intent(inout) :: complaints
      type(error_type), allocatable :: error

      associate (s => plan%integration)
         if (s%n_discard > 0 .and. s%n_discard > s%n_steps - fewest_measured) &
            call complaints%add_general( &
            scene%path//': integration%n_discard = '//to_text(s%n_discard)//': must leave '// &
            to_text(fewest_measured)//' steps or more of the '//to_text(s%n_steps))
         if (complaints%n > 0) return
         if (s%method == 'newmark') then
            call check_newmark(plan%structure, s%dt, s%max_halvings, s%beta, s%gamma, error)
         else
            call check_exact(plan%structure, s%dt, s%tolerance, error)
         end if
         if (allocated(error)) call complaints%add_general(scene%path//': '//error%message)
      end associate
   end subroutine check_march

   !> Lists the cases: deterministic ones first, then those of each process; the force level varies
   !> fastest.
   pure subroutine plan_cases(scene, plan)
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(inout) :: plan
      type(case_type), allocatable :: levels(:)
      integer :: i

      levels = scene%excitation%levels()
      if (scene%runs_deterministic()) plan%cases = levels
      if (.not. scene%runs_samples()) return
      levels%n_samples = scene%campaign%n_samples
      do i = 1, size(plan%processes)
         levels%process = i
         plan%cases = [plan%cases, levels]
      end do
   end subroutine plan_cases

   !> Name of a scene: the name of its file without folder and extension.
   pure function scene_name(path) result(name)
      character(*), intent(in) :: path
      character(:), allocatable :: name
      integer :: dot

      name = path(index(path, '/', back=.true.) + 1:)
      dot = index(name, '.', back=.true.)
      if (dot > 1) name = name(:dot - 1)
   end function scene_name

end module config_plan
