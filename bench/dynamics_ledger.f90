!> Error and cost of the energy ledger of the exact march over 100,000 steps, at tolerances of 1e-6,
!> where transitions are local, and of 1e-10, where they are not. The error is relative to the work
!> done. 32 samples of the paper's chain.
!> Run: build/release/bin/bench_dynamics_ledger
program bench_dynamics_ledger
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use structure_chain, only: build_chain
   use structure_model, only: structure_type
   use dynamics_exact_march, only: exact_march, new_exact_march
   use dynamics_excitation, only: noise_force
   use dynamics_joint, only: count_open_slips
   use dynamics_response, only: block_state, start_block, stored_energy
   implicit none(type, external)
   integer, parameter :: n_steps = 100000, n_samples = 32, n_dof = 5
   real(wp), parameter :: dt = 0.00843_wp, variances(2) = [3.7_wp, 41.1_wp]
   real(wp), parameter :: tolerances(2) = [1.0e-6_wp, 1.0e-10_wp]
   type(structure_type) :: chain
   type(exact_march) :: marcher
   type(stream_type) :: stream
   type(error_type), allocatable :: error
   real(wp) :: friction(n_dof, n_samples), normal(n_dof*n_samples), nanoseconds, with_ledger, defect
   real(wp), allocatable :: record(:), force(:, :)
   integer :: i, k

   call build_chain(spread(1.0_wp, 1, n_dof), spread(25.0_wp, 1, n_dof), &
                    spread(50.0_wp, 1, n_dof), &
                    spread(10.0_wp, 1, n_dof), spread(0.005_wp, 1, n_dof), chain, error)
   call stop_on_error()
   allocate (record(0:n_steps), force(0:n_steps, 1))
   stream = new_stream(2016_long, label_of('bench'), 0)
   call stream%normals(normal)
   friction = max(0.01_wp, 0.2_wp + 0.067_wp*reshape(normal, shape(friction)))
   call noise_force([0.0_wp, 2.5_wp], dt, stream, record)
   print '(a)', '# tolerance variance  defect_over_work  ns_with_ledger  ns_without  ratio'
   do k = 1, size(tolerances)
      call new_exact_march(chain, dt, tolerances(k), marcher, error)
      call stop_on_error()
      do i = 1, size(variances)
         force(:, 1) = sqrt(variances(i))*record
         call time_march(.false., nanoseconds, defect)
         call time_march(.true., with_ledger, defect)
         print '(es11.0, f9.1, es18.1, f16.1, f12.1, f7.2)', tolerances(k), variances(i), defect, &
            with_ledger, nanoseconds, with_ledger/nanoseconds
      end do
   end do

contains

   !> Finds the CPU time per sample-step, and the largest defect of the samples where a ledger is
   !> kept.
   subroutine time_march(keeps_ledger, nanoseconds, defect)
      logical, intent(in) :: keeps_ledger
      real(wp), intent(out) :: nanoseconds   !! [ns]
      real(wp), intent(out) :: defect        !! relative to the work of damping and friction
      integer, parameter :: piece = 1000
      type(block_state) :: state
      real(wp) :: begin, end, nothing(0, n_dof, n_samples), work(n_samples)
      integer :: step

      state%keeps_ledger = keeps_ledger
      call start_block(chain, friction, state)
      call cpu_time(begin)
      do step = 0, n_steps - piece, piece
         call marcher%advance(state, force(step:step + piece, :), piece + 1, nothing, error=error)
         call stop_on_error()
      end do
      call cpu_time(end)
      nanoseconds = 1.0e9_wp*(end - begin)/(real(n_steps, wp)*n_samples)
      defect = 0.0_wp
      if (.not. keeps_ledger) return
      call count_open_slips(chain, state%step*marcher%dt, state)
      work = state%work_viscous + sum(state%slip_limit*state%account%slip_distance, 1)
      defect = maxval(abs(state%work_input - work - stored_energy(chain, state))/work)
   end subroutine time_march

   subroutine stop_on_error()
      if (allocated(error)) error stop error%message
   end subroutine stop_on_error

end program bench_dynamics_ledger
