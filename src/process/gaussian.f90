!> Realizations of Gaussian processes: Eq. (38), and the recursion of Eq. (39) from either start.
!>
!> The rows of L^-1, L the Cholesky factor of the covariance matrix, are the prediction filters of
!> increasing order; beyond the order of the process they stay. So Eq. (38) for the infinite-domain
!> covariance is the recursion started from the stationary law, and needs no matrix. From the banded
!> matrix G itself it also needs none that is dense: with G = R R', the solution of R' X = W has
!> covariance G^-1; near the ends of the window that is not the infinite-domain covariance, so a
!> margin is drawn too and dropped.
module process_gaussian
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_toeplitz, only: banded_cholesky, factor_banded_toeplitz
   use process_autoregressive_model, only: innovation_std, reflection_of, step_up
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: draw_as_requested, draw_gaussian, burn_in_length, widest_margin

   real(wp), parameter :: forgotten = 1.0e-9_wp   !! share of a start that may be left
   integer, parameter :: longest_burn_in = 100000000

contains

   !> Draws consecutive values of a stationary run in the way that the request names.
   subroutine draw_as_requested(model, stream, values)
      type(process_model_type), intent(in) :: model     !! solved, without sign constraint
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)                !! (point) [unit of X]

      select case (model%request%simulation)
      case ('from_rest')
         call draw_from_rest(model, stream, values)
      case ('matrix')
         call draw_by_matrix(model, stream, values)
      case default
         call draw_gaussian(model, stream, values)
      end select
   end subroutine draw_as_requested

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
      type(banded_cholesky) :: factor
      real(wp), allocatable :: window(:)
      logical :: is_positive
      integer :: margin

      margin = min(burn_in_length(model), widest_margin(model))
      allocate (window(size(values) + 2*margin))
      call factor_banded_toeplitz(symbol_of_process(model%a, model%b0), size(window), factor, &
                                  is_positive)
      if (.not. is_positive) error stop 'draw_by_matrix: the model is not stationary'
      call stream%normals(window)
      call factor%solve_transposed(window)
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
                                                log(forgotten)/log(largest)))
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

end module process_gaussian
