!> Work of the force and of the dampers over a part of a step, in modes.
!>
!> Where the sliders move uniformly, by what they move in the part, the dampers' work is an exact
!> quadratic form of the velocities and accelerations at the start and of the rise of what acts.
!> The rest of the sliders' motion adds a t^2 + b t^3 to velocities. Numbers in brackets are
!> formulas of docs/exact_march.md.
module dynamics_exact_modal_ledger
   use core_kinds, only: wp
   use dynamics_exact_modal_blocks, only: modal_blocks
   use dynamics_exact_modal_sliders, only: groups, lanes
   use numerics_dense_product, only: pack_matrix, packed_matrix, padded_rows
   use numerics_lapack, only: multiply
   implicit none(type, external)
   private
   public :: modal_ledger

   integer, parameter :: n_blocks = 12

   !> Works are in J.
   type :: modal_ledger
      logical :: is_ready = .false.
      real(wp), private :: scale = 0.0_wp                !! 1/h^2 [1/s^2]
      real(wp), allocatable, private :: block(:, :, :)   !! A (2, 2, block)
      real(wp), allocatable, private :: load(:, :)       !! (row, force) h^2 Phi' b
      real(wp), allocatable, private :: reads(:, :)      !! (row, force) X, where a force acts
      !> (row, v g a or p' g, force) integral of X - X(0)
      real(wp), allocatable, private :: area(:, :, :)
      real(wp), allocatable, private :: half(:, :)       !! (entry, row) p' at 1/2
      !> With one port, (mode) C^_rr and (entry, mode) the form (M9): vv, va, aa, vg, ag, gg
      real(wp), allocatable, private :: decay(:), loss(:, :)
      !> With two, C^ and the form, block of rows by block, on and above its diagonal
      type(packed_matrix), private :: damping, form(n_blocks)
      integer, private :: block_rows = 0
      !> (lane, force, group) X(0) and (.., power, group) forces of the part under way
      real(wp), allocatable, private :: place(:, :, :), force(:, :, :, :)
   contains
      procedure :: prepare
      procedure :: start_part
      procedure :: add_part
   end type modal_ledger

contains

   !> Prepares the quadratic forms of all modes, each by itself where C^ is diagonal.
   subroutine prepare(self, h, rate, damping, load, blocks, half)
      class(modal_ledger), intent(inout) :: self
      real(wp), intent(in) :: h                            !! of a part [s]
      real(wp), intent(in) :: rate(:), damping(:, :)       !! Omega (mode), C^ (mode, mode)
      real(wp), intent(in) :: load(:, :)                   !! (mode, force) h^2 Phi' b
      type(modal_blocks), intent(in) :: blocks
      real(wp), intent(in) :: half(:, :)                   !! see modal_operators
      real(wp), allocatable :: area(:, :), w(:, :)
      integer :: n, n_forces, r

      n = size(rate)
      n_forces = size(load, 2)
      self%is_ready = .true.
      self%scale = 1.0_wp/h**2
      self%block = blocks%block
      self%load = blocks%pushes(load)
      self%reads = transpose(blocks%reads(transpose(load)))
      self%half = half
      allocate (self%place(lanes, n_forces, groups), self%force(lanes, n_forces, 0:1, groups))
      if (blocks%ports == 2) then
         call find_loss(rate, damping, load, w, area)
         call put_form(self, n, blocks%state, w, area)
         call pack_matrix(matmul(transpose(blocks%state(:n, :)), blocks%reads(damping)), &
                          self%damping)
         return
      end if
      self%decay = [(damping(r, r), r=1, n)]
      allocate (self%loss(6, n), self%area(n, 3, n_forces))
      do r = 1, n
         call find_loss(rate(r:r), damping(r:r, r:r), reshape([1.0_wp], [1, 1]), w, area)
         self%loss(:, r) = [w(1, 1), 2.0_wp*w(1, 2), w(2, 2), 2.0_wp*w(1, 3), 2.0_wp*w(2, 3), &
                            w(3, 3)]
         self%area(r, :, :) = matmul(area([1, 3, 2], :), load(r:r, :))
      end do
   end subroutine prepare

   !> Puts the form and the areas for two ports: (v, a) = V p', and the second half of V gives g.
   subroutine put_form(self, n, state, w, area)
      type(modal_ledger), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: state(:, :)   !! V (q q', number)
      real(wp), intent(in) :: w(:, :)       !! (v a g, v a g)
      real(wp), intent(in) :: area(:, :)    !! (v a g, force)
      real(wp), allocatable :: all(:, :), form(:, :)
      integer :: first, i, last, rows

      rows = padded_rows(2*n)
      allocate (all(3*n, 2*rows), source=0.0_wp)
      all(:2*n, :2*n) = state
      all(2*n + 1:, rows + 1:rows + 2*n) = state(n + 1:, :)
      form = matmul(transpose(all), matmul(w, all))
      self%area = reshape(matmul(transpose(all), area), [rows, 2, size(area, 2)])
      self%block_rows = padded_rows((2*rows + n_blocks - 1)/n_blocks)
      do i = 1, n_blocks
         first = min((i - 1)*self%block_rows, 2*rows)
         last = min(i*self%block_rows, 2*rows)
         call pack_matrix(2.0_wp*form(first + 1:last, first + 1:), self%form(i))
         self%form(i)%value(:, :last - first, :) = 0.5_wp*self%form(i)%value(:, :last - first, :)
      end do
   end subroutine put_form

   !> Finds W = integral of exp(A't) Q exp(A t) over a part, by its power series over 2^-s of it,
   !> doubled: W(2t) = W(t) + exp(A't) W(t) exp(A t). With y = (v, a, g, P, R): v' = a, a' = g - C^
   !> a - Omega^2 v, P' = load' v, R' = P, so that R is the area of X - X(0).
   subroutine find_loss(rate, damping, load, w, area)
      real(wp), intent(in) :: rate(:), damping(:, :), load(:, :)
      real(wp), allocatable, intent(out) :: w(:, :)      !! (v a g, v a g)
      real(wp), allocatable, intent(out) :: area(:, :)   !! (v a g, force)
      integer, parameter :: n_terms = 16                 !! 0.25^16/16! = 1e-23
      real(wp), allocatable, dimension(:, :) :: a, change, more, q, term
      real(wp) :: t
      integer :: f, i, k, m, n, n_doublings

      n = size(rate)
      m = 3*n + 2*size(load, 2)
      allocate (a(m, m), q(m, m), term(m, m), w(m, m), source=0.0_wp)
      allocate (more(m, m))
      do i = 1, n
         a(i, n + i) = 1.0_wp
         a(n + i, i) = -rate(i)**2
         a(n + i, n + 1:2*n) = -damping(i, :)
         a(n + i, 2*n + i) = 1.0_wp
      end do
      do f = 1, size(load, 2)
         a(3*n + f, :n) = load(:, f)
         a(m - size(load, 2) + f, 3*n + f) = 1.0_wp
      end do
      n_doublings = max(0, exponent(4.0_wp*maxval(sum(abs(a), 2))))
      t = 0.5_wp**n_doublings
      q(:n, :n) = damping
      do i = 1, m
         term(i, i) = 1.0_wp
      end do
      change = term
      do k = 1, n_terms
         q = q*(t/k)
         w = w + q
         call multiply(q, a, more)
         q = more + transpose(more)
         call multiply(a, term, more)
         term = more*(t/k)
         change = change + term
      end do
      do k = 1, n_doublings
         call multiply(w, change, q)
         call multiply(change, q, more, .true.)
         w = w + 0.5_wp*(more + transpose(more))
         q = change
         call multiply(q, q, change)
      end do
      w = w(:3*n, :3*n)
      area = transpose(change(m - size(load, 2) + 1:, :3*n))
   end subroutine find_loss

   !> Keeps rates and displacements at the start of a part, and the rates of the free motion at its
   !> half.
   pure subroutine start_part(self, g, rows, force, now, pushed, y)
      class(modal_ledger), intent(inout) :: self
      integer, intent(in) :: g, rows                     !! group of lanes
      real(wp), intent(in) :: force(lanes, size(self%load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: now(lanes, rows, 2)        !! p, p'
      real(wp), intent(in) :: pushed(lanes, rows)        !! S z
      real(wp), intent(inout) :: y(lanes, rows, 5)       !! v, g, a or p', g; room; p' at 1/2
      real(wp) :: push(lanes, 2)   ! of both numbers of a block: of one port the first has none
      integer :: f, i, port, ports, r, row

      ports = size(self%half, 1)/2 - 1
      self%force(:, :, :, g) = force
      self%place(:, :, g) = 0.0_wp
      push = 0.0_wp
      do r = 1, size(self%load, 1), ports
         do row = r, r + ports - 1
            i = row - r + 3 - ports
            push(:, i) = pushed(:, row)
            y(:, row, 2) = 0.0_wp
            do f = 1, size(self%load, 2)
               push(:, i) = push(:, i) + self%load(row, f)*force(:, f, 0)
               y(:, row, 2) = y(:, row, 2) + self%load(row, f)*force(:, f, 1)
               self%place(:, f, g) = self%place(:, f, g) + self%reads(row, f)*now(:, row, 1)
            end do
         end do
         associate (a => self%block(:, :, 1 + (r - 1)/ports), first => now(:, r, 1), &
                    second => now(:, r + ports - 1, 3 - ports), last => r + ports - 1)
            y(:, r, 1) = (push(:, 1) + a(1, 1)*first) + a(1, 2)*second
            y(:, last, 5 - 2*ports) = (push(:, 2) + a(2, 1)*first) + a(2, 2)*second
            do row = r, last
               y(:, row, 5) = self%half(1, row)*first + self%half(2, row)*second
               do port = 1, ports
                  y(:, row, 5) = y(:, row, 5) &
                                 + (self%half(2 + port, row)*push(:, 2 + port - ports) &
                                    + self%half(2 + ports + port, row)*y(:, r + port - 1, 2))
               end do
            end do
         end associate
      end do
   end subroutine start_part

   !> Adds the works of a group over the part: input, of all forces, is by parts F(1) X(1) - F(0)
   !> X(0) - F' times the integral of X. The rest of the sliders' motion adds a t^2 + b t^3 to v
   !> (M9).
   pure subroutine add_part(self, g, rows, now, turned, rest, y, work)
      class(modal_ledger), intent(in) :: self
      integer, intent(in) :: g, rows
      real(wp), intent(in) :: now(lanes, rows, 2)    !! p, p' at the end
      real(wp), intent(in) :: turned(lanes, rows)    !! S zeta(1)
      real(wp), intent(in) :: rest(lanes, rows, 2)   !! p, p' at the end by the rest
      !> See start_part; the free motion has taken a quarter of its p' at 1 from the last
      real(wp), intent(inout) :: y(lanes, rows, 5)
      real(wp), intent(inout) :: work(lanes, 2)      !! input, viscous
      real(wp), dimension(lanes) :: area, half, place, uniform   ! half, uniform: p' at 1/2 and 1
      real(wp) :: c(6)
      integer :: f, n, r

      n = size(self%load, 1)
      y(:, :n, 2) = y(:, :n, 2) + turned(:, :n)
      do f = 1, size(self%load, 2)
         area = self%place(:, f, g)
         place = 0.0_wp
         do r = 1, n
            place = place + self%reads(r, f)*now(:, r, 1)
            area = area + self%reads(r, f)*(0.4_wp*rest(:, r, 1) - 0.05_wp*rest(:, r, 2))
            area = area + (self%area(r, 1, f)*y(:, r, 1) + self%area(r, 2, f)*y(:, r, 2))
            if (size(self%area, 2) == 3) area = area + self%area(r, 3, f)*y(:, r, 3)
         end do
         associate (before => self%force(:, f, 0, g), rise => self%force(:, f, 1, g))
            work(:, 1) = work(:, 1) + self%scale*((before + rise)*place &
                                                  - before*self%place(:, f, g) - rise*area)
         end associate
      end do
      if (allocated(self%decay)) then
         do r = 1, n
            c = self%scale*self%loss(:, r)
            associate (v => y(:, r, 1), g => y(:, r, 2), a => y(:, r, 3))
               work(:, 2) = work(:, 2) + (v*(c(1)*v + c(2)*a + c(4)*g) + a*(c(3)*a + c(5)*g) &
                                          + c(6)*g**2)
            end associate
            y(:, r, 3) = self%decay(r)*rest(:, r, 1)
            y(:, r, 4) = self%decay(r)*rest(:, r, 2)
         end do
      else
         call add_form(self, 2*rows, y, y(:, :, 4), work(:, 2))
         call self%damping%multiply(rest(:, :, 1), y(:, :, 3))
         call self%damping%multiply(rest(:, :, 2), y(:, :, 4))
      end if
      do r = 1, n
         associate (q => rest(:, r, 1), v => rest(:, r, 2))
            uniform = now(:, r, 2) - v
            half = y(:, r, 5) + 0.25_wp*uniform
            work(:, 2) = work(:, 2) + self%scale* &
                         (y(:, r, 3)*((1.6_wp*half + 0.4_wp*uniform) + (48.0_wp/35.0_wp)*q) &
                          + y(:, r, 4)*((5.0_wp*uniform - 4.0_wp*half - y(:, r, 1))/30.0_wp &
                                        + (3.0_wp*v - 4.0_wp*q)/35.0_wp))
         end associate
      end do
   end subroutine add_part

   !> Adds the dampers' work in uniform motion, y' W y, where damping couples the modes.
   pure subroutine add_form(self, rows, y, product, work)
      class(modal_ledger), intent(in) :: self
      integer, intent(in) :: rows
      real(wp), intent(in) :: y(lanes, rows)
      real(wp), intent(inout) :: product(lanes, self%block_rows)   !! room
      real(wp), intent(inout) :: work(lanes)
      integer :: b, first, r

      do b = 1, n_blocks
         first = (b - 1)*self%block_rows
         if (first >= rows) exit
         call self%form(b)%multiply(y(1, first + 1), product)
         do r = 1, min(self%block_rows, rows - first)
            work = work + self%scale*(y(:, first + r)*product(:, r))
         end do
      end do
   end subroutine add_form

end module dynamics_exact_modal_ledger
