!> Groups cases into pools, whose samples one regression uses: cases that differ only in the law of
!> the friction, under one force record. Draws from that law.
module campaign_pooling
   use campaign_plan, only: case_type, have_same_force, plan_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: to_text
   use process_model, only: process_model_type, process_request, request_label
   use process_realization, only: n_chains_of, draw_chains, draw_points
   use process_reference, only: has_one_value
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: add_new_laws, case_pool, draw_law, estimators_of, find_input_points, find_pools, &
             fitted_samples, plan_draws, pools_of_new_laws, reason_for_plain, sharing_cases

   integer, parameter, public :: fewest_samples = 25   !! samples of a case with a regression
   integer, parameter :: most_inputs = 64              !! friction values of a sample
   !> Samples of a pool of several cases: with more, the error of the pool's surrogate for one of
   !> them is no longer small against its other errors (formula (12) of docs/regression.md).
   integer, parameter :: most_pooled = 600
   integer, parameter, public :: most_samples = 2400   !! samples of a regression

   integer, parameter :: most_values = 2**21           !! values of all draws from a law
   integer, parameter :: fewest_draws = 2**14, most_draws = 2**17
   !> Independent draws that a window of a long realization is worth.
   real(wp), parameter :: share_of_windows = 0.8_wp

   !> Cases whose samples one regression uses.
   type :: case_pool
      integer, allocatable :: cases(:)      !! case numbers, ascending
      integer, allocatable :: n_fitted(:)   !! (case) number of its first samples that are used
   end type case_pool

contains

   !> Pools of a plan. Cases with plain estimates are in none. A case that would overfill a pool
   !> starts another one.
   pure function find_pools(plan) result(pools)
      type(plan_type), intent(in) :: plan
      type(case_pool), allocatable :: pools(:)
      integer :: c, n_pools, p
      integer :: number(size(plan%cases))   ! number of each case's pool; 0: none

      number = 0
      n_pools = 0
      do c = 1, size(plan%cases)
         if (plan%cases(c)%audits > 0 .or. len(reason_for_plain(plan, c)) > 0) cycle
         do p = 1, n_pools
            if (can_join(plan, members_of(p), c)) exit
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

      !> Case numbers of pool p so far.
      pure function members_of(p) result(cases)
         integer, intent(in) :: p
         integer, allocatable :: cases(:)
         integer :: i

         cases = pack([(i, i=1, size(number))], number == p)
      end function members_of

   end function find_pools

   !> Number of cases in the pool of each case, itself included, if all cases had the samples of a
   !> regression; 0: plain estimates with any number of samples.
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

   !> Number of samples in the regression of a case.
   elemental real(wp) function fitted_samples(n, n_cases)
      real(wp), intent(in) :: n        !! samples of the case
      integer, intent(in) :: n_cases   !! as in sharing_cases

      fitted_samples = min(max(n, min(n_cases*n, real(most_pooled, wp))), real(most_samples, wp))
   end function fitted_samples

   !> Adds the processes that a plan lacks, and cases of them without samples.
   pure subroutine add_new_laws(processes, plan)
      type(process_request), intent(in) :: processes(:)
      type(plan_type), intent(inout) :: plan
      type(case_type), allocatable :: cases(:)
      integer :: i, p

      do p = 1, size(processes)
         if (any([(request_label(plan%processes(i)) == request_label(processes(p)), &
                   i=1, size(plan%processes))])) cycle
         plan%processes = [plan%processes, processes(p)]
         cases = pack(plan%cases, plan%cases%process == 1)   ! all levels of the force
         cases%process = size(plan%processes)
         cases%n_samples = 0
         plan%cases = [plan%cases, cases]
      end do
   end subroutine add_new_laws

   !> Pools for cases without samples, whose laws are new: for each force these cases and those
   !> whose samples serve them, of which a pool takes no more than it may have. If cases are not
   !> pooled, the one of the largest std serves.
   pure function pools_of_new_laws(plan) result(pools)
      type(plan_type), intent(in) :: plan
      type(case_pool), allocatable :: pools(:)
      integer, allocatable :: laws(:), sources(:)
      logical, dimension(size(plan%cases)) :: has_law, is_new, shares
      integer :: c, i

      is_new = plan%cases%n_samples == 0
      has_law = [(len(reason_for_plain(plan, c)) == 0, c=1, size(has_law))]
      allocate (pools(0))
      do c = 1, size(plan%cases)
         shares = have_same_force(plan%cases, plan%cases(c))
         if (.not. is_new(c) .or. any(shares(:c - 1) .and. is_new(:c - 1))) cycle
         laws = pack([(i, i=1, size(shares))], shares .and. is_new)
         sources = pack([(i, i=1, size(shares))], shares .and. has_law .and. .not. is_new)
         if (size(sources) == 0) cycle
         if (plan%excitation%per_sample .or. plan%estimator /= 'pooled') sources = &
            [sources(maxloc(plan%processes(plan%cases(sources)%process)%std, 1))]
         pools = [pools, case_pool([sources, laws], &
                                   [min(plan%cases(sources)%n_samples, &
                                        most_pooled/size(sources)), 0*laws])]
      end do
   end function pools_of_new_laws

   !> Estimator of each case: 'pooled', 'regression' or 'plain'.
   pure function estimators_of(pools, n_cases) result(name)
      type(case_pool), intent(in) :: pools(:)
      integer, intent(in) :: n_cases
      character(12) :: name(n_cases)
      integer :: p

      name = 'plain'
      do p = 1, size(pools)
         name(pools(p)%cases) = merge('pooled      ', 'regression  ', size(pools(p)%cases) > 1)
      end do
   end function estimators_of

   !> True if a case can join a pool. It cannot if the pool has the same process, because it adds
   !> the same friction values.
   pure logical function can_join(plan, members, number)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: members(:), number   !! case numbers
      integer :: i

      can_join = plan%estimator == 'pooled' .and. .not. plan%excitation%per_sample .and. &
                 have_same_force(plan%cases(members(1)), plan%cases(number)) .and. &
                 sum(real(plan%cases([members, number])%n_samples, wp)) <= most_pooled .and. &
                 all([(request_label(plan%processes(plan%cases(members(i))%process)) /= &
                       request_label(plan%processes(plan%cases(number)%process)), &
                       i=1, size(members))])
   end function can_join

   !> Reason why a case has plain estimates; '' if it has a regression.
   pure function reason_for_plain(plan, number) result(reason)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      character(:), allocatable :: reason
      integer, allocatable :: points(:), joints(:)

      reason = ''
      call find_input_points(plan%structure, points, joints)
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

   !> Chooses how to draw from a law: windows of long realizations, a correlation length apart; or
   !> windows from random streams of their own (stride 0), if the sampler starts without cost or a
   !> long realization takes too much memory.
   pure subroutine plan_draws(n_points, is_exact, correlation_length, n_draws, stride)
      integer, intent(in) :: n_points               !! points of a window
      logical, intent(in) :: is_exact               !! true: the sampler is 'exact'
      real(wp), intent(in) :: correlation_length    !! L0 [points]
      integer, intent(out) :: n_draws, stride

      n_draws = fewest_draws
      stride = 0
      if (is_exact .or. n_points > most_values/fewest_draws) return
      n_draws = max(fewest_draws, min(most_draws, most_values/n_points))
      stride = n_points + ceiling(min(correlation_length, 8.0_wp*n_points))
   end subroutine plan_draws

   !> Lists the points of the process whose values joints take, ascending, and the first joint of
   !> each.
   pure subroutine find_input_points(structure, points, joints)
      type(structure_type), intent(in) :: structure
      integer, allocatable, intent(out) :: points(:), joints(:)
      integer :: first(structure%n_points)   ! first joint of each point; 0: none
      integer :: i, j

      first = 0
      do j = structure%n_joints, 1, -1
         first(structure%friction_point(j)) = j
      end do
      points = pack([(i, i=1, size(first))], first > 0)
      joints = first(points)
   end subroutine find_input_points

   !> Draws from the law of a process, as plan_draws chooses.
   subroutine draw_law(seed, model, points, draws, n_independent, at_most)
      integer(long), intent(in) :: seed
      type(process_model_type), intent(in) :: model
      integer, intent(in) :: points(:)                    !! points of the process, ascending
      real(wp), allocatable, intent(out) :: draws(:, :)   !! (draw, point)
      real(wp), intent(out) :: n_independent              !! independent draws they are worth
      integer, intent(in), optional :: at_most            !! limits the number of draws
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
         n_chains = n_chains_of(model)
         allocate (chains(n_chains, stride*((n - 1)/n_chains + 1)))
         stream = new_stream(seed, label, 0)
         call draw_chains(model, stream, chains)
         do i = 1, n
            draws(i, :) = chains(1 + modulo(i - 1, n_chains), ((i - 1)/n_chains)*stride + points)
         end do
      end if
   end subroutine draw_law

end module campaign_pooling
