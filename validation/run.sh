#!/usr/bin/env bash
# Runs the controller on physics engines of other projects, and writes the tables of
# validation/results/README.md. It is not part of tests/run.sh. On a Debian machine it installs
# YADE and Siconos with apt, and MuJoCo with pip.
#
#   validation/run.sh                    every row, 20 runs each, on one core
#   validation/run.sh --runs 3 b g       some rows with fewer runs
#   validation/run.sh --table            the tables from the results alone
#
# A row begins anew, and replaces its file in validation/results.
set -eu
cd "$(dirname "$0")/.."
root=$PWD
work=${CARGO_TARGET_DIR:-$root/target}/validation
wheels=$work/wheels site=$work/site venv=$work/venv jobs=$work/jobs
runs=20
rows=()
only_table=
while [ $# -gt 0 ]; do
    case $1 in
    --runs) runs=$2 && shift ;;
    --table) only_table=1 ;;
    [a-g]) rows+=("$1") ;;
    *) echo "run.sh: $1 is refused; accepted: --runs N, --table and rows a to g" >&2 && exit 2 ;;
    esac
    shift
done
[ ${#rows[@]} -gt 0 ] || rows=(a b c d e f g)

if ! command -v yade >/dev/null || ! /usr/bin/python3 -c 'import siconos.kernel' 2>/dev/null; then
    DEBIAN_FRONTEND=noninteractive timeout 1800 \
        apt-get -y -q install --no-install-recommends yade python3-siconos </dev/null
fi
mkdir -p "$work" "$jobs"
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check \
    maturin==1.16.0 mujoco==4.0.0 numpy==2.4.6
rm -rf "$wheels" "$site"
PATH=$venv/bin:$PATH maturin build --locked --release \
    --manifest-path bindings/python/Cargo.toml --out "$wheels"
"$venv/bin/pip" install --quiet --no-deps --target "$site" "$wheels"/kband-*.whl
export PYTHONPATH=$site PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1

[ -z "$only_table" ] || rows=()
for row in "${rows[@]}"; do
    results=validation/results/$row.csv
    rm -f "$jobs"/*.json "$results"
    "$venv/bin/python" validation/rows.py "$jobs" --runs "$runs" "$row"
    for job in "$jobs"/*.json; do
        case $job in
        # YADE and Siconos are built for Debian's Python.
        *-yade.json) nice -n 10 yade -n -x -j1 validation/yade_engine.py "$job" "$results" ;;
        *-siconos.json)
            nice -n 10 /usr/bin/python3 validation/siconos_engine.py "$job" "$results"
            ;;
        *) nice -n 10 "$venv/bin/python" validation/mujoco_engine.py "$job" "$results" ;;
        esac
        "$venv/bin/python" validation/own_plant.py "$job" "$results"
    done
done
"$venv/bin/python" validation/table.py validation/results validation/results/README.md
