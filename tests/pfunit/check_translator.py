"""Each rule of the dialect; what it refuses is checked in check_refusals.py."""

import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "translator"))

from checking import check
from reading import Source
from writing import driver, translation

ONE_TEST = "@test\nsubroutine a()\nend subroutine a\n"
ONE_MPI_TEST = "@test(npes=[2])\nsubroutine a(this)\nend subroutine a\n"
ONE_CASE_TEST = "@test\nsubroutine a(this)\nend subroutine a\n"


def read(text: str, name: str = "some.pf") -> Source:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / name
        path.write_text(text)
        source = Source(path)
        check(source)
    return source


def gathered(text: str) -> str:
    """Text written after the tests."""
    source = read(text)
    assert not source.complaints, source.complaints
    return translation(source, Path("some.F90")).split("end module some\n")[-1]


class Translations(unittest.TestCase):
    def assert_line(self, line: str, expected: str):
        """The directive becomes this."""
        source = read(f"{ONE_TEST}{line}\n")
        self.assertEqual([], source.complaints)
        self.assertEqual(expected, source.lines[3])

    def test_an_assertion_becomes_a_call_that_leaves_the_test(self):
        self.assert_line(
            "   @assertEqual(1, n)",
            "   call assertEqual(1, n, location=SourceLocation('some.pf', 4))"
            "; if (anyExceptions()) return",
        )

    def test_an_assertion_of_the_old_mpi_spelling_stays_in_the_test(self):
        self.assert_line(
            "@mpiAssertTrue(x)", "call AssertTrue(x, location=SourceLocation('some.pf', 4))"
        )

    def test_an_assertion_may_have_no_operand(self):
        self.assert_line(
            "@assertExceptionRaised()",
            "call assertExceptionRaised(location=SourceLocation('some.pf', 4))"
            "; if (anyExceptions()) return",
        )

    def test_case_and_blanks_before_the_parenthesis_do_not_matter(self):
        self.assert_line(
            "@ASSERTtrue  (x)  ",
            "call ASSERTtrue(x, location=SourceLocation('some.pf', 4))"
            "; if (anyExceptions()) return",
        )

    def test_brackets_and_quotes_in_arguments_are_kept(self):
        arguments = """f([1, (2)], ")"), g(")'(", '@ " !'), message='it''s, (a "test'"""
        source = read(f"{ONE_TEST}@assertEqual({arguments})\n")
        self.assertEqual([], source.complaints)
        self.assertIn(f"assertEqual({arguments}, location=", source.lines[3])

    def test_lines_keep_their_numbers(self):
        source = read("module some\n\n" + ONE_TEST + "end module some\n")
        text = translation(source, Path("out/some.F90")).splitlines()
        self.assertEqual(f'#line 1 "{source.path}"', text[0])
        self.assertEqual(source.lines, text[1:7])
        self.assertEqual("!@test", source.lines[2])
        self.assertEqual('#line 9 "out/some.F90"', text[7])

    def test_comments_and_blank_lines_may_follow_a_directive(self):
        source = read("@test\n\n   ! why\n@disable\n! how\nsubroutine a ! what\nend\n")
        self.assertEqual([], source.complaints)
        self.assertEqual(["a"], [test.name for test in source.tests])

    def test_an_at_sign_in_a_string_or_a_comment_is_none(self):
        source = read(ONE_TEST + "x = '@assertTrue(y)' ! don't @me\nz = 'a &\n@b'\n")
        self.assertEqual([], source.complaints)

    def test_module_procedures_are_no_modules(self):
        lines = "module some\ninterface f\n module procedure g\nend interface\n"
        self.assertEqual([], read(lines + ONE_TEST + "end module some\n").complaints)

    def test_a_module_may_spell_the_name_of_its_file_in_other_case(self):
        self.assertEqual([], read("Module SOME\n" + ONE_TEST + "end module\n").complaints)


class Gathering(unittest.TestCase):
    def test_a_plain_test(self):
        text = gathered("module some\n" + ONE_TEST + "end module some\n")
        self.assertIn("   use some\n", text)
        self.assertIn("      call suite%add('some.a', TestMethod(test=a))\n", text)

    def test_before_and_after(self):
        around = "@before\nsubroutine b()\nend\n@after\nsubroutine c\nend\n"
        text = gathered("module some\n" + around + ONE_TEST + "end module some\n")
        self.assertIn("TestMethod(test=a, before=b, after=c)", text)

    def test_a_disabled_test_is_named_and_not_passed(self):
        text = gathered("module some\n@test\n@disable\nsubroutine a\nend\nend module some\n")
        self.assertIn("      call suite%add('some.a')\n", text)

    def test_a_guarded_test(self):
        for guard in ("ifdef", "ifndef"):
            with self.subTest(guard):
                text = gathered(
                    f"module some\n@test({guard}=X)\nsubroutine a\nend\nend module some\n"
                )
                self.assertRegex(text, f"#{guard} X\n.*some.a.*\n#endif\n")

    def test_an_mpi_test(self):
        for directive in ("test", "mpitest", "MPItest"):
            with self.subTest(directive):
                test = f"@{directive}(npes=[1,2])\nsubroutine a(this)\nend\n"
                text = gathered(f"module some\n{test}end module some\n")
                self.assertIn("add_for_each(suite, 'some.a', MpiTestMethod(test=a), [1, 2])", text)

    def test_a_file_without_module_declares_its_tests(self):
        text = translation(read(ONE_TEST), Path("some.F90"))
        self.assertIn("   interface\n      subroutine a()\n", text)
        self.assertNotIn("use some\n", text)

    def test_a_fixture_is_constructed_for_each_test(self):
        case = "module some\n@testCase(constructor=new)\ntype, extends(TestCase) :: T\nend type\n"
        text = gathered(case + ONE_CASE_TEST + "end module some\n")
        self.assertIn("      test%T = new()\n", text)
        self.assertIn("call suite%add('some.a', pf_new(a))", text)

    def test_a_test_overrides_the_options_of_its_fixture(self):
        case = "module some\n@testCase(npes=[1])\ntype, extends(MpiTestCase) :: T\nend type\n"
        text = gathered(case + ONE_CASE_TEST + ONE_MPI_TEST + "end module some\n")
        self.assertIn("add_for_each(suite, 'some.a', pf_new(a), [1])", text)
        self.assertIn("add_for_each(suite, 'some.a', pf_new(a), [2])", text)

    def test_parameters_are_any_expression(self):
        case = (
            "module some\n@testParameter\ntype, extends(AbstractTestParameter) :: P\nend type\n"
            "@testCase(constructor=T, testParameters={list(1, 'a,}')})\n"
            "type, extends(ParameterizedTestCase) :: T\nend type\n"
        )
        text = gathered(case + ONE_CASE_TEST + "end module some\n")
        self.assertIn("call pf_add_each(suite, 'some.a', a, list(1, 'a,}'))", text)
        self.assertIn("         test%T = T(parameters(i))\n", text)

    def test_the_driver_calls_each_suite(self):
        text = driver("main", ["first", "second"], is_mpi=True)
        self.assertIn("   use pfunit_main, only", text)
        self.assertIn("   call first_suite(suite)\n   call second_suite(suite)\n", text)


if __name__ == "__main__":
    unittest.main()
