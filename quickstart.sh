#!/usr/bin/env bash
# The whole paper on this machine: packages, build, the study on all cores, figures and report.
set -euo pipefail
cd "$(dirname "$0")"
. scripts/prepare.sh

# shellcheck disable=SC2086   # one word a package
install_packages $build_packages
mkdir -p results/paper
build release entroslip
make_venv postproc/requirements.txt

program=build/release/bin/entroslip
ranks=$(nproc)
say "The paper's friction study: input/paper.nml on $ranks ranks"
"${mpi_run[@]}" "$ranks" $program run input/paper.nml --output results/paper/paper.h5

say "Figures and report"
.venv/bin/python -m postproc results/paper/paper.h5 --out results/paper
say "Done: open results/paper/report.html"
