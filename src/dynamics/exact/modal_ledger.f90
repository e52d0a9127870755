!> Work of the forces and of the dampers over a part of a step, in modes (M9).
!>
!> Both are exact for the motion of the blocks. The dampers take the integral of N(y') minus the
!> growth of v'v, N(y) = q'C^q + 2 q'q'. The integral is a quadratic form for each block, in p' at
!> the start and the forces. Numbers in brackets are formulas of docs/modal_march.md.
module dynamics_exact_modal_ledger
   use core_kinds, only: wp
   use dynamics_exact_modal_blocks, only: modal_blocks
   use dynamics_exact_modal_terms, only: lanes
   use dynamics_exact_transitions, only: integral
   use numerics_lapack, only: unit_matrix
   implicit none(type, external)
   private
   public :: modal_ledger

   integer, parameter :: most_items = 12   !! items of a block with two ports and I_0 .. I_4

   !> Work is in J. The items of a block are p' at the start, then of each port the uniform motion
   !> S I_0 plus the rise of the force, and S I_k - S I_0/(k + 1)!, k = 1 .. n, what the moments
   !> differ from those of a uniform motion (M9).
   type :: modal_ledger
      logical :: is_ready = .false.
      integer, private :: ports = 1
      !> (item, force, 0:1, block) factors of the integrals of X' and of t X', X where a force acts
      real(wp), allocatable, private :: motion(:, :, :, :)
      !> (1:2, pair) pairs of blocks: each with itself and then with those that N couples it with;
      !> (item of the first, item of the second, pair) the form, doubled except for the diagonal of
      !> a block with itself
      integer, allocatable, private :: pair(:, :)
      real(wp), allocatable, private :: form(:, :, :)
   contains
      procedure :: prepare
      procedure :: add_part
   end type modal_ledger

contains

   !> Prepares the forms of all blocks, and of the pairs of blocks that N couples.
   pure subroutine prepare(self, h, damping, load, blocks, fit)
      class(modal_ledger), intent(inout) :: self
      real(wp), intent(in) :: h                 !! length of a part [s]
      real(wp), intent(in) :: damping(:, :)     !! C^ (mode, mode)
      real(wp), intent(in) :: load(:, :)        !! (mode, force) h^2 Phi' b
      type(modal_blocks), intent(in) :: blocks
      real(wp), intent(in) :: fit(0:, 0:)       !! see kernel_fit of modal_operators
      real(wp), parameter :: negligible = 1.0e-10_wp   !! coupling of two blocks over v'v
      real(wp) :: metric(2*size(damping, 1), 2*size(damping, 1))
      real(wp) :: largest(2*size(damping, 1))   ! state variable, for (q, q') of norm 1
      real(wp), allocatable :: form(:, :), motion(:, :), outputs(:, :)
      integer :: b, c, i, n, n_modes

      n_modes = size(damping, 1)
      self%is_ready = .true.
      self%ports = blocks%ports
      outputs = transpose(blocks%outputs(transpose(load), .false.))   ! (row, force)
      metric = blocks%metric(damping)
      largest = norm2(blocks%inverse, 2)
      n = 2 + blocks%ports*size(fit, 1)
      allocate (self%pair(2, 0), self%form(n, n, 0), self%motion(n, size(load, 2), 0:1, n_modes))
      do b = 1, n_modes
         do c = b, n_modes
            associate (of_b => [2*b - 1, 2*b], of_c => [2*c - 1, 2*c])
               if (c > b .and. maxval(abs(metric(of_b, of_c)))*maxval(largest(of_b)) &
                   *maxval(largest(of_c)) <= negligible) cycle
            end associate
            call find_form(blocks, metric, [(i, i=b, c, max(1, c - b))], fit, form, motion)
            self%pair = reshape([self%pair, b, c], [2, size(self%pair, 2) + 1])
            self%form = reshape([self%form, 2.0_wp*form], [n, n, size(self%pair, 2)])
            if (c > b) cycle
            do i = 1, n
               self%form(i, i, size(self%form, 3)) = form(i, i)
            end do
            associate (ports => outputs(self%ports*(b - 1) + 1:self%ports*b, :), &
                       rise => motion(:, :self%ports), area => motion(:, 3:2 + self%ports))
               self%motion(:, :, 0, b) = matmul(rise, ports)
               self%motion(:, :, 1, b) = matmul(rise - area, ports)   ! by parts
            end associate
         end do
      end do
      self%form = self%form/h**2   ! [1/part^2] to [1/s^2]
      self%motion = self%motion/h**2
   end subroutine prepare

   !> Finds the form of one or two blocks: the integral W of exp(A't) N exp(At) over a part, by its
   !> series over 2^-s of the part and s doublings W(2t) = W(t) + exp(A't) W(t) exp(At). The state
   !> has p' of each block, p'' = A p' + B f', the derivatives of the polynomial f with the moments,
   !> and of the first block P' = p' and R' = P.
   pure subroutine find_form(blocks, metric, chosen, fit, form, motion)
      type(modal_blocks), intent(in) :: blocks
      real(wp), intent(in) :: metric(:, :)     !! N
      integer, intent(in) :: chosen(:)
      real(wp), intent(in) :: fit(0:, 0:)      !! see prepare
      real(wp), allocatable, intent(out) :: form(:, :)   !! (item of the first, of the last block)
      real(wp), allocatable, intent(out) :: motion(:, :)   !! P, R (item of the first block, 1:4)
      integer, parameter :: n_terms = 16       !! 0.25^16/16! = 1e-23
      real(wp), allocatable, dimension(:, :) :: a, change, moments, q, term, w
      real(wp) :: t
      integer :: b, d, i, k, m, n, n_doublings, p

      n = 2 + blocks%ports*size(fit, 1)
      m = n*size(chosen)
      allocate (a(m + 4, m + 4), q(m + 4, m + 4), w(m + 4, m + 4), moments(n, n), source=0.0_wp)
      do b = 1, size(chosen)
         associate (first => n*(b - 1))
            a(first + 1:first + 2, first + 1:first + 2) = blocks%block(:, :, chosen(b))
            do i = first + 3 - blocks%ports, first + n - blocks%ports   ! f' drives the ports
               a(i, i + blocks%ports) = 1.0_wp
            end do
         end associate
      end do
      do i = 1, 2
         a(m + i, i) = 1.0_wp
         a(m + 2 + i, m + i) = 1.0_wp
         moments(i, i) = 1.0_wp
      end do
      associate (rates => [(n*(b - 1) + 1, n*(b - 1) + 2, b=1, size(chosen))], &
                 of_blocks => [(2*chosen(b) - 1, 2*chosen(b), b=1, size(chosen))])
         q(rates, rates) = metric(of_blocks, of_blocks)
      end associate
      do i = 3, 2 + blocks%ports
         moments(i, i) = 1.0_wp
      end do
      do k = 1, ubound(fit, 1)   ! f'(t) = sum I_k fit(k, p) (-p) (1 - t)^(p - 1)
         do d = 0, ubound(fit, 1)
            do i = 3, 2 + blocks%ports
               moments(i + blocks%ports*d, i + blocks%ports*k) = &
                  (-1)**(d + 1)*sum([(fit(k, p)*gamma(p + 1.0_wp)/gamma(real(p - d, wp)), &
                                      p=d + 1, ubound(fit, 2))])
            end do
         end do
      end do
      n_doublings = max(0, exponent(4.0_wp*maxval(sum(abs(a), 2))))
      t = 0.5_wp**n_doublings
      allocate (term, change, source=unit_matrix(m + 4))
      do k = 1, n_terms
         q = q*(t/k)
         w = w + q
         q = matmul(q, a)
         q = q + transpose(q)
         term = matmul(a, term)*(t/k)
         change = change + term
      end do
      do k = 1, n_doublings
         w = w + matmul(transpose(change), matmul(w, change))
         change = matmul(change, change)
      end do
      form = matmul(transpose(moments), matmul(w(:n, m - n + 1:m), moments))
      motion = transpose(matmul(change(m + 1:, :n), moments))
   end subroutine find_form

   !> Adds the work of a group of lanes over the part, without the growth of v'v (M9).
   pure subroutine add_part(self, rows, load, force, slider_moments, rates, work)
      class(modal_ledger), intent(in) :: self
      integer, intent(in) :: rows
      real(wp), intent(in) :: load(:, :)                         !! h^2 Phi' b (row, force)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: slider_moments(lanes, rows, 0:*)   !! S I
      real(wp), intent(in) :: rates(lanes, 2, *)     !! p' at the start
      real(wp), intent(inout) :: work(lanes, 2)      !! input, viscous
      real(wp), dimension(lanes, most_items) :: first, second   ! a constant extent aligns them
      real(wp), dimension(lanes) :: done, lost
      integer :: b, e, f, k, n

      n = size(self%motion, 1)
      done = 0.0_wp
      lost = 0.0_wp
      do e = 1, size(self%pair, 2)
         b = self%pair(1, e)
         if (self%pair(2, e) == b) then
            call find_items(b, first)
            call add_form(n, .true., self%form(:, :, e), first, first, lost)
            do k = 0, 1
               do f = 1, size(load, 2)
                  call add_input(n, self%motion(:, f, k, b), first, force(:, f, k), done)
               end do
            end do
         else
            call find_items(self%pair(2, e), second)
            call add_form(n, .false., self%form(:, :, e), first, second, lost)
         end if
      end do
      work(:, 1) = work(:, 1) + done
      work(:, 2) = work(:, 2) + lost

   contains

      !> Finds the items of a block.
      pure subroutine find_items(block, items)
         integer, intent(in) :: block
         real(wp), intent(inout) :: items(lanes, n)
         real(wp) :: rise(lanes)
         integer :: column, f, k, row

         items(:, :2) = rates(:, :, block)
         do row = self%ports*(block - 1) + 1, self%ports*block
            rise = 0.0_wp
            do f = 1, size(load, 2)
               rise = rise + load(row, f)*force(:, f, 1)
            end do
            column = 2 + row - self%ports*(block - 1)
            items(:, column) = slider_moments(:, row, 0) + rise
            do k = 1, (n - 2)/self%ports - 1
               items(:, column + self%ports*k) = slider_moments(:, row, k) &
                                                 - integral(1, k)*slider_moments(:, row, 0)
            end do
         end do
      end subroutine find_items

   end subroutine add_part

   !> Adds the form of two blocks; of one with itself, only its upper triangle counts.
   pure subroutine add_form(n, is_own, form, first, second, total)
      integer, intent(in) :: n
      logical, intent(in) :: is_own
      real(wp), intent(in) :: form(n, n), first(lanes, n), second(lanes, n)
      real(wp), intent(inout) :: total(lanes)
      real(wp), dimension(lanes) :: column, all
      integer :: i, k

      all = 0.0_wp
      do k = 1, n
         column = 0.0_wp
         do i = 1, merge(k, n, is_own)
            column = column + form(i, k)*first(:, i)
         end do
         all = all + column*second(:, k)
      end do
      total = total + all
   end subroutine add_form

   !> Adds a force times the sum of items times factors.
   pure subroutine add_input(n, factor, item, force, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor(n), item(lanes, n), force(lanes)
      real(wp), intent(inout) :: total(lanes)
      real(wp) :: share(lanes)
      integer :: i

      share = 0.0_wp
      do i = 1, n
         share = share + factor(i)*item(:, i)
      end do
      total = total + force*share
   end subroutine add_input

end module dynamics_exact_modal_ledger
