!> A process in HDF5: its request and solution as a group of the results file, and before that its
!> solution as a file of the store, so that a later run need not fit it again.
module io_process_results
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: wp
   use core_text, only: numbered
   use io_files, only: exists
   use io_hdf5, only: hdf5_file, hdf5_group, new_group, open_hdf5
   use io_store, only: advise, create_in_store, finish_in_store, open_in_store, shard_store
   use process_components, only: component, component_visitor, reset_components, &
                                 visit_components
   use process_model, only: process_model_type, process_request
   use process_reference, only: is_reference, law_name
   implicit none(type, external)
   private
   public :: store_process, process_file_name, read_stored_processes, write_process

   character(*), parameter :: solution = '/solution'   !! group in a file of the store

   !> Writes each component of a process into a group, or reads it from there.
   type, extends(component_visitor) :: group_visitor
      type(hdf5_group) :: group
      logical :: writes = .false.
   contains
      procedure :: visit_table
      procedure :: visit_real, visit_text
   end type group_visitor

contains

   !> Writes the group of a solved process, or of a refused one with the reason.
   subroutine write_process(file, number, model, error, realizations)
      type(hdf5_file), intent(in) :: file
      integer, intent(in) :: number
      type(process_model_type), intent(in) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), contiguous, optional :: realizations(:, :)   !! (point, realization)
      type(hdf5_group) :: group

      group = new_group(file, '/process/'//numbered('p', number))
      call write_request(group, model%request)
      call write_solution(group, model)
      if (present(realizations)) then
         call group%put_axis('point', size(realizations, 1), 'point')
         call group%put_axis('realization', size(realizations, 2), 'realization')
         call group%put('realizations', realizations, 'unit of x', 'realizations of the process', &
                        'realization point')
      end if
      call group%take_error(error)
   end subroutine write_process

   !> Writes the components of the solution.
   subroutine write_solution(group, model)
      type(hdf5_group), intent(inout) :: group
      type(process_model_type), intent(in) :: model
      type(process_model_type) :: copy
      type(group_visitor) :: visitor

      copy = model
      visitor%group = group
      visitor%writes = .true.
      call visit_components(visitor, copy)
      group = visitor%group
   end subroutine write_solution

   !> Reads the components of the solution; the model has its request already.
   subroutine read_solution(file, group, model, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(group_visitor) :: visitor

      visitor%group = hdf5_group(file=file, path=group)
      call reset_components(model)
      call visit_components(visitor, model)
      call visitor%group%take_error(error)
      if (.not. (allocated(error) .or. model%is_solved .or. allocated(model%reason))) &
         call raise(error, exit_file, file%path//': '//group//' does not hold a process')
   end subroutine read_solution

   !> Writes the values of the request that apply to it as attributes.
   subroutine write_request(group, request)
      type(hdf5_group), intent(inout) :: group
      type(process_request), intent(in) :: request

      call group%attribute('law', law_name(request))
      call group%attribute('method', trim(request%method))
      call group%attribute('mean', request%mean)
      call group%attribute('std', request%std)
      if (request%method == 'values') return
      call group%attribute('correlation', trim(request%correlation))
      call group%attribute('correlation_length', request%correlation_length)
      if (request%correlation == 'both') &
         call group%attribute('second_length', request%second_length)
      call group%attribute('positive', request%positive)
      if (is_reference(request)) return
      call group%attribute('order', request%order)
      call group%attribute('sampler', trim(request%sampler))
      if (request%positive) call group%attribute('branch_asked', trim(request%branch))
      if (.not. request%positive) call group%attribute('simulation', trim(request%simulation))
      if (request%order > 0) return
      call group%attribute('bound_l0', merge(request%bounds(1), 0.0_wp, &
                                             request%correlation == 'L1'))
      call group%attribute('bound_l1', merge(request%bounds(1), 0.0_wp, &
                                             request%correlation == 'L0'))
      if (request%bounds(2) > 0.0_wp) call group%attribute('upper_bound', request%bounds(2))
      call group%attribute('bound_side', trim(request%bound_side))
      call group%attribute('max_order', request%max_order)
   end subroutine write_request

   !> Writes or reads a number: a scalar dataset if it has a description, else an attribute.
   subroutine visit_real(self, item, value, error)
      class(group_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), intent(inout) :: value
      real(wp), intent(inout), optional :: error
      character(:), allocatable :: name

      name = trim(item%name)
      if (self%writes) then
         if (item%is_optional .and. .not. abs(value) > 0.0_wp) return
         if (item%is_whole) then
            call self%group%attribute(name, nint(value))
         else if (item%about == '') then
            call self%group%attribute(name, value)
         else
            call self%group%put_value(name, value, trim(item%units), trim(item%about), error)
         end if
      else if (item%about == '') then
         call self%group%read(name, value)
      else
         if (item%is_optional) then
            value = 0.0_wp
            if (.not. self%group%has(name)) return
         end if
         call self%group%read_part(name, [integer ::], value)
         if (present(error)) &
            call self%group%read_part(name//'_error', [integer ::], error)
      end if
   end subroutine visit_real

   !> Writes or reads a text as an attribute.
   subroutine visit_text(self, item, value)
      class(group_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      character(:), allocatable, intent(inout) :: value

      if (self%writes) then
         if (allocated(value)) call self%group%attribute(trim(item%name), value)
      else if (self%group%has_attribute(trim(item%name))) then
         call self%group%read(trim(item%name), value)
      end if
   end subroutine visit_text

   !> Writes or reads a dataset of one axis or two.
   subroutine visit_table(self, item, values)
      class(group_visitor), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), allocatable, intent(inout) :: values(:, :)
      real(wp), allocatable :: row(:)
      character(:), allocatable :: axes
      logical :: is_row

      is_row = item%rows%name == ''
      if (self%writes) then
         if (.not. allocated(values)) return
         call self%group%put_axis(trim(item%axis%name), size(values, 2), trim(item%axis%about), &
                                  item%axis%first)
         if (.not. is_row) call self%group%put_axis(trim(item%rows%name), size(values, 1), &
                                                    trim(item%rows%about), item%rows%first)
         axes = trim(item%axis%name)//' '//item%rows%name
         call self%group%put(trim(item%name), values, trim(item%units), trim(item%about), &
                             trim(axes), trim(merge('integer', 'real   ', item%is_whole)), &
                             pack(shape(values), [.not. is_row, .true.]))
      else if (is_row) then
         call self%group%get(trim(item%name), row)
         if (allocated(row)) values = reshape(row, [1, size(row)])
      else
         call self%group%get(trim(item%name), values)
      end if
   end subroutine visit_table

   !> Writes a process that is solved, or refused with its reason, to a file of the store. It is on
   !> the disk when this returns without error.
   subroutine store_process(store, number, model, error)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number   !! number of the process
      type(process_model_type), intent(in) :: model
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_group) :: group
      type(hdf5_file) :: file

      call create_in_store(store, process_file_name(number), file, error)
      if (allocated(error)) return
      group = new_group(file, solution)
      group%has_fixed_texts = .true.   ! with a checksum; Python need not read this file
      call write_solution(group, model)
      call group%take_error(error)
      call finish_in_store(store, process_file_name(number), file, error)
   end subroutine store_process

   !> Reads the processes that a store or an earlier results file has. Refuses a damaged file of the
   !> store, and one of another scene or program; count_stored_samples has checked the results file.
   subroutine read_stored_processes(store, models, is_kept, error)
      type(shard_store), intent(in) :: store
      type(process_model_type), intent(inout) :: models(:)   !! (process), their requests known
      logical, intent(out) :: is_kept(:)                     !! true if a file has the process
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file, results
      character(:), allocatable :: group
      logical :: has_results
      integer :: i

      is_kept = .false.
      has_results = exists(store%output)
      if (has_results) call open_hdf5(store%output, results, error)
      do i = 1, size(models)
         if (allocated(error)) exit
         group = '/process/'//numbered('p', i)
         is_kept(i) = exists(store%folder//'/'//process_file_name(i))
         if (is_kept(i)) then
            call open_in_store(store, process_file_name(i), file, error)
            if (allocated(error)) exit
            call read_solution(file, solution, models(i), error)
            call file%abandon()
            call advise(error)
         else if (has_results) then
            is_kept(i) = results%has(group)
            if (is_kept(i)) call read_solution(results, group, models(i), error)
         end if
      end do
      call results%abandon()
   end subroutine read_stored_processes

   !> Name of the file of a process in a store, such as process_p003.h5.
   pure function process_file_name(number) result(name)
      integer, intent(in) :: number
      character(:), allocatable :: name

      name = 'process_'//numbered('p', number)//'.h5'
   end function process_file_name

end module io_process_results
