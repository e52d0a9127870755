!> Misspelt names: the nearest known name, in any case.
module core_spelling
   implicit none(type, external)
   private
   public :: lowered, nearest_name

contains

   !> The text in lower case.
   pure function lowered(text)
      character(*), intent(in) :: text
      character(len(text)) :: lowered
      integer :: i

      lowered = text
      do i = 1, len(text)
         if (text(i:i) >= 'A' .and. text(i:i) <= 'Z') lowered(i:i) = achar(iachar(text(i:i)) + 32)
      end do
   end function lowered

   !> The known name nearest to `name`, in any case; blank if none is within a third of its letters.
   pure function nearest_name(name, known) result(nearest)
      character(*), intent(in) :: name
      character(*), intent(in) :: known(:)
      character(len(known)) :: nearest
      integer :: i, distance, least

      nearest = ''
      if (len(name) > len(known)) return
      least = max(1, len(name)/3) + 1
      do i = 1, size(known)
         distance = edit_distance(lowered(name), lowered(trim(known(i))))
         if (distance >= least) cycle
         least = distance
         nearest = known(i)
      end do
   end function nearest_name

   !> Distance of two names: letters to insert, delete, replace or swap with their neighbour.
   pure integer function edit_distance(a, b) result(distance)
      character(*), intent(in) :: a, b
      integer :: d(0:len(a), 0:len(b)), i, j

      d(:, 0) = [(i, i=0, len(a))]
      d(0, :) = [(j, j=0, len(b))]
      do j = 1, len(b)
         do i = 1, len(a)
            d(i, j) = min(d(i - 1, j) + 1, d(i, j - 1) + 1, &
                          d(i - 1, j - 1) + merge(0, 1, a(i:i) == b(j:j)))
            if (i > 1 .and. j > 1) then
               if (a(i:i) == b(j - 1:j - 1) .and. a(i - 1:i - 1) == b(j:j)) &
                  d(i, j) = min(d(i, j), d(max(i, 2) - 2, max(j, 2) - 2) + 1)
            end if
         end do
      end do
      distance = d(len(a), len(b))
   end function edit_distance

end module core_spelling
