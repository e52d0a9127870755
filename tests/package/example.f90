!> The process of largest entropy with L0 = 1 of order 2: b0 = 4 sqrt(3) - 6.
program example
   use core_kinds, only: long, wp
   use process_fit, only: fit_process
   use process_model, only: process_model_type, process_request
   implicit none(type, external)
   type(process_request) :: request
   type(process_model_type) :: model

   request%method = 'autoregressive'
   request%correlation = 'L0'
   request%correlation_length = 1.0_wp
   request%order = 2
   request%std = 1.0_wp
   request%sampler = 'sequential'
   call fit_process(request, 1_long, model)
   print '(a, f9.6)', 'b0 = ', model%b0
   if (abs(model%b0 - (4*sqrt(3.0_wp) - 6)) > 1.0e-6_wp) error stop 'not the known solution'
end program example
