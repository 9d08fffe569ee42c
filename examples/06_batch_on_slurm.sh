#!/bin/bash
# Trim everything that a manifest lists on many machines: sbatch examples/06_batch_on_slurm.sh manifest.csv /scratch/out
#SBATCH --job-name=trim
#SBATCH --array=1-16
#SBATCH --cpus-per-task=8
#SBATCH --mem=32G
# Tasks that are killed or run out of time lose nothing that is finished: submit the same line again.
set -euo pipefail
manifest=$1 output=$2

# The first trim compiles kernels; the others find them here.
export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$HOME/.cache/gaussian-trimmer}"

python -m gaussian_trimmer batch "$manifest" --output "$output" \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers "$SLURM_CPUS_PER_TASK"
