"""How a test executable behaves, and what the compiler must not accept.

Usage: check_runner.py SPECS COMPILER MODULES, with the directory of the built specifications, the
Fortran compiler, and the directory of the module files.
"""

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SPECS, COMPILER, MODULES = sys.argv[1:4]

TEST = """\
program some
   use, intrinsic :: iso_fortran_env, only: int64, real32, real64
   use funit
   implicit none
   logical :: yes = .true.
   {}
end program some
"""


def run(name: str, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([f"{SPECS}/{name}", *arguments], capture_output=True, text=True)


class Executables(unittest.TestCase):
    def test_success(self):
        done = run("spec_fixture")
        self.assertEqual((0, " OK\n (2 tests)\n", ""), (done.returncode, done.stdout, done.stderr))

    def test_disabled_tests_are_counted(self):
        self.assertIn(" OK\n (13 tests, 1 disabled)\n", run("spec_serial").stdout)

    def test_verbose_names_each_test_before_it_runs(self):
        lines = run("spec_param", "--verbose").stdout.splitlines()
        self.assertEqual("Start: spec_param.doubles[n=0]", lines[0])
        self.assertEqual("Start: spec_param.own_list[n=3]", lines[3])

    def test_a_filter_takes_the_tests_whose_name_contains_it(self):
        self.assertIn(" (1 tests)", run("spec_param", "-f", "own").stdout)
        self.assertIn(" (0 tests)", run("spec_param", "-f", "nothing").stdout)

    def test_unknown_options_are_refused(self):
        done = run("spec_param", "--xml")
        self.assertEqual(1, done.returncode)
        self.assertIn("usage", done.stderr)

    def test_failures_are_named_with_their_place_and_values(self):
        done = run("fail_serial")
        self.assertEqual(2, done.returncode)
        self.assertIn("Encountered 1 or more failures/errors during testing", done.stdout)
        for report in (
            "f01_wrong_integer\n  [fail_serial.pf:17]\n  wanted 1 == 2\n",
            "f02_outside_tolerance\n  [fail_serial.pf:22]\n  off by a tenth\n  wanted 1.0",
            "wanted 2.0000000000000000 == NaN at element [2]; difference NaN, tolerance 0.179",
            "Arrays not conformable: shapes [3] and [2]",
            "wanted 2.0000000000000000 == 2.5000000000000000 at element [2]; difference 0.5",
            "this message must show\n  wanted .true.",
            "wanted an exception: nobody threw this",
            "f10_thrown_and_not_caught\n  uncaught\n",
            'wanted "abc", found "abd"',
            "on purpose",
        ):
            with self.subTest(report):
                self.assertIn(report, done.stdout)


class Strictness(unittest.TestCase):
    def compiles(self, line: str) -> bool:
        with tempfile.TemporaryDirectory() as directory:
            source = Path(directory) / "some.f90"
            source.write_text(TEST.format(line))
            command = [COMPILER, "-fsyntax-only", f"-I{MODULES}", source]
            return subprocess.run(command, capture_output=True, cwd=directory).returncode == 0

    def test_what_pfunit_accepts_compiles(self):
        for line in (
            "call assertEqual(1, 1_int64, 'text')",
            "call assertEqual(1.0_real32, 1.0_real64, 1.0_real32, 'text')",
            "call assertLessThan(1, 2, message='text')",
            "call assertEquivalent(yes, yes, message='text')",
        ):
            with self.subTest(line):
                self.assertTrue(self.compiles(line))

    def test_what_pfunit_does_not_accept_does_not_compile(self):
        for line in (
            "call assertEqual(1.0_real64, 1.0_real32)",
            "call assertEqual(1_int64, 1)",
            "call assertEqual(1.0, 1)",
            "call assertEqual(1.0_real32, 1.0_real32, tolerance=1.0_real64)",
            "call assertEqual(1, 1, tolerance=1)",
            "call assertLessThan(1, 2, 'text')",
            "call assertNotEqual(1, 2, 'text')",
            "call assertEquivalent(yes, yes, 'text')",
            "call assertLessThan((1.0, 0.0), (2.0, 0.0))",
            "call assertRelativelyEqual(1.0, 1.0)",
        ):
            with self.subTest(line):
                self.assertFalse(self.compiles(line))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
