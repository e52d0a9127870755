#!/bin/bash
# A scene as a Slurm job that goes on, by itself, for as many wall times as it needs:
#
#   sbatch input/batch/slurm.sh SCENE OUTPUT [options of run, such as --set campaign%n_samples=1000]
#
# The job stops ahead of its wall time with everything finished safe (code 75) and puts itself back
# into the queue; the next start continues. The results are the same bits as without interruption.
# Options on sbatch's command line win over those below: sbatch --ntasks=128 --time=08:00:00 ...
# As a job array (sbatch --array=1-8 ...) its members share the work: input/batch/slurm_array.sh.
#
#SBATCH --job-name=entroslip
#SBATCH --ntasks=32
#SBATCH --time=04:00:00
# To this script (B:), five minutes ahead; the program needs seconds, unless a process is being fitted.
# A wall time of a few minutes needs a shorter lead: sbatch --time=00:05:00 --signal=B:USR1@30 ...
#SBATCH --signal=B:USR1@300
#SBATCH --requeue
# One log over all starts:
#SBATCH --output=%x-%j.log
#SBATCH --open-mode=append

scene=${1:?which scene? sbatch slurm.sh SCENE OUTPUT}
output=${2:?which output? sbatch slurm.sh SCENE OUTPUT}
shift 2
program=${ENTROSLIP:-build/release/bin/entroslip}
export OPENBLAS_NUM_THREADS=1 # else OpenBLAS starts threads that entroslip leaves idle

share=()
if [ -n "$SLURM_ARRAY_TASK_ID" ]; then share=(--share); fi

# mpirun hands SIGUSR1 on to every rank, and they end together; of SIGTERM it would die itself.
ask_to_stop() {
  echo "signalled: asking the run to stop"
  kill -USR1 "$run"
}
trap ask_to_stop USR1 TERM

count_kept() { # processes and blocks of samples that are finished
  find "$(readlink -f "$output").shards" -name '*.h5' 2>/dev/null | wc -l
}
kept=$(count_kept)

# shellcheck disable=SC2086   # words of options
mpirun $MPIRUN_OPTIONS -n "$SLURM_NTASKS" "$program" run "$scene" --output "$output" "${share[@]}" "$@" &
run=$!
while kill -0 "$run" 2>/dev/null; do
  wait "$run" # which a signal to this script ends early
done
wait "$run"
code=$?

if [ "$code" -eq 75 ] && [ "$(count_kept)" -eq "$kept" ]; then
  echo "not back into the queue: this start finished no block of samples; give it more time"
elif [ "$code" -eq 75 ]; then
  echo "back into the queue"
  # SLURM_JOB_ID of one member is the number of the whole array
  scontrol requeue "${SLURM_ARRAY_JOB_ID:-$SLURM_JOB_ID}${SLURM_ARRAY_TASK_ID:+_$SLURM_ARRAY_TASK_ID}"
fi
exit "$code"
