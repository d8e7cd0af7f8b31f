#!/bin/sh
# Trains what `tools/pack_training.py` has packed next to this script, or resumes:
# `sh train_packed.sh OUT`. Needs Python with torch, Lightning, numpy and OpenCV.
set -e
mkdir -p "$1"
out=$(cd "$1" && pwd)
cd "$(dirname "$0")"
sum=$(cat pack.tar.gz.* | cksum)
if [ ! -d run ]; then
    mkdir -p unpacked
    cat pack.tar.gz.* | tar xz -C unpacked
    if [ -d unpacked/wheels ]; then
        python3 -m pip install -q --no-index --no-deps --target unpacked/site unpacked/wheels/*.whl
    fi
    echo "$sum" > unpacked/pack.cksum
    mv unpacked run
elif [ "$sum" != "$(cat run/pack.cksum)" ]; then
    echo "error: $PWD/run is of other pieces than $PWD/pack.tar.gz.*: take a folder of their own" >&2
    exit 1
fi
cd run
PYTHONPATH=site exec python3 -m shaftpose.training.bare "$out"
