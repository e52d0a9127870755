#!/usr/bin/env bash
# The whole paper on this machine: packages, build, the study on all cores, figures and report.
set -euo pipefail
cd "$(dirname "$0")"
. scripts/prepare.sh

# shellcheck disable=SC2086   # one word a package
install_packages $build_packages
build release entroslip
make_venv postproc/requirements.txt

# solve SCENE [OPTION ...]: everything the scene asks for, into results/paper.
solve() {
  local code=0
  "${mpi_run[@]}" "$ranks" build/release/bin/entroslip run "input/$1.nml" \
    --output "results/paper/$1.h5" "${@:2}" || code=$?
  if [ "$code" -eq 3 ]; then
    say "What an earlier version left in results/paper cannot be used: move it away, and start again"
  fi
  [ "$code" -eq 0 ] || exit "$code"
}

ranks=$(nproc)
mkdir -p results/paper
say "Section 2, the processes: input/paper_process.nml on $ranks ranks"
solve paper_process
say "Section 3, the friction study: input/paper.nml on $ranks ranks"
solve paper
say "The runs without uncertainty, 25 times as long: input/deterministic.nml"
solve deterministic --set integration%n_steps=10000000
say "From stuck to slipping: input/sweep.nml, and one sample of input/smallest.nml with its history"
solve sweep
build/release/bin/entroslip replay input/smallest.nml --case 1 --sample 3 \
  --output results/paper/one_sample.h5
say "What accuracy costs in this study: entroslip tradeoff input/paper.nml"
if [ ! -e results/paper/tradeoff.h5 ]; then
  "${mpi_run[@]}" "$ranks" build/release/bin/entroslip tradeoff input/paper.nml \
    --output results/paper/tradeoff.h5 --quiet
fi
say "Tables, figures and the report"
.venv/bin/python -m entroslip results/paper/{paper_process,paper,deterministic,sweep,one_sample,tradeoff}.h5 \
  --out results/paper
say "Done: open results/paper/report.html"
if [ "$(id -u)" -eq 0 ]; then
  echo "As root, mpirun wants: export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1"
fi
