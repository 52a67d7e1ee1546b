#!/bin/sh
# SPDX-License-Identifier: MIT OR Apache-2.0
#
# Runs every peer that is there, each on one core, one line of JSON per variant on the
# standard output. A peer that is not there is named on the standard error together with
# what it needs, and the exit status is 1.
#
#   CORE=0 CC=gcc PYTHON=python3 ./run.sh
set -u

here=$(cd "$(dirname "$0")" && pwd)
core=${CORE:-0}
cc=${CC:-gcc}
python=${PYTHON:-python3}

missing=0
lack() {
    printf '%s\n' "missing: $1" "hint: $2" >&2
    missing=1
}

if ! command -v taskset >/dev/null; then
    lack "taskset, without which no peer is held to one core" "install util-linux"
    exit 1
fi

build=$(mktemp -d) || exit 1
trap 'rm -rf "$build"' EXIT
lines=$build/lines

# Runs a command on the one core, its lines both shown and kept.
pinned() {
    name=$1
    shift
    # Not a pipe, which would hide the status of the peer behind that of tee.
    taskset -c "$core" "$@" >"$build/out" || lack "$name, which failed" "see the message above"
    tee -a "$lines" <"$build/out"
}

# Builds a C program: name, then the arguments of the compiler.
compile() {
    name=$1
    shift
    "$cc" "$@" -o "$build/$name" -lm && return
    lack "$name, which does not build" "gcc 9 or later, glibc 2.22 or later with libmvec"
    return 1
}

if command -v "$cc" >/dev/null; then
    fast="-Ofast -march=native -fopenmp-simd"
    # Only on x86 has gcc an opinion on the width of vectors: half of what AVX-512 has.
    case $(uname -m) in x86_64) fast="$fast -mprefer-vector-width=512" ;; esac
    for real in double float; do
        # shellcheck disable=SC2086 # the flags are words
        compile "fleet-$real" $fast -DREAL=$real "$here/c/fleet.c" &&
            pinned "fleet-$real" "$build/fleet-$real"
    done
    case $(uname -m) in
    x86_64)
        compile fleet_intrinsics -O3 "$here/c/fleet_intrinsics.c" &&
            pinned fleet_intrinsics "$build/fleet_intrinsics"
        ;;
    *) lack "fleet_intrinsics, which is for x86-64" "run it on such a processor" ;;
    esac
else
    lack "$cc, for the peers in C" "install gcc, or set CC"
fi

for peer in jax:jax_rk4.py mujoco:mujoco_rollout.py; do
    module=${peer%%:*}
    script=${peer#*:}
    if "$python" -c "import $module" 2>/dev/null; then
        pinned "$script" "$python" -B "$here/$script"
    else
        lack "$module for $script" \
            "python3 -m venv .venv && .venv/bin/pip install -r $here/requirements.txt, then PYTHON=.venv/bin/python"
    fi
done

# The peers that integrate the same equations have to arrive at the same place: f64 up to
# rounding, f32 within the rounding of a thousand steps. MuJoCo compares itself.
if [ -s "$lines" ]; then
    awk -F'"' '/"check"/ && $4 !~ /mujoco/ {
        x = $0
        sub(/.*"check": /, "", x)
        x += 0
        bound = $4 ~ /f64/ ? 1e-9 : 1e-5
        if (first == "") first = x
        off = x - first
        if (off < 0) off = -off
        if (off > bound) {
            printf "disagrees: %s ends at x = %.12f, the first peer at %.12f\n", $4, x, first
            bad = 1
        }
    } END { exit bad }' "$lines" >&2 || missing=1
fi
exit "$missing"
