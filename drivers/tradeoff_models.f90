!> Text of `entroslip tradeoff` on processes: orders, lengths of fits, standard errors of fits.
module driver_tradeoff_models
   use campaign_plan, only: plan_type
   use core_kinds, only: wp
   use core_phrases, only: brief, numbered, padded
   use core_text, only: to_text
   use process_model, only: process_model_type
   use tradeoff_effects, only: variant_row
   use tradeoff_variants, only: order_row, variant_type
   implicit none(type, external)
   private
   public :: fits_text, orders_text, variants_text

   character, parameter :: line_feed = new_line('a')

contains

   !> Table: the change of published numbers with orders and lengths of fits.
   pure function variants_text(plan, variants, rows) result(text)
      type(plan_type), intent(in) :: plan
      type(variant_type), intent(in) :: variants(:)
      type(variant_row), intent(in) :: rows(:)
      character(:), allocatable :: fit, text
      integer :: i

      text = ''
      do i = 1, size(rows)
         associate (variant => variants(rows(i)%variant))
            if (is_first(i)) then
               if (i > 1) text = text//line_feed
               text = text//heading(variant)
            end if
            fit = 'chosen'
            if (variant%request%fit_steps > 0) fit = to_text(variant%request%fit_steps)
            text = text//merge('* ', '  ', variant%is_own)// &
                   padded(to_text(variant%request%order), 6)//padded(fit, 8)// &
                   padded(brief(rows(i)%seconds), 8)
            if (rows(i)%is_reference) then
               text = text//'compared with'//line_feed
               cycle
            end if
            text = text//padded(with_error(rows(i)%slip_mean, rows(i)%slip_mean_error), 19)// &
                   padded(with_error(rows(i)%slip_std, rows(i)%slip_std_error), 18)// &
                   change_of_bands(rows(i))//line_feed
         end associate
      end do
      if (size(rows) > 0) text = text//'* the scene''s own; the largest change over levels and '// &
                                 'dofs +- standard error'//line_feed

   contains

      pure function change_of_bands(row) result(change)
         type(variant_row), intent(in) :: row
         character(:), allocatable :: change

         change = '-'
         if (plan%output%spectrum) &
            change = with_error(100*row%band_ratio, 100*row%band_ratio_error)
      end function change_of_bands

      pure logical function is_first(i)
         integer, intent(in) :: i

         is_first = i == 1
         if (is_first) return
         associate (a => variants(rows(i - 1)%variant), b => variants(rows(i)%variant))
            is_first = a%process /= b%process .or. (a%is_of_fit .neqv. b%is_of_fit)
         end associate
      end function is_first

   end function variants_text

   pure function heading(variant) result(text)
      type(variant_type), intent(in) :: variant
      character(:), allocatable :: text

      associate (request => variant%request)
         text = numbered('p', variant%process)//', '//trim(request%correlation)//' = '// &
                brief(request%correlation_length)//', std '//brief(request%std)//': other '// &
                trim(merge('lengths of its fit', 'orders            ', variant%is_of_fit))// &
                line_feed//'  order fit     fit [s] mean slip [points] std of slip       '// &
                'bands [%]'//line_feed
      end associate
   end function heading

   pure function with_error(value, standard_error) result(text)
      real(wp), intent(in) :: value, standard_error
      character(:), allocatable :: text

      text = brief(value)//'+-'//brief(standard_error)
   end function with_error

   !> Table: entropy and time by the order of the processes.
   pure function orders_text(rows) result(text)
      type(order_row), intent(in) :: rows(:)
      character(:), allocatable :: text, other
      integer :: i

      text = '  process                  order  entropy lost  other length  fit [ms]'//line_feed
      do i = 1, size(rows)
         associate (row => rows(i))
            other = trim(merge('L1', 'L0', row%correlation == 'L0'))//' = '// &
                    brief(row%other_length)
            text = text//merge('* ', '  ', row%is_own)// &
                   padded(row%method//', '//row%correlation//' = '// &
                          brief(row%correlation_length), 25)// &
                   padded(to_text(row%order), 7)//padded(brief(row%entropy_lost), 14)// &
                   padded(other, 14)//brief(row%milliseconds)//line_feed
         end associate
      end do
      text = text//'* an order of the scene; entropy [nat] per point below that of white noise'// &
             line_feed
   end function orders_text

   !> Standard errors that the simulated fits of positive processes end with.
   pure function fits_text(models) result(text)
      type(process_model_type), intent(in) :: models(:)
      character(:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(models)
         associate (m => models(i))
            if (.not. (m%request%positive .and. m%is_solved)) cycle
            text = text//padded(numbered('p', i), 10)// &
                   padded(brief(100*m%mean_error/m%mean), 11)// &
                   padded(brief(100*m%std_error/m%std), 11)// &
                   brief(100*m%l0_error/m%l0)//line_feed
         end associate
      end do
      if (text /= '') text = 'fit       mean [%]   std [%]    L0 [%], standard errors'// &
                             line_feed//text
   end function fits_text

end module driver_tradeoff_models
