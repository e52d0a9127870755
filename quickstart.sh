#!/usr/bin/env bash
# The whole paper on this machine: packages, build, the study on all cores, figures and report.
set -euo pipefail
cd "$(dirname "$0")"
. scripts/prepare.sh

# shellcheck disable=SC2086   # one word a package
install_packages $build_packages
build release entroslip
make_venv postproc/requirements.txt

# study SCENE FOLDER: everything the scene asks for, and its report.
study() {
  mkdir -p "results/$2"
  "${mpi_run[@]}" "$ranks" build/release/bin/entroslip run "input/$1.nml" --output "results/$2/$1.h5"
  .venv/bin/python -m postproc "results/$2/$1.h5" --out "results/$2"
}

ranks=$(nproc)
say "Section 2, the processes: input/paper_process.nml on $ranks ranks"
study paper_process processes
say "Section 3, the friction study: input/paper.nml on $ranks ranks"
study paper paper
say "Done: open results/paper/report.html and results/processes/report.html"
