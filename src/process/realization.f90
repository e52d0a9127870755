!> Realizations of a solved process: consecutive values of one stationary run (Secs. 2.2 to 2.4).
!>
!> Each call walks along the stream that it is handed and nothing else, so a sample's values do not
!> depend on who else is drawn.
!>
!> Without sign constraint they come by Eq. (38), or the recursion of Eq. (39) from either start.
!> The rows of L^-1, L the Cholesky factor of the covariance matrix, are the prediction filters of
!> increasing order; beyond the order of the process they stay. So Eq. (38) for the infinite-domain
!> covariance is the recursion started from the stationary law, and needs no matrix. From the banded
!> matrix G itself it also needs none that is dense: with G = R R', the solution of R' X = W has
!> covariance G^-1; near the ends of the window that is not the infinite-domain covariance, so a
!> margin is drawn too and dropped.
module process_realization
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_lapack, only: solve_banded_factor
   use process_autoregressive_model, only: innovation_std, reflection_of, step_up
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_model, only: process_model_type
   use process_positive_exact, only: draw_window, sweeps_to_forget
   use process_positive_sequential, only: march_chains, march_sequential
   use process_positive_truncated_normal, only: draw_truncated, lanes, log_acceptance
   use process_reference, only: draw_reference, is_reference
   implicit none(type, external)
   private
   public :: burn_in_length, chains_of, draw_chains, draw_gaussian, draw_points, way_of_drawing, &
             way_type, widest_margin

   real(wp), parameter :: forgotten = 1.0e-10_wp   !! weight of the start when the sweeps end
   real(wp), parameter :: rest_forgotten = 1.0e-9_wp   !! the same, of a run from rest
   integer, parameter :: longest_burn_in = 100000000

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
         select case (model%request%simulation)
         case ('from_rest')
            call draw_from_rest(model, stream, values)
         case ('matrix')
            call draw_by_matrix(model, stream, values)
         case default
            call draw_gaussian(model, stream, values)
         end select
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
      real(wp) :: window(size(values) + 2*model%memory)
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
      ln_windows = -log(model%lambda)*(n_points + 2*model%memory)
      way%by_windows = ln_windows < log(way%n_sweeps/cost_of_trial)
      if (way%by_windows) way%n_windows = exp(ln_windows)
   end function way_of_drawing

   !> Draws consecutive values of a run that starts from the stationary Gaussian law: no burn-in.
   subroutine draw_gaussian(model, stream, values)
      type(process_model_type), intent(in) :: model     !! solved, without sign constraint
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)                !! (point) [unit of X]
      real(wp) :: filter(model%order), kappa(model%order), scale
      integer :: m, n

      n = size(values)
      call stream%normals(values)
      kappa = reflection_of(model%a)
      scale = model%b0/innovation_std(kappa, 1.0_wp)
      if (n > 0) values(1) = scale*values(1)
      do m = 1, min(model%order, n - 1)
         scale = scale*sqrt((1.0_wp - kappa(m))*(1.0_wp + kappa(m)))
         call step_up(filter, m, kappa(m))
         values(m + 1) = scale*values(m + 1) - dot_product(filter(:m), values(m:1:-1))
      end do
      call recur(model, values, model%order + 1)
      values = model%mu + values
   end subroutine draw_gaussian

   !> Draws consecutive values of a run that starts from z = 0, after as many as it takes to forget
   !> that (Sec. 2.3).
   subroutine draw_from_rest(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp), allocatable :: run(:)
      integer :: n_dropped

      n_dropped = burn_in_length(model)
      allocate (run(n_dropped + size(values)))
      call stream%normals(run)
      call recur(model, run, 0)
      values = model%mu + run(n_dropped + 1:)
   end subroutine draw_from_rest

   !> Draws by Eq. (38) with the matrix G of the direct method, on a window with margins as long as
   !> the memory. Not stationary to rounding where that is more than `widest_margin`.
   subroutine draw_by_matrix(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp), allocatable :: window(:)
      type(error_type), allocatable :: error
      integer :: margin

      margin = min(burn_in_length(model), widest_margin(model))
      allocate (window(size(values) + 2*margin))
      call stream%normals(window)
      call solve_banded_factor(symbol_of_process(model%a, model%b0), window, error)
      if (allocated(error)) error stop 'draw_by_matrix: the model is not stationary'
      values = model%mu + window(margin + 1:margin + size(values))
   end subroutine draw_by_matrix

   !> Points beside the wanted ones that a banded matrix has room for.
   pure function widest_margin(model) result(n)
      type(process_model_type), intent(in) :: model
      integer :: n
      integer, parameter :: most_entries = 2**23   ! of the band, on either side: 64 MB

      n = most_entries/(1 + model%order)
   end function widest_margin

   !> Values after which a start is forgotten, by the largest pole.
   pure function burn_in_length(model) result(n)
      type(process_model_type), intent(in) :: model
      integer :: n
      real(wp) :: largest

      n = model%order
      if (model%order == 0) return
      largest = maxval(abs(model%poles))
      if (largest > 0.0_wp) n = n + ceiling(min(real(longest_burn_in, wp), &
                                                log(rest_forgotten)/log(largest)))
   end function burn_in_length

   !> Turns white noise into the process by Eq. (39), from point `first` + 1 on.
   pure subroutine recur(model, values, first)
      type(process_model_type), intent(in) :: model
      real(wp), intent(inout) :: values(:)
      integer, intent(in) :: first
      integer :: i, q

      do i = first + 1, size(values)
         q = min(model%order, i - 1)
         values(i) = model%b0*values(i) - dot_product(model%a(:q), values(i - 1:i - q:-1))
      end do
   end subroutine recur

end module process_realization
