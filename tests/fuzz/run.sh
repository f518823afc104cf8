#!/usr/bin/env bash
# Searches every way into kband by coverage, with libFuzzer and the address sanitizer.
#
#   tests/fuzz/run.sh [SECONDS [TARGET...]]   60 seconds for each target; all of them but log, which needs a board's image with a log
#
# Prints for each target how many inputs were tried, how many branches they reached and the corpus that they left in
# target/fuzz/corpus/TARGET; exit status 1 where an input failed: it lies in target/fuzz/failed and runs again with
#   KBAND_FUZZ=TARGET target/fuzz/x86_64-unknown-linux-gnu/release/fuzz FILE
# What it found worth keeping goes into the tree by tests/fuzz/keep.py, and is where the next search begins.
# The compiler is the stable one. -Zsanitizer is the only thing that it has to be talked into; where its runtime is missing the
# search runs without, and says so.
set -u
cd "$(dirname "$0")/../.." || exit 1
seconds=${1:-60}
[ $# = 0 ] || shift
host=$(rustc -vV | sed -n 's/^host: //p')
folder=${CARGO_TARGET_DIR:-$PWD/target}/fuzz
mkdir -p "$folder/corpus" "$folder/failed" || exit 1

flags="--cfg fuzzing -Cdebug-assertions -Coverflow-checks -Ccodegen-units=4 -Cpasses=sancov-module"
for argument in level=4 inline-8bit-counters pc-table trace-compares; do
    flags="$flags -Cllvm-args=-sanitizer-coverage-$argument"
done
if compgen -G "$(rustc --print target-libdir)/librustc*_rt.asan.a" >/dev/null; then
    flags="$flags -Zsanitizer=address"
    export RUSTC_BOOTSTRAP=1 ASAN_OPTIONS=detect_leaks=0:abort_on_error=1
    echo "with the address sanitizer"
else
    echo "without the address sanitizer: this compiler has no runtime of it"
fi
# Across crates nothing is to be gained here, and it takes long.
export CARGO_PROFILE_RELEASE_LTO=off
# Once for the programs that run here while it builds, once for the search: --target keeps them apart.
features=libfuzzer
case " $* " in *" log "*) features=libfuzzer,log ;; esac
RUSTFLAGS=$flags cargo build --locked --release --package kband-fuzz --features "$features" --bin fuzz --target "$host" \
    --target-dir "$folder" || exit 1

targets=("$@")
[ $# != 0 ] || targets=(scene settings rows record elf frames bus service store)
failed=0
for target in "${targets[@]}"; do
    corpus=$folder/corpus/$target log=$folder/$target.log
    mkdir -p "$corpus"
    found=$folder/found/$target
    mkdir -p "$found"
    tests/fuzz/keep.py --unpack "$target" "$found" || exit 1
    seeds=("tests/fuzz/corpus/$target" "$found")
    [ "$target" != scene ] || seeds+=(tests/scenes)
    KBAND_FUZZ=$target "$folder/$host/release/fuzz" -max_total_time="$seconds" -max_len=4096 -timeout=20 -rss_limit_mb=4096 \
        -print_final_stats=1 -artifact_prefix="$folder/failed/$target-" "$corpus" "${seeds[@]}" >"$log" 2>&1
    status=$?
    tried=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    covered=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
    echo "fuzz: $target ${tried:-0} inputs, ${covered:-0} branches, corpus $(find "$corpus" -type f | wc -l), exit status $status"
    if [ $status != 0 ]; then
        failed=1
        grep -E "panicked|ERROR:|SUMMARY" -A 3 "$log" | head -n 20
    fi
done
exit $failed
