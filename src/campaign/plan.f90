!> A scene as numbers: processes to fit, cases to run, how to march, results to keep, audits.
!>
!> Audits repeat a share of every case's samples with a far better method. An audit is a case of its
!> own, behind all others: the same process, force and sample numbers, so the same friction. It
!> repeats the first samples. They are independent draws, so the first are as good a choice as any,
!> and those of a larger share or a longer campaign are among them.
module campaign_plan
   use core_kinds, only: long, wp
   use process_model, only: process_request
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: plan_type, case_type, accuracy_settings, excitation_settings, integration_settings, &
             output_settings
   public :: have_same_force, kept_dofs
   public :: add_audits, audit_of, kept_of, reference_for, repeats_samples

   integer, parameter :: fewest = 2                     !! samples, of a case with so many
   real(wp), parameter :: tighter = 1.0e-3_wp           !! than the tolerance of the scene
   real(wp), parameter :: newmark_reference = 1.0e-9_wp !! tolerance where the scene has none
   real(wp), parameter :: tightest = 1.0e-12_wp         !! of the event method

   !> One excitation level with one process: n_samples structures that differ in friction only
   !> (and in the force record, when every sample has its own).
   type :: case_type
      integer :: process = 0           !! into plan%processes; 0: none, friction as given
      !> variance of noise in a band [N^2], amplitude of a sine [N], else a factor of the force
      real(wp) :: strength = 1.0_wp
      integer :: n_samples = 1
      integer :: first_sample = 1      !! number of the first draw: another one in a replay
      integer :: audits = 0            !! the case whose samples it repeats, to find their errors
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

   !> True if two cases have the same force on the same samples.
   elemental logical function have_same_force(one, other)
      type(case_type), intent(in) :: one, other

      have_same_force = .not. (abs(one%strength - other%strength) > 0.0_wp .or. &
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

   !> Appends an audit for every case where the plan has a share to be repeated, or a numerical
   !> target to be proved; to be called again when the cases have more samples.
   pure subroutine add_audits(plan)
      type(plan_type), intent(inout) :: plan
      type(case_type), allocatable :: audits(:)
      integer :: i

      plan%cases = pack(plan%cases, plan%cases%audits == 0)
      if (.not. repeats_samples(plan)) return
      audits = plan%cases
      audits%audits = [(i, i=1, size(audits))]
      audits%n_samples = min(audits%n_samples, &
                             max(fewest, ceiling(plan%accuracy%audit*audits%n_samples)))
      plan%cases = [plan%cases, audits]
   end subroutine add_audits

   !> True if samples are repeated to find their numerical error.
   pure logical function repeats_samples(plan)
      type(plan_type), intent(in) :: plan

      repeats_samples = max(plan%accuracy%audit, plan%accuracy%target_slip_points, &
                            plan%accuracy%target_band_ratio) > 0.0_wp
   end function repeats_samples

   !> The case that repeats samples of this one; 0: none.
   pure function audit_of(plan, case_number) result(audit)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: case_number
      integer :: audit

      audit = findloc(plan%cases%audits, case_number, dim=1)
   end function audit_of

   !> The setting that repeats samples: the event method, its tolerance a thousand times tighter
   !> than the scene's.
   pure function reference_for(integration) result(reference)
      type(integration_settings), intent(in) :: integration
      type(integration_settings) :: reference

      reference = integration
      reference%method = 'event'
      reference%tolerance = max(tighter*integration%tolerance, tightest)
      if (integration%method == 'newmark') reference%tolerance = newmark_reference
   end function reference_for

   !> Results kept of a case's samples; of an audit's, those that are compared, and the energies.
   pure function kept_of(plan, case_number) result(kept)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: case_number
      type(output_settings) :: kept

      kept = plan%output
      ! a level of a forecast is a record, not a sine
      kept%harmonic = kept%harmonic .and. plan%cases(case_number)%frequency > 0.0_wp
      if (plan%cases(case_number)%audits == 0) return
      kept%slip = .false.   ! the series of its parts: slip fractions are always there
      kept%energy = .true.
      kept%history = .false.
      kept%harmonic = .false.
      kept%transitions = .false.
   end function kept_of

end module campaign_plan
