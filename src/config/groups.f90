!> All groups of a scene together, and what follows from which of them are there.
module config_groups
   use config_accuracy, only: accuracy_group
   use config_campaign, only: campaign_group
   use config_chain, only: chain_group
   use config_complaints, only: complaint_list
   use config_excitation, only: excitation_group
   use config_heading, only: heading_group
   use config_integration, only: integration_group
   use config_output, only: output_group
   use config_process, only: process_group
   implicit none(type, external)
   private
   public :: scene_type

   !> A group that is absent has its defaults here.
   type :: scene_type
      character(:), allocatable :: path
      character(:), allocatable :: text            !! the file's, with the --set options as comments behind it
      type(heading_group) :: heading
      type(process_group), allocatable :: processes(:)   !! (group), in file order
      type(chain_group) :: chain
      type(excitation_group) :: excitation
      type(integration_group) :: integration
      type(campaign_group) :: campaign
      type(accuracy_group) :: accuracy
      type(output_group) :: output
      logical :: has_heading = .false., has_chain = .false., has_excitation = .false., &
                 has_integration = .false., has_campaign = .false., has_accuracy = .false., &
                 has_output = .false.
      character(:), allocatable :: force_path      !! where excitation%file was found
      logical :: force_is_hdf5 = .false.           !! then who has read it sets n_force_values
      integer :: n_force_values = 0                !! of a record of the force file
      character(80), allocatable :: unused(:)      !! group%name of what is given and has no effect
   contains
      procedure :: runs_deterministic
      procedure :: runs_samples
   end type scene_type

contains

   !> Are there cases with the friction of &chain?
   pure logical function runs_deterministic(self)
      class(scene_type), intent(in) :: self

      runs_deterministic = self%has_chain .and. (self%campaign%deterministic .or. .not. self%runs_samples())
   end function runs_deterministic

   !> Are there cases with drawn friction?
   pure logical function runs_samples(self)
      class(scene_type), intent(in) :: self

      runs_samples = self%has_chain .and. size(self%processes) > 0 .and. self%campaign%n_samples > 0
   end function runs_samples

end module config_groups
