!> Blocks of samples: friction drawn, marched under the case's force, spectra formed as the march goes.
module ensemble_sample
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: to_text
   use dynamics_event, only: new_event_marcher
   use dynamics_excitation, only: band_limited_force
   use dynamics_newmark, only: new_newmark
   use dynamics_response, only: block_state, marcher_type, start_block, stored_energy
   use ensemble_plan, only: plan_type
   use ensemble_results, only: block_result, spectrum_layout
   use numerics_spectrum, only: welch_type
   use process_model, only: process_model_type, request_label
   use process_positive, only: draw_points
   implicit none(type, external)
   private
   public :: runner_type, prepare_runner, run_block, draw_friction, block_width

   integer, parameter :: records_per_piece = 256   !! of a march that is interrupted to form spectra

   !> All that blocks of one plan share.
   type :: runner_type
      type(plan_type) :: plan
      class(marcher_type), allocatable :: marcher
      real(wp), allocatable :: force(:)    !! (step) the shared record; of unit variance unless from a file
      type(spectrum_layout) :: layout
   end type runner_type

   abstract interface
      !> Whether the run has been asked to end.
      logical function stop_query()
      end function stop_query
   end interface
contains
end module ensemble_sample
