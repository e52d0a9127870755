!> Work of the forces and of the dampers over a part or less, from the power series of its paths.
!>
!> Stored energy changes by input - viscous - friction. Friction needs no integral: it takes mu N
!> times the slip distance (dynamics_joint).
module dynamics_exact_ledger
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, local_responses, width
   use dynamics_exact_series, only: most_degree, series_type
   use dynamics_exact_transitions, only: transition_group
   use numerics_quadrature, only: gauss_legendre
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: ledger_type, new_ledger

   integer, parameter :: lanes = 8, vectors = width/lanes

   !> Response of a dof to a transition of its joint: d_3 (t - tau)^3 + ... is added to its path.
   type :: response_type
      integer :: lane, row
      real(wp) :: time                   !! tau [parts]
      real(wp) :: power(3:most_degree)   !! d
   end type response_type

   !> Data from which the work of a part is computed [J].
   type :: ledger_type
      real(wp), allocatable :: node(:), weight(:)   !! Gauss-Legendre quadrature on (0, 1)
      real(wp), allocatable :: mass(:)              !! (dof) m/h^2 [kg/s^2]
      real(wp), allocatable :: decay(:)             !! (dof) diagonal of D = M C^/h^2
      type(sparse_matrix) :: damping                !! twice D below its diagonal
      integer :: n_responses = 0
      type(response_type), allocatable :: response(:)   !! responses to local transitions of a part
      real(wp), allocatable :: area(:, :)           !! (lane, loaded dof) integral of all responses
   contains
      procedure :: keep_response
      procedure :: add_part
   end type ledger_type

contains

   !> Ledger of a series, with as many nodes n as integrate the dampers' power to 0.001 of the
   !> tolerance: power changes at 2 rho, twice the fastest rate, and the error of n nodes is
   !> (n!)^4/((2n + 1) (2n)!^3) times the derivative of order 2n. A force that rises from rest makes
   !> x_2 and x_3, whose power has the degree 4 at any rate: 3 nodes at least.
   pure function new_ledger(series, structure, tolerance) result(ledger)
      type(series_type), intent(in) :: series
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: tolerance
      type(ledger_type) :: ledger
      integer, parameter :: most_nodes = 12
      real(wp), allocatable :: damping(:, :)   ! twice M C^/h^2 = C/h
      integer :: j, n

      do n = 3, most_nodes - 1
         if ((2.0_wp*series%rate)**(2*n)*gamma(n + 1.0_wp)**4 <= &
             1.0e-3_wp*tolerance*(2*n + 1)*gamma(2*n + 1.0_wp)**3) exit
      end do
      allocate (ledger%node(n), ledger%weight(n), ledger%decay(series%n_dof))
      call gauss_legendre(0.0_wp, 1.0_wp, ledger%node, ledger%weight)
      ledger%mass = structure%lumped_mass()/series%h**2
      allocate (damping, source=2.0_wp/series%h*structure%damping)
      do j = 1, series%n_dof
         ledger%decay(j) = 0.5_wp*damping(j, j)
         damping(:j, j) = 0.0_wp
      end do
      ledger%damping = sparse_of(damping)
      allocate (ledger%response(1))
      allocate (ledger%area(width, size(series%loaded)), source=0.0_wp)
   end function new_ledger

   !> Adds the work of all lanes over a span of a part. Responses count in the velocities of their
   !> own dofs; those of other dofs are below a hundredth and neglected. The force's work on a
   !> response d is, by parts, f(1) d(1) - f' times the integral of d. Spans other than 1 have none.
   pure subroutine add_part(self, series, paths, span, work)
      class(ledger_type), intent(inout) :: self
      type(series_type), intent(in) :: series
      type(joint_paths), intent(in) :: paths
      real(wp), intent(in) :: span(width)           !! [parts]
      real(wp), intent(inout) :: work(width, 2)     !! input, viscous
      real(wp) :: added(width)   ! by transitions, to the displacement at the end
      real(wp), dimension(width) :: power, term
      real(wp) :: push(width, 0:1)   ! h^2 M^-1 b F: value and rise over the span [m]
      integer :: dof, f, i, k

      associate (x => paths%x, layer => paths%layer)
         do i = 1, size(series%loaded)
            dof = series%loaded(i)
            push = 0.0_wp
            do f = 1, size(series%load, 2)
               push = push + series%load(dof, f)*paths%force(:, f, :)
            end do
            push(:, 1) = span*push(:, 1)
            added = x(:, dof, paths%finish(0)) - x(:, dof, layer(0))
            power = 1.0_wp
            do k = 1, series%degree
               power = power*span
               term = x(:, dof, layer(k))*power
               added = added - term
               work(:, 1) = work(:, 1) + self%mass(dof)*term &
                            *(push(:, 0) + (real(k, wp)/(k + 1))*push(:, 1))
            end do
            work(:, 1) = work(:, 1) + self%mass(dof)*(added*(push(:, 0) + push(:, 1)) &
                                                      - self%area(:, i)*push(:, 1))
         end do
         call add_viscous(self, series%degree, paths%n_padded, span, x(1, 1, layer(1)), &
                          x(1, 1, 2), work(:, 2))
      end associate
      self%n_responses = 0
      self%area = 0.0_wp
   end subroutine add_part

   !> Adds the work of the dampers, eight lanes at a time, so that sums stay in registers.
   pure subroutine add_viscous(self, degree, n_padded, span, x1, x, work)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree, n_padded
      real(wp), intent(in) :: span(lanes, vectors)
      real(wp), intent(in) :: x1(lanes, vectors, n_padded), x(lanes, vectors, n_padded, 2:degree)
      real(wp), intent(inout) :: work(lanes, vectors)
      real(wp) :: velocity(lanes, size(self%mass))
      real(wp), dimension(lanes) :: total, t
      integer :: e, g, i, k, v

      do v = 1, vectors
         do g = 1, size(self%node)
            t = self%node(g)*span(:, v)
            do i = 1, size(self%mass)
               total = degree*x(:, v, i, degree)
               do k = degree - 1, 2, -1
                  total = total*t + k*x(:, v, i, k)
               end do
               velocity(:, i) = total*t + x1(:, v, i)
            end do
            call add_responses(self, degree, self%node(g), lanes*(v - 1), velocity)
            do i = 1, size(self%mass)
               total = self%decay(i)*velocity(:, i)
               do e = self%damping%start(i), self%damping%start(i + 1) - 1
                  total = total + self%damping%value(e)*velocity(:, self%damping%column(e))
               end do
               work(:, v) = work(:, v) + self%weight(g)*span(:, v)*velocity(:, i)*total
            end do
         end do
      end do
   end subroutine add_viscous

   !> Adds the responses to transitions before t to the velocities of their dofs.
   pure subroutine add_responses(self, degree, t, before, velocity)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree
      integer, intent(in) :: before   !! number of lanes before those of velocity
      real(wp), intent(in) :: t
      real(wp), intent(inout) :: velocity(lanes, size(self%mass))
      real(wp) :: rest
      integer :: e, k, l

      do e = 1, self%n_responses
         associate (response => self%response(e))
            l = response%lane - before
            if (response%time >= t .or. l < 1 .or. l > lanes) cycle
            rest = 0.0_wp
            do k = degree, 3, -1
               rest = rest*(t - response%time) + k*response%power(k)
            end do
            velocity(l, response%row) = velocity(l, response%row) + rest*(t - response%time)**2
         end associate
      end do
   end subroutine add_responses

   !> Keeps a transition for add_part: the response of its dof, and the integrals of the responses
   !> of loaded dofs, sum N_s A_(s+1) (10).
   pure subroutine keep_response(self, loaded, responses, group, entry)
      class(ledger_type), intent(inout) :: self
      integer, intent(in) :: loaded(:)   !! dofs
      type(local_responses), intent(in) :: responses
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      integer :: e, i

      if (self%n_responses == size(self%response)) self%response = [self%response, self%response]
      self%n_responses = self%n_responses + 1
      associate (l => group%lane(entry), row => group%row(entry), area => self%area)
         self%response(self%n_responses) = response_type(l, row, group%time(entry), &
                                                         group%response(entry, :))
         do i = 1, size(loaded)
            if (loaded(i) == row) area(l, i) = area(l, i) + group%ends(entry, 3)
            do e = responses%first(row), responses%first(row + 1) - 1
               if (responses%dof(e) /= loaded(i)) cycle
               area(l, i) = area(l, i) + (responses%value(1, e)*group%ends(entry, 5) &
                                          + responses%value(2, e)*group%ends(entry, 7))
            end do
         end do
      end associate
   end subroutine keep_response

end module dynamics_exact_ledger
