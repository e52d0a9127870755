!> How far the friction of a long contact scatters when its coefficient varies along it.
!>
!> Twenty Jenkins elements side by side are pushed by the same displacement. Of their friction
!> coefficients only mean, standard deviation and correlation length are known, and that they are
!> positive: the process of largest entropy gives the rest.
program friction_of_a_contact
   use core_kinds, only: long, wp
   use core_random, only: new_stream, stream_type
   use process_fit, only: fit_process
   use process_model, only: process_model_type, process_request, request_label
   use process_realization, only: draw_points
   implicit none(type, external)
   integer, parameter :: n_contacts = 400, n_sliders = 20, n_steps = 8
   integer(long), parameter :: seed = 2016
   real(wp), parameter :: stiffness = 50.0_wp, normal_load = 10.0_wp   ! of each slider [N/m], [N]
   type(process_request) :: request
   type(process_model_type) :: model
   type(stream_type) :: stream
   real(wp) :: friction(n_sliders), displacement(0:n_steps), force(0:n_steps, n_contacts)
   real(wp) :: mean, deviation
   integer :: contact, i

   request%method = 'autoregressive'
   request%correlation = 'L0'
   request%correlation_length = 1.0_wp
   request%order = 2
   request%mean = 0.2_wp
   request%std = 0.067_wp
   request%positive = .true.
   request%sampler = 'sequential'
   call fit_process(request, seed, model)
   if (.not. model%is_solved) error stop 'there is no such process'

   displacement = [(0.01_wp*i, i=0, n_steps)]
   force = 0.0_wp
   do contact = 1, n_contacts
      stream = new_stream(seed, request_label(request), contact)
      call draw_points(model, stream, friction)
      do i = 1, n_sliders
         force(:, contact) = force(:, contact) &
                             + min(stiffness*displacement, friction(i)*normal_load)   ! stick, slip
      end do
   end do

   print '(a)', 'displacement [m]   mean force [N]   standard deviation [N]'
   do i = 0, n_steps
      mean = sum(force(i, :))/n_contacts
      deviation = sqrt(sum((force(i, :) - mean)**2)/(n_contacts - 1))
      print '(f10.2, f18.3, f19.3)', displacement(i), mean, deviation
   end do
end program friction_of_a_contact
