!> &process: requests for maximum-entropy processes (Sec. 2). The group may be repeated.
module config_groups_process
   use config_text_value_table, only: choice_length, entry_type, interval, not_negative, positive, &
      visitor_type
   use core_kinds, only: wp
   use process_model, only: process_request
   implicit none(type, external)
   private
   public :: process_group, visit_process

   !> Request that all processes of the group share, and lists of lengths, orders and standard
   !> deviations. Each std is combined with every pair of length and order.
   type :: process_group
      type(process_request) :: shared = process_request(positive=.true.)
      character(:), allocatable :: values          !! path of a file of samples; '': none
      real(wp), allocatable :: lengths(:)          !! [points]
      integer, allocatable :: orders(:)
      character(choice_length) :: pairing = 'zip'  !! pairing of lengths and orders; or 'product'
      real(wp), allocatable :: range_l0(:), range_l1(:)   !! a bound, or lower and upper [points]
      real(wp), allocatable :: stds(:)
      integer :: n_points = 5
      integer :: n_realizations = 0
   end type process_group

contains

   !> Visits the table of &process.
   subroutine visit_process(self, visitor)
      type(process_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor
      logical :: has_law

      call visitor%visit_text(self%values, entry_type('values', &
         'given friction values in place of a process: a text file, one line for each '// &
         'sample, one value for each friction point', in_fingerprint=.false.))
      has_law = self%values == ''
      call visitor%visit(self%shared%method, entry_type('method', &
         'autoregressive: a recursion of finite order (Sec. 2.3); direct: correlation '// &
         'lengths cut at m_max (Sec. 2.2)', choices='autoregressive direct'))
      call visitor%visit(self%shared%correlation, entry_type('correlation', &
         'definition of the correlation length: L0 (Eq. 8), L1 (Eq. 9), or both at once '// &
         '(autoregressive method only)', choices='L0 L1 both'))
      call visitor%visit(self%lengths, entry_type('correlation_length', &
         'one or several; 0 gives independent values, 1e12 or more one value for all joints', &
         'points', not_negative, is_required=has_law))
      call visitor%visit(self%shared%second_length, entry_type('second_length', &
         "with correlation = 'both': the L1, beside L0 in correlation_length", 'points', &
         not_negative, is_used=self%shared%correlation == 'both'))
      ! the paper has orders 2, 5 and 10 for its lengths 0.3, 1 and 3
      call visitor%visit(self%orders, entry_type('order', &
         'order M of the recursion; m_max of the direct method, where it must be given; '// &
         '0: chosen from the bounds', rule=interval(0.0_wp, 2000.0_wp), &
         default='for each length: 2 below 0.65, 5 below 2, else 10'), &
         default=merge(2, merge(5, 10, self%lengths < 2.0_wp), self%lengths < 0.65_wp))
      call visitor%visit(self%pairing, entry_type('pairing', &
         'zip: one order for each correlation length, or one for all; product: every order '// &
         'with every length', choices='zip product'))
      call visitor%visit(self%range_l0, entry_type('bound_l0', &
         'with order = 0 and L1 imposed: bound on L0, or lower and upper bound; 0: none', &
         'points', not_negative, is_used=any(self%orders == 0)), default=[0.0_wp])
      call visitor%visit(self%range_l1, entry_type('bound_l1', &
         'with order = 0 and L0 imposed: bound on L1, or lower and upper bound; 0: none', &
         'points', not_negative, is_used=any(self%orders == 0)), default=[0.0_wp])
      call visitor%visit(self%shared%bound_side, entry_type('bound_side', &
         'side of a single bound; automatic: upper for L1, lower for L0, which gives the '// &
         'largest order', choices='automatic upper lower', &
         is_used=any([self%range_l0, self%range_l1] > 0.0_wp) .and. &
         size(self%range_l0) == 1 .and. size(self%range_l1) == 1))
      call visitor%visit(self%shared%max_order, entry_type('max_order', &
         'with order = 0: largest order tried', rule=interval(1.0_wp, 200.0_wp), &
         is_used=any(self%orders == 0)))
      call visitor%visit(self%shared%mean, entry_type('mean', &
         'mean of the process, the same at every point', is_required=has_law))
      call visitor%visit(self%stds, entry_type('std', &
         'standard deviation; one or several, each with every pair of length and order', &
         rule=positive, is_required=has_law))
      call visitor%visit(self%shared%positive, entry_type('positive', &
         'with a positivity constraint (Sec. 2.4)'))
      call visitor%visit(self%shared%sampler, entry_type('sampler', &
         'law of a positive process: values rejected one at a time as in Sec. 2.4, or Eq. 25 '// &
         'exactly', choices='sequential exact', is_used=self%shared%positive))
      call visitor%visit(self%shared%branch, entry_type('branch', &
         'signs of K(m) of a positive process: nonnegative imposes K(m) >= 0; any also allows '// &
         'K(m) that change sign', choices='any nonnegative', is_used=self%shared%positive))
      call visitor%visit(self%shared%fit_steps, entry_type('fit_steps', &
         'positive process of order 2 or more: simulated values in each of the 512 batches '// &
         'of its fit; 0: chosen', rule=interval(0.0_wp, 1048576.0_wp), &
         is_used=self%shared%positive .and. self%shared%fit_steps > 0))
      call visitor%visit(self%shared%all_signs, entry_type('all_signs', &
         'direct method: solve every sequence of signs (at most 2**30; positive: 2**11) '// &
         'and list the best', is_used=self%shared%method == 'direct'))
      call visitor%visit(self%shared%inversion_half_width, entry_type('inversion_half_width', &
         "direct method: M of the paper's inversion (Eq. 35), as a check; 0: no check", &
         rule=interval(0.0_wp, 2000.0_wp), &
         is_used=self%shared%method == 'direct' .and. .not. self%shared%positive))
      call visitor%visit(self%shared%simulation, entry_type('simulation', &
         'how values without sign constraint are drawn: Eq. 39 from its stationary law or '// &
         'from rest, or Eq. 38 (matrix)', choices='stationary from_rest matrix', &
         is_used=.not. self%shared%positive))
      call visitor%visit(self%n_points, entry_type('n_points', &
         'points of a realization, the same in all &process; not used with motion: the joints '// &
         'determine it', rule=interval(lower=1.0_wp), in_fingerprint=.false.))
      call visitor%visit(self%n_realizations, entry_type('n_realizations', &
         'realizations to write, the same in all &process', rule=not_negative, &
         in_fingerprint=.false.))
   end subroutine visit_process

end module config_groups_process
