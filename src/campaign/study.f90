!> A campaign as blocks of samples: which are still to be marched, and their friction.
module campaign_study
   use campaign_plan, only: plan_type
   use campaign_runner, only: block_width
   use core_kinds, only: wp
   use core_random, only: new_stream, stream_type
   use process_model, only: process_model_type, request_label
   use process_realization, only: draw_points
   implicit none(type, external)
   private
   public :: block_range, open_blocks, draw_friction

   !> Consecutive samples of a case.
   type :: block_range
      integer :: case_number = 0
      integer :: first = 0, last = 0   !! sample numbers, from 1
   end type block_range

contains

   !> The blocks that are still to be run, widest first so that ranks end together.
   pure function open_blocks(plan, is_finished) result(blocks)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: is_finished(:, :)   !! (sample, case)
      type(block_range), allocatable :: blocks(:)
      integer :: c, first, last, n, width

      width = block_width(plan)
      n = 0
      allocate (blocks(64))
      do c = 1, size(plan%cases)
         first = 1
         do while (first <= plan%cases(c)%n_samples)
            if (is_finished(first, c)) then
               first = first + 1
               cycle
            end if
            last = first
            do while (last < min(plan%cases(c)%n_samples, first + width - 1))
               if (is_finished(last + 1, c)) exit
               last = last + 1
            end do
            n = n + 1
            if (n > size(blocks)) blocks = [blocks, blocks]
            blocks(n) = block_range(c, first, last)
            first = last + 1
         end do
      end do
      blocks = blocks(:n)
      blocks = [pack(blocks, blocks%last - blocks%first + 1 == width), &
                pack(blocks, blocks%last - blocks%first + 1 < width)]
   end function open_blocks

   !> The friction coefficients of a block: each sample from its own stream, or as given.
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
