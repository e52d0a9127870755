!> The best estimates of a case: those of a regression where there is one, else plain sampling's.
module campaign_estimates
   use campaign_results, only: case_statistics
   use core_kinds, only: wp
   use statistics_estimates, only: statistic_type, student_factor, upward_error
   implicit none(type, external)
   private
   public :: case_estimates

   !> Estimates of one case with how they came about.
   type :: case_estimates
      character(12) :: estimator = 'plain'      !! 'pooled', 'regression' or 'plain'
      character(:), allocatable :: reason       !! why plain; empty: it is not
      integer, allocatable :: pooled_with(:)    !! the other cases whose samples were used
      type(case_statistics) :: best
      integer, allocatable :: friction_points(:)   !! of the process, of the sensitivities
      !> (friction point, joint) shares of the variance of the slip fraction
      type(statistic_type), allocatable :: sensitivity(:, :)
   contains
      procedure :: start
      procedure :: take_spectrum
   end type case_estimates

contains

   !> Makes room for the estimates of a regression in the place of plain ones: zeros, so that ranks
   !> that take some each can add up all.
   pure subroutine start(self, friction_points)
      class(case_estimates), intent(inout) :: self   !! with plain estimates
      integer, intent(in) :: friction_points(:)    !! of the process, ascending
      type(statistic_type), parameter :: nothing = statistic_type(ratio=0.0_wp)

      self%friction_points = friction_points
      allocate (self%sensitivity(size(friction_points), self%best%n_joints), source=nothing)
      self%best%numbers = nothing
      if (.not. allocated(self%best%psd)) return
      self%best%psd = nothing
      self%best%pseudo_variances = nothing
   end subroutine start

   !> Takes the estimates of the spectra of a dof, and plain ones at the frequencies behind those,
   !> which have no power.
   pure subroutine take_spectrum(self, dof, plain, spectrum, integrals)
      class(case_estimates), intent(inout) :: self
      integer, intent(in) :: dof
      type(case_statistics), intent(in) :: plain
      type(statistic_type), intent(in) :: spectrum(:, :)   !! (frequency, statistic)
      type(statistic_type), intent(in) :: integrals(:)     !! (statistic)
      integer :: n

      n = size(spectrum, 1)
      self%best%pseudo_variances(dof, :) = integrals
      self%best%psd(dof, :n, :) = spectrum
      self%best%psd(dof, n + 1:, :) = plain%psd(dof, n + 1:, :)
      associate (mean => self%best%psd(dof, n + 1:, 1))
         mean%error = upward_error(mean%value, mean%error &
                                   *student_factor(plain%psd_mean_freedoms(dof, n + 1:)))
      end associate
   end subroutine take_spectrum

end module campaign_estimates
