!> &scene, &campaign, &accuracy and &output: title and seed, number of samples, target accuracy, and
!> results to keep.
module config_groups_study
   use campaign_plan, only: accuracy_settings, output_settings
   use config_text_value_table, only: choice_length, entry_type, interval, not_negative, &
      visitor_type
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: campaign_group, heading_group, output_group
   public :: visit_accuracy, visit_campaign, visit_output, visit_scene

   !> Title and seed of the study.
   type :: heading_group
      character(:), allocatable :: title
      integer(long) :: seed = 2016
   end type heading_group

   !> Cases and samples. Defaults are those of the paper, without its deterministic cases.
   type :: campaign_group
      integer :: n_samples = 100
      logical :: deterministic = .false.
      character(choice_length) :: estimator = 'pooled'
      real(wp) :: walltime = 0.0_wp   !! [min]; 0: no limit
   end type campaign_group

   !> Results to keep, by name.
   type, extends(output_settings) :: output_group
      character(choice_length), allocatable :: quantities(:)
   contains
      procedure :: keeps
   end type output_group

contains

   !> Visits the table of &scene.
   subroutine visit_scene(self, visitor)
      type(heading_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit_text(self%title, entry_type('title', &
         'title of the results; empty: the name of the scene file', in_fingerprint=.false.))
      call visitor%visit(self%seed, entry_type('seed', &
         'seed of all random streams, any whole number'))
   end subroutine visit_scene

   !> Visits the table of &campaign.
   subroutine visit_campaign(self, visitor)
      type(campaign_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%n_samples, entry_type('n_samples', &
         'samples of each case with random friction; 0: no such case', rule=not_negative, &
         in_fingerprint=.false.))
      call visitor%visit(self%deterministic, entry_type('deterministic', &
         'also one case without uncertainty per level of the force, before the others, with '// &
         'chain%friction or else process%mean', in_fingerprint=.false.))
      call visitor%visit(self%estimator, entry_type('estimator', &
         'statistics over samples by regression over the cases of one force (pooled, at most '// &
         '600 samples) or over each case, or plain', in_fingerprint=.false., &
         choices='pooled regression plain'))
      call visitor%visit(self%walltime, entry_type('walltime', &
         'stop after this time, without the blocks in flight; 0: no limit', 'min', not_negative, &
         in_fingerprint=.false.))
   end subroutine visit_campaign

   !> Visits the table of &accuracy.
   subroutine visit_accuracy(self, visitor)
      type(accuracy_settings), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%target_slip_points, entry_type('target_slip_points', &
         'wanted numerical error of slip fractions, in percentage points; 0: no target', '%', &
         not_negative, in_fingerprint=.false.))
      call visitor%visit(self%target_band_ratio, entry_type('target_band_ratio', &
         'wanted relative numerical error of band ratios; 0: no target', rule=not_negative, &
         in_fingerprint=.false.))
      call visitor%visit(self%target_statistical, entry_type('target_statistical', &
         'wanted standard error of mean slip fractions, in percentage points; 0: no target', '%', &
         not_negative, in_fingerprint=.false.))
      call visitor%visit(self%sample_until_met, entry_type('sample_until_met', &
         'add n_samples at a time until target_statistical is met', in_fingerprint=.false.))
      call visitor%visit(self%audit, entry_type('audit', &
         'share of the samples that the reference method repeats, to measure the numerical '// &
         'error', rule=interval(0.0_wp, 1.0_wp), in_fingerprint=.false.))
   end subroutine visit_accuracy

   !> Visits the table of &output.
   subroutine visit_output(self, visitor)
      type(output_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit_choices(self%quantities, entry_type('quantities', &
         'results to compute and keep', &
         choices='slip spectrum energy history realizations transitions'), &
         default=[character(choice_length) :: 'slip', 'spectrum'])
      call visitor%visit(self%dofs, entry_type('dofs', &
         'dofs with spectra and histories, ascending; 0: all', rule=not_negative, &
         is_used=self%keeps('spectrum') .or. self%keeps('history')), default=[0])
      call visitor%visit(self%percentiles, entry_type('percentiles', &
         'percentiles of all statistics over samples, ascending', '%', &
         interval(0.0_wp, 100.0_wp, is_open=.true.), in_fingerprint=.false.), &
         default=[5.0_wp, 95.0_wp])
      call visitor%visit(self%segment_length, entry_type('segment_length', &
         'steps of a Welch segment of the spectra; at most all steps', &
         rule=interval(8.0_wp, 1.0e8_wp), is_used=self%keeps('spectrum')))
      call visitor%visit(self%spectrum_every, entry_type('spectrum_every', &
         'every n-th step enters the spectra; 0: n is chosen, and stated in the results', &
         rule=not_negative, is_used=self%keeps('spectrum')))
      call visitor%visit(self%samples, entry_type('samples', &
         'keep the spectra and slip series of every sample; else only their statistics, and no '// &
         'samples can be added later', is_used=self%keeps('spectrum')))
   end subroutine visit_output

   !> True if the results have a quantity.
   pure logical function keeps(self, quantity)
      class(output_group), intent(in) :: self
      character(*), intent(in) :: quantity

      keeps = any(self%quantities == quantity)
   end function keeps

end module config_groups_study
