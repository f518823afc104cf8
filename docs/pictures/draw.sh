#!/usr/bin/env bash
# Draws the manual's pictures anew, where they are no longer what their command draws.
#   docs/pictures/draw.sh          writes them
#   docs/pictures/draw.sh --check  only names them, and fails
# KBAND names another kband than that of a release build.
set -eu
pictures=$(cd "$(dirname "$0")" && pwd)
root=$pictures/../..
if [ -z "${KBAND:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --bin kband
    KBAND=${CARGO_TARGET_DIR:-$root/target}/release/kband
fi
kband() { "$KBAND" "$@" >/dev/null 2>told || { cat told >&2; exit 1; }; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"$KBAND" simulate --print-scene | sed -e 's/^duration = .*/duration = 4.0/' -e 's/^gear = 1.*/locked = 1/' -e 's/^scatter = .*/scatter = 0.0/' >lock.toml
kband simulate lock.toml --out locked.svg --trace trace.csv
kband diagram --restitution 0.2 --k 0.3..0.5:300 --out diagram.svg
kband diagram --show regimes --k 0.1..0.8:140 --restitution 0..0.9:90 --out regimes.svg
kband basins --k 0.43 --restitution 0.2 --grid 60 --out basins.svg
kband transport --restitution 0.2 --incline 3 --out transport.svg
kband margins --out margins.svg
kband transport --restitution 0.2 --friction 0.3 --incline 3 --throw 0.4..3 --out friction.svg
kband bands --restitution 0.10..0.30 --second-tone 0.15,2.356 --orders 1 --out bands.svg
"$KBAND" simulate --print-scene | sed 's/^second_tone = 0.0/second_tone = 0.15/' >tones.toml
kband simulate tones.toml --restitution 0.3 --out tones.svg --trace trace.csv
cp "$root/tests/scenes/hopper_dump.toml" dump.toml
kband simulate dump.toml --out dump.svg --trace trace.csv
# A picture says of itself which commit drew it, and so never has that of the commit it is in.
plain() { grep -v '^<metadata>' "$1"; }
wrong=0
for drawn in *.svg; do
    kept=$pictures/$drawn
    if [ -f "$kept" ] && grep -q '^<metadata>' "$kept" && cmp -s <(plain "$drawn") <(plain "$kept"); then
        continue
    fi
    if [ "${1:-}" = --check ]; then
        echo "$drawn is no longer what its command draws"
        wrong=1
    else
        cp "$drawn" "$kept"
        echo "drew $drawn"
    fi
done
exit $wrong
