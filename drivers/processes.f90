!> Solves the processes of a scene on all ranks.
module driver_processes
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_text, only: counted, to_text
   use driver_deadline, only: time_to_stop
   use driver_output, only: output_type
   use io_process_results, only: store_process, read_stored_processes
   use io_progress, only: inform, progress_type
   use numerics_sorting, only: sort_order
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: world_type
   use process_components, only: component, component_visitor, reset_components, visit_components
   use process_direct_constraint, only: constraint_of
   use process_direct_fit, only: check_by_inversion, count_search_parts
   use process_direct_sign_search, only: restore_search, search_all_signs, sign_search_result
   use process_fit, only: fit_from_sign_search, fit_process
   use process_model, only: process_model_type, process_request
   use process_scaling, only: scale_to_request, first_of_fit, scaled_request
   implicit none(type, external)
   private
   public :: solve_processes

   !> Broadcasts each component of a model from the rank that has it.
   type, extends(component_visitor) :: broadcast_visitor
      type(world_type) :: world
      integer :: source = 0   !! rank that has the model
   contains
      procedure :: visit_table => broadcast_table
   end type broadcast_visitor

contains

   !> Solves all processes; all ranks get all models. Processes that differ only in scale share a
   !> fit. Ranks fit different processes; a long search over signs is divided among all ranks. With
   !> an output, loads the processes that it holds and stores each new one at once. After a request
   !> to stop or an error the remaining processes stay unsolved, without a reason. Collective.
   subroutine solve_processes(world, plan, models, output, error, wanted)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(process_model_type), allocatable, intent(out) :: models(:)
      type(output_type), intent(in), optional :: output
      type(error_type), allocatable, intent(out), optional :: error   !! with an output
      logical, intent(in), optional :: wanted(:)   !! (process); absent: all are
      type(process_request) :: requests(size(plan%processes))   ! scaled to mean 1, or to std 1
      type(process_model_type) :: fit
      type(work_counter) :: counter
      type(progress_type) :: progress
      type(broadcast_visitor) :: visitor
      integer, dimension(size(plan%processes)) :: first, n_parts, owner
      integer, allocatable :: fits(:)   ! processes to be fitted; others scale their models
      integer :: i, item
      logical :: is_missing(size(plan%processes))
      type(error_type), allocatable :: failure

      allocate (models(size(plan%processes)))
      if (size(models) == 0) return
      do i = 1, size(models)
         models(i)%request = plan%processes(i)
         requests(i) = scaled_request(plan%processes(i))
         n_parts(i) = count_search_parts(requests(i))
      end do
      first = first_of_fit(plan%processes)
      owner = -1
      if (present(output)) call load_processes(output, models, owner, failure)
      is_missing = owner < 0
      if (present(wanted)) is_missing = is_missing .and. wanted
      ! the longest fits first: those of high order, then those near the limit of std/mean
      fits = sort_order(-(requests%order + requests%std))
      fits = pack(fits, [(any(is_missing .and. first == fits(i)), i=1, size(fits))])
      call new_counter(world, size(fits), counter)
      if (size(fits) > 0) call progress%start(size(fits), 0, 'processes')
      do
         item = counter%next(stops=time_to_stop() .or. allocated(failure))
         if (item == 0) exit
         call progress%show(max(0, item - world%n_ranks))
         if (n_parts(fits(item)) > 1) cycle
         call solve(requests(fits(item)), plan%seed, fit)
         call keep_models(world, plan, fit, is_missing .and. first == fits(item), models, owner, &
                          failure, output)
      end do
      call counter%close()
      call progress%finish()
      do i = 1, size(fits)
         if (n_parts(fits(i)) == 1) cycle
         call search_together(world, requests(fits(i)), n_parts(fits(i)), allocated(failure), &
                              fit)
         if (fit%is_solved .or. allocated(fit%reason)) &
            call keep_models(world, plan, fit, is_missing .and. first == fits(i), models, owner, &
                             failure, output)
      end do
      visitor%world = world
      do i = 1, size(models)
         visitor%source = world%maximum(owner(i))
         if (visitor%source < 0) cycle
         if (visitor%source /= world%rank) call reset_components(models(i))
         call visit_components(visitor, models(i))
      end do
      if (present(error)) call move_alloc(failure, error)
   end subroutine solve_processes

   !> Scales a fitted model to every process that shares the fit, and stores the models.
   subroutine keep_models(world, plan, fit, shares_fit, models, owner, error, output)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: fit
      logical, intent(in) :: shares_fit(:)   !! (process)
      type(process_model_type), intent(inout) :: models(:)
      integer, intent(inout) :: owner(:)     !! (process) rank that has the model, else -1
      type(error_type), allocatable, intent(inout) :: error
      type(output_type), intent(in), optional :: output
      integer :: i

      do i = 1, size(models)
         if (.not. shares_fit(i)) cycle
         models(i) = fit
         call scale_to_request(plan%processes(i), models(i))
         owner(i) = world%rank
         if (present(output) .and. .not. allocated(error)) &
            call store_process(output%store, i, models(i), error)
      end do
   end subroutine keep_models

   !> Reads the processes that an earlier run has stored, on the root. Collective.
   subroutine load_processes(output, models, owner, error)
      type(output_type), intent(in) :: output
      type(process_model_type), intent(inout) :: models(:)
      integer, intent(inout) :: owner(:)   !! (process) 0, the root, if it is loaded
      type(error_type), allocatable, intent(out) :: error
      integer, allocatable :: known(:)
      logical :: is_kept(size(models))

      if (output%world%is_root()) then
         call read_stored_processes(output%store, models, is_kept, error)
         if (any(is_kept) .and. .not. allocated(error)) &
            call inform('continuing: '//to_text(count(is_kept))//' of '// &
                            counted(size(is_kept), 'process is', 'processes are')//' there')
         known = merge(0, owner, is_kept)
      end if
      call output%world%broadcast(known)
      owner = known
   end subroutine load_processes

   !> Fits a process, and checks it by the paper's inversion if that is requested.
   subroutine solve(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      real(wp) :: finish, start

      call cpu_time(start)
      call fit_process(request, seed, model)
      call cpu_time(finish)
      model%seconds = finish - start
      call check_inversion(model)
   end subroutine solve

   !> Solves all sequences of signs of a process in parts that the ranks share; the root selects the
   !> best solution unless parts are missing. Collective.
   subroutine search_together(world, request, n_parts, stops, model)
      type(world_type), intent(in) :: world
      type(process_request), intent(in) :: request
      integer, intent(in) :: n_parts
      logical, intent(in) :: stops   !! true if this rank has an error: no part is begun
      type(process_model_type), intent(out) :: model
      type(sign_search_result) :: search          ! parts of this rank
      type(work_counter) :: counter
      type(progress_type) :: progress
      real(wp), allocatable :: numbers(:)    ! numbers of the sequences that are solutions
      real(wp) :: finish, start, sums(3)
      integer :: part

      allocate (search%solutions(0))   ! a rank may get no part
      call new_counter(world, n_parts, counter)
      call progress%start(n_parts, 0, 'parts of a process')
      do
         part = counter%next(stops=time_to_stop() .or. stops)
         if (part == 0) exit
         call progress%show(max(0, part - world%n_ranks))
         call cpu_time(start)
         call search_all_signs(constraint_of(request), part, n_parts, search)
         call cpu_time(finish)
         search%seconds = search%seconds + finish - start
      end do
      call counter%close()
      call progress%finish()
      sums = [real(wp) :: search%n_examined, search%n_consistent, search%seconds]
      numbers = real(search%solutions%number, wp)
      call world%add_up(size(sums), sums)
      call world%join(numbers)
      if (.not. world%is_root()) return
      call restore_search(constraint_of(request), sums, numbers, search)
      call fit_from_sign_search(request, search, model)
      model%seconds = search%seconds
      call check_inversion(model)
   end subroutine search_together

   !> Compares a model with the paper's inversion of a finite matrix (Eq. 35), if that is requested.
   subroutine check_inversion(model)
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable :: error
      real(wp) :: finish, start

      associate (half_width => model%request%inversion_half_width)
         if (half_width == 0 .or. .not. model%is_solved) return
         call cpu_time(start)
         call check_by_inversion(model, half_width, model%inversion, error)
         call cpu_time(finish)
      end associate
      if (allocated(error)) model%inversion%error = huge(1.0_wp)   ! the matrix is singular
      model%inversion%seconds = finish - start
      model%inversion%seconds_of_fit = model%seconds
   end subroutine check_inversion

   !> Broadcasts one component. All ranks visit the components in the same order.
   subroutine broadcast_table(self, item, values)
      class(broadcast_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), allocatable, intent(inout) :: values(:, :)

      associate (unused => item)
      end associate
      call self%world%broadcast(values, self%source)
   end subroutine broadcast_table

end module driver_processes
