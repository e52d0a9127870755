!> Realizations of a solved process: consecutive values of one stationary run (Secs. 2.2 to 2.4).
!>
!> Each call walks along the stream that it is handed and nothing else, so a sample's values do not
!> depend on who else is drawn.
module process_realization
   use core_kinds, only: wp
   use core_random, only: stream_type
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_gaussian, only: draw_as_requested, draw_gaussian
   use process_model, only: process_model_type
   use process_positive_exact, only: draw_window, sweeps_to_forget
   use process_positive_sequential, only: march_chains, march_sequential
   use process_positive_truncated_normal, only: draw_truncated, lanes, log_acceptance
   use process_reference, only: draw_reference, is_reference
   implicit none(type, external)
   private
   public :: chains_of, draw_chains, draw_points, way_of_drawing, way_type

   real(wp), parameter :: forgotten = 1.0e-10_wp   !! weight of the start when the sweeps end

   !> How a realization of the exact law is drawn.
   type :: way_type
      logical :: by_windows = .false.   !! whole ones, until one is positive; else by sweeps
      real(wp) :: n_windows = 1.0_wp    !! expected
      integer :: n_sweeps = 0           !! over one window, a value at a time
   end type way_type

contains

   !> Draws the next realization of the process, of as many points as there are values.
   subroutine draw_points(model, stream, values)
      type(process_model_type), intent(in) :: model   !! solved
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)              !! (point) [unit of X]

      if (.not. model%is_solved) error stop 'draw_points: the process is not solved'
      if (is_reference(model%request)) then
         call draw_reference(model, stream, values)
      else if (.not. model%request%positive) then
         call draw_as_requested(model, stream, values)
      else if (allocated(model%nodes)) then
         call draw_alternating(model, stream, values)
      else if (allocated(model%g)) then
         call draw_window(model%g, model%mu*(model%g(0) + 2.0_wp*sum(model%g(1:))), model%mean, &
                          model%memory, sweeps_of(model), stream, values)
      else if (is_sequential(model)) then
         call march_sequential(model%a, model%mu/model%b0*(1.0_wp + sum(model%a)), &
                               model%mean/model%b0, model%memory, stream, values)
         values = model%b0*values
      else
         call draw_exact(model, stream, values)
      end if
   end subroutine draw_points

   !> Draws realizations that are independent of each other, for a large number of values: a value
   !> of many chains costs a fifth of one of a single chain. The first values do not depend on how
   !> many are drawn.
   subroutine draw_chains(model, stream, values)
      type(process_model_type), intent(in) :: model   !! solved
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:, :)           !! (chain, point) chains_of [unit of X]

      if (is_sequential(model)) then
         call march_chains(model%a, model%mu/model%b0*(1.0_wp + sum(model%a)), &
                           model%mean/model%b0, model%memory, stream, values)
         values = model%b0*values
      else
         call draw_points(model, stream, values(1, :))
      end if
   end subroutine draw_chains

   !> Chains that draw_chains has; one where the sampler knows no more.
   pure integer function chains_of(model)
      type(process_model_type), intent(in) :: model

      chains_of = merge(lanes, 1, is_sequential(model))
   end function chains_of

   !> True if values are drawn one after the other by the rejection of Sec. 2.4.
   pure logical function is_sequential(model)
      type(process_model_type), intent(in) :: model

      is_sequential = model%request%positive .and. model%request%sampler == 'sequential' &
                      .and. .not. (is_reference(model%request) .or. allocated(model%nodes) &
                                   .or. allocated(model%g))
   end function is_sequential

   !> Sweeps that forget the start where G is given alone: those of the Gaussian law, or the square
   !> of the memory, which is 62/(1 - |K(m + 1)/K(m)|) at least.
   pure integer function sweeps_of(model)
      type(process_model_type), intent(in) :: model

      sweeps_of = max(sweeps_to_forget(model%g(0)*model%std**2, model%l0, forgotten), &
                      ceiling(24.0_wp*(model%memory/62.0_wp)**2))
   end function sweeps_of

   !> Draws from the law of Eq. (25) of order 1 where K(m) alternates: a Markov chain. Its
   !> transition density is a mixture of truncated normal laws, one for each value that may follow
   !> next but one.
   subroutine draw_alternating(model, stream, values)
      type(process_model_type), intent(in) :: model   !! with G, order 1
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp), dimension(size(model%nodes)) :: c, share
      real(wp) :: factor, field, hazard, u(2), x
      integer :: i, n

      field = (model%g(0) + 2.0_wp*model%g(1))*model%mu
      x = model%mean
      do n = 1 - model%memory, size(values)
         call stream%uniforms(u)
         c = model%b0*(field - model%g(1)*(x + model%nodes))
         share = log_acceptance(c) + 0.5_wp*c**2
         share = model%weights*exp(max(share - maxval(share), -700.0_wp))
         u(2) = u(2)*sum(share)
         do i = 1, size(share) - 1
            u(2) = u(2) - share(i)
            if (u(2) <= 0.0_wp) exit
         end do
         call draw_truncated(c(i), u(1), x, hazard, factor)
         x = model%b0*x
         if (n >= 1) values(n) = x
      end do
   end subroutine draw_alternating

   !> Draws from the law of Eq. (25): a whole Gaussian window with margins beyond the memory,
   !> redrawn until all of it is positive, its middle kept; or, where as many sweeps cost less than
   !> as many trials, one value at a time (Gibbs), until the start has lost all but `forgotten` of
   !> its weight.
   subroutine draw_exact(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp) :: window(window_size(model, size(values)))
      type(way_type) :: way

      way = way_of_drawing(model, size(values))
      if (way%by_windows) then
         do
            call draw_gaussian(model, stream, window)
            if (all(window > 0.0_wp)) exit
         end do
         values = window(model%memory + 1:model%memory + size(values))
      else
         call draw_window(symbol_of_process(model%a, 1.0_wp), &
                          model%mu/model%b0*(1.0_wp + sum(model%a))**2, &
                          model%mean/model%b0, model%memory, way%n_sweeps, stream, values)
         values = model%b0*values
      end if
   end subroutine draw_exact

   !> The cheaper of the two ways; of a model, coefficients, std, L0, memory and Lambda count.
   pure function way_of_drawing(model, n_points) result(way)
      type(process_model_type), intent(in) :: model   !! of the exact law
      integer, intent(in) :: n_points
      type(way_type) :: way
      real(wp), parameter :: cost_of_trial = 1.5_wp   ! of a sweep over the same window
      real(wp) :: ln_windows

      way%n_sweeps = sweeps_to_forget((1.0_wp + sum(model%a**2))*(model%std/model%b0)**2, &
                                      model%l0, forgotten)
      ln_windows = -log(model%lambda)*window_size(model, n_points)
      way%by_windows = ln_windows < log(way%n_sweeps/cost_of_trial)
      if (way%by_windows) way%n_windows = exp(ln_windows)
   end function way_of_drawing

   pure integer function window_size(model, n_points)
      type(process_model_type), intent(in) :: model
      integer, intent(in) :: n_points

      window_size = n_points + 2*model%memory
   end function window_size

end module process_realization
