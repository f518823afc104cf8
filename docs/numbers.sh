#!/usr/bin/env bash
# Makes every number, table and picture of the manual anew that comes from a command: some 15
# minutes of one core.
#   docs/numbers.sh          writes them
#   docs/numbers.sh --check  only says which are no longer what the commands say
set -eu
cd "$(dirname "$0")/.."
case ${1-} in
    '') accept=1 ;;
    --check) accept=0 ;;
    *) echo "docs/numbers.sh: takes --check or nothing" >&2; exit 2 ;;
esac
export KBAND_ACCEPT=$accept
# One after another: they write into the same pages.
cargo test --quiet --release -p kband-host --test tables -- --include-ignored --test-threads 1
docs/pictures/draw.sh "$@"
