!> Power series of the free motion of a structure with diagonal mass over one part of a step.
!>
!> Time t runs from 0 to 1 over the part. Displacements are x_0 + x_1 t + ... + x_P t^P with
!> (k + 1)(k + 2) x_(k+2) = f_k - (k + 1) C^ x_(k+1) - K^ x_k, C^ = h M^-1 C, K^ = h^2 M^-1 K, where
!> K has the springs of all stuck joints. The higher the power, the fewer entries of C^ are kept:
!> those far from the diagonal affect low powers only (2). Numbers in brackets are the formulas of
!> docs/exact_march.md.
module dynamics_exact_series
   use core_kinds, only: two_pi, wp
   use dynamics_exact_powers, only: add_power, power_operator
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: series_type, new_series
   public :: fastest_rate, form_matrices, longest_part, most_degree, without_diagonal

   integer, parameter :: most_degree = 24
   real(wp), parameter :: longest_part = 1.0_wp   !! fastest rate times h, at most (4)
   real(wp), parameter :: memory = 2000.0_wp      !! N: steps until the error of a step decays (1)

   !> Rows are the dofs, then the links: directions w of joints that do not hold one dof to the
   !> ground. The path of a link is w.x.
   type :: series_type
      integer :: n_dof = 0, n_links = 0, n_rows = 0
      integer :: degree = 0
      real(wp) :: h = 0.0_wp                            !! [s]
      real(wp) :: rate = 0.0_wp                         !! fastest rate times h
      type(power_operator) :: powers                    !! 2 .. P
      real(wp), allocatable :: diagonal(:)              !! (row) K^_ii; 0 for a link
      type(sparse_matrix) :: links                      !! w (link, dof)
      real(wp), allocatable :: mobility(:)              !! (entry of links) w_i/m_i [1/kg]
      integer, allocatable :: row(:)                    !! (joint) row of its path
      real(wp), allocatable :: spring(:)                !! (joint) h^2 k/m on a dof, h^2 k on a link
      integer, allocatable :: loaded(:)                 !! dofs with a load
      real(wp), allocatable :: load(:, :)               !! h^2 M^-1 b (dof, force) [m/N]
   contains
      procedure :: work
   end type series_type

contains

   !> Multiplications of one sample in one part without transitions (11).
   pure real(wp) function work(self)
      class(series_type), intent(in) :: self
      integer :: k

      work = 3.5_wp*self%degree*self%n_rows + (self%degree - 1.0_wp)* &   ! guards; diagonal, links
             (2*self%n_dof + 2*size(self%links%value))
      do k = 1, size(self%powers%factors)
         work = work + count(abs(self%powers%factors(k)%value) > 0.0_wp)
      end do
   end function work

   !> Prepares the series for a step of equal parts.
   subroutine new_series(structure, dt, parts, tolerance, series)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      integer, intent(in) :: parts        !! parts of a step
      real(wp), intent(in) :: tolerance   !! relative to the rms displacement
      type(series_type), intent(out) :: series
      real(wp) :: error          ! error e of one part (1)
      real(wp) :: motion, load   ! x_(k+1) over x_1 in free motion; over x_2 of a load from rest
      real(wp), allocatable :: damping(:, :), stiffness(:, :)   ! C^, K^ without joints
      real(wp), allocatable :: share(:, :)   ! |C^_ij| times motion of dof j over that of dof i
      integer :: k

      series%n_dof = structure%n_dof
      series%h = dt/parts
      series%loaded = pack([(k, k=1, structure%n_dof)], any(abs(structure%load) > 0.0_wp, 2))
      series%load = series%h**2*structure%load/spread(structure%lumped_mass(), 2, &
                                                      structure%n_forces)
      call form_matrices(structure, series%h, damping, stiffness)
      call find_rows(structure, series)
      series%diagonal(:structure%n_dof) = [(stiffness(k, k), k=1, structure%n_dof)]
      stiffness = without_diagonal(stiffness)
      series%rate = series%h*fastest_rate(structure)
      error = tolerance/(parts*memory*max(structure%n_dof, 5))
      series%degree = degree_for(series%rate, min(error, 0.25_wp*tolerance*series%rate**3))
      allocate (share, source=abs(damping))   ! an assignment would read undefined bounds
      call weigh_by_motion(structure, dt, share)
      motion = 1.0_wp
      load = 1.0_wp
      do k = 0, series%degree - 2
         if (k > 0) motion = motion*series%rate/(k + 1)
         if (k == 2) load = load/3.0_wp
         if (k > 2) load = load*series%rate/(k + 1)
         call add_power(series%powers, k, series%degree, series%n_rows, stiffness, &
                        merge(damping, 0.0_wp, share*motion > 2.5_wp*error .or. &
                              share*load > 0.1_wp*tolerance), series%load)
      end do
   end subroutine new_series

   !> Upper bound of |lambda| over the modes of every pattern of stuck joints [rad/s]: |lambda|^2 <=
   !> c |lambda| + omega^2 with the largest eigenvalues c of M^-1 C and omega^2 of M^-1 K with all
   !> joints stuck. A slipping joint only takes stiffness away.
   pure function fastest_rate(structure) result(rate)
      type(structure_type), intent(in) :: structure
      real(wp) :: rate

      associate (half_c => 0.5_wp*structure%fastest_decay)
         rate = half_c + sqrt(half_c**2 + (two_pi*maxval(structure%frequencies_stuck))**2)
      end associate
   end function fastest_rate

   !> Lowest degree P whose error in one part is not above a bound, (1) or (1a).
   pure function degree_for(rate, most) result(degree)
      real(wp), intent(in) :: rate   !! fastest rate times h, at most about 1
      real(wp), intent(in) :: most   !! bound of rate^(P + 1)/(P + 1)!
      integer :: degree
      integer, parameter :: least_degree = 6
      real(wp) :: error

      error = rate
      do degree = 1, most_degree - 1
         error = error*rate/(degree + 1)
         if (degree >= least_degree .and. error <= most) return
      end do
      degree = most_degree
   end function degree_for

   !> Multiplies entries (i, j) by the motion of dof j over that of dof i, if that is above 1. A dof
   !> moves less than the dof that drives it by the spring between them over its own dynamic
   !> stiffness under the fastest force (2).
   pure subroutine weigh_by_motion(structure, dt, entries)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt   !! [s]
      real(wp), intent(inout) :: entries(:, :)
      real(wp), parameter :: least = 1.0e-30_wp
      real(wp), parameter :: steps_of_period = 20.0_wp   ! period of the fastest force in steps (2)
      real(wp), dimension(structure%n_dof) :: mass, motion, moved_before
      real(wp) :: stuck(structure%n_dof, structure%n_dof)   ! K with all joints stuck [N/m]
      real(wp) :: stiffness(structure%n_dof)   ! dynamic, under the fastest force [N/m]
      type(sparse_matrix) :: springs
      real(wp) :: fastest   ! omega_f^2 [rad^2/s^2]
      integer :: e, i, j

      stuck = structure%stuck_stiffness([(.true., j=1, structure%n_joints)])
      springs = sparse_of(without_diagonal(stuck))
      mass = structure%lumped_mass()
      fastest = (two_pi/(steps_of_period*dt))**2
      stiffness = [(stuck(i, i), i=1, structure%n_dof)] - mass*fastest
      motion = maxval(abs(structure%load), 2)/max(stiffness, mass*fastest)
      motion = max(least, motion/max(tiny(least), maxval(motion)))
      do
         moved_before = motion
         do i = 1, structure%n_dof
            do e = springs%start(i), springs%start(i + 1) - 1
               associate (spring => abs(springs%value(e)))
                  motion(i) = max(motion(i), motion(springs%column(e)) &
                                  *spring/max(spring, stiffness(i)))
               end associate
            end do
         end do
         if (all(motion <= moved_before)) exit
      end do
      do j = 1, structure%n_dof
         entries(:, j) = entries(:, j)*max(1.0_wp, motion(j)/motion)
      end do
   end subroutine weigh_by_motion

   !> Forms C^ = h M^-1 C and K^ = h^2 M^-1 K, K without joints.
   pure subroutine form_matrices(structure, h, damping, stiffness)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: h   !! [s]
      real(wp), allocatable, intent(out) :: damping(:, :), stiffness(:, :)   !! (dof, dof)
      real(wp) :: mass(structure%n_dof)
      integer :: j

      mass = structure%lumped_mass()
      allocate (damping, stiffness, mold=structure%damping)
      do j = 1, structure%n_dof
         damping(:, j) = h*structure%damping(:, j)/mass
         stiffness(:, j) = h**2*structure%stiffness(:, j)/mass
      end do
   end subroutine form_matrices

   !> A square matrix with zeros on its diagonal.
   pure function without_diagonal(matrix) result(rest)
      real(wp), intent(in) :: matrix(:, :)   !! (row, column)
      real(wp) :: rest(size(matrix, 1), size(matrix, 2))
      integer :: i

      rest = matrix
      do i = 1, size(matrix, 1)
         rest(i, i) = 0.0_wp
      end do
   end function without_diagonal

   !> Finds the row of each joint: that of a dof for a joint that holds it to the ground, else that
   !> of a link, one for each direction.
   pure subroutine find_rows(structure, series)
      type(structure_type), intent(in) :: structure
      type(series_type), intent(inout) :: series
      integer :: first_joint(structure%n_joints)   ! (link) first joint of its direction
      real(wp) :: mass(structure%n_dof)
      integer :: i, j, k

      allocate (series%row(structure%n_joints))
      do j = 1, structure%n_joints
         associate (w => structure%direction(:, j))
            i = findloc(abs(w) > 0.0_wp, .true., 1)
            if (count(abs(w) > 0.0_wp) == 1 .and. abs(w(i) - 1.0_wp) <= 0.0_wp) then
               series%row(j) = i
               cycle
            end if
            do k = 1, series%n_links
               if (all(abs(w - structure%direction(:, first_joint(k))) <= 0.0_wp)) exit
            end do
            first_joint(k) = j
            series%n_links = max(k, series%n_links)
            series%row(j) = series%n_dof + k
         end associate
      end do
      series%n_rows = series%n_dof + series%n_links
      mass = structure%lumped_mass()
      series%links = sparse_of(reshape([(structure%direction(:, first_joint(k)), &
                                         k=1, series%n_links)], &
                                       [series%n_links, series%n_dof], order=[2, 1]))
      allocate (series%mobility, source=series%links%value/mass(series%links%column))
      allocate (series%spring, source=series%h**2*structure%joint_stiffness)
      do j = 1, structure%n_joints
         i = series%row(j)
         if (i <= series%n_dof) series%spring(j) = series%spring(j)/mass(i)
      end do
      allocate (series%diagonal(series%n_rows), source=0.0_wp)
   end subroutine find_rows

end module dynamics_exact_series
