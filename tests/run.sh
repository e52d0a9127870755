#!/usr/bin/env bash
# Every test: packages, both builds, unit and MPI tests, the program end to end, the Python package.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/prepare.sh

# shellcheck disable=SC2086   # one word a package
install_packages $build_packages $test_packages
build debug
build release
make_venv tests/requirements.txt

failed=0
say "Unit and MPI tests: release"
ctest --preset release || failed=1
# Three lanes share the cores: two of pytest, a file of tests in one of them, and the unit tests with every check.
say "The program end to end, and the Python package; beside them unit and MPI tests: debug"
ctest --preset debug --parallel 1 >build/ctest-debug.log 2>&1 &
checked=$!
.venv/bin/python -m pytest -q -n 2 --dist loadfile tests || failed=1
if wait "$checked"; then tail -n 5 build/ctest-debug.log; else failed=1 && cat build/ctest-debug.log; fi
exit $failed
