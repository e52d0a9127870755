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
for preset in debug release; do
  say "Unit and MPI tests: $preset"
  ctest --preset "$preset" || failed=1
done
say "The program end to end, and the Python package"
.venv/bin/python -m pytest -q tests || failed=1
exit $failed
