#!/usr/bin/env bash
# Builds the board's image of the last commit in two folders, each with its own CARGO_HOME, and
# compares them. Takes a few minutes.
#
#   tests/reproducible.sh [TOOLCHAIN]   TOOLCHAIN such as +kband-thumb
set -eu
cd "$(dirname "$0")/.."
home=${CARGO_HOME:-$HOME/.cargo}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
unset CARGO_TARGET_DIR RUSTFLAGS CARGO_ENCODED_RUSTFLAGS

# build FOLDER HOME: prints the SHA-256 of the image, built in a clone in FOLDER with
# CARGO_HOME=HOME.
build() {
    git clone --quiet . "$1"
    mkdir -p "$2"
    ln -s "$home/registry" "$2/registry"
    (cd "$1" && CARGO_HOME=$2 cargo $toolchain feeder --quiet --locked --offline) >&2
    sha256sum <"$1/target/thumbv7em-none-eabihf/firmware/feeder"
}
toolchain=${1:-}
one=$(build "$work/a" "$work/home")
other=$(build "$work/another/folder" "$work/a/home of another")
echo "image: $one"
[ "$one" = "$other" ] || { echo "the image follows the folder: $other" >&2; exit 1; }
