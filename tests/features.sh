#!/usr/bin/env bash
# Checks the crate kband in every combination of its features: for the desk, with its documentation, and for CPUs without an
# operating system.
#
#   tests/features.sh [CARGO...]    CARGO... compiles for these CPUs; cargo, if not given
set -eu
exec </dev/null
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- cargo
target=${CARGO_TARGET_DIR:-target}

# Plant and wire bring control.
combinations=('' analysis control plant wire analysis,plant,wire)

for features in "${combinations[@]}"; do
    for unstable in '' unstable; do
        echo "desk: ${features:-none} $unstable"
        cargo clippy --quiet --locked --package kband --lib --no-default-features --features "$features,$unstable" -- -D warnings
    done
    RUSTDOCFLAGS="-D warnings" cargo doc --quiet --locked --package kband --no-deps --no-default-features --features "$features" \
        --target-dir "$target/docs"
done
for cpu in thumbv7em-none-eabihf thumbv6m-none-eabi; do
    for features in "${combinations[@]}"; do
        echo "$cpu: ${features:-none}"
        "$@" clippy --config firmware/image.toml --quiet --locked --profile firmware --target "$cpu" --target-dir "$target/emulated" \
            --package kband --lib --no-default-features --features "$features" -- -D warnings
    done
done
