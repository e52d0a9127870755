#!/usr/bin/env bash
# Every test: packages, both builds, unit and MPI tests, the program end to end, the Python package.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/prepare.sh

# shellcheck disable=SC2086   # one word a package
install_packages $build_packages
# What waits for the network comes while the compiler works.
{ install_packages $test_packages; make_venv tests/requirements.txt; } &
installed=$!
build release

failed=0
say "Beside what follows: the debug build, its unit and MPI tests (build/debug.log)"
{ build debug; ctest --preset debug --parallel 1; } >build/debug.log 2>&1 &
debugged=$!
say "Unit and MPI tests: release"
ctest --preset release || failed=1
say "The program end to end, and the Python package"
# Three processes on two cores, as some tests wait. Files in their order: docs and house, whose tests take longest, first.
# Without its packages the debug job is still waited for.
{ wait $installed && .venv/bin/python -m pytest -q -n 3 --dist loadfile --no-loadscope-reorder tests; } || failed=1
say "Unit and MPI tests: debug"
if wait $debugged; then tail -n 5 build/debug.log; else failed=1 && cat build/debug.log; fi
exit $failed
