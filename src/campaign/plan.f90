!> A scene as numbers: processes to fit, cases to run, how to march, results to keep.
module campaign_plan
   use core_kinds, only: long, wp
   use process_model, only: process_request
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: plan_type, case_type, accuracy_settings, excitation_settings, integration_settings, &
             output_settings
   public :: have_same_force, kept_dofs, scale_of, strength_of

   !> One excitation level with one process: n_samples structures that differ in friction only
   !> (and in the force record, when every sample has its own).
   type :: case_type
      integer :: process = 0           !! into plan%processes; 0: none, friction as given
      real(wp) :: variance = 0.0_wp    !! of noise in a band [N^2]; else 0
      integer :: n_samples = 1
      integer :: first_sample = 1      !! another one in a replay
      integer :: audits = 0            !! the case whose samples it repeats, to find their errors
      real(wp) :: factor = 1.0_wp      !! of the force of a file, or of a given spectrum
      real(wp) :: amplitude = 0.0_wp   !! of a sine [N]; else 0
      real(wp) :: frequency = 0.0_wp   !! of a sine [Hz]
   end type case_type

   !> Forces on the structure. Defaults are the paper's noise.
   type :: excitation_settings
      character(16) :: kind = 'band_limited'   !! or 'file', 'sine', 'psd'
      real(wp), allocatable :: band(:)         !! (2) [Hz]
      integer :: dof = 0                       !! the forced mass, resolved: never 0 in a plan
      character(:), allocatable :: file
      logical :: per_sample = .false.          !! a record of its own for each sample
      logical :: base = .false.                !! the ground's acceleration, in m/s^2 for N
      real(wp), allocatable :: density(:, :)   !! (Hz and N^2/Hz, row) of kind 'psd'
   end type excitation_settings

   !> How the structure is marched. Defaults are the paper's scheme, step and length.
   type :: integration_settings
      character(16) :: method = 'newmark'    !! or 'event'
      real(wp) :: dt = 0.00843_wp            !! [s]
      integer :: n_steps = 400000
      integer :: n_discard = 0               !! steps left out of every statistic
      integer :: max_halvings = 15           !! newmark
      real(wp) :: beta = 0.25_wp             !! newmark
      real(wp) :: gamma = 0.5_wp             !! newmark
      real(wp) :: tolerance = 1.0e-6_wp      !! event: displacement error relative to its rms
   end type integration_settings

   !> Results to keep; others are not computed. Defaults are what the figures of the paper need.
   type :: output_settings
      logical :: slip = .false.
      logical :: spectrum = .false.
      logical :: energy = .false.
      logical :: history = .false.
      logical :: harmonic = .false.             !! fundamental of the response to a sine
      logical :: transitions = .false.
      integer, allocatable :: dofs(:)           !! of spectra and histories, ascending; none: all
      real(wp), allocatable :: percentiles(:)   !! [%], ascending
      integer :: segment_length = 8192          !! steps of a Welch segment
      integer :: spectrum_every = 0             !! every k-th step enters the spectra; 0: chosen
      logical :: samples = .true.               !! spectra of each of several samples
   contains
      procedure :: keeps_spectra
   end type output_settings

   !> Errors that are wanted, and how they are watched; 0: none.
   type :: accuracy_settings
      real(wp) :: target_slip_points = 0.0_wp    !! numerical error [points of %]
      real(wp) :: target_band_ratio = 0.0_wp     !! numerical error, relative
      real(wp) :: target_statistical = 0.0_wp    !! standard error [points of %]
      logical :: sample_until_met = .false.
      real(wp) :: audit = 0.0_wp                 !! share of the samples that is repeated
   end type accuracy_settings

   !> All that a campaign is made from.
   type :: plan_type
      character(:), allocatable :: title
      integer(long) :: seed = 0
      type(process_request), allocatable :: processes(:)
      !> (point, sample) of the process whose method is 'values'
      real(wp), allocatable :: values(:, :)
      integer :: n_points = 0                   !! of a written realization
      integer :: n_realizations = 0
      logical :: has_structure = .false.        !! without one only processes are solved
      type(structure_type) :: structure
      real(wp), allocatable :: friction(:)      !! (joint) for cases without process
      character(:), allocatable :: friction_from   !! 'chain%friction', 'process%mean' or the joints
      type(excitation_settings) :: excitation
      type(integration_settings) :: integration
      type(case_type), allocatable :: cases(:)  !! in case-number order, c001 first; audits last
      type(accuracy_settings) :: accuracy
      type(output_settings) :: output
      character(16) :: estimator = 'plain'      !! 'pooled', 'regression' or 'plain'
      real(wp) :: walltime = 0.0_wp             !! [min]; 0: no limit
   end type plan_type

contains

   !> True if the results have the spectrum of each of so many samples.
   pure logical function keeps_spectra(self, n_samples)
      class(output_settings), intent(in) :: self
      integer, intent(in) :: n_samples

      keeps_spectra = self%spectrum .and. (self%samples .or. n_samples == 1)
   end function keeps_spectra

   !> Factor of the record that all cases share.
   elemental function scale_of(case) result(scale)
      type(case_type), intent(in) :: case
      real(wp) :: scale

      scale = case%factor
      if (case%variance > 0.0_wp) scale = sqrt(case%variance)
      if (case%amplitude > 0.0_wp) scale = case%amplitude
   end function scale_of

   !> Number by which levels of the force are told apart and ranked.
   elemental function strength_of(case) result(strength)
      type(case_type), intent(in) :: case
      real(wp) :: strength

      strength = case%factor
      if (case%variance > 0.0_wp) strength = case%variance
      if (case%amplitude > 0.0_wp) strength = case%amplitude
   end function strength_of

   !> True if two cases have the same force on the same samples.
   elemental logical function have_same_force(one, other)
      type(case_type), intent(in) :: one, other

      have_same_force = .not. (abs(strength_of(one) - strength_of(other)) > 0.0_wp .or. &
                               abs(one%frequency - other%frequency) > 0.0_wp)
   end function have_same_force

   !> The dofs whose spectra and histories are kept, ascending.
   pure function kept_dofs(plan) result(dofs)
      type(plan_type), intent(in) :: plan
      integer, allocatable :: dofs(:)
      integer :: i

      if (allocated(plan%output%dofs)) dofs = plan%output%dofs
      if (.not. allocated(dofs)) allocate (dofs(0))
      if (size(dofs) == 0) dofs = [(i, i=1, plan%structure%n_dof)]
   end function kept_dofs

end module campaign_plan
