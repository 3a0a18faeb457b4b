#!/usr/bin/env bash
# Sampled scenes to tracks, one at a time in each task of a Slurm array:
#   sbatch --array=0-99 slurm_array.sh SHOTS TRACKS
# SHOTS is a folder of NAME.npz, TRACKS gets a folder NAME each. Fewer tasks than shots take several each. A shot that is
# there is not done again, so the same line goes on after a task was ended: each appears whole or not at all.
#SBATCH --job-name=dermis
#SBATCH --cpus-per-task=1
#SBATCH --mem=4G
#SBATCH --time=04:00:00
set -u
shots=${1:?folder of shots} tracks=${2:?folder for tracks}
task=${SLURM_ARRAY_TASK_ID:?run it by sbatch --array} tasks=${SLURM_ARRAY_TASK_COUNT:-1} first=${SLURM_ARRAY_TASK_MIN:-0}
python=${DERMIS_PYTHON:-python3} package=${DERMIS_PACKAGE:-dermis}
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

mkdir -p "$tracks" || exit 2
status=0
number=0
for shot in "$shots"/*.npz; do
    mine=$((number % tasks == task - first))
    number=$((number + 1))
    name=$(basename "$shot" .npz)
    if [ "$mine" = 0 ] || [ -e "$tracks/$name" ]; then continue; fi
    part=$(mktemp -d "$tracks/.$name.XXXXXX") || exit 2
    "$python" -m "$package" render "$shot" --out "$part/new" --workers 1 --quiet
    code=$?
    # 1: tracks were written, with findings of severity error
    if [ "$code" -le 1 ] && [ ! -e "$tracks/$name" ]; then mv "$part/new" "$tracks/$name" || code=2; fi
    rm -rf "$part"
    if [ "$code" -gt "$status" ]; then status=$code; fi
done
exit "$status"
