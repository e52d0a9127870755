!> A campaign as blocks of samples, which ranks claim, and the friction of a block.
module campaign_study
   use campaign_plan, only: plan_type
   use campaign_runner, only: block_width
   use core_kinds, only: wp
   use core_random, only: new_stream, stream_type
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type, request_label
   use process_realization, only: draw_points
   implicit none(type, external)
   private
   public :: block_range, draw_friction, open_claims

   integer, parameter :: most_block_claimers = 64   !! ranks that claim a block at a time

   !> Consecutive samples of a case.
   type :: block_range
      integer :: case_number = 0
      integer :: first = 0, last = 0   !! sample numbers, from 1
   end type block_range

contains

   !> Samples that are still to be run, as ranks claim them, most first so that ranks end together.
   !> A claim is one block. For more than most_block_claimers ranks, whose shards would be too many,
   !> it is up to 1/(3 n_ranks) of the blocks that are left (guided self-scheduling): a rank with a
   !> third of the others' speed does not end after them.
   pure function open_claims(plan, is_finished, n_ranks) result(claims)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: is_finished(:, :)   !! (sample, case)
      integer, intent(in) :: n_ranks             !! that share them
      type(block_range), allocatable :: claims(:)
      integer :: c, first, last, most, n, n_open, width

      width = block_width(plan)
      n_open = sum([(count(.not. is_finished(:plan%cases(c)%n_samples, c)), &
                     c=1, size(plan%cases))])
      n = 0
      allocate (claims(64))
      do c = 1, size(plan%cases)
         first = 1
         do while (first <= plan%cases(c)%n_samples)
            if (is_finished(first, c)) then
               first = first + 1
               cycle
            end if
            most = width
            if (n_ranks > most_block_claimers) most = width*max(1, n_open/width/(3*n_ranks))
            last = first
            do while (last < min(plan%cases(c)%n_samples, first + most - 1))
               if (is_finished(last + 1, c)) exit
               last = last + 1
            end do
            n_open = n_open - (last - first + 1)
            n = n + 1
            if (n > size(claims)) claims = [claims, claims]
            claims(n) = block_range(c, first, last)
            first = last + 1
         end do
      end do
      claims = claims(:n)
      claims = claims(sort_order(real(claims%first - claims%last, wp)))
   end function open_claims

   !> Draws the friction coefficients of a block, each sample from its own stream, or takes the
   !> given ones.
   subroutine draw_friction(plan, models, block, friction)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)   !! (process)
      type(block_range), intent(in) :: block
      real(wp), allocatable, intent(out) :: friction(:, :)   !! (joint, sample)
      real(wp) :: values(plan%structure%n_points)
      type(stream_type) :: stream
      integer :: w

      allocate (friction(plan%structure%n_joints, block%last - block%first + 1))
      associate (process => plan%cases(block%case_number)%process)
         if (process == 0) then
            friction = spread(plan%friction, 2, size(friction, 2))
            return
         end if
         if (plan%processes(process)%method == 'values') then
            friction(:, :) = plan%values(plan%structure%friction_point, block%first:block%last)
            return
         end if
         do w = 1, size(friction, 2)
            stream = new_stream(plan%seed, request_label(plan%processes(process)), &
                                block%first + w - 1)
            call draw_points(models(process), stream, values)
            friction(:, w) = values(plan%structure%friction_point)
         end do
      end associate
   end subroutine draw_friction

end module campaign_study
