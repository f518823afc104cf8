#!/usr/bin/env bash
# Runs the checks of the project; exit status 0 if all passed.
#
#   tests/run.sh                            every check that a change must pass
#   tests/run.sh --soak [MILLIONS [SEED]]   long runs: 100 million launches of every arithmetic, a day
#                                           and a week of operation, a million frames on the link, the
#                                           listed mutants, and 5 minutes of search for each fuzz target
#   tests/run.sh --mutants [COUNT [SEED]]   300 drawn mutants, of which 90 % must be caught; needs
#                                           cargo install --locked cargo-mutants
#   tests/run.sh --mutants listed [WHICH..] the mutants of tests/mutants/mutants.toml
#   tests/run.sh --drawn [MINUTES [SEED]]   30 minutes of drawn scenes, settings, requests and power cuts;
#                                           each round prints its seed. A seed that fails becomes a test
#   tests/run.sh --fuzz [SECONDS [TARGET..]] the search for inputs alone, 60 s for each target
#   tests/run.sh --reproducible             the image of the board from two folders: the same bits
#   tests/run.sh --features                 the desk with every cargo feature (probe, MQTT)
#
# A million launches take 4 s of a core on one tone and 5 s on several: 1000 million take 1 to 2
# hours.
#
# Each step prints its name, its time and its last lines. Its complete output is in
# target/run/STEP.log; the end is printed if the step fails. A step that exceeds its limit is
# killed, with every process that it started. After the first two steps there is no network.
set -u
exec </dev/null
cd "$(dirname "$0")/.." || exit 1
case ${1:-} in
'' | --soak | --mutants | --drawn | --fuzz | --reproducible | --features) ;;
--help | -h)
    sed -n '2,/^set -u/{/^#/s/^# \{0,1\}//p}' tests/run.sh
    exit 0
    ;;
*)
    echo "tests/run.sh: no option $1; tests/run.sh --help lists them"
    exit 2
    ;;
esac
ulimit -c 0
[ -d "${CARGO_HOME:-${HOME:-/root}/.cargo}/bin" ] && PATH="${CARGO_HOME:-${HOME:-/root}/.cargo}/bin:$PATH"

export CARGO_TERM_COLOR=never CARGO_TERM_PROGRESS_WHEN=never CARGO_NET_RETRY=3 CARGO_HTTP_TIMEOUT=30
export RUST_BACKTRACE=0 GIT_TERMINAL_PROMPT=0
unset CARGO_BUILD_TARGET RUSTFLAGS CARGO_ENCODED_RUSTFLAGS
target=${CARGO_TARGET_DIR:-target}
case $target in /*) ;; *) target=$PWD/$target ;; esac
export CARGO_TARGET_DIR=$target
logs=$target/run
mkdir -p "$logs" || exit 1

thumb=thumbv7em-none-eabihf
small=thumbv6m-none-eabi
passed=0 failures=() began=$SECONDS running='' mark=''

# Every process of a step carries the step's mark in its environment.
left_over() {
    [ -z "$mark" ] || grep -lzx "KBAND_STEP=$mark" /proc/[0-9]*/environ 2>/dev/null | cut -d / -f 3
}
sweep() {
    local process
    for process in $(left_over); do
        echo "    left running, killed: $process $(tr '\0' ' ' <"/proc/$process/cmdline" 2>/dev/null | cut -c 1-120)"
        kill -KILL "$process" 2>/dev/null
    done
}
stop() {
    [ -z "$running" ] || kill -TERM "$running" 2>/dev/null
    sleep 1
    sweep
    echo "tests/run.sh: stopped"
    exit 130
}
trap stop INT TERM HUP

# Prints name and result line of every test program with tests, and measured sizes and counts.
closing_lines() {
    awk '/^     Running |^   Doc-tests / { name = $NF; gsub(/.*\/|-[0-9a-f]+\)$/, "", name) }
        /^test result:/ && !/ 0 passed; 0 failed; 0 ignored/ { print "   " name ": " $0 }
        /^setup: ready|KiB of flash|instructions a (sample|cycle)|stack [0-9]+ of|^panics left|^dependencies: |^fuzz: |^flood: |^mutants: |^capture plan|^instructions .* orbits |^every impact of|launches of seed [0-9]+, none missed|^[0-9]+ passed.* in [0-9.]+s/ { print "   " $0 }' "$1"
}

# step NAME LIMIT COMMAND...: LIMIT in seconds.
step() {
    local name=$1 limit=$2 start=$SECONDS status log
    shift 2
    log=$logs/${name// /-}.log
    mark=$$.$passed.${#failures[@]}
    printf '== %s (limit %s s)\n' "$name" "$limit"
    KBAND_STEP=$mark timeout --kill-after=10 "$limit" "$@" >"$log" 2>&1 &
    running=$!
    wait "$running"
    status=$?
    running=''
    closing_lines "$log"
    sweep
    if [ $status = 0 ]; then
        passed=$((passed + 1))
        printf '   ok, %s s\n' $((SECONDS - start))
    else
        failures+=("$name")
        tail -n 60 "$log" | cut -c 1-200 | tail -c 6000
        [ $status != 124 ] && [ $status != 137 ] || echo "   cut by its limit of $limit s"
        printf '   FAILED (exit status %s), %s s; all of it: %s\n' $status $((SECONDS - start)) "$log"
    fi
    return $status
}
finish() {
    local summary="$passed steps passed, ${#failures[@]} failed, $((SECONDS - began)) s"
    if [ ${#failures[@]} = 0 ]; then
        echo "tests/run.sh: all passed: $summary"
        exit 0
    fi
    local IFS=,
    echo "tests/run.sh: FAILED: ${failures[*]}: $summary"
    exit 1
}

step "set-up" 1500 tests/setup.sh || finish
step "download crates" 400 cargo fetch --locked || finish
export CARGO_NET_OFFLINE=true

if [ "${1:-}" = --soak ]; then
    millions=${2:-100} seed=${3:-1}
    case $millions$seed in *[!0-9]*) echo "tests/run.sh: --soak takes a number of millions and a seed"; exit 2 ;; esac
    step "soak" $((7200 + 120 * millions)) env KBAND_MILLIONS="$millions" KBAND_SEED="$seed" \
        cargo test --release --locked --package kband-tests --test first_impact -- --nocapture
    step "random scenes" 7200 env KBAND_SCENES=2000 KBAND_SEED=2 \
        cargo test --release --locked --package kband-tests --test random_scenes -- --nocapture
    step "day" 7200 env KBAND_DAYS=1 cargo test --release --locked --package kband-tests --test day
    step "flood" 7200 env KBAND_FRAMES=1000000 KBAND_SEED=2 \
        cargo test --release --locked --package kband-tests --test flood -- --nocapture
    step "hostile frames" 7200 env KBAND_FUZZED=1000000 KBAND_SEED=2 KBAND_TARGETS="bus frames" \
        cargo test --release --locked --package kband-fuzz --test inputs -- --nocapture
    step "power cuts of an update" 7200 env KBAND_EVERY_CUT=1 KBAND_CUTS=10 \
        cargo test --release --locked --package kband-machines --test update -- --nocapture
    step "mutants" 14400 tests/mutants/run.py
    step "search by coverage" 7200 tests/fuzz/run.sh 300
    step "week" 7200 env KBAND_DAYS=7 cargo test --release --locked --package kband-tests --test day
    finish
fi

if [ "${1:-}" = --mutants ]; then
    shift
    if [ "${1:-}" = listed ]; then
        shift
        step "mutants" 14400 tests/mutants/run.py "$@"
        finish
    fi
    count=${1:-300} seed=${2:-$RANDOM}
    case $count$seed in *[!0-9]*) echo "tests/run.sh: --mutants takes a count and a seed, or: listed"; exit 2 ;; esac
    echo "mutants of seed $seed"
    step "drawn mutants" 28800 tests/mutants/run.py --drawn "$count" "$seed"
    finish
fi

if [ "${1:-}" = --drawn ]; then
    minutes=${2:-30} seed=${3:-$RANDOM}
    case $minutes$seed in *[!0-9]*) echo "tests/run.sh: --drawn takes a number of minutes and a seed"; exit 2 ;; esac
    step "test builds" 3600 cargo test --locked --no-run --package kband-control --package kband-plant --package kband-firmware \
        --package kband-fuzz --package kband-tests --test random_scenes --test loops --test inputs --lib || finish
    export KBAND_SCENES=100 KBAND_LOTS=30 KBAND_FUZZED=20000
    while [ $((SECONDS - began)) -lt $((60 * minutes)) ] && [ ${#failures[@]} = 0 ]; do
        export KBAND_SEED=$seed
        step "scenes of seed $seed" 7200 cargo test --locked --package kband-tests --test random_scenes
        step "feeders of seed $seed" 7200 cargo test --locked --package kband-plant --lib drawn
        step "lots of seed $seed" 7200 cargo test --locked --package kband-plant --test loops lots
        step "machines of seed $seed" 7200 cargo test --locked --package kband-plant --test loops bounds
        step "settings of seed $seed" 7200 cargo test --locked --package kband-control --lib bounds
        step "requests and power cuts of seed $seed" 7200 cargo test --locked --package kband-firmware --lib
        step "inputs of seed $seed" 7200 cargo test --locked --package kband-fuzz --test inputs
        seed=$((seed + 1))
    done
    finish
fi

if [ "${1:-}" = --fuzz ]; then
    shift
    case ${1:-60} in *[!0-9]*) echo "tests/run.sh: --fuzz takes a number of seconds, then targets"; exit 2 ;; esac
    step "search by coverage" $((3600 + 15 * ${1:-60})) tests/fuzz/run.sh "$@"
    finish
fi

# The toolchain that compiles for the targets: rustup's, or the one that tests/setup.sh built.
cross=cargo
compgen -G "$(rustc --print target-libdir --target $thumb)/libcore-*.rlib" >/dev/null || cross='cargo +kband-thumb'

if [ "${1:-}" = --reproducible ]; then
    step "same bits from two folders" 2400 tests/reproducible.sh ${cross#cargo}
    finish
fi

if [ "${1:-}" = --features ]; then
    step "clippy for all features of the desk" 2400 cargo clippy --locked --package kband-host --all-features --all-targets \
        -- -D warnings
    step "desk with all features" 2400 cargo build --locked --package kband-host --all-features --bin kband
    step "probe before an emulated chip" 1200 cargo test --locked --package kband-host --features flash --test probe
    step "readings and events at a broker" 1200 cargo test --locked --package kband-host --features mqtt --test serve -- mqtt
    step "unit tests with all features" 1200 cargo test --locked --package kband-host --all-features --lib
    finish
fi

step "format" 60 cargo fmt --all --check
step "clippy for the desk" 1200 cargo clippy --locked --workspace --exclude kband-python --all-targets -- -D warnings
# With profile and folder of the images, build scripts and macros are compiled once for both.
step "clippy for the target" 1200 $cross clippy --config firmware/image.toml --locked --profile firmware --target $thumb \
    --target-dir "$target/emulated" --package kband-firmware --package kband-loader --package kband-emulated -- -D warnings
# The tests need these images, built with the same arguments. One package at a time: together the
# packages would get each other's features. The second board is built first, because the image of
# the first one overwrites it.
image() {
    local name=$1
    shift
    step "$name" 1200 $cross build --config firmware/image.toml --locked --profile firmware --target-dir "$target/emulated" "$@"
}
step "dependencies" 60 tests/dependencies.py
image "images for the emulated CPU" --package kband-emulated --bins --target $thumb
image "images for the emulated small CPU" --package kband-emulated --bin kernel_bits --bin kernel_cost --target $small
image "image of the second board" --package kband-firmware --bin feeder --target $thumb \
    --no-default-features --features stm32g474re
image "images of the application" --package kband-firmware --bins --target $thumb
step "test builds" 1200 cargo test --locked --no-run
step "unit tests" 600 cargo test --locked --no-fail-fast --lib --bins --examples
step "doc tests" 600 cargo test --locked --no-fail-fast --doc
step "integration and emulated tests" 1200 tests/programs.py
step "Python package" 900 bindings/python/test.sh
RUSTDOCFLAGS=-Dwarnings step "documentation" 600 cargo doc --locked --workspace --exclude kband-python --no-deps --lib
finish
