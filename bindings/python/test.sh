#!/usr/bin/env bash
# Builds the Python wheel and checks it: clippy, types, stubs, tests. tests/setup.sh has installed
# what it needs.
#
#   bindings/python/test.sh             with the profile of the tests
#   bindings/python/test.sh --release   with the release's
#
# It needs no network.
set -eu
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
case $target in /*) ;; *) target=$PWD/$target ;; esac
export CARGO_TARGET_DIR=$target CARGO_NET_OFFLINE=true VIRTUAL_ENV=$target/python/venv
export PATH=$VIRTUAL_ENV/bin:$PATH PYTHONDONTWRITEBYTECODE=1 MYPY_CACHE_DIR=$target/python/mypy
profile='--profile dev'
[ "${1:-}" != --release ] || profile=--release
cargo clippy --locked --package kband-python -- -D warnings
wheels=$target/python/wheels
site=$target/python/site
rm -rf "$wheels" "$site"
# shellcheck disable=SC2086
maturin build --locked --manifest-path bindings/python/Cargo.toml --out "$wheels" $profile
pip install --quiet --no-index --no-deps --target "$site" "$wheels"/kband-*.whl
export PYTHONPATH=$site
cd bindings/python
mypy --strict python/kband tests
stubtest kband._kband
pytest -p no:cacheprovider tests
