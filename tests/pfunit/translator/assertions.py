"""Write the Fortran module funit_numbers: one specific procedure per assertion and pair of kinds.

Operands of any rank up to 3 are handed on as flat lists of the widest kind; what an assertion
means stands in funit_compare alone.
"""

from typing import NamedTuple

EQUALITIES = {"assertEqual": "==", "assertNotEqual": "/="}
ORDERINGS = {
    "assertLessThan": "<",
    "assertLessThanOrEqual": "<=",
    "assertGreaterThan": ">",
    "assertGreaterThanOrEqual": ">=",
}
RELATIVE = {"assertRelativelyEqual": "~="}


class Number(NamedTuple):
    """A type of numbers."""

    family: str
    bits: int

    @property
    def name(self) -> str:
        """For names of procedures, for example real64."""
        return f"{self.family}{self.bits}"

    @property
    def declaration(self) -> str:
        """For example real(real64)."""
        return f"{self.family}({'int' if self.family == 'integer' else 'real'}{self.bits})"


BITS = {"integer": (8, 16, 32, 64), "real": (32, 64), "complex": (32, 64)}
NUMBERS = [Number(family, bits) for family, sizes in BITS.items() for bits in sizes]
DEFAULT, WIDEST = 32, 64
DEFAULT_REAL = Number("real", DEFAULT)
FLAT_LIST = {
    "integer": "flat({})",
    "real": "real(flat({}), real64)",
    "complex": "cmplx(flat({}), kind=real64)",
}

MODULE = """\
!> Assertions on numbers, written by the translator.
module funit_numbers
   use, intrinsic :: iso_fortran_env, only: int8, int16, int32, int64, real32, real64
   use funit_compare, only: compare, extents
   use funit_exceptions, only: SourceLocation
   implicit none(type, external)
   private
{public}

{interfaces}
contains

{procedures}
end module funit_numbers
"""

INTERFACE = """\
   interface {name}
{specifics}
   end interface {name}
"""

ASSERTION = """\
   subroutine {name}(expected, actual, {dummies})
      {expected}, intent(in) :: expected(..)
      {actual}, intent(in) :: actual(..)
{tolerance_declaration}      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call compare({expected_list}, '{relation}', {actual_list}, &
         extents(expected), extents(actual), {tolerance}message, location)
   end subroutine {name}
"""

FLAT = """\
   pure function {name}(x) result(list)
      {given}, intent(in) :: x(..)
      {widest}, allocatable :: list(:)

      select rank (x)
      rank (0)
         list = [{widest} :: x]
      rank (1)
         list = [{widest} :: x]
      rank (2)
         list = [{widest} :: x]
      rank (3)
         list = [{widest} :: x]
      rank (*)   ! what gfortran takes the value of an expression without elements for
         allocate (list(0))
      rank default
         error stop 'funit: assertions take arrays of rank 3 at most'
      end select
   end function {name}
"""


def unique(items: list) -> list:
    """The items in their order, each once."""
    return list(dict.fromkeys(items))


def expected_of(actual: Number) -> list[Number]:
    """Types of the expected value: the default types up to the actual one, and the actual one."""
    families = list(BITS)
    narrower = families[: families.index(actual.family) + 1]
    return unique([*(Number(family, DEFAULT) for family in narrower), actual])


def tolerances_of(assertion: str, actual: Number) -> list[Number | None]:
    """Types of the tolerance: a default real, or the actual kind; None if none is needed."""
    absent = [] if assertion in RELATIVE else [None]
    if actual.family == "integer" or assertion in ORDERINGS:
        return absent
    return unique([*absent, DEFAULT_REAL, Number("real", actual.bits)])


def actuals_of(assertion: str) -> list[Number]:
    """Types of the actual value: complex numbers have no order, integers are exact."""
    families = {**dict.fromkeys(ORDERINGS, ("integer", "real")), "assertRelativelyEqual": ("real",)}
    return [number for number in NUMBERS if number.family in families.get(assertion, BITS)]


def specific(
    assertion: str, relation: str, expected: Number, actual: Number, tolerance: Number | None
) -> tuple[str, str]:
    """Name and text of one specific procedure."""
    name = f"{assertion}_{expected.name}_{actual.name}"
    passed = "" if actual.family == "integer" else "0.0_real64, "
    declaration = ""
    # a message that must be named comes after the location, which the translator always names
    by_position = assertion == "assertEqual" and (actual.family != "complex" or tolerance)
    dummies = "message, location" if by_position else "location, message"
    if tolerance:
        name += f"_{tolerance.name}"
        dummies = f"tolerance, {dummies}"
        declaration = f"      {tolerance.declaration}, intent(in) :: tolerance\n"
        passed = "real(tolerance, real64), "
    flat_list = FLAT_LIST[actual.family]
    return name, ASSERTION.format(
        name=name,
        dummies=dummies,
        expected=expected.declaration,
        actual=actual.declaration,
        tolerance_declaration=declaration,
        expected_list=flat_list.format("expected"),
        relation=relation,
        actual_list=flat_list.format("actual"),
        tolerance=passed,
    )


def flat(number: Number) -> tuple[str, str]:
    """Name and text of the function that makes a list of the widest kind of its argument."""
    name = f"flat_{number.name}"
    widest = number._replace(bits=WIDEST).declaration
    return name, FLAT.format(name=name, given=number.declaration, widest=widest)


def interface(name: str, specifics: dict[str, str]) -> str:
    """The generic name of some procedures."""
    lines = "\n".join(f"      module procedure {each}" for each in specifics)
    return INTERFACE.format(name=name, specifics=lines)


def assertions() -> str:
    """The whole module."""
    generics = {
        assertion: dict(
            specific(assertion, relation, expected, actual, tolerance)
            for actual in actuals_of(assertion)
            for expected in expected_of(actual)
            for tolerance in tolerances_of(assertion, actual)
        )
        for assertion, relation in (EQUALITIES | ORDERINGS | RELATIVE).items()
    }
    public = "\n".join(f"   public :: {assertion}" for assertion in generics)
    generics["flat"] = dict(flat(number) for number in NUMBERS)
    return MODULE.format(
        public=public,
        interfaces="\n".join(interface(*generic) for generic in generics.items()),
        procedures="\n".join(
            text for specifics in generics.values() for text in specifics.values()
        ),
    )
