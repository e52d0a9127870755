!> Work of the force and of the dampers over a piece of motion, from the power series of its paths.
!>
!> Stored energy changes by input - viscous - friction. The joints' share needs no integral: a joint
!> that slips takes mu N times its way (dynamics_joint).
module dynamics_exact_ledger
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, local_answers, width
   use dynamics_exact_series, only: most_degree, series_type
   use dynamics_exact_transitions, only: transition_group
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
      real(wp), allocatable :: damping(:, :)   ! twice M C^/h^2 = C/h
      integer :: j, n

      do n = 2, most - 1
         if ((2.0_wp*series%rate)**(2*n)*gamma(n + 1.0_wp)**4 <= &
             1.0e-3_wp*tolerance*(2*n + 1)*gamma(2*n + 1.0_wp)**3) exit
      end do
      allocate (ledger%node(n), ledger%weight(n))
      allocate (ledger%mass(series%n_dof), ledger%decay(series%n_dof))
      call gauss_legendre(0.0_wp, 1.0_wp, ledger%node, ledger%weight)
      ledger%mass = structure%lumped_mass()/series%h**2
      allocate (damping, source=2.0_wp/series%h*structure%damping)
      do j = 1, series%n_dof
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
         call add_viscous(self, series%degree, paths%top, span, x(1, 1, layer(1)), x(1, 1, 2), &
                          work(:, 2))
      end associate
      self%n_answers = 0
      self%area = 0.0_wp
   end subroutine add_part

   !> Adds the work of the dampers, eight lanes at a time, so that sums stay in registers.
   pure subroutine add_viscous(self, degree, top, span, x1, x, work)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree, top
      real(wp), intent(in) :: span(lanes, vectors)
      real(wp), intent(in) :: x1(lanes, vectors, top), x(lanes, vectors, top, 2:degree)
      real(wp), intent(inout) :: work(lanes, vectors)
      real(wp) :: velocity(lanes, size(self%mass))
      real(wp), dimension(lanes) :: total, t
      integer :: e, g, i, k, l, v

      do v = 1, vectors
         do g = 1, size(self%node)
            t = self%node(g)*span(:, v)
            do i = 1, size(self%mass)
               do l = 1, lanes
                  total(l) = degree*x(l, v, i, degree)
               end do
               do k = degree - 1, 2, -1
                  do l = 1, lanes
                     total(l) = total(l)*t(l) + k*x(l, v, i, k)
                  end do
               end do
               do l = 1, lanes
                  velocity(l, i) = total(l)*t(l) + x1(l, v, i)
               end do
            end do
            call add_answers(self, degree, self%node(g), lanes*(v - 1), velocity)
            do i = 1, size(self%mass)
               do l = 1, lanes
                  total(l) = self%decay(i)*velocity(l, i)
               end do
               do e = self%damping%start(i), self%damping%start(i + 1) - 1
                  do l = 1, lanes
                     total(l) = total(l) + self%damping%value(e)*velocity(l, self%damping%column(e))
                  end do
               end do
               do l = 1, lanes
                  work(l, v) = work(l, v) + self%weight(g)*span(l, v)*velocity(l, i)*total(l)
               end do
            end do
         end do
      end do
   end subroutine add_viscous

   !> Adds the answers to transitions before t, in the velocities of their dofs.
   pure subroutine add_answers(self, degree, t, before, velocity)
      class(ledger_type), intent(in) :: self
      integer, intent(in) :: degree
      integer, intent(in) :: before   !! lanes before those of velocity
      real(wp), intent(in) :: t
      real(wp), intent(inout) :: velocity(lanes, size(self%mass))
      real(wp) :: rest
      integer :: e, k, l

      do e = 1, self%n_answers
         associate (answer => self%answer(e))
            l = answer%lane - before
            if (answer%time >= t .or. l < 1 .or. l > lanes) cycle
            rest = 0.0_wp
            do k = degree, 3, -1
               rest = rest*(t - answer%time) + k*answer%power(k)
            end do
            velocity(l, answer%row) = velocity(l, answer%row) + rest*(t - answer%time)**2
         end associate
      end do
   end subroutine add_answers

   !> Keeps a transition for add_part: the answer of its dof, and the integrals of the answers of
   !> loaded dofs, which are the next of the sums (7).
   pure subroutine note_answer(self, loaded, answers, group, entry)
      class(ledger_type), intent(inout) :: self
      integer, intent(in) :: loaded(:)   !! dofs
      type(local_answers), intent(in) :: answers
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      integer :: e, i

      if (self%n_answers == size(self%answer)) self%answer = [self%answer, self%answer]
      self%n_answers = self%n_answers + 1
      associate (l => group%lane(entry), row => group%row(entry), area => self%area)
         self%answer(self%n_answers) = answer_type(l, row, group%time(entry), &
                                                   group%answer(entry, :))
         do i = 1, size(loaded)
            if (loaded(i) == row) area(l, i) = area(l, i) + group%ends(entry, 3)
            do e = answers%first(row), answers%first(row + 1) - 1
               if (answers%dof(e) /= loaded(i)) cycle
               area(l, i) = area(l, i) + (answers%value(1, e)*group%ends(entry, 5) &
                                          + answers%value(2, e)*group%ends(entry, 7))
            end do
         end do
      end associate
   end subroutine note_answer

end module dynamics_exact_ledger
