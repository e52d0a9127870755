!> Which cases share their samples in one regression: those that differ in the law of the friction
!> alone, under one force record; and draws of that law.
module campaign_pooling
   use campaign_plan, only: have_same_force, plan_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: to_text
   use process_model, only: process_model_type, request_label
   use process_realization, only: chains_of, draw_chains, draw_points
   use process_reference, only: has_one_value
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: case_pool, draw_law, estimators_of, find_points, find_pools, fitted_samples, &
             plan_draws, reason_for_plain, sharing_cases

   integer, parameter, public :: fewest_samples = 20   !! of a case
   integer, parameter :: most_inputs = 64               !! friction values of a sample
   !> Samples of a pool of several cases: with more, what the pool cannot tell of a law is no longer
   !> small beside the error of a case (formula (12) of docs/regression.md).
   integer, parameter :: most_pooled = 600
   integer, parameter, public :: most_samples = 2400    !! of a regression

   integer, parameter :: most_values = 2**21   !! of the draws of a law
   integer, parameter :: fewest_draws = 2**14, most_draws = 2**17

   !> Cases whose samples one regression uses.
   type :: case_pool
      integer, allocatable :: cases(:)      !! their numbers, ascending
      integer, allocatable :: n_fitted(:)   !! (case) its first samples that the regression uses
   end type case_pool

   real(wp), parameter :: share_of_windows = 0.8_wp   !! independent draws in a window

contains

   !> All pools of a plan; a case that is estimated by plain sampling is in none. A full pool is
   !> followed by another one.
   pure function find_pools(plan) result(pools)
      type(plan_type), intent(in) :: plan
      type(case_pool), allocatable :: pools(:)
      integer :: c, n_pools, number(size(plan%cases)), p   ! number of each case's pool; 0: none

      number = 0
      n_pools = 0
      do c = 1, size(plan%cases)
         if (plan%cases(c)%audits > 0 .or. len(reason_for_plain(plan, c)) > 0) cycle
         do p = 1, n_pools
            if (takes(plan, members_of(p), c)) exit
         end do
         number(c) = p
         n_pools = max(n_pools, p)
      end do
      allocate (pools(n_pools))
      do p = 1, n_pools
         pools(p)%cases = members_of(p)
         pools(p)%n_fitted = min(plan%cases(pools(p)%cases)%n_samples, most_samples)
      end do

   contains

      pure function members_of(p) result(cases)
         integer, intent(in) :: p
         integer, allocatable :: cases(:)
         integer :: i

         cases = pack([(i, i=1, size(number))], number == p)
      end function members_of

   end function find_pools

   !> How many cases would share their samples with each one, itself counted, as long as a pool has
   !> room for them; 0: plain sampling, however many samples.
   pure function sharing_cases(plan) result(n_cases)
      type(plan_type), intent(in) :: plan
      integer :: n_cases(size(plan%cases))
      type(plan_type) :: larger
      type(case_pool), allocatable :: pools(:)
      integer :: p

      larger = plan
      larger%cases%n_samples = max(fewest_samples, plan%cases%n_samples)
      n_cases = 0
      pools = find_pools(larger)
      do p = 1, size(pools)
         n_cases(pools(p)%cases) = size(pools(p)%cases)
      end do
   end function sharing_cases

   !> Samples in the regression of a case of n samples that may share with others.
   elemental real(wp) function fitted_samples(n, n_cases)
      real(wp), intent(in) :: n
      integer, intent(in) :: n_cases   !! as in sharing_cases

      fitted_samples = min(max(n, min(n_cases*n, real(most_pooled, wp))), real(most_samples, wp))
   end function fitted_samples

   !> 'pooled', 'regression' or 'plain' for each case.
   pure function estimators_of(plan) result(name)
      type(plan_type), intent(in) :: plan
      character(12) :: name(size(plan%cases))
      type(case_pool), allocatable :: pools(:)
      integer :: p

      name = 'plain'
      pools = find_pools(plan)
      do p = 1, size(pools)
         name(pools(p)%cases) = merge('pooled      ', 'regression  ', size(pools(p)%cases) > 1)
      end do
   end function estimators_of

   !> True if a further case belongs to those of a pool, and finds room. The same process twice has
   !> the same friction values, so it is no further knowledge.
   pure logical function takes(plan, members, number)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: members(:), number
      integer :: i

      takes = plan%estimator == 'pooled' .and. .not. plan%excitation%per_sample
      takes = takes .and. have_same_force(plan%cases(members(1)), plan%cases(number))
      takes = takes .and. sum(real(plan%cases([members, number])%n_samples, wp)) <= most_pooled
      do i = 1, size(members)
         takes = takes .and. label_of_case(plan, members(i)) /= label_of_case(plan, number)
      end do
   end function takes

   pure integer(long) function label_of_case(plan, number)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      label_of_case = request_label(plan%processes(plan%cases(number)%process))
   end function label_of_case

   !> Why a case is estimated by plain sampling; empty where it is not.
   pure function reason_for_plain(plan, number) result(reason)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      character(:), allocatable :: reason
      integer, allocatable :: points(:), joints(:)

      reason = ''
      call find_points(plan%structure, points, joints)
      associate (case => plan%cases(number))
         if (plan%estimator == 'plain') then
            reason = "campaign%estimator = 'plain'"
         else if (case%process == 0) then
            reason = 'the friction is given'
         else if (plan%processes(case%process)%method == 'values') then
            reason = 'the samples are given: they have no law'
         else if (has_one_value(plan%processes(case%process)) .and. size(points) > 1) then
            reason = 'all joints have one friction value'
         else if (case%n_samples < fewest_samples) then
            reason = 'fewer than '//to_text(fewest_samples)//' samples'
         else if (size(points) > most_inputs) then
            reason = 'more than '//to_text(most_inputs)//' friction values'
         end if
      end associate
   end function reason_for_plain

   !> Chooses how a law is drawn: windows of long realizations, a correlation length apart; or
   !> windows from streams of their own (stride 0), where the sampler's cost is that of a window or
   !> a long realization would take much memory.
   pure subroutine plan_draws(n_points, is_exact, correlation_length, n_draws, stride)
      integer, intent(in) :: n_points               !! of a window
      logical, intent(in) :: is_exact               !! sampler
      real(wp), intent(in) :: correlation_length    !! L0 [points]
      integer, intent(out) :: n_draws, stride

      n_draws = fewest_draws
      stride = 0
      if (is_exact .or. n_points > most_values/fewest_draws) return
      n_draws = max(fewest_draws, min(most_draws, most_values/n_points))
      stride = n_points + ceiling(min(correlation_length, 8.0_wp*n_points))
   end subroutine plan_draws

   !> Finds the points of the process that give joints their friction, ascending, and the first
   !> such joint of each.
   pure subroutine find_points(structure, points, joints)
      type(structure_type), intent(in) :: structure
      integer, allocatable, intent(out) :: points(:), joints(:)
      integer :: first(structure%n_points)   ! joint that takes a point; 0: none
      integer :: i, j

      first = 0
      do j = structure%n_joints, 1, -1
         first(structure%friction_point(j)) = j
      end do
      points = pack([(i, i=1, size(first))], first > 0)
      joints = first(points)
   end subroutine find_points

   !> Draws windows of long realizations, or each from a stream of its own; fewer where fewer are
   !> wanted.
   subroutine draw_law(seed, model, points, draws, n_independent, at_most)
      integer(long), intent(in) :: seed
      type(process_model_type), intent(in) :: model
      integer, intent(in) :: points(:)                    !! of the process, ascending
      real(wp), allocatable, intent(out) :: draws(:, :)   !! (draw, point)
      real(wp), intent(out) :: n_independent              !! draws that all windows are worth
      integer, intent(in), optional :: at_most            !! windows
      type(stream_type) :: stream
      real(wp), allocatable :: chains(:, :), values(:)
      integer(long) :: label
      integer :: i, n, n_chains, stride

      label = label_of(request_label(model%request), label_of('law'))
      call plan_draws(points(size(points)), model%request%sampler == 'exact', model%l0, n, stride)
      n_independent = share_of_windows*n
      if (present(at_most)) n = min(n, at_most)
      allocate (draws(n, size(points)))
      if (stride == 0) then
         allocate (values(points(size(points))))
         do i = 1, n
            stream = new_stream(seed, label, i)
            call draw_points(model, stream, values)
            draws(i, :) = values(points)
         end do
      else
         n_chains = chains_of(model)
         allocate (chains(n_chains, stride*((n - 1)/n_chains + 1)))
         stream = new_stream(seed, label, 0)
         call draw_chains(model, stream, chains)
         do i = 1, n
            draws(i, :) = chains(1 + modulo(i - 1, n_chains), ((i - 1)/n_chains)*stride + points)
         end do
      end if
   end subroutine draw_law

end module campaign_pooling
