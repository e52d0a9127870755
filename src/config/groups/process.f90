!> &process: maximum-entropy processes that are wanted (Sec. 2). The group may be repeated.
module config_groups_process
   use config_text_value_table, only: about, at_least, between, choice_length, entry_type, &
      not_negative, positive, visitor_type
   use core_kinds, only: wp
   use process_model, only: process_request
   implicit none(type, external)
   private
   public :: process_group, visit_process

   !> A request that all processes of the group share, and lists of what they differ in: every
   !> correlation length with its order, and these with every std.
   type :: process_group
      type(process_request) :: shared = process_request(positive=.true.)
      character(:), allocatable :: values   !! path of a file of samples; '': none
      real(wp), allocatable :: lengths(:)
      integer, allocatable :: orders(:)
      character(choice_length) :: pairing = 'zip'
      real(wp), allocatable :: range_l0(:), range_l1(:)
      real(wp), allocatable :: stds(:)
      integer :: n_points = 5
      integer :: n_realizations = 0
   end type process_group

contains

   !> Visits the table of &process.
   subroutine visit_process(self, visitor)
      type(process_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor
      type(entry_type) :: entry
      logical :: has_law

      call visitor%visit_text(self%values, about('values', &
         'samples as they are, instead of a law: a text file, a line a '// &
         'sample, a value a joint', shapes_samples=.false.))
      has_law = .true.
      if (allocated(self%values)) has_law = self%values == ''
      call visitor%visit(self%shared%method, about('method', &
         'Sec. 2.3: recursion of a finite order; Sec. 2.2: covariances up to m_max', &
         choices='autoregressive direct'))
      call visitor%visit(self%shared%correlation, about('correlation', &
         'definition of the correlation length, Eq. 8 or 9; both: not direct', &
         choices='L0 L1 both'))
      call visitor%visit(self%lengths, about('correlation_length', &
         'one or several; 0: independent values; 1e12 or more: one value for all', 'points', &
         not_negative(), required=has_law))
      call visitor%visit(self%shared%second_length, about('second_length', &
         'both: L1, where correlation_length is L0', 'points', not_negative(), &
         used=self%shared%correlation == 'both'))
      entry = about('order', 'M of the recursion, m_max of direct (must be given); 0: found '// &
                    'from the bounds', rule=between(0.0_wp, 2000.0_wp))
      entry%default = 'for each length: 2 below 0.65, 5 below 2, else 10'
      call visitor%visit(self%orders, entry, default=usual_orders(self%lengths))
      call visitor%visit(self%pairing, about('pairing', &
         'zip: an order for each correlation length, or one for all; product: all', &
         choices='zip product'))
      call visitor%visit(self%range_l0, about('bound_l0', &
         'order 0 with L1 imposed: of L0, or lower and upper; 0: none', 'points', not_negative(), &
         used=any_zero(self%orders)), default=[0.0_wp])
      call visitor%visit(self%range_l1, about('bound_l1', &
         'order 0 with L0 imposed: of L1, or lower and upper; 0: none', 'points', not_negative(), &
         used=any_zero(self%orders)), default=[0.0_wp])
      call visitor%visit(self%shared%bound_side, about('bound_side', &
         'of the bound; automatic: upper of L1, lower of L0, so the largest order', &
         choices='automatic upper lower', used=is_one_sided(self%range_l0, self%range_l1)))
      call visitor%visit(self%shared%max_order, about('max_order', 'order 0: search no further', &
         rule=between(1.0_wp, 200.0_wp), used=any_zero(self%orders)))
      call visitor%visit(self%shared%mean, about('mean', 'homogeneous', required=has_law))
      call visitor%visit(self%stds, about('std', 'one or several, each with every pair', &
         rule=positive(), required=has_law))
      call visitor%visit(self%shared%positive, about('positive', 'no negative values (Sec. 2.4)'))
      call visitor%visit(self%shared%sampler, about('sampler', &
         'positive values: one at a time as Sec. 2.4, or the law of Eq. 25 itself', &
         choices='sequential exact', used=self%shared%positive))
      call visitor%visit(self%shared%branch, about('branch', &
         'positive: nonnegative keeps K(m) >= 0; any goes on beyond it', &
         choices='any nonnegative', used=self%shared%positive))
      call visitor%visit(self%shared%fit_steps, about('fit_steps', &
         'positive, order 2 on: fit to so many values in each of 512 batches; 0: chosen', &
         rule=between(0.0_wp, 1048576.0_wp), &
         used=self%shared%positive .and. self%shared%fit_steps > 0))
      call visitor%visit(self%shared%all_signs, about('all_signs', &
         'direct: solve every sequence of signs (2**30 at most; positive: 2**11), '// &
         'list the best', used=self%shared%method == 'direct'))
      call visitor%visit(self%shared%inversion_half_width, about('inversion_half_width', &
         "direct: M of Eq. 35, the paper's inversion as a check; 0: none", &
         rule=between(0.0_wp, 2000.0_wp), &
         used=self%shared%method == 'direct' .and. .not. self%shared%positive))
      call visitor%visit(self%shared%simulation, about('simulation', &
         'any sign: Eq. 39 from its stationary law or from_rest, or Eq. 38 (matrix)', &
         choices='stationary from_rest matrix', used=.not. self%shared%positive))
      call visitor%visit(self%n_points, about('n_points', &
         'of a realization, for all &process; with motion: of the joints', rule=at_least(1.0_wp), &
         shapes_samples=.false.))
      call visitor%visit(self%n_realizations, about('n_realizations', &
         'to be written, for all &process', rule=not_negative(), shapes_samples=.false.))
   end subroutine visit_process

   !> Order for each correlation length, the paper's 2, 5, 10 for its 0.3, 1, 3; one where there is
   !> no length.
   pure function usual_orders(lengths) result(orders)
      real(wp), allocatable, intent(in) :: lengths(:)   !! [points]
      integer, allocatable :: orders(:)

      orders = [2]
      if (.not. allocated(lengths)) return
      if (size(lengths) == 0) return
      orders = merge(2, merge(5, 10, lengths < 2.0_wp), lengths < 0.65_wp)
   end function usual_orders

   !> True if one of the bounds is given, and by one value.
   pure logical function is_one_sided(bound, other)
      real(wp), allocatable, intent(in) :: bound(:), other(:)

      is_one_sided = .false.
      if (.not. (allocated(bound) .and. allocated(other))) return
      is_one_sided = any([bound, other] > 0.0_wp) .and. max(size(bound), size(other)) == 1
   end function is_one_sided

   pure logical function any_zero(order)
      integer, allocatable, intent(in) :: order(:)

      any_zero = .false.
      if (allocated(order)) any_zero = any(order == 0)
   end function any_zero

end module config_groups_process
