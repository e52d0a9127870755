#!/bin/bash
# A scene as a PBS job that goes on, by itself, for as many wall times as it needs:
#
#   qsub -v SCENE=input/paper.nml,OUTPUT=results/paper.h5 input/batch/pbs.sh
#
# Options of run go into OPTIONS: qsub -v "SCENE=...,OUTPUT=...,OPTIONS=--set campaign%n_samples=1000".
# They have no commas, at which qsub -v divides: a list of values belongs into the scene.
# PBS gives no warning ahead of the wall time, so the program keeps a limit of its own, ten minutes
# below it: it stops with everything finished safe (code 75), and the job submits itself again.
# For another wall time: -l walltime=... below, and with it MINUTES=... beside SCENE.
# As a job array (qsub -J 1-8 ...) its members share the work; when all are done, submit the job once
# more without -J: it merges what they left.
#
#PBS -N entroslip
#PBS -l select=1:ncpus=32:mpiprocs=32
#PBS -l walltime=04:00:00
#PBS -j oe
#PBS -r y

minutes=${MINUTES:-230} # below the wall time above

cd "$PBS_O_WORKDIR" || exit 2
: "${SCENE:?which scene? qsub -v SCENE=...,OUTPUT=... pbs.sh}"
: "${OUTPUT:?which output? qsub -v SCENE=...,OUTPUT=... pbs.sh}"
program=${ENTROSLIP:-build/release/bin/entroslip}
script=${SCRIPT:-input/batch/pbs.sh} # to be submitted again: PBS runs a copy of it
export OPENBLAS_NUM_THREADS=1 # else OpenBLAS starts threads that entroslip leaves idle

share=$SHARE # handed on by a member of an array that submits itself again
if [ -n "$PBS_ARRAY_INDEX" ]; then share=--share; fi

count_kept() { # processes and blocks of samples that are finished
  find "$(readlink -f "$OUTPUT").shards" -name '*.h5' 2>/dev/null | wc -l
}
kept=$(count_kept)

# shellcheck disable=SC2086   # words of options
mpirun $MPIRUN_OPTIONS -n "$(wc -l <"$PBS_NODEFILE")" -machinefile "$PBS_NODEFILE" "$program" run \
  "$SCENE" --output "$OUTPUT" --set "campaign%walltime=$minutes" $share $OPTIONS
code=$?

if [ "$code" -eq 75 ] && [ "$(count_kept)" -eq "$kept" ]; then
  echo "not submitted again: this start finished no block of samples; give it more time"
elif [ "$code" -eq 75 ]; then
  settings="SCENE=$SCENE,OUTPUT=$OUTPUT,MINUTES=$minutes"
  qsub -v "$settings,ENTROSLIP=$program,SCRIPT=$script,SHARE=$share,OPTIONS=$OPTIONS" "$script"
fi
exit "$code"
