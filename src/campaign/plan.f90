!> Plan of a campaign: processes to fit, cases to run, settings of the march, results to keep.
!>
!> An audit repeats the first samples of a case with a far more accurate method. It is a case of its
!> own, after all others, with the same process, force and sample numbers, so the same friction.
!> Samples are independent draws, so the first ones are as good a choice as any; those of a smaller
!> share or a shorter campaign are among those of a larger one.
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

   integer, parameter :: fewest_audited = 2             !! samples of an audit, if there are so many
   real(wp), parameter :: tolerance_ratio = 1.0e-3_wp   !! tolerance of audits over the scene's
   real(wp), parameter :: reached = 1.0e-12_wp          !! tolerance that the event method reaches
   real(wp), parameter :: newmark_reference = 1.0e-9_wp !! tolerance of audits of Newmark's scheme

   !> One process under one excitation: n_samples structures that differ in friction only (and in
   !> the force record, if every sample has its own).
   type :: case_type
      integer :: process = 0           !! place in plan%processes; 0: given friction
      !> variance of band-limited noise [N^2], amplitude of a sine [N], otherwise a factor of the
      !> force
      real(wp) :: strength = 1.0_wp
      integer :: n_samples = 1
      integer :: first_sample = 1      !! number of the first draw, 1 unless samples are replayed
      integer :: audits = 0            !! case whose samples this audit repeats; 0: no audit
      real(wp) :: frequency = 0.0_wp   !! frequency of a sine [Hz]
   end type case_type

   !> Forces on the structure. Defaults are the paper's noise.
   type :: excitation_settings
      character(16) :: kind = 'band_limited'   !! or 'file', 'sine', 'psd'
      real(wp), allocatable :: band(:)         !! (2) [Hz]
      integer :: dof = 0                       !! forced dof, never 0 in a plan
      character(:), allocatable :: file
      logical :: per_sample = .false.          !! true: each sample has its own force record
      logical :: base = .false.                !! true: acceleration of the ground [m/s^2], no force
      real(wp), allocatable :: density(:, :)   !! (Hz and N^2/Hz, row) of kind 'psd'
   end type excitation_settings

   !> Settings of the march. Defaults are the paper's scheme, step and length.
   type :: integration_settings
      character(16) :: method = 'newmark'    !! or 'event'
      real(wp) :: dt = 0.00843_wp            !! [s]
      integer :: n_steps = 400000
      integer :: n_discard = 0               !! steps at the start that no statistic uses
      integer :: max_halvings = 15           !! newmark
      real(wp) :: beta = 0.25_wp             !! newmark
      real(wp) :: gamma = 0.5_wp             !! newmark
      real(wp) :: tolerance = 1.0e-6_wp      !! event: displacement error relative to its rms
   end type integration_settings

   !> Results that are computed and kept. Defaults are what the figures of the paper need.
   type :: output_settings
      logical :: slip = .false.
      logical :: spectrum = .false.
      logical :: energy = .false.
      logical :: history = .false.
      logical :: harmonic = .false.             !! fundamental of the response to a sine
      logical :: transitions = .false.
      integer, allocatable :: dofs(:)           !! dofs of spectra and histories; none: all
      real(wp), allocatable :: percentiles(:)   !! [%], ascending
      integer :: segment_length = 8192          !! steps of a Welch segment
      integer :: spectrum_every = 0             !! every k-th step enters the spectra; 0: chosen
      logical :: samples = .true.               !! true: spectra and slip series of each sample
   contains
      procedure :: keeps_spectra
   end type output_settings

   !> Accuracy that is wanted, and audits; 0: no target, no audits.
   type :: accuracy_settings
      real(wp) :: target_slip_points = 0.0_wp    !! numerical error [points of %]
      real(wp) :: target_band_ratio = 0.0_wp     !! numerical error, relative
      real(wp) :: target_statistical = 0.0_wp    !! standard error [points of %]
      logical :: sample_until_met = .false.      !! true: adds samples to meet target_statistical
      real(wp) :: audit = 0.0_wp                 !! share of the samples that audits repeat
   end type accuracy_settings

   !> All that determines the results of a campaign, and its time limit.
   type :: plan_type
      character(:), allocatable :: title
      integer(long) :: seed = 0
      type(process_request), allocatable :: processes(:)
      !> (point, sample) friction values of the process whose method is 'values'
      real(wp), allocatable :: values(:, :)
      integer :: n_points = 0                   !! points of a written realization
      integer :: n_realizations = 0
      logical :: has_structure = .false.        !! false: only processes are solved
      type(structure_type) :: structure
      real(wp), allocatable :: friction(:)      !! (joint) friction of cases without process
      character(:), allocatable :: friction_from   !! 'chain%friction', 'process%mean' or the joints
      type(excitation_settings) :: excitation
      type(integration_settings) :: integration
      type(case_type), allocatable :: cases(:)  !! cases by their numbers, then audits
      type(accuracy_settings) :: accuracy
      type(output_settings) :: output
      character(16) :: estimator = 'plain'      !! 'pooled', 'regression' or 'plain'
      real(wp) :: walltime = 0.0_wp             !! [min]; 0: no limit
   end type plan_type

contains

   !> True if the results of a case have the spectrum of each sample.
   pure logical function keeps_spectra(self, n_samples)
      class(output_settings), intent(in) :: self
      integer, intent(in) :: n_samples   !! samples of the case

      keeps_spectra = self%spectrum .and. (self%samples .or. n_samples == 1)
   end function keeps_spectra

   !> True if two cases have the same force on the same samples.
   elemental logical function have_same_force(one, other)
      type(case_type), intent(in) :: one, other

      have_same_force = .not. (abs(one%strength - other%strength) > 0.0_wp .or. &
                               abs(one%frequency - other%frequency) > 0.0_wp)
   end function have_same_force

   !> Dofs whose spectra and histories are kept, ascending.
   pure function kept_dofs(plan) result(dofs)
      type(plan_type), intent(in) :: plan
      integer, allocatable :: dofs(:)
      integer :: i

      if (allocated(plan%output%dofs)) dofs = plan%output%dofs
      if (.not. allocated(dofs)) allocate (dofs(0))
      if (size(dofs) == 0) dofs = [(i, i=1, plan%structure%n_dof)]
   end function kept_dofs

   !> Appends an audit for every case if the plan asks for audits or has a numerical target. It is
   !> called again when cases get more samples.
   pure subroutine add_audits(plan)
      type(plan_type), intent(inout) :: plan
      type(case_type), allocatable :: audits(:)
      integer :: i

      plan%cases = pack(plan%cases, plan%cases%audits == 0)
      if (.not. repeats_samples(plan)) return
      audits = plan%cases
      audits%audits = [(i, i=1, size(audits))]
      audits%n_samples = min(audits%n_samples, &
                             max(fewest_audited, ceiling(plan%accuracy%audit*audits%n_samples)))
      plan%cases = [plan%cases, audits]
   end subroutine add_audits

   !> True if audits repeat samples to find their numerical error.
   pure logical function repeats_samples(plan)
      type(plan_type), intent(in) :: plan

      repeats_samples = max(plan%accuracy%audit, plan%accuracy%target_slip_points, &
                            plan%accuracy%target_band_ratio) > 0.0_wp
   end function repeats_samples

   !> Number of the audit of a case; 0: none.
   pure integer function audit_of(plan, case_number) result(audit)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: case_number

      audit = findloc(plan%cases%audits, case_number, dim=1)
   end function audit_of

   !> Settings of the march of audits: the event method with a thousandth of the scene's tolerance.
   pure type(integration_settings) function reference_for(integration) result(reference)
      type(integration_settings), intent(in) :: integration

      reference = integration
      reference%method = 'event'
      reference%tolerance = max(tolerance_ratio*integration%tolerance, &
                                min(integration%tolerance, reached))
      if (integration%method == 'newmark') reference%tolerance = newmark_reference
   end function reference_for

   !> Results kept of the samples of a case. An audit keeps those that are compared, and energies.
   pure type(output_settings) function kept_of(plan, case_number) result(kept)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: case_number

      kept = plan%output
      ! march_level of tradeoff_sample replaces a sine by its record, without frequency
      kept%harmonic = kept%harmonic .and. plan%cases(case_number)%frequency > 0.0_wp
      if (plan%cases(case_number)%audits == 0) return
      kept%slip = .false.   ! series of spans; slip fractions are always kept
      kept%energy = .true.
      kept%history = .false.
      kept%harmonic = .false.
      kept%transitions = .false.
   end function kept_of

end module campaign_plan
