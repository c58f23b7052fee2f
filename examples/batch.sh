#!/bin/sh
#SBATCH --job-name=mill --array=1-3 --ntasks=1 --cpus-per-task=2 --time=0:20:00
# Variants of the mill, a task of the array each:  sbatch examples/batch.sh
# The store keeps meshes and superelements, so that equal parts are reduced once.
set -- thick rollers rigid
shift $((SLURM_ARRAY_TASK_ID - 1))
export HEADSTOCK_STORE="${HEADSTOCK_STORE:-$PWD/results/store}"
exec ./headstock run machines/mill.toml --variant "$1" --analysis static --analysis modal -o "results/mill_$1"
