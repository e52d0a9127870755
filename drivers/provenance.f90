!> Where results come from: the scene, the program, the machine.
module driver_provenance
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use config_fingerprint, only: canonical_text, fingerprint
   use config_scene, only: scene_type
   use driver_build_info, only: architecture, compiler_flags, git_commit, version
   use driver_command_line, only: command_line
   use io_identity, only: identity_type
   use io_results, only: provenance_type
   implicit none(type, external)
   private
   public :: identity_of, provenance_of

contains

   !> Identity by which shards and results of one campaign know each other.
   function identity_of(scene, command) result(identity)
      type(scene_type), intent(in) :: scene
      character(*), intent(in) :: command   !! that writes the file
      type(identity_type) :: identity

      identity%settings = canonical_text(scene)
      identity%fingerprint = fingerprint(scene)
      identity%version = version//' ('//git_commit//')'
      identity%architecture = architecture//', '//compiler_version()
      identity%command = command
   end function identity_of

   !> All that the results file says of its origin.
   function provenance_of(scene, line, title, n_ranks) result(provenance)
      type(scene_type), intent(in) :: scene
      type(command_line), intent(in) :: line
      character(*), intent(in) :: title
      integer, intent(in) :: n_ranks
      type(provenance_type) :: provenance
      integer :: i

      provenance%identity = identity_of(scene, line%command)
      provenance%title = title
      provenance%scene = scene%text
      provenance%overrides = ''
      do i = 1, size(line%overrides)
         if (i > 1) provenance%overrides = provenance%overrides//new_line('a')
         provenance%overrides = provenance%overrides//trim(line%overrides(i))
      end do
      provenance%git_commit = git_commit
      provenance%compiler = compiler_version()
      provenance%flags = compiler_flags
      provenance%seed = scene%heading%seed
      provenance%n_ranks = n_ranks
   end function provenance_of

end module driver_provenance
