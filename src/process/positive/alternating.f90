!> Positive processes of first order whose K(m) changes its sign with every lag: they go on beyond
!> the largest std/mean of those with K(m) >= 0, for both lengths sum |K(m)|.
!>
!> With the coupling held the length grows with the field, up to that of the Gaussian process, which
!> a coupling of 1/2 and more does not have; with the length held std/mean grows with the coupling,
!> to a limit at field = minus infinity or without one.
module process_positive_alternating
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_root_search, only: new_root_search, root_search
   use process_positive_kernel, only: first_order_law, new_alternating_law
   implicit none(type, external)
   private
   public :: match_alternating, alternating_limit

   real(wp), parameter :: matched = 1.0e-10_wp        !! relative, of the length
   real(wp), parameter :: ratio_matched = 1.0e-9_wp   !! relative
   real(wp), parameter :: strongest = 1.0e6_wp        !! coupling/field^2 that the nodes resolve
   integer, parameter :: max_steps = 80

contains

   !> The law with the wanted ratio and length, where there is one.
   subroutine match_alternating(correlation, length, ratio, is_sequential, law, error)
      character(*), intent(in) :: correlation   !! 'L0' or 'L1'
      real(wp), intent(in) :: length            !! [lags]
      real(wp), intent(in) :: ratio             !! std/mean
      logical, intent(in) :: is_sequential
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      type(root_search) :: search
      real(wp) :: coupling, excess, guess, least, parameter
      integer :: step
      logical :: is_found

      least = length/(1.0_wp + length)   ! of the Gaussian process, Eq. (39)
      if (.not. is_sequential) least = least/(1.0_wp + least**2)
      search = new_root_search(0.5_wp)
      parameter = log(0.7_wp)
      guess = 2.0_wp
      do step = 1, max_steps
         coupling = least*(1.0_wp + exp(parameter))
         call match_length(correlation, length, coupling, is_sequential, guess, law, is_found)
         excess = -1.0_wp   ! where the nodes do not resolve it the process is nearly Gaussian
         if (is_found) excess = log(law%std/law%mean/ratio)
         if (abs(excess) <= ratio_matched) return
         call search%advance(parameter, excess)
         if (abs(parameter) > 40.0_wp) exit
      end do
      call raise(error, exit_no_solution, 'the search for alternating K(m) ended '// &
                 to_text(excess)//' (relative) from std/mean')
   end subroutine match_alternating

   !> The largest std/mean of this length; `huge` where the strongest coupling has still more.
   subroutine alternating_limit(correlation, length, is_sequential, limit, error)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      logical, intent(in) :: is_sequential
      real(wp), intent(out) :: limit
      type(error_type), allocatable, intent(out) :: error
      type(first_order_law) :: law
      type(root_search) :: search
      real(wp) :: excess, parameter
      integer :: step

      limit = huge(1.0_wp)
      call new_alternating_law(0.0_wp, strongest, -1.0_wp, is_sequential, law, error)
      if (allocated(error)) return
      if (length_of(law, correlation) <= length) return
      search = new_root_search(1.0_wp)
      parameter = log(length)
      do step = 1, max_steps
         call new_alternating_law(0.0_wp, exp(parameter), -1.0_wp, is_sequential, law, error)
         if (allocated(error)) return
         excess = log(length_of(law, correlation)/length)
         if (abs(excess) <= matched) exit
         call search%advance(parameter, excess)
      end do
      limit = law%std/law%mean
   end subroutine alternating_limit

   !> The field that gives a coupling the wanted length.
   subroutine match_length(correlation, length, coupling, is_sequential, parameter, law, is_found)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length, coupling
      logical, intent(in) :: is_sequential
      real(wp), intent(inout) :: parameter   !! a guess; then that of the law: see `field_of`
      type(first_order_law), intent(out) :: law
      logical, intent(out) :: is_found
      real(wp), parameter :: largest = 100.0_wp
      type(error_type), allocatable :: error
      type(root_search) :: search
      real(wp) :: excess, trial
      integer :: step

      search = new_root_search(0.25_wp)
      trial = parameter
      is_found = .false.
      do step = 1, max_steps
         call new_alternating_law(1.0_wp, coupling, field_of(trial), is_sequential, law, error)
         if (allocated(error)) return
         excess = log(length_of(law, correlation)/length)
         is_found = abs(excess) <= matched
         if (is_found) exit
         call search%advance(trial, excess)
         if (abs(trial) > largest) return
      end do
      if (is_found) parameter = trial
   end subroutine match_length

   !> Fields as exp far below zero, so that few doublings reach any limit.
   elemental function field_of(parameter) result(field)
      real(wp), intent(in) :: parameter
      real(wp) :: field

      field = parameter
      if (parameter < 0.0_wp) field = 1.0_wp - exp(min(-parameter, 60.0_wp))
   end function field_of

   elemental function length_of(law, correlation) result(length)
      type(first_order_law), intent(in) :: law
      character(*), intent(in) :: correlation
      real(wp) :: length

      length = merge(law%l0, law%l1, correlation == 'L0')
   end function length_of

end module process_positive_alternating
