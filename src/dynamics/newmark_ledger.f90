!> The energy ledger of Newmark's march: works over the steps of many samples.
!>
!> With average acceleration the work of the mean force over the way, of the dampers at the mean
!> velocity, and of the sliders, is the change of the stored energy, to rounding.
module dynamics_newmark_ledger
   use core_kinds, only: long, wp
   use dynamics_alignment, only: register_width
   implicit none(type, external)
   private
   public :: add_works

contains

   !> Adds the works of the steps that the listed samples have tried, where they stand. A register
   !> of dofs at a time; without branches, for nobody can guess which steps stand.
   pure subroutine add_works(n, rows, forced_dof, max_halvings, dt, n_listed, sample, n_samples, &
                             has_passed, tick, ticks, slot, column, n_steps, n_records, force, &
                             damping, pull, motion, work)
      integer, intent(in) :: n, rows, forced_dof, max_halvings, n_listed, n_samples
      real(wp), intent(in) :: dt                  !! [s]
      integer, intent(in) :: sample(n_listed), column(n_samples), n_steps, n_records
      !> 1: the step does not stand; when it begins and how long it is [ticks]; where it begins
      integer(long), dimension(n_samples), intent(in) :: has_passed, tick, ticks, slot
      real(wp), intent(in) :: force(0:n_steps, n_records)         !! [N]
      real(wp), intent(in) :: damping(rows, n)                    !! C
      real(wp), intent(in) :: pull(rows, n_samples)               !! what a slipping one carries [N]
      real(wp), intent(in) :: motion(rows, 3, 0:1, n_samples)     !! a, v, x
      real(wp), intent(inout) :: work(rows, 3, n_samples)         !! input, viscous, friction [J]
      real(wp) :: drag(register_width), middle, per_time, share, stands
      integer(long) :: new, old
      integer :: c, first, i, j, k, step, w

      share = 0.5_wp**max_halvings
      do k = 1, n_listed
         w = sample(k)
         c = column(w)
         old = slot(w)
         new = 1 - old
         stands = 1 - has_passed(w)
         step = int(shiftr(tick(w), max_halvings))
         middle = share*((tick(w) - shiftl(int(step, long), max_halvings)) + 0.5_wp*ticks(w))
         middle = force(step, c) + middle*(force(step + 1, c) - force(step, c))
         work(forced_dof, 1, w) = work(forced_dof, 1, w) + stands*middle* &
                                  (motion(forced_dof, 3, new, w) - motion(forced_dof, 3, old, w))
         per_time = stands/(share*dt*ticks(w))
         do first = 0, rows - 1, register_width
            drag = 0.0_wp
            do j = 1, n
               !$omp simd
               do i = 1, register_width
                  drag(i) = drag(i) + damping(first + i, j)* &
                            (motion(j, 3, new, w) - motion(j, 3, old, w))
               end do
            end do
            !$omp simd
            do i = first + 1, first + register_width
               block
                  real(wp) :: way
                  way = motion(i, 3, new, w) - motion(i, 3, old, w)
                  work(i, 2, w) = work(i, 2, w) + per_time*drag(i - first)*way
                  work(i, 3, w) = work(i, 3, w) + stands*pull(i, w)*way
               end block
            end do
         end do
      end do
   end subroutine add_works

end module dynamics_newmark_ledger
