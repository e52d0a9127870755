!> A solved positive process of order 1 or 2 once more without sampling, as a check: by the
!> transfer operator on Gauss nodes, which shares neither random numbers nor formulas with the fit.
module process_positive_check
   use core_kinds, only: wp
   use process_model, only: process_model_type
   use process_positive_partition, only: entropy_of_exact_law, log_sqrt_two_pi
   use process_positive_quadrature, only: find_stationary_law, new_operator, transfer_operator
   use process_truncated_normal, only: hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: check_by_quadrature

   integer, parameter :: highest_order = 2
   integer, parameter :: most_nodes = 64         !! cubed, at order 2: a tenth of a second
   integer, parameter :: most_lags = 400
   real(wp), parameter :: nodes_per_b0 = 3.0_wp  !! conditional laws are b0 wide: 1e-8 and better
   real(wp), parameter :: widths = 12.0_wp       !! std beyond the mean: no mass to speak of

contains

   !> Fills `model%quadrature`; nothing where nodes would be too many or too few.
   subroutine check_by_quadrature(model)
      type(process_model_type), intent(inout) :: model   !! solved, positive
      type(transfer_operator) :: operator
      real(wp), allocatable :: k(:)
      real(wp) :: location, offset, reach
      integer :: m, n_lags, n_nodes
      logical :: is_sequential, is_settled

      reach = (model%mean + widths*model%std)/model%b0
      if (model%order > highest_order .or. model%order < 1 .or. model%memory > most_lags .or. &
          reach*nodes_per_b0 > most_nodes) return
      n_nodes = max(ceiling(nodes_per_b0*reach), most_nodes/2)
      n_lags = model%memory
      is_sequential = model%request%sampler == 'sequential'
      location = model%mu/model%b0
      offset = location*(1.0_wp + sum(model%a))
      operator = new_operator(model%a, offset, reach, n_nodes, is_sequential)
      call find_stationary_law(operator, 1.0e-11_wp, is_settled)
      if (.not. is_settled) return
      k = operator%autocovariance(n_lags)
      associate (check => model%quadrature, sums => [(real(m, wp), m=1, n_lags)])
         check%n_nodes = n_nodes
         check%mean = model%b0*operator%expectation(operator%newest)
         check%std = model%b0*sqrt(k(1))
         check%l0 = sum(abs(k(2:)))/k(1)
         check%l1 = dot_product(sums, abs(k(2:)))/sum(abs(k))
         if (is_sequential) then
            check%entropy = 0.5_wp + log_sqrt_two_pi + operator%expectation( &
                            log_acceptance(operator%c) - 0.5_wp*operator%c*hazard_ratio(operator%c))
         else
            check%entropy = entropy_of_exact_law(log_sqrt_two_pi + 0.5_wp*location*offset &
                                                 *(1.0_wp + sum(model%a)) + operator%log_lambda, &
                                                 offset*(1.0_wp + sum(model%a)), &
                                                 check%mean/model%b0)
         end if
         check%entropy = check%entropy + log(model%b0)
      end associate
   end subroutine check_by_quadrature

end module process_positive_check
