#!/usr/bin/env bash
# Draws the manual's pictures anew.
set -eu
cd "$(dirname "$0")"
kband() { cargo run --quiet --release -- "$@"; }
scene=$(mktemp --suffix .toml)
trap 'rm -f "$scene"' EXIT
kband simulate --print-scene | sed -e 's/^duration = .*/duration = 4.0/' -e 's/^gear = 1.*/locked = 1/' -e 's/^scatter = .*/scatter = 0.0/' >"$scene"
kband simulate "$scene" --out locked.svg --trace "${scene%.toml}.csv"
rm -f "${scene%.toml}.csv"
kband diagram --restitution 0.2 --k 0.3..0.5:300 --out diagram.svg
kband diagram --show regimes --k 0.1..0.8:140 --restitution 0..0.9:90 --out regimes.svg
kband basins --k 0.43 --restitution 0.2 --grid 60 --out basins.svg
kband transport --restitution 0.2 --incline 3 --out transport.svg
kband margins --out margins.svg
kband transport --restitution 0.2 --friction 0.3 --incline 3 --throw 0.4..3 --out friction.svg
kband bands --restitution 0.10..0.30 --second-tone 0.15,2.356 --orders 1 --out bands.svg
kband simulate --restitution 0.3 --compare-second-tone 0.15 --out tones.svg
