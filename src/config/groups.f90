!> All groups of a scene, and which parts of the program they ask for.
module config_groups
   use campaign_plan, only: accuracy_settings, integration_settings
   use config_groups_motion, only: chain_group, excitation_group, structure_group, visit_chain, &
      visit_excitation, visit_integration, visit_structure
   use config_groups_process, only: process_group, visit_process
   use config_groups_study, only: campaign_group, heading_group, output_group, visit_accuracy, &
      visit_campaign, visit_output, visit_scene
   use config_text_value_table, only: visitor_type
   use core_kinds, only: long, wp
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: group_docs, group_names, scene_type

   !> Names of the groups, and the subject of each.
   character(*), parameter :: &
      group_names(*) = [character(12) :: 'scene', 'process', 'structure', 'chain', 'excitation', &
                                         'integration', 'campaign', 'accuracy', 'output'], &
      group_docs(*) = [character(80) :: 'Title and seed of the study', &
                      'Maximum-entropy processes (Sec. 2); the group may be repeated', &
                      'A structure from files with Jenkins joints, in place of &chain', &
                      'A row of masses held by Jenkins joints (Sec. 3); needs &excitation', &
                      'The forces on the chain or structure', &
                      'Method and steps of the march through time', &
                      'Number of samples, estimator, time limit', &
                      'Target accuracy, and the audit of the numerical error', &
                      'Results to keep; others are not computed']

   !> A scene: its groups, absent ones with their defaults, and the data of the files it names.
   type :: scene_type
      character(:), allocatable :: path
      character(:), allocatable :: text            !! text of the file, and the choice for targets
      type(heading_group) :: heading
      type(process_group), allocatable :: processes(:)   !! (group), in file order
      type(structure_group) :: structure_files
      type(chain_group) :: chain
      type(excitation_group) :: excitation
      type(integration_settings) :: integration
      type(campaign_group) :: campaign
      type(accuracy_settings) :: accuracy
      type(output_group) :: output
      logical :: has_structure = .false., has_chain = .false., has_excitation = .false.
      logical :: has_unknown_group = .false.       !! true if a group has an unknown name
      logical :: friction_is_mean = .false.        !! true if deterministic cases use process%mean
      type(structure_type) :: structure            !! structure of &structure
      integer(long) :: structure_label = 0         !! hash of the data in its files
      character(:), allocatable :: force_path      !! path at which excitation%file was found
      logical :: force_is_hdf5 = .false.           !! true if the caller must read the force file
      real(wp), allocatable :: force(:, :)         !! (0:n_steps, record) force file [N]
      integer :: n_force_values = 0                !! size of a record of the force file
      real(wp), allocatable :: density(:, :)       !! (Hz and N^2/Hz, row) excitation%psd
      integer(long) :: force_label = 0             !! hash of `force` or `density`
      real(wp), allocatable :: values(:, :)        !! (point, sample) process%values
      integer(long) :: values_label = 0            !! hash of `values`
      character(80), allocatable :: unused(:)      !! group%name of values that have no effect
   contains
      procedure :: visit
      procedure :: has_motion
      procedure :: n_dof
      procedure :: n_forces
      procedure :: runs_deterministic
      procedure :: runs_samples
   end type scene_type

contains

   !> Visits the table of one group.
   subroutine visit(self, group, number, visitor)
      class(scene_type), intent(inout) :: self
      character(*), intent(in) :: group
      integer, intent(in) :: number   !! number of the &process; else unused
      class(visitor_type), intent(inout) :: visitor

      select case (group)
      case ('scene')
         call visit_scene(self%heading, visitor)
      case ('process')
         call visit_process(self%processes(number), visitor)
      case ('structure')
         call visit_structure(self%structure_files, visitor)
      case ('chain')
         call visit_chain(self%chain, visitor)
      case ('excitation')
         call visit_excitation(self%excitation, visitor)
      case ('integration')
         call visit_integration(self%integration, visitor)
      case ('campaign')
         call visit_campaign(self%campaign, visitor)
      case ('accuracy')
         call visit_accuracy(self%accuracy, visitor)
      case ('output')
         call visit_output(self%output, visitor)
      case default
         error stop 'visit: no such group'
      end select
   end subroutine visit

   !> True if the scene has deterministic cases.
   pure logical function runs_deterministic(self)
      class(scene_type), intent(in) :: self

      runs_deterministic = self%has_motion() .and. &
                           (self%campaign%deterministic .or. .not. self%runs_samples())
   end function runs_deterministic

   !> True if the scene has cases with random friction.
   pure logical function runs_samples(self)
      class(scene_type), intent(in) :: self

      runs_samples = self%has_motion() .and. size(self%processes) > 0 .and. &
                     self%campaign%n_samples > 0
   end function runs_samples

   !> True if the scene has a structure, from files or as a chain.
   pure logical function has_motion(self)
      class(scene_type), intent(in) :: self

      has_motion = self%has_structure .or. self%has_chain
   end function has_motion

   !> Number of degrees of freedom; 0 if it is not known yet.
   pure integer function n_dof(self)
      class(scene_type), intent(in) :: self

      n_dof = merge(self%structure%n_dof, self%chain%n_dof, self%has_structure)
   end function n_dof

   !> Number of forces on the structure; 0 if it is not known yet.
   pure integer function n_forces(self)
      class(scene_type), intent(in) :: self

      n_forces = merge(self%structure%n_forces, 1, self%has_structure)
   end function n_forces

end module config_groups
