#!/usr/bin/env bash
# Makes every number, table and picture of the manual anew that comes from a command: minutes on two cores.
#   docs/numbers.sh          writes them
#   docs/numbers.sh --check  only says which are no longer what the commands say
set -eu
cd "$(dirname "$0")/.."
accept=1
[ "${1:-}" = --check ] && accept=0
cargo build --release --quiet --bin kband
export KBAND=$PWD/${CARGO_TARGET_DIR:-target}/release/kband
KBAND_ACCEPT=$accept cargo test --quiet -p kband-host --test tables -- --include-ignored --test-threads 1
KBAND_ACCEPT=$accept cargo test --quiet -p kband-host --test schemas
docs/pictures/draw.sh "$@"
