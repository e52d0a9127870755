!> Audits: a share of every case's samples is repeated with a far better method.
!>
!> An audit is a case of its own, behind all others: the same process, force and sample numbers, so
!> the same friction. It repeats the first samples. They are independent draws, so the first are as
!> good a choice as any, and those of a larger share or a longer campaign are among them.
module campaign_audit
   use campaign_plan, only: case_type, integration_settings, output_settings, plan_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: add_audits, audit_of, kept_of, reference_for

   integer, parameter :: fewest = 2                     !! of a case with so many samples
   real(wp), parameter :: tighter = 1.0e-3_wp           !! than the tolerance of the scene
   real(wp), parameter :: newmark_reference = 1.0e-9_wp !! tolerance where the scene has none
   real(wp), parameter :: tightest = 1.0e-12_wp         !! of the event method

contains

   !> Appends an audit for every case where the plan has a share to be repeated, or a numerical
   !> target to be proved; to be called again when the cases have more samples.
   pure subroutine add_audits(plan)
      type(plan_type), intent(inout) :: plan
      type(case_type), allocatable :: audits(:)
      integer :: i

      plan%cases = pack(plan%cases, plan%cases%audits == 0)
      if (.not. max(plan%accuracy%audit, plan%accuracy%target_slip_points, &
                    plan%accuracy%target_band_ratio) > 0.0_wp) return
      audits = plan%cases
      audits%audits = [(i, i=1, size(audits))]
      audits%n_samples = min(audits%n_samples, &
                             max(fewest, ceiling(plan%accuracy%audit*audits%n_samples)))
      plan%cases = [plan%cases, audits]
   end subroutine add_audits

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

end module campaign_audit
