!> Realizations of a solved process: consecutive values of one stationary run (Secs. 2.2 to 2.4).
!>
!> A call uses random numbers of the given stream alone: a sample does not depend on other samples.
!>
!> Values of any sign are drawn in three ways:
!> - from the stationary law by the recursion of Eq. (39). It is the same as Eq. (38) with the
!>   covariance of the infinite domain, because the rows of L^-1, L its Cholesky factor, are the
!>   prediction filters of increasing order, which stay the same beyond the order of the process;
!> - from rest by the same recursion, after a burn-in;
!> - by Eq. (38) with the banded matrix G = R R': the solution of R' X = W has the covariance G^-1.
!>   Near the ends of the window this is not that of the infinite domain, so margins are dropped.
!> Positive values are drawn one by one by rejection (Sec. 2.4), or from the exact law, Eq. (25).
module process_realization
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_lapack, only: solve_banded_factor
   use process_autoregressive_model, only: innovation_std, reflection_of, step_up
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_model, only: process_model_type
   use process_positive_exact, only: draw_window, sweeps_to_forget
   use process_positive_sequential, only: march_chains
   use process_positive_truncated_normal, only: draw_truncated, lanes, log_acceptance
   use process_reference, only: draw_reference, is_reference
   implicit none(type, external)
   private
   public :: burn_in_length, draw_chains, draw_gaussian, draw_points, n_chains_of, widest_margin

   real(wp), parameter :: start_weight = 1.0e-10_wp   !! weight of the start after the sweeps
   real(wp), parameter :: rest_weight = 1.0e-9_wp   !! weight of the start after a burn-in
   integer, parameter :: longest_burn_in = 100000000       !! [points]

contains

   !> Draws a realization of the process.
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
         call draw_sequential(model, 1, size(values), stream, values)
      else
         call draw_exact(model, stream, values)
      end if
   end subroutine draw_points

   !> Draws several independent realizations: a value then costs a fifth of one in a single
   !> realization. The first values do not depend on the number of points.
   subroutine draw_chains(model, stream, values)
      type(process_model_type), intent(in) :: model   !! solved
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:, :)           !! (chain, point) n_chains_of [unit of X]

      if (is_sequential(model)) then
         call draw_sequential(model, size(values, 1), size(values, 2), stream, values)
      else
         call draw_points(model, stream, values(1, :))
      end if
   end subroutine draw_chains

   subroutine draw_sequential(model, n_chains, n_points, stream, values)
      type(process_model_type), intent(in) :: model
      integer, intent(in) :: n_chains, n_points
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(n_chains, n_points)

      call march_chains(model%a, model%mu/model%b0*(1.0_wp + sum(model%a)), model%mean/model%b0, &
                        model%memory, stream, values)
      values = model%b0*values
   end subroutine draw_sequential

   !> Number of realizations that draw_chains draws; 1 unless the sampler is sequential.
   pure integer function n_chains_of(model)
      type(process_model_type), intent(in) :: model

      n_chains_of = merge(lanes, 1, is_sequential(model))
   end function n_chains_of

   !> True if values are drawn one by one by the rejection of Sec. 2.4.
   pure logical function is_sequential(model)
      type(process_model_type), intent(in) :: model

      is_sequential = model%request%positive .and. model%request%sampler == 'sequential' &
                      .and. .not. (is_reference(model%request) .or. allocated(model%nodes) &
                                   .or. allocated(model%g))
   end function is_sequential

   !> Number of sweeps that forget the start if the model has G alone: that of the Gaussian law, or
   !> 24 (memory/62)^2 if that is more. The memory is at least 62/(1 - |K(m + 1)/K(m)|).
   pure integer function sweeps_of(model)
      type(process_model_type), intent(in) :: model

      sweeps_of = max(sweeps_to_forget(model%g(0)*model%std**2, model%l0, start_weight), &
                      ceiling(24.0_wp*(model%memory/62.0_wp)**2))
   end function sweeps_of

   !> Draws from the exact law, Eq. (25), of order 1 with alternating K(m): a Markov chain whose
   !> transition density is a mixture of truncated normal laws, one for each node.
   subroutine draw_alternating(model, stream, values)
      type(process_model_type), intent(in) :: model   !! model with G, order 1
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

   !> Draws from the exact law, Eq. (25), by the cheaper of two methods: Gaussian windows, with
   !> margins as long as the memory, until one is positive; or sweeps over one window, a value at a
   !> time (Gibbs), until its start has a weight of `start_weight`.
   subroutine draw_exact(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp) :: window(size(values) + 2*model%memory)
      real(wp), parameter :: window_cost = 1.5_wp   ! over that of a sweep
      real(wp) :: ln_windows   ! expected number of windows until one is positive
      integer :: n_sweeps

      n_sweeps = sweeps_to_forget((1.0_wp + sum(model%a**2))*(model%std/model%b0)**2, model%l0, &
                                  start_weight)
      ln_windows = -log(model%lambda)*size(window)
      if (ln_windows < log(n_sweeps/window_cost)) then
         do
            call draw_gaussian(model, stream, window)
            if (all(window > 0.0_wp)) exit
         end do
         values = window(model%memory + 1:model%memory + size(values))
      else
         call draw_window(symbol_of_process(model%a, 1.0_wp), &
                          model%mu/model%b0*(1.0_wp + sum(model%a))**2, &
                          model%mean/model%b0, model%memory, n_sweeps, stream, values)
         values = model%b0*values
      end if
   end subroutine draw_exact

   !> Draws a Gaussian realization from the stationary law.
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
      call apply_recursion(model, values, model%order + 1)
      values = model%mu + values
   end subroutine draw_gaussian

   !> Draws a Gaussian realization that starts from z = 0, after a burn-in (Sec. 2.3).
   subroutine draw_from_rest(model, stream, values)
      type(process_model_type), intent(in) :: model
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      real(wp), allocatable :: run(:)
      integer :: burn_in

      burn_in = burn_in_length(model)
      allocate (run(burn_in + size(values)))
      call stream%normals(run)
      call apply_recursion(model, run, 0)
      values = model%mu + run(burn_in + 1:)
   end subroutine draw_from_rest

   !> Draws a Gaussian realization by Eq. (38) with the matrix G of the direct method, on a window
   !> with margins of the burn-in length, or of `widest_margin` if that is less.
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

   !> Largest number of points in a margin, for the memory of the banded matrix.
   pure integer function widest_margin(model) result(n)
      type(process_model_type), intent(in) :: model
      integer, parameter :: max_entries = 2**23   ! entries of the band of a margin: 64 MB

      n = max_entries/(1 + model%order)
   end function widest_margin

   !> Number of points after which a start is forgotten, by the largest pole.
   pure integer function burn_in_length(model) result(n)
      type(process_model_type), intent(in) :: model
      real(wp) :: largest

      n = model%order
      if (model%order == 0) return
      largest = maxval(abs(model%poles))
      if (largest > 0.0_wp) n = n + ceiling(min(real(longest_burn_in, wp), &
                                                log(rest_weight)/log(largest)))
   end function burn_in_length

   !> Turns white noise into the process by Eq. (39), from point first + 1 on.
   pure subroutine apply_recursion(model, values, first)
      type(process_model_type), intent(in) :: model
      real(wp), intent(inout) :: values(:)
      integer, intent(in) :: first
      integer :: i, q

      do i = first + 1, size(values)
         q = min(model%order, i - 1)
         values(i) = model%b0*values(i) - dot_product(model%a(:q), values(i - 1:i - q:-1))
      end do
   end subroutine apply_recursion

end module process_realization
