!> A structure with Jenkins joints: M x'' + C x' + K x + sum_j w_j r_j = b F(t).
!>
!> Joint j acts along its direction w_j. A stuck joint is a spring, r_j = k_j (w_j.x - z_j), with
!> its slider at z_j; a slipping one carries r_j = +-mu_j N_j. With all joints stuck, or all
!> slipping, the structure is linear. Friction coefficients mu_j belong to a sample.
module structure_model
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: two_pi, wp
   use core_memory, only: can_allocate
   use core_text, only: brief, to_text
   use numerics_lapack, only: find_symmetric_eigenvectors, multiply, solve_positive_definite, &
                              solve_symmetric_eigenproblem, unit_matrix
   implicit none(type, external)
   private
   public :: build_structure, damping_type, part_names, structure_type
   public :: most_dofs, too_large

   !> Largest n for which a default integer holds LAPACK's workspace of an eigenproblem, 2 n^2 + 6 n
   !> + 1 numbers
   integer, parameter :: most_dofs = 32766
   real(wp), parameter :: least_share = 1.0e-10_wp   !! eigenvalue over the largest that is not zero
   real(wp), parameter :: least_gap = 100.0_wp       !! eigenvalue over that of a zero mode below it
   real(wp), parameter :: rounding = 10.0_wp*epsilon(1.0_wp)   !! of an energy over its terms

   !> One structure. Matrices are full.
   type :: structure_type
      integer :: n_dof = 0, n_joints = 0, n_forces = 0
      integer :: n_points = 0                        !! points of the friction process
      real(wp), allocatable :: mass(:, :)            !! M (dof, dof) [kg]
      real(wp), allocatable :: stiffness(:, :)       !! K without the joints (dof, dof) [N/m]
      real(wp), allocatable :: damping(:, :)         !! C (dof, dof) [N s/m], for all patterns
      real(wp), allocatable :: direction(:, :)       !! w_j (dof, joint)
      real(wp), allocatable :: joint_stiffness(:)    !! k_j (joint) [N/m]
      real(wp), allocatable :: normal_load(:)        !! N_j (joint) [N]
      real(wp), allocatable :: joint_friction(:)     !! mu_j (joint) of deterministic cases
      integer, allocatable :: friction_point(:)      !! (joint) point of the process that gives mu_j
      real(wp), allocatable :: load(:, :)            !! b (dof, force)
      real(wp), allocatable :: damping_ratio(:)      !! (mode); size 0: C is not modal damping
      real(wp) :: fastest_decay = 0.0_wp             !! largest eigenvalue of M^-1 C [1/s]
      integer :: n_zero_modes = 0                    !! rigid motions with all joints stuck
      real(wp) :: dropped_frequency = 0.0_wp         !! of zero modes, by what K has in them [Hz]
      real(wp), allocatable :: frequencies_stuck(:)  !! (mode) [Hz], ascending
      real(wp), allocatable :: modes_stuck(:, :)     !! Phi (dof, mode), Phi' M Phi = 1
      real(wp), allocatable :: frequencies_slip(:)   !! (mode) [Hz], ascending; negative: unstable
   contains
      procedure :: has_lumped_mass
      procedure :: lumped_mass
      procedure :: stuck_stiffness
   end type structure_type

   !> Damping of a structure: the matrix if there is one, else alpha M + beta K if alpha or beta is
   !> not zero, else a damping ratio of every mode with all joints stuck.
   type :: damping_type
      real(wp), allocatable :: matrix(:, :)      !! C (dof, dof) [N s/m]
      real(wp) :: rayleigh(2) = 0.0_wp           !! alpha [1/s], beta [s]
      real(wp), allocatable :: ratio(:)          !! fraction of critical, of all modes or (mode)
   end type damping_type

   !> Names of a structure's parts in messages: their files, or values of the scene.
   type :: part_names
      character(:), allocatable :: mass, stiffness, damping
   end type part_names

contains

   !> Message of a structure that is too large for the memory, eight (dof, dof) and eight (dof,
   !> joint) matrices; '' if it fits.
   function too_large(n_dof, n_joints) result(text)
      integer, intent(in) :: n_dof, n_joints
      character(:), allocatable :: text

      text = ''
      associate (bytes => 64.0_wp*n_dof*(real(n_dof, wp) + n_joints))
         if (.not. can_allocate(bytes)) &
            text = 'its matrices take '//to_text(nint(bytes/1.0e6_wp))//' MB, which the system '// &
                   'does not give: reduce the model (python -m entroslip.structure import --modes)'
      end associate
   end function too_large

   !> Completes a structure whose M, K, joints, directions and load are given: finds frequencies and
   !> modes, and forms C. Refuses an M that is not positive definite, a K that buckles with all
   !> joints stuck, and a C that feeds energy. Does not check sizes, symmetry and joints.
   subroutine build_structure(damping, names, structure, error)
      type(damping_type), intent(in) :: damping
      type(part_names), intent(in) :: names
      type(structure_type), intent(inout) :: structure
      type(error_type), allocatable, intent(out) :: error

      structure%n_dof = size(structure%mass, 1)
      structure%n_joints = size(structure%joint_stiffness)
      structure%n_forces = size(structure%load, 2)
      structure%n_points = maxval(structure%friction_point)
      if (is_singular(structure%mass)) then
         call raise(error, exit_bad_input, names%mass//': a mass matrix must be positive definite')
         return
      end if
      call find_modes(.false., names%stiffness, structure, structure%frequencies_slip, error)
      if (allocated(error)) return
      call find_modes(.true., names%stiffness, structure, structure%frequencies_stuck, error)
      if (allocated(error)) return
      call form_damping(damping, names%damping, structure, error)
   end subroutine build_structure

   !> True if M is not positive definite, or only by rounding: if for a dof 1/(M_ii (M^-1)_ii), the
   !> share of its mass that does not move with other dofs, is below n epsilon.
   logical function is_singular(mass)
      real(wp), intent(in) :: mass(:, :)
      type(error_type), allocatable :: error
      real(wp), allocatable :: factor(:, :), inverse(:, :)
      integer :: i, n

      n = size(mass, 1)
      allocate (factor, source=mass)
      allocate (inverse, source=unit_matrix(n))
      call solve_positive_definite(factor, inverse, error)
      is_singular = allocated(error)
      if (.not. is_singular) &
         is_singular = any([(n*epsilon(1.0_wp)*mass(i, i)*inverse(i, i) > 1.0_wp, i=1, n)])
   end function is_singular

   !> Forms C from the damping that is given.
   subroutine form_damping(damping, name, structure, error)
      type(damping_type), intent(in) :: damping
      character(*), intent(in) :: name
      type(structure_type), intent(inout) :: structure
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: decay(:)

      allocate (structure%damping_ratio(0))
      if (allocated(damping%matrix)) then
         call solve_symmetric_eigenproblem(damping%matrix, structure%mass, decay, error)
         if (allocated(error)) return
         if (decay(1) < -least_share*maxval(abs(decay))) &
            call raise(error, exit_bad_input, name//': a damping matrix must not feed energy: '// &
                       'its least eigenvalue over M is '//brief(decay(1))//' 1/s')
         structure%damping = damping%matrix
         structure%fastest_decay = maxval(decay)
      else if (any(abs(damping%rayleigh) > 0.0_wp)) then
         if (any(damping%rayleigh < 0.0_wp)) &
            call raise(error, exit_bad_input, name//': rayleigh must be zero or positive')
         structure%damping = damping%rayleigh(1)*structure%mass + &
                             damping%rayleigh(2)*structure%stiffness
         structure%fastest_decay = damping%rayleigh(1) + damping%rayleigh(2) &
                                   *(two_pi*maxval(structure%frequencies_slip))**2
      else if (all(size(damping%ratio) /= [1, structure%n_dof])) then
         call raise(error, exit_bad_input, name//': must be one value, or one for each of the '// &
                    to_text(structure%n_dof)//' modes')
      else if (any(damping%ratio < 0.0_wp)) then
         call raise(error, exit_bad_input, name//': must be zero or positive')
      else
         structure%damping_ratio = damping%ratio
         if (size(damping%ratio) == 1) &
            structure%damping_ratio = spread(damping%ratio(1), 1, structure%n_dof)
         structure%damping = modal_damping(structure%mass, structure%modes_stuck, &
                                           structure%damping_ratio, structure%frequencies_stuck)
         structure%fastest_decay = 2.0_wp*two_pi*maxval(structure%frequencies_stuck &
                                                        *structure%damping_ratio)
      end if
   end subroutine form_damping

   !> True if M is diagonal.
   pure logical function has_lumped_mass(self)
      class(structure_type), intent(in) :: self

      has_lumped_mass = count(abs(self%mass) > 0.0_wp) == self%n_dof   ! its diagonal is positive
   end function has_lumped_mass

   !> Diagonal of M (dof) [kg].
   pure function lumped_mass(self) result(mass)
      class(structure_type), intent(in) :: self
      real(wp) :: mass(self%n_dof)
      integer :: i

      mass = [(self%mass(i, i), i=1, self%n_dof)]
   end function lumped_mass

   !> Stiffness with a pattern of stuck joints, K + sum k_j w_j w_j' over these (dof, dof) [N/m].
   pure function stuck_stiffness(self, is_stuck) result(k)
      class(structure_type), intent(in) :: self
      logical, intent(in) :: is_stuck(:)   !! (joint)
      real(wp) :: k(self%n_dof, self%n_dof)
      integer :: i, j

      k = self%stiffness
      do j = 1, self%n_joints
         if (.not. is_stuck(j)) cycle
         do i = 1, self%n_dof
            if (self%direction(i, j) == 0.0_wp) cycle
            k(:, i) = k(:, i) + self%joint_stiffness(j)*self%direction(i, j)*self%direction(:, j)
         end do
      end do
   end function stuck_stiffness

   !> Finds natural frequencies [Hz], ascending, negative for negative eigenvalues, with all joints
   !> stuck or all slipping, and the number of zero modes. With all stuck also finds
   !> mass-normalized modes, and refuses a negative eigenvalue.
   subroutine find_modes(are_stuck, name, structure, frequencies, error)
      logical, intent(in) :: are_stuck
      character(*), intent(in) :: name   !! name of K in messages
      type(structure_type), intent(inout) :: structure
      real(wp), allocatable, intent(out) :: frequencies(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: eigenvalues(:), modes(:, :), stiffness(:, :)
      integer :: j
      logical :: needs_modes

      needs_modes = are_stuck
      stiffness = structure%stuck_stiffness([(are_stuck, j=1, structure%n_joints)])
      if (.not. needs_modes) then
         call solve_symmetric_eigenproblem(stiffness, structure%mass, eigenvalues, error)
         if (allocated(error)) return
         needs_modes = minval(abs(eigenvalues)) <= least_share*maxval(abs(eigenvalues))
      end if
      if (needs_modes) then
         call solve_symmetric_eigenproblem(stiffness, structure%mass, eigenvalues, error, modes)
         if (allocated(error)) return
         if (are_stuck) call refine_modes(structure, eigenvalues, modes, error)
         if (allocated(error)) return
         call find_low_modes(are_stuck, name, structure, eigenvalues, modes, error)
         if (allocated(error)) return
         if (are_stuck .and. minval(eigenvalues) < 0.0_wp) then
            call raise(error, exit_bad_input, name//': with all joints stuck, the least '// &
                       'eigenvalue over M is '//brief(minval(eigenvalues))//' 1/s^2: must not '// &
                       'be negative, the structure would buckle')
            return
         end if
      end if
      allocate (frequencies, source=sign(sqrt(abs(eigenvalues)), eigenvalues)/two_pi)
      if (are_stuck) call move_alloc(modes, structure%modes_stuck)
   end subroutine find_modes

   !> Finds again the modes whose eigenvalues are below 1e-4 of the largest, as all have its
   !> rounding: from the energies of K and of the joints among these modes (Rayleigh-Ritz). Then
   !> those below 1e-4 of the largest of these, and so on.
   subroutine refine_modes(structure, eigenvalues, modes, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(inout), contiguous :: eigenvalues(:)   !! (mode), ascending
      real(wp), intent(inout), contiguous :: modes(:, :)      !! (dof, mode)
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: share = 1.0e-4_wp
      real(wp), allocatable, dimension(:, :) :: energy, extension, mass, pushed, vectors
      real(wp), allocatable :: refined(:)
      integer :: last, m

      last = size(eigenvalues)
      do
         m = count(abs(eigenvalues(:last)) <= share*eigenvalues(last))
         if (m == 0 .or. m == last) return
         associate (low => modes(:, :m))
            allocate (pushed, mold=low)
            allocate (energy(m, m), mass(m, m))
            call multiply(structure%mass, low, pushed)
            call multiply(low, pushed, mass, transposes_a=.true.)
            call multiply(structure%stiffness, low, pushed)
            call multiply(low, pushed, energy, transposes_a=.true.)
            extension = extensions(structure, low)
            energy = energy + matmul(transpose(extension), extension)
            call solve_symmetric_eigenproblem(energy, mass, refined, error, vectors)
            if (allocated(error)) return
            eigenvalues(:m) = refined
            call multiply(low, vectors, pushed)
            low = pushed
         end associate
         deallocate (energy, mass, pushed)
         last = m
      end do
   end subroutine refine_modes

   !> Finds eigenvalues below 1e-10 of the largest, which have few correct digits, and their modes,
   !> from the energies among these modes (Rayleigh-Ritz): first of K, which are zero below the
   !> rounding of their terms, then of K and the joints.
   !>
   !> An energy e of K below 1e-10 of its terms, and 1/100 of the next eigenvalue (low modes of a
   !> fine mesh are nearer to each other), may come from rounded entries. The mode is a zero mode if
   !> joints do not hold it. If they hold it by less, or e matters to a mode near rounding, K is
   !> refused. As rounding mixes e/a of the mode of the next eigenvalue a into a zero mode, joints
   !> hold a mode if their energy in it exceeds e^2/a.
   subroutine find_low_modes(are_stuck, name, structure, eigenvalues, modes, error)
      logical, intent(in) :: are_stuck
      character(*), intent(in) :: name                !! name of K in the message
      type(structure_type), intent(inout) :: structure
      real(wp), intent(inout) :: eigenvalues(:)       !! (mode), ascending
      real(wp), intent(inout) :: modes(:, :)          !! (dof, mode)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: extension(:, :), vectors(:, :)   ! (joint, mode), (mode, mode)
      real(wp), allocatable, dimension(:) :: of_joints, of_k, terms   ! (mode)
      real(wp) :: above, largest, outside
      integer :: first, i, last

      structure%n_zero_modes = 0
      structure%dropped_frequency = 0.0_wp
      largest = maxval(abs(eigenvalues))
      first = 1 + count(eigenvalues < -least_share*largest)
      last = first - 1 + count(abs(eigenvalues) <= least_share*largest)
      if (last < first) return
      outside = huge(1.0_wp)
      if (last < size(eigenvalues)) outside = eigenvalues(last + 1)
      above = outside
      associate (low => modes(:, first:last), eigenvalue => eigenvalues(first:last), &
                 k => structure%stiffness)
         of_k = eigenvalue
         vectors = matmul(transpose(low), matmul(k, low))
         call find_symmetric_eigenvectors(vectors, of_k, error)
         if (allocated(error)) return
         low = matmul(low, vectors)
         where (abs(of_k) <= rounding*sum(abs(low)*matmul(abs(k), abs(low)), 1)) of_k = 0.0_wp
         extension = extensions(structure, low)
         if (.not. are_stuck) extension = 0.0_wp
         vectors = matmul(transpose(extension), extension)
         do i = 1, size(of_k)
            vectors(i, i) = vectors(i, i) + of_k(i)
         end do
         call find_symmetric_eigenvectors(vectors, eigenvalue, error)
         if (allocated(error)) return
         low = matmul(low, vectors)
         of_k = matmul(of_k, vectors**2)
         of_joints = sum(matmul(extension, vectors)**2, 1)
         terms = sum(abs(low)*matmul(abs(k), abs(low)), 1)
         eigenvalue = of_k + of_joints
         do i = size(of_k), 1, -1
            associate (e => abs(of_k(i)))
               if (e <= least_share*terms(i) .and. (structure%n_zero_modes > 0 .or. &
                                                    above > least_gap*of_k(i))) then
                  if (of_joints(i) <= (rounding*largest + 10.0_wp*e)**2/outside) then
                     eigenvalue(i) = 0.0_wp
                     structure%n_zero_modes = structure%n_zero_modes + 1
                     structure%dropped_frequency = max(structure%dropped_frequency, sqrt(e)/two_pi)
                  else if (of_joints(i) <= e .or. e > 0.01_wp*of_joints(i) .and. &
                           eigenvalue(i) <= 10.0_wp*rounding*terms(i)) then
                     call raise(error, exit_bad_input, name//': with all joints stuck, joints '// &
                                'hold a mode by '//brief(of_joints(i))//' 1/s^2 and K by '// &
                                brief(of_k(i))//', which may be rounding of its entries: give '// &
                                'K with more digits')
                     return
                  end if
               end if
            end associate
            above = eigenvalue(i)
         end do
      end associate
   end subroutine find_low_modes

   !> Extensions of the joints in modes, times the roots of their stiffness: the squares add up to
   !> the energy of the joints.
   pure function extensions(structure, modes) result(extension)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: modes(:, :)         !! (dof, mode)
      real(wp), allocatable :: extension(:, :)    !! (joint, mode)

      extension = matmul(transpose(structure%direction), modes) &
                  *spread(sqrt(structure%joint_stiffness), 2, size(modes, 2))
   end function extensions

   !> Modal damping C = M Phi diag(2 zeta omega) Phi' M (dof, dof) [N s/m].
   function modal_damping(mass, modes, ratio, frequencies) result(damping)
      real(wp), intent(in), contiguous :: mass(:, :), modes(:, :)   !! (dof, dof) [kg]; (dof, mode)
      real(wp), intent(in) :: ratio(:), frequencies(:)     !! zeta (mode), (mode) [Hz]
      real(wp), allocatable :: damping(:, :)
      real(wp), allocatable :: momentum(:, :)   ! sqrt(2 zeta omega) Phi' M (mode, dof)
      integer :: r

      allocate (momentum, damping, mold=mass)
      call multiply(modes, mass, momentum, transposes_a=.true.)
      do r = 1, size(ratio)
         momentum(r, :) = sqrt(2.0_wp*ratio(r)*two_pi*frequencies(r))*momentum(r, :)
      end do
      call multiply(momentum, momentum, damping, transposes_a=.true.)
      damping = 0.5_wp*(damping + transpose(damping))
   end function modal_damping

end module structure_model
