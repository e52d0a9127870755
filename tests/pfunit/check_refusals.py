"""Refusals of each rule of the dialect: the line and the reason."""

import unittest

from check_translator import ONE_CASE_TEST, ONE_MPI_TEST, ONE_TEST, read


class Refusals(unittest.TestCase):
    def assert_refused(self, text: str, line: int, reason: str, name: str = "some.pf"):
        source = read(text, name)
        self.assertEqual([f"{source.path}:{line}: {reason}"], source.complaints)

    def test_unknown_directives(self):
        for name in ("foo", "assertThat", "mpiBefore", "suite", ""):
            with self.subTest(name):
                self.assert_refused(ONE_TEST + f"@{name}(x)\n", 4, f"unknown directive @{name}")

    def test_company_on_the_line_of_a_directive(self):
        for line in ("@assertTrue(x) ! why", "@assertTrue(x); y = 1", "@assertTrue x"):
            with self.subTest(line):
                self.assert_refused(ONE_TEST + line, 4, "@assertTrue must stand alone on its line")
        self.assert_refused(
            ONE_TEST + "if (x) @assertTrue(y)", 4, "a directive must stand alone on its line"
        )
        self.assert_refused("@test ! why\n" + ONE_TEST, 1, "@test must stand alone on its line")

    def test_a_continued_directive(self):
        for line in ("@assertTrue(x, &", "@assertTrue(x, 'a", "@assertTrue(x ! )"):
            with self.subTest(line):
                self.assert_refused(
                    ONE_TEST + line,
                    4,
                    "@assertTrue must end on its line: a parenthesis or a quote is open",
                )

    def test_operands(self):
        for line, reason in {
            "@assertEqual(1)": "@assertEqual needs parentheses with 2 operands",
            "@assertTrue": "@assertTrue needs parentheses with 1 operands",
            "@assertExceptionRaised": "@assertExceptionRaised needs parentheses with 0 operands",
            "@assertEqual(1,)": "an argument is empty",
            "@assertLessThan(1, 2, 'x')": (
                "@assertLessThan takes 2 arguments by position: name the others"
            ),
        }.items():
            with self.subTest(line):
                self.assert_refused(ONE_TEST + line, 4, reason)

    def test_options(self):
        for line, reason in {
            "@test(cases=[1])": "@test does not take `cases=[1]` here",
            "@test([1, 2])": "@test does not take `[1, 2]` here",
            "@test(npes=[1], npes=[2])": "@test does not take `npes=[2]` here",
            "@before(this)": "@before does not take `this` here",
            "@testCase(ifdef=A)": "@testCase does not take `ifdef=A` here",
        }.items():
            with self.subTest(line):
                self.assert_refused(ONE_TEST + line, 4, reason)

    def test_values_of_options(self):
        for option, reason in {
            "npes=[n]": "npes=[n]: must be a list of literal positive integers like [1, 2]",
            "npes=[0]": "npes=[0]: must be a list of literal positive integers like [1, 2]",
            "npes=[]": "npes=[]: must be a list of literal positive integers like [1, 2]",
            "testParameters=[p]": "testParameters=[p]: must be an expression in braces",
            "testParameters={ }": "testParameters={ }: must be an expression in braces",
            "ifdef=A, ifndef=B": "@test takes ifdef or ifndef, not both",
        }.items():
            with self.subTest(option):
                self.assert_refused(
                    ONE_TEST + f"@test({option})\nsubroutine b(this)\nend\n", 5, reason
                )

    def test_disable_before_test(self):
        for line in ("@disable\n", "@before\n@disable\n", "@test\n@disable()\n"):
            with self.subTest(line):
                complaints = read(line + ONE_TEST).complaints
                self.assertIn("@disable must follow @test", complaints[0])

    def test_a_directive_about_nothing(self):
        self.assert_refused(
            "@test\n@before\n" + ONE_TEST[6:],
            2,
            "@test must be followed by what it is about, not by @before",
        )
        self.assert_refused(ONE_TEST + "@after", 4, "@after is followed by nothing")

    def test_subroutines_of_other_forms(self):
        for line in (
            "pure subroutine b()",
            "subroutine b(x, y)",
            "subroutine b() bind(c)",
            "subroutine b &",
            "integer :: b",
        ):
            with self.subTest(line):
                self.assert_refused(
                    ONE_TEST + f"@test\n{line}\n",
                    5,
                    "@test must be followed by `subroutine name` or `subroutine name(this)`",
                )

    def test_types_of_other_forms(self):
        for directive in ("testcase", "testparameter"):
            with self.subTest(directive):
                self.assert_refused(
                    ONE_TEST + f"@{directive}\ntype :: T\n",
                    5,
                    f"@{directive} must be followed by `type, extends(parent) :: name`",
                )

    def test_module_names(self):
        for line, reason in {
            "module other": "module other: must have the name of its file, some",
            "module some ! here": "the module line must end after the name",
            "module some; use x": "the module line must end after the name",
        }.items():
            with self.subTest(line):
                self.assert_refused(f"{line}\n{ONE_TEST}", 1, reason)
        self.assert_refused(
            f"module some\n{ONE_TEST}end module\nmodule some\n", 6, "a second module in this file"
        )

    def test_names_that_pfunit_exports(self):
        for line in (
            "pure integer function run(x) result(y)",
            "subroutine run",
            "integer, intent(in) :: a(2, n), run(3) = [1, 2, 3]",
            "use thing, only: walk, run => step",
        ):
            with self.subTest(line):
                self.assert_refused(ONE_TEST + line, 4, "the name run is taken by pFUnit")
        for line in (
            "end subroutine run",
            "call run(x)",
            "x = [real :: run, 'a :: run']",
            "! a function is :: run",
        ):
            with self.subTest(line):
                self.assertEqual([], read(ONE_TEST + line).complaints)

    def test_preprocessor_lines(self):
        self.assert_refused("#ifdef A\n" + ONE_TEST, 1, "a line must not start with #")

    def test_a_file_without_tests(self):
        self.assert_refused("module some\nend module\n", 2, "there is no @test in this file")

    def test_arguments_of_tests(self):
        self.assert_refused("@test\nsubroutine a(this)\n", 2, "@test a: must take no arguments")
        self.assert_refused("@test(npes=[1])\nsubroutine a\n", 2, "@test a: must take (this)")
        self.assert_refused(
            "@test(testParameters={p})\nsubroutine a\n",
            2,
            "@test a: testParameters need a ParameterizedTestCase",
        )

    def test_what_surrounds_tests(self):
        before, after = "@before\nsubroutine b{}\nend\n", "@after\nsubroutine c{}\nend\n"
        self.assert_refused(
            ONE_TEST + before.format("(this)"), 5, "@before b: must take no arguments"
        )
        self.assert_refused(
            ONE_MPI_TEST + before.format("(this)") + after.format(""),
            8,
            "@after c: must take (this), as the MPI tests do",
        )
        self.assert_refused(
            ONE_MPI_TEST + after.format("(this)"),
            5,
            "@after c: MPI tests need both @before and @after",
        )
        self.assert_refused(ONE_TEST + before.format("") * 2, 8, "a second @before in this file")
        complaints = read(ONE_TEST + ONE_MPI_TEST + before.format("(this)")).complaints
        self.assertIn("cannot serve serial and MPI tests in one file", complaints[0])

    def assert_case_refused(self, case: str, line: int, reason: str):
        self.assert_refused(f"module some\n{case}{ONE_CASE_TEST}end module some\n", line, reason)

    def test_fixtures(self):
        parameter = "@testParameter\ntype, extends(AbstractTestParameter) :: P\n"
        for case, line, reason in (
            (
                "@testCase\ntype, extends(Base) :: T\n",
                3,
                "@testCase T: must extend TestCase, ParameterizedTestCase or MpiTestCase",
            ),
            (
                "@testCase(npes=[1])\ntype, extends(TestCase) :: T\n",
                5,
                "@test a: npes needs an MpiTestCase",
            ),
            (
                "@testCase(testParameters={p})\ntype, extends(TestCase) :: T\n",
                5,
                "@test a: testParameters need a ParameterizedTestCase",
            ),
            (
                "@testCase\ntype, extends(MpiTestCase) :: T\n",
                5,
                "@test a: needs npes, its own or of @testCase",
            ),
            (
                "@testCase(npes=[1], constructor=f)\ntype, extends(MpiTestCase) :: T\n",
                3,
                "@testCase T: an MpiTestCase takes no constructor",
            ),
            (
                parameter
                + "@testCase(testParameters={p})\ntype, extends(ParameterizedTestCase) :: T\n",
                5,
                "@testCase T: a ParameterizedTestCase needs a constructor",
            ),
            (
                "@testCase(constructor=f, testParameters={p})\n"
                "type, extends(ParameterizedTestCase) :: T\n",
                3,
                "@testCase T: a ParameterizedTestCase needs a @testParameter",
            ),
            (
                parameter + "@testCase(constructor=f)\ntype, extends(ParameterizedTestCase) :: T\n",
                7,
                "@test a: needs testParameters, its own or of @testCase",
            ),
            (
                "@testCase\ntype, extends(TestCase) :: T\n" * 2,
                5,
                "a second @testCase in this file",
            ),
            (
                "@testCase\ntype, extends(TestCase) :: T\n@after\nsubroutine b()\n",
                5,
                "@after b: a @testCase has setUp and tearDown instead",
            ),
        ):
            with self.subTest(reason):
                self.assert_case_refused(case, line, reason)
        self.assert_refused(
            "@testCase\ntype, extends(TestCase) :: T\n" + ONE_CASE_TEST,
            2,
            "@testCase T: must stand in a module",
        )

    def test_parameters(self):
        line = "@testParameter\ntype, extends({}) :: P\n"
        self.assert_refused(
            ONE_TEST + line.format("Base"),
            5,
            "@testParameter P: must extend AbstractTestParameter",
        )
        self.assert_refused(
            ONE_TEST + line.format("AbstractTestParameter") * 2,
            7,
            "a second @testParameter in this file",
        )

    def test_every_complaint_is_made_in_one_pass(self):
        self.assertEqual(3, len(read("#x\n@foo\n@assertTrue()\n" + ONE_TEST).complaints))


if __name__ == "__main__":
    unittest.main()
