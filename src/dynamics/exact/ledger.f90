!> Work of the force and of the dampers over a piece of motion, from the power series of its paths.
!>
!> Stored energy changes by input - viscous - friction. The joints' share needs no integral: a joint
!> that slips takes mu N times its way (dynamics_joint).
module dynamics_exact_ledger
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, width
   use dynamics_exact_series, only: form_matrices, most_degree, series_type
   use numerics_quadrature, only: gauss_legendre
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: ledger_type, new_ledger

   integer, parameter :: lanes = 8, vectors = width/lanes

   !> Terms that one transition adds to the path of its dof: d_3 (t - tau)^3 + ...
   type :: answer_type
      integer :: lane, row
      real(wp) :: time                   !! tau [parts]
      real(wp) :: power(3:most_degree)   !! d
   end type answer_type

   !> Works are in J.
   type :: ledger_type
      real(wp), allocatable :: node(:), weight(:)   !! Gauss and Legendre, on (0, 1)
      real(wp), allocatable :: mass(:)              !! (dof) m/h^2 [kg/s^2]
      !> Diagonal of M C^/h^2, and twice what is below it: v'Cv is the sum of v_i times rows of both
      real(wp), allocatable :: decay(:)             !! (dof)
      type(sparse_matrix) :: damping
      !> Transitions answered locally in the part
      integer :: n_answers = 0
      type(answer_type), allocatable :: answer(:)
      real(wp), allocatable :: area(:, :)           !! (lane, loaded dof) integral of what they add
   contains
      procedure :: note_answer
      procedure :: add_part
   end type ledger_type

contains

   !> As many nodes as integrate the power of the fastest motion a thousand times better than the
   !> tolerance: powers change at twice its rate, and n nodes leave (n!)^4/((2n + 1) (2n)!^3) times
   !> the derivative of order 2n.
   pure function new_ledger(series, structure, tolerance) result(ledger)
      type(series_type), intent(in) :: series
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: tolerance
      type(ledger_type) :: ledger
      integer, parameter :: most = 12
      real(wp), allocatable, dimension(:, :) :: damping, stiffness   ! C^, K^
      integer :: j, n

      do n = 2, most - 1
         if ((2.0_wp*series%rate)**(2*n)*gamma(n + 1.0_wp)**4 <= &
             1.0e-3_wp*tolerance*(2*n + 1)*gamma(2*n + 1.0_wp)**3) exit
      end do
      allocate (ledger%node(n), ledger%weight(n))
      allocate (ledger%mass(series%n_dof), ledger%decay(series%n_dof))
      call gauss_legendre(0.0_wp, 1.0_wp, ledger%node, ledger%weight)
      ledger%mass = structure%lumped_mass()/series%h**2
      call form_matrices(structure, series%h, damping, stiffness)
      do j = 1, series%n_dof
         damping(:, j) = 2.0_wp*ledger%mass*damping(:, j)
         ledger%decay(j) = 0.5_wp*damping(j, j)
         damping(:j, j) = 0.0_wp
      end do
      ledger%damping = sparse_of(damping)
      allocate (ledger%answer(1))
      allocate (ledger%area(width, size(series%loaded)), source=0.0_wp)
   end function new_ledger

   !> Adds the works of all lanes over spans of one part. Answers to transitions are part of the
   !> velocities of their own dofs, the others' are left out: they are below a hundredth of it. The
   !> force's work on an answer is by parts f(1) d(1) - f' times the integral of d. Spans other than
   !> 1 have no answers.
   pure subroutine add_part(self, series, paths, span, work)
      class(ledger_type), intent(inout) :: self
      type(series_type), intent(in) :: series
      type(joint_paths), intent(in) :: paths
      real(wp), intent(in) :: span(width)           !! [parts]
      real(wp), intent(inout) :: work(width, 2)     !! input, viscous
      real(wp) :: added(width)   ! by transitions, to the end of a path
      real(wp), dimension(width) :: power, term
      real(wp) :: push(width, 0:1)   ! h^2 M^-1 b F: value and rise over the span [m]
      integer :: dof, f, i, k

      associate (x => paths%x, layer => paths%layer)
         do i = 1, size(series%loaded)
            dof = series%loaded(i)
            push = 0.0_wp
            do f = 1, size(series%load, 2)
               push = push + series%load(i, f)*paths%force(:, f, :)
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
         call add_viscous(self, series%degree, paths%top, span, x(1, 1, layer(1)), x(1, 1, 2), &
                          work(:, 2))
      end associate
      self%n_answers = 0
      self%area = 0.0_wp
   end subroutine add_part

   !> Adds the work of the dampers. Sums stay in registers, as in dynamics_exact_powers.
   pure subroutine add_viscous(self, degree, top, span, x1, x, work)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree, top
      real(wp), intent(in) :: span(lanes, vectors)
      real(wp), intent(in) :: x1(lanes, vectors, top), x(lanes, vectors, top, 2:degree)
      real(wp), intent(inout) :: work(lanes, vectors)
      real(wp) :: velocity(lanes, vectors, size(self%mass))
      real(wp), dimension(lanes) :: a1, a2, a3, a4
      real(wp), dimension(lanes, vectors) :: t, weight
      integer :: e, g, i, j, k, l

      do g = 1, size(self%node)
         t = self%node(g)*span
         weight = self%weight(g)*span
         do i = 1, size(self%mass)
            do l = 1, lanes
               a1(l) = degree*x(l, 1, i, degree)
               a2(l) = degree*x(l, 2, i, degree)
               a3(l) = degree*x(l, 3, i, degree)
               a4(l) = degree*x(l, 4, i, degree)
            end do
            do k = degree - 1, 2, -1
               do l = 1, lanes
                  a1(l) = a1(l)*t(l, 1) + k*x(l, 1, i, k)
                  a2(l) = a2(l)*t(l, 2) + k*x(l, 2, i, k)
                  a3(l) = a3(l)*t(l, 3) + k*x(l, 3, i, k)
                  a4(l) = a4(l)*t(l, 4) + k*x(l, 4, i, k)
               end do
            end do
            do l = 1, lanes
               velocity(l, 1, i) = a1(l)*t(l, 1) + x1(l, 1, i)
               velocity(l, 2, i) = a2(l)*t(l, 2) + x1(l, 2, i)
               velocity(l, 3, i) = a3(l)*t(l, 3) + x1(l, 3, i)
               velocity(l, 4, i) = a4(l)*t(l, 4) + x1(l, 4, i)
            end do
         end do
         call add_answers(self, degree, self%node(g), velocity)
         do i = 1, size(self%mass)
            do l = 1, lanes
               a1(l) = self%decay(i)*velocity(l, 1, i)
               a2(l) = self%decay(i)*velocity(l, 2, i)
               a3(l) = self%decay(i)*velocity(l, 3, i)
               a4(l) = self%decay(i)*velocity(l, 4, i)
            end do
            do e = self%damping%start(i), self%damping%start(i + 1) - 1
               j = self%damping%column(e)
               do l = 1, lanes
                  a1(l) = a1(l) + self%damping%value(e)*velocity(l, 1, j)
                  a2(l) = a2(l) + self%damping%value(e)*velocity(l, 2, j)
                  a3(l) = a3(l) + self%damping%value(e)*velocity(l, 3, j)
                  a4(l) = a4(l) + self%damping%value(e)*velocity(l, 4, j)
               end do
            end do
            do l = 1, lanes
               work(l, 1) = work(l, 1) + weight(l, 1)*velocity(l, 1, i)*a1(l)
               work(l, 2) = work(l, 2) + weight(l, 2)*velocity(l, 2, i)*a2(l)
               work(l, 3) = work(l, 3) + weight(l, 3)*velocity(l, 3, i)*a3(l)
               work(l, 4) = work(l, 4) + weight(l, 4)*velocity(l, 4, i)*a4(l)
            end do
         end do
      end do
   end subroutine add_viscous

   !> Adds the answers to transitions before t, in the velocities of their dofs.
   pure subroutine add_answers(self, degree, t, velocity)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree
      real(wp), intent(in) :: t
      real(wp), intent(inout) :: velocity(width, size(self%mass))
      real(wp) :: rest
      integer :: e, k

      do e = 1, self%n_answers
         associate (answer => self%answer(e))
            if (answer%time >= t) cycle
            rest = 0.0_wp
            do k = degree, 3, -1
               rest = rest*(t - answer%time) + k*answer%power(k)
            end do
            velocity(answer%lane, answer%row) = velocity(answer%lane, answer%row) &
                                                + rest*(t - answer%time)**2
         end associate
      end do
   end subroutine add_answers

   !> Keeps the answer to a transition for add_part.
   pure subroutine note_answer(self, lane, row, time, power)
      class(ledger_type), intent(inout) :: self
      integer, intent(in) :: lane, row
      real(wp), intent(in) :: time, power(3:)   !! tau; d
      type(answer_type), allocatable :: more(:)

      if (self%n_answers == size(self%answer)) then
         allocate (more(2*self%n_answers))
         more(:self%n_answers) = self%answer
         call move_alloc(more, self%answer)
      end if
      self%n_answers = self%n_answers + 1
      associate (answer => self%answer(self%n_answers))
         answer%lane = lane
         answer%row = row
         answer%time = time
         answer%power = power
      end associate
   end subroutine note_answer

end module dynamics_exact_ledger
