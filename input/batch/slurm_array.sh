#!/bin/bash
# A scene as a Slurm job array, whose members share its work, and a job that merges what they leave.
# Not a job itself: start it where you would start sbatch.
#
#   input/batch/slurm_array.sh MEMBERS SCENE OUTPUT [options of sbatch, such as --time=01:00:00]
#
# Members start when the queue lets them, few or all at once; each takes blocks of samples that no
# other has and keeps them beside OUTPUT, on a file system that all of them see. One that runs out of
# wall time goes back into the queue. The last job runs when all members are done: it finds every
# sample there, computes what a member that was killed has left, and writes OUTPUT.
set -euo pipefail

members=${1:?how many members? slurm_array.sh MEMBERS SCENE OUTPUT}
scene=${2:?which scene? slurm_array.sh MEMBERS SCENE OUTPUT}
output=${3:?which output? slurm_array.sh MEMBERS SCENE OUTPUT}
shift 3
job=$(dirname "$0")/slurm.sh

array=$(sbatch --parsable --array="1-$members" "$@" "$job" "$scene" "$output")
merge=$(sbatch --parsable --dependency="afterany:$array" "$@" "$job" "$scene" "$output")
echo "members $array, merging $merge"
