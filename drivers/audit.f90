!> Numerical error of a case, as its audit states it.
module driver_audit
   use campaign_comparison, only: compare_slip, numerical_error, spectrum_comparison
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result, spectrum_layout
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_audit_results, only: write_audit
   use io_gathering, only: read_part, read_samples, shards_of
   use io_results, only: results_writer
   use io_shards, only: shard_type
   use io_store, only: shard_store
   implicit none(type, external)
   private
   public :: finish_audit

contains

   !> Compares the audit with the samples that it repeats, and writes it; for the root alone.
   subroutine finish_audit(plan, audit, layout, store, shards, writer, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: audit   !! case number
      type(spectrum_layout), intent(in) :: layout
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(results_writer), intent(in) :: writer
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: tested, reference
      type(numerical_error) :: errors

      associate (audited => plan%cases(audit)%audits, n => plan%cases(audit)%n_samples)
         call read_samples(store, shards_of(shards, audited, n), audited, 1, n, tested, error)
         if (.not. allocated(error)) &
            call read_samples(store, shards_of(shards, audit, n), audit, 1, n, reference, error)
         if (allocated(error)) return
         call compare_slip(tested%slip_fraction, reference%slip_fraction, &
                           plan%cases(audited)%n_samples, errors)
      end associate
      if (plan%output%spectrum) &
         call compare_psd(plan, audit, size(layout%frequency), store, shards, errors, error)
      if (allocated(error)) return
      call write_audit(writer, plan, audit, reference, layout, errors, store, shards, error)
   end subroutine finish_audit

   !> Compares the spectra of a case with those of its audit, a range of frequencies at a time.
   subroutine compare_psd(plan, audit, n_frequencies, store, shards, errors, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: audit   !! case number
      integer, intent(in) :: n_frequencies
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(numerical_error), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      type(spectrum_comparison) :: comparison
      type(shard_type), allocatable :: audits(:), own(:)
      real(wp), allocatable :: tested(:, :, :), reference(:, :, :)   ! (dof, frequency, sample)
      integer :: f, n_dof, together

      n_dof = size(kept_dofs(plan))
      together = frequencies_together(n_dof, n_frequencies)
      associate (audited => plan%cases(audit)%audits, n => plan%cases(audit)%n_samples)
         own = shards_of(shards, audited, n)
         audits = shards_of(shards, audit, n)
         do f = 1, n_frequencies, together
            allocate (tested(n_dof, min(together, n_frequencies - f + 1), n))
            allocate (reference, mold=tested)
            call read_part(store, own, audited, 'psd', [1, f, 1], tested, error)
            if (.not. allocated(error)) &
               call read_part(store, audits, audit, 'psd', [1, f, 1], reference, error)
            if (allocated(error)) return
            call comparison%add(tested, reference, plan%output%percentiles)
            deallocate (tested, reference)
         end do
         call comparison%finish(plan%cases(audited)%n_samples, errors)
      end associate
   end subroutine compare_psd

end module driver_audit
