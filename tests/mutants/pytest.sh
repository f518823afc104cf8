#!/bin/sh
# The tests of the Python package with the options of a test program of cargo. It runs in
# bindings/python of the copied tree, with the environment that tests/setup.sh made.
#
#   pytest.sh --list --format=terse
#   pytest.sh --exact --test-threads=1 TEST...
set -eu
python=$CARGO_TARGET_DIR/../python/venv/bin/python
export PYTHONPATH=python PYTHONDONTWRITEBYTECODE=1
if [ "$1" = --list ]; then
    "$python" -m pytest -p no:cacheprovider --collect-only tests | sed -n '/::/s/$/: test/p'
    exit
fi
shift 2
exec "$python" -m pytest -x -p no:cacheprovider "$@"
