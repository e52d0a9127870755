!> Response of a block of samples to a sine: amplitude and phase of the fundamental in consecutive
!> windows of ten periods. A sample is steady if the fundamentals of successive windows agree.
module campaign_harmonic
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use campaign_plan, only: integration_settings
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_harmonic, only: harmonic_window, new_harmonic_window
   implicit none(type, external)
   private
   public :: harmonic_collector, start_harmonics

   integer, parameter :: values_per_period = 24    !! fewest used values of a period
   real(wp), parameter :: agreement = 1.0e-3_wp    !! relative difference of two fundamentals

   !> Fundamentals of the current window and of the one before it. The last window ends with the
   !> march.
   type :: harmonic_collector
      integer :: every = 1                              !! steps between used values
      type(harmonic_window), private :: window
      integer, private :: n_before = 0                  !! number of values before the first window
      integer, private :: n_added = 0                   !! number of values so far
      integer, private :: n_windows = 0                 !! number of complete windows
      complex(wp), allocatable, private :: now(:, :)    !! (dof, sample) sum of the current window
      complex(wp), allocatable, private :: last(:, :)   !! (dof, sample) of the last full window
      real(wp), allocatable, private :: since(:)        !! (sample) [s]; not a number: not steady
   contains
      procedure :: add
      procedure :: finish
      procedure, private :: end_window
   end type harmonic_collector

contains

   !> Prepares the windows of a march, which are in its measured part.
   subroutine start_harmonics(integration, frequency, n_dof, n_samples, collector, error)
      type(integration_settings), intent(in) :: integration
      real(wp), intent(in) :: frequency   !! frequency of the sine [Hz]
      integer, intent(in) :: n_dof, n_samples
      type(harmonic_collector), intent(out) :: collector
      type(error_type), allocatable, intent(out) :: error
      integer :: n_measured

      do while (2*collector%every*values_per_period*frequency*integration%dt <= 1.0_wp)
         collector%every = 2*collector%every
      end do
      associate (every => collector%every, window => collector%window)
         call new_harmonic_window(frequency, every*integration%dt, window, error)
         if (allocated(error)) return
         n_measured = (integration%n_steps - integration%n_discard)/every
         collector%n_before = integration%n_steps/every &
                              - window%n_values*(n_measured/window%n_values)
      end associate
      allocate (collector%now(n_dof, n_samples), source=(0.0_wp, 0.0_wp))
      collector%last = collector%now
      allocate (collector%since(n_samples), source=ieee_value(1.0_wp, ieee_quiet_nan))
   end subroutine start_harmonics

   !> Adds the next values, each `every` steps after the one before.
   pure subroutine add(self, x)
      class(harmonic_collector), intent(inout) :: self
      real(wp), intent(in) :: x(:, :, :)   !! (value, dof, sample) [m]
      integer :: dof, first, n, place, sample
      real(wp) :: start

      first = 1
      do while (first <= size(x, 1))
         place = self%n_added - self%n_before   ! number of values since the first window began
         if (place < 0) then
            n = min(-place, size(x, 1) - first + 1)
         else
            place = modulo(place, self%window%n_values)
            n = min(self%window%n_values - place, size(x, 1) - first + 1)
            start = (self%n_added - place)*self%window%interval
            do sample = 1, size(x, 3)
               do dof = 1, size(x, 2)
                  self%now(dof, sample) = self%now(dof, sample) &
                                          + self%window%fundamental_share(place + 1, start, &
                                                                x(first:first + n - 1, dof, sample))
               end do
            end do
            if (place + n == self%window%n_values) call self%end_window(start)
         end if
         self%n_added = self%n_added + n
         first = first + n
      end do
   end subroutine add

   !> Compares a complete window with the one before it, and starts the next one.
   pure subroutine end_window(self, start)
      class(harmonic_collector), intent(inout) :: self
      real(wp), intent(in) :: start   !! start of the window [s]
      integer :: sample

      if (self%n_windows > 0) then
         do sample = 1, size(self%since)
            associate (now => self%now(:, sample), last => self%last(:, sample))
               if (maxval(abs(now - last)) > agreement*maxval(abs(now))) then
                  self%since(sample) = ieee_value(1.0_wp, ieee_quiet_nan)
               else if (ieee_is_nan(self%since(sample))) then
                  self%since(sample) = start - self%window%n_values*self%window%interval
               end if
            end associate
         end do
      end if
      self%n_windows = self%n_windows + 1
      self%last = self%now
      self%now = (0.0_wp, 0.0_wp)
   end subroutine end_window

   !> Returns the amplitude [m] and phase [rad] in the last window, and the time [s] since which all
   !> windows agree.
   pure subroutine finish(self, result)
      class(harmonic_collector), intent(in) :: self
      type(block_result), intent(inout) :: result

      result%harmonic_amplitude = abs(self%last)
      result%harmonic_phase = atan2(aimag(self%last), real(self%last, wp))
      result%steady_since = self%since
      result%steady = merge(0.0_wp, 1.0_wp, ieee_is_nan(self%since))
   end subroutine finish

end module campaign_harmonic
