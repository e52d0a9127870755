!> Divides a campaign into claims, the samples that a rank takes at once, and draws the friction of
!> a block.
module campaign_study
   use campaign_plan, only: have_same_force, plan_type
   use campaign_runner, only: block_width
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: new_stream, stream_type
   use core_text, only: to_text
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type, request_label
   use process_realization, only: draw_points
   implicit none(type, external)
   private
   public :: block_range, claim_type, draw_friction, name_sample, open_claims

   integer, parameter :: most_block_claimers = 64   !! ranks up to which a claim is one block

   !> Consecutive samples of a case.
   type :: block_range
      integer :: case_number = 0
      integer :: first = 0, last = 0   !! sample numbers, from 1
   end type block_range

   !> Samples that a rank takes at once: one or more blocks of a case, or samples of several cases
   !> that march as one block.
   type :: claim_type
      type(block_range), allocatable :: ranges(:)
   contains
      procedure :: n_samples
   end type claim_type

contains

   !> Claims of all samples that are not finished, the largest first so that ranks end together. A
   !> claim is one block. For more than most_block_claimers ranks, whose shards would be too many,
   !> it is up to 1/(3 n_ranks) of the remaining blocks (guided self-scheduling): a rank with a
   !> third of the others' speed does not end after them.
   pure function open_claims(plan, is_finished, n_ranks, is_shared) result(claims)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: is_finished(:, :)   !! (sample, case)
      integer, intent(in) :: n_ranks
      !> true: other runs share the samples, by the names of shards; a claim is a block of one case
      logical, intent(in) :: is_shared
      type(claim_type), allocatable :: claims(:)
      type(block_range), allocatable :: ranges(:)
      integer :: c, first, last, most, n, n_open, width

      width = block_width(plan)
      n_open = sum([(count(.not. is_finished(:plan%cases(c)%n_samples, c)), &
                     c=1, size(plan%cases))])
      n = 0
      allocate (ranges(64))
      do c = 1, size(plan%cases)
         first = 1
         do while (first <= plan%cases(c)%n_samples)
            if (is_finished(first, c)) then
               first = first + 1
               cycle
            end if
            most = width
            if (n_ranks > most_block_claimers .and. .not. is_shared) &
               most = width*max(1, n_open/width/(3*n_ranks))
            last = first
            do while (last < min(plan%cases(c)%n_samples, first + most - 1))
               if (is_finished(last + 1, c)) exit
               last = last + 1
            end do
            n_open = n_open - (last - first + 1)
            n = n + 1
            if (n > size(ranges)) ranges = [ranges, ranges]
            ranges(n) = block_range(c, first, last)
            first = last + 1
         end do
      end do
      ranges = ranges(sort_order(real(ranges(:n)%first - ranges(:n)%last, wp)))
      call join_ranges(plan, ranges, width, merge(n, n_ranks, is_shared), claims)
      claims = claims(sort_order(-real(claims%n_samples(), wp)))
   end function open_claims

   !> Joins ranges that do not fill a block, of cases with the same force: a block takes nearly the
   !> same time with any number of samples. At least `fewest` claims are left.
   pure subroutine join_ranges(plan, ranges, width, fewest, claims)
      type(plan_type), intent(in) :: plan
      type(block_range), intent(in) :: ranges(:)   !! longest first
      integer, intent(in) :: width                 !! samples of a block
      integer, intent(in) :: fewest
      type(claim_type), allocatable, intent(out) :: claims(:)
      type(claim_type), allocatable :: joined(:)
      integer :: i, n, place

      allocate (joined(size(ranges)))
      n = 0
      do i = 1, size(ranges)
         place = n + 1
         if (n + size(ranges) - i >= fewest) place = place_of(ranges(i))
         if (place > n) then
            n = place
            joined(n)%ranges = [ranges(i)]
         else
            joined(place)%ranges = [joined(place)%ranges, ranges(i)]
         end if
      end do
      claims = joined(:n)

   contains

      !> Number of the first claim that a range may join; n + 1 if there is none.
      pure integer function place_of(range) result(place)
         type(block_range), intent(in) :: range

         place = n + 1
         if (plan%excitation%per_sample .or. range%last - range%first + 1 >= width) return
         associate (case => plan%cases(range%case_number), &
                    most => width - (range%last - range%first + 1))
            do place = 1, n
               if (joined(place)%n_samples() > most) cycle
               associate (other => plan%cases(joined(place)%ranges(1)%case_number))
                  if (have_same_force(case, other) .and. &
                      (case%audits > 0 .eqv. other%audits > 0)) return
               end associate
            end do
         end associate
      end function place_of

   end subroutine join_ranges

   !> Number of samples of a claim.
   elemental integer function n_samples(self)
      class(claim_type), intent(in) :: self

      n_samples = sum(self%ranges%last - self%ranges%first + 1)
   end function n_samples

   !> Draws the friction of a block, each sample from its own random stream, or takes given values.
   subroutine draw_friction(plan, models, ranges, friction)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)   !! (process)
      type(block_range), intent(in) :: ranges(:)          !! samples of the block
      real(wp), allocatable, intent(out) :: friction(:, :)   !! (joint, sample)
      real(wp) :: values(plan%structure%n_points)
      type(stream_type) :: stream
      integer :: i, sample, w

      allocate (friction(plan%structure%n_joints, sum(ranges%last - ranges%first + 1)))
      w = 0
      do i = 1, size(ranges)
         associate (process => plan%cases(ranges(i)%case_number)%process, &
                    before => plan%cases(ranges(i)%case_number)%first_sample - 1)
            do sample = before + ranges(i)%first, before + ranges(i)%last
               w = w + 1
               if (process == 0) then
                  friction(:, w) = plan%friction
               else if (plan%processes(process)%method == 'values') then
                  friction(:, w) = plan%values(plan%structure%friction_point, sample)
               else
                  stream = new_stream(plan%seed, request_label(plan%processes(process)), sample)
                  call draw_points(models(process), stream, values)
                  friction(:, w) = values(plan%structure%friction_point)
               end if
            end do
         end associate
      end do
   end subroutine draw_friction

   !> Begins the message of an error of one sample of a block with its case and number.
   pure subroutine name_sample(plan, block, error)
      type(plan_type), intent(in) :: plan
      type(block_range), intent(in) :: block(:)   !! samples of the block
      type(error_type), intent(inout) :: error
      character(:), allocatable :: name
      integer :: i, k

      k = error%sample
      if (k == 0) return
      do i = 1, size(block)
         associate (case => plan%cases(block(i)%case_number), &
                    n => block(i)%last - block(i)%first + 1)
            if (k <= n) then
               name = 'case '//to_text(block(i)%case_number)
               if (case%audits > 0) name = 'audit of case '//to_text(case%audits)
               error%message = name//', sample '// &
                               to_text(case%first_sample + block(i)%first + k - 2)//': '// &
                               error%message
               return
            end if
            k = k - n
         end associate
      end do
   end subroutine name_sample

end module campaign_study
