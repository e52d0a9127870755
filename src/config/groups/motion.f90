!> &chain, &structure, &excitation and &integration: the structure, the forces on it and its
!> integration in time.
module config_groups_motion
   use campaign_plan, only: case_type, excitation_settings, integration_settings
   use config_text_value_table, only: entry_type, interval, not_negative, positive, visitor_type
   use core_kinds, only: wp
   use dynamics_exact_march, only: least_tolerance
   use dynamics_newmark_march, only: most_halvings
   use structure_model, only: most_dofs
   implicit none(type, external)
   private
   public :: chain_group, excitation_group, structure_group
   public :: visit_chain, visit_excitation, visit_integration, visit_structure
   public :: fewest_measured

   integer, parameter :: fewest_measured = 64   !! steps after n_discard: two spans of slip_series

   !> The paper's chain (Sec. 3, its values are the defaults). Lists have one value, or one per dof.
   type :: chain_group
      integer :: n_dof = 5
      real(wp), allocatable :: mass(:)
      real(wp), allocatable :: coupling_stiffness(:)
      real(wp), allocatable :: contact_stiffness(:)
      real(wp), allocatable :: normal_load(:)
      real(wp), allocatable :: friction(:)
      real(wp), allocatable :: damping_ratio(:)
   end type chain_group

   !> Structure from files, with paths as written in the scene.
   type :: structure_group
      character(:), allocatable :: mass_matrix
      character(:), allocatable :: stiffness_matrix
      character(:), allocatable :: damping_matrix
      real(wp), allocatable :: rayleigh(:)
      real(wp), allocatable :: damping_ratio(:)
      character(:), allocatable :: joints
      character(:), allocatable :: directions
      character(:), allocatable :: load
   end type structure_group

   !> Forces on the structure, and the lists of levels, each of which makes a case.
   type, extends(excitation_settings) :: excitation_group
      real(wp), allocatable :: variance(:)    !! [N^2]; empty if not given
      real(wp), allocatable :: frequency(:)   !! [Hz]; empty if not given
      real(wp), allocatable :: amplitude(:)   !! [N]; empty if not given
      character(:), allocatable :: psd        !! path of a file; '' if not given
      real(wp), allocatable :: factor(:)      !! factor of a force from a file or spectrum
   contains
      procedure :: levels
      procedure :: level_name
   end type excitation_group

contains

   !> Visits the table of &chain.
   subroutine visit_chain(self, visitor)
      type(chain_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%n_dof, entry_type('n_dof', &
         'number of masses; the first is next to the wall', &
         rule=interval(1.0_wp, real(most_dofs, wp)), &
         default='length of the longest list, else 5'))
      call visitor%visit(self%mass, entry_type('mass', 'one value, or one per dof', 'kg', &
         positive, per_dof=self%n_dof), default=[1.0_wp])
      call visitor%visit(self%coupling_stiffness, entry_type('coupling_stiffness', &
         'springs between the masses; the first one joins the wall', 'N/m', not_negative, &
         per_dof=self%n_dof), default=[25.0_wp])
      call visitor%visit(self%contact_stiffness, entry_type('contact_stiffness', &
         'springs of the Jenkins elements', 'N/m', positive, per_dof=self%n_dof), &
         default=[50.0_wp])
      call visitor%visit(self%normal_load, entry_type('normal_load', &
         'normal loads of the sliders', 'N', not_negative, per_dof=self%n_dof), default=[10.0_wp])
      call visitor%visit(self%friction, entry_type('friction', &
         'friction coefficients of the deterministic cases', rule=not_negative, &
         per_dof=self%n_dof, default='the mean that all &process share'))
      call visitor%visit(self%damping_ratio, entry_type('damping_ratio', &
         'ratio of critical damping of each mode, all joints stuck', rule=not_negative, &
         per_dof=self%n_dof), default=[0.005_wp])
   end subroutine visit_chain

   !> Visits the table of &structure.
   subroutine visit_structure(self, visitor)
      type(structure_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      ! the fingerprint has the values of the matrices, not the names of their files
      call visitor%visit_text(self%mass_matrix, entry_type('mass_matrix', &
         'M as a Matrix Market file, real or integer', 'kg', in_fingerprint=.false.))
      call visitor%visit_text(self%stiffness_matrix, entry_type('stiffness_matrix', &
         'K without the joints, as a Matrix Market file', 'N/m', in_fingerprint=.false.))
      call visitor%visit_text(self%damping_matrix, entry_type('damping_matrix', &
         'C as a Matrix Market file; or give one of the next two', 'N s/m', in_fingerprint=.false.))
      call visitor%visit(self%rayleigh, entry_type('rayleigh', &
         'alpha [1/s], beta [s]: C = alpha M + beta K', rule=not_negative, length=2), &
         default=[0.0_wp, 0.0_wp])
      call visitor%visit(self%damping_ratio, entry_type('damping_ratio', &
         'ratio of critical damping: one value, or one per mode, all joints stuck', &
         rule=not_negative), default=[0.005_wp])
      call visitor%visit_text(self%joints, entry_type('joints', &
         'text file, one joint a line: dof_a dof_b stiffness normal_load friction '// &
         '[friction_point]; dof_b = 0 is the ground', in_fingerprint=.false.))
      call visitor%visit_text(self%directions, entry_type('directions', &
         'W (dofs x joints) as a Matrix Market file; lines of joints then have no dofs', &
         in_fingerprint=.false.))
      call visitor%visit_text(self%load, entry_type('load', &
         'text file of factors, one dof a line, one force a column; '// &
         'none: 1 at excitation%dof, or with base at all dofs', in_fingerprint=.false.))
   end subroutine visit_structure

   !> Visits the table of &excitation.
   subroutine visit_excitation(self, visitor)
      type(excitation_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%kind, entry_type('kind', &
         'Gaussian noise with a flat or given spectrum, sines, or a force history from a file', &
         choices='band_limited psd sine file'))
      call visitor%visit(self%band, entry_type('band', &
         'frequencies of the noise, from and to', 'Hz', not_negative, length=2, &
         is_used=self%kind == 'band_limited'), default=[0.0_wp, 2.5_wp])
      call visitor%visit(self%variance, entry_type('variance', &
         'expected variance of the noise; one or several, each a case', 'N^2', positive))
      call visitor%visit(self%frequency, entry_type('frequency', &
         'frequency of the sine; one or several, each a case', 'Hz', positive, &
         is_used=self%kind == 'sine'))
      call visitor%visit(self%amplitude, entry_type('amplitude', &
         'amplitude of the sine; one or several, each with every frequency', 'N', positive, &
         is_used=self%kind == 'sine'))
      call visitor%visit_text(self%psd, entry_type('psd', &
         'text file with the one-sided spectrum: Hz and N^2/Hz on a line, linear in between', &
         in_fingerprint=.false.))
      call visitor%visit_text(self%file, entry_type('file', &
         'force history: text (force, or time and force) or HDF5, beside the scene '// &
         'or in the current folder', in_fingerprint=.false.))
      call visitor%visit(self%factor, entry_type('factor', &
         'factor of the force (its square multiplies psd); one or several, each a case', &
         rule=positive, is_used=self%kind == 'file' .or. self%kind == 'psd'), default=[1.0_wp])
      call visitor%visit(self%dof, entry_type('dof', 'the forced dof; 0: the last', &
         rule=not_negative))
      call visitor%visit(self%base, entry_type('base', &
         'the force is a ground acceleration [m/s^2], of all dofs alike or of each by load; '// &
         'motion is relative to the ground'))
      call visitor%visit(self%per_sample, entry_type('per_sample', &
         'each sample has its own force record; else only the friction differs'))
   end subroutine visit_excitation

   !> One case of one sample for each force level; for sines the frequency varies fastest.
   pure function levels(self)
      class(excitation_group), intent(in) :: self
      type(case_type), allocatable :: levels(:)
      real(wp), allocatable :: strength(:)
      integer :: i

      select case (self%kind)
      case ('band_limited')
         strength = self%variance
      case ('sine')
         strength = [(spread(self%amplitude(i), 1, size(self%frequency)), &
                      i=1, size(self%amplitude))]
      case default
         strength = self%factor
      end select
      allocate (levels(size(strength)))
      levels%strength = strength
      if (self%kind == 'sine') levels%frequency = [(self%frequency, i=1, size(self%amplitude))]
   end function levels

   !> Name of the value that the force levels differ in.
   pure function level_name(self) result(name)
      class(excitation_group), intent(in) :: self
      character(:), allocatable :: name

      select case (self%kind)
      case ('band_limited')
         name = 'variance'
      case ('sine')
         name = 'amplitude'
      case default
         name = 'factor'
      end select
   end function level_name

   !> Visits the table of &integration.
   subroutine visit_integration(self, visitor)
      type(integration_settings), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      call visitor%visit(self%method, entry_type('method', &
         'newmark: the scheme of Sec. 3; event: the exact march', choices='newmark event'))
      call visitor%visit(self%dt, entry_type('dt', 'time step', 's', positive))
      call visitor%visit(self%n_steps, entry_type('n_steps', &
         'time steps; 0: as many as a force file has', rule=interval(0.0_wp, 2.0e9_wp)))
      call visitor%visit(self%n_discard, entry_type('n_discard', &
         'first steps, left out of all statistics', rule=not_negative))
      call visitor%visit(self%max_halvings, entry_type('max_halvings', &
         'newmark: steps with a transition are halved down to dt/2^max_halvings', &
         rule=interval(0.0_wp, real(most_halvings, wp)), is_used=self%method == 'newmark'))
      call visitor%visit(self%beta, entry_type('beta', "newmark: the scheme's beta", &
         rule=interval(0.0_wp, 0.5_wp), is_used=self%method == 'newmark'))
      call visitor%visit(self%gamma, entry_type('gamma', &
         "newmark: the scheme's gamma; 0.5 adds no damping", rule=interval(0.5_wp, 1.0_wp), &
         is_used=self%method == 'newmark'))
      call visitor%visit(self%tolerance, entry_type('tolerance', &
         'event: error of a displacement relative to its rms', &
         rule=interval(least_tolerance, 1.0_wp), is_used=self%method == 'event'))
   end subroutine visit_integration

end module config_groups_motion
