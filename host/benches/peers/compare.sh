#!/usr/bin/env bash
# Other programs on the launches of `kband bench`, in sequence on one core: CSV of kernel, workload,
# ns an impact. Missing ones are reported and left out: numba and heyoka of PYTHON (default
# python3), a C++ compiler with Boost.
#   host/benches/peers/compare.sh
#   PYTHON=venv/bin/python host/benches/peers/compare.sh
set -eu
cd "$(dirname "$0")"
python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PYTHONDONTWRITEBYTECODE=1
echo "kernel,workload,impact_time (ns)"
if "$python" -c "import numba" 2>"$work/why"; then
    "$python" textbook.py
else
    echo "numba left out: $(tail -n 1 "$work/why")" >&2
fi
if "$python" -c "import heyoka" 2>"$work/why"; then
    "$python" event.py
else
    echo "heyoka left out: $(tail -n 1 "$work/why")" >&2
fi
if ${CXX:-c++} -std=c++17 -O3 -march=native -o "$work/toms748" toms748.cpp 2>"$work/why"; then
    "$work/toms748"
else
    echo "C++ left out: $(head -n 1 "$work/why")" >&2
fi
