#!/usr/bin/env bash
# Fuzzes every input of kband, guided by coverage, with libFuzzer and the address sanitizer.
#
#   tests/fuzz/run.sh [SECONDS [TARGET...]]   60 seconds for each target, by default for all but log,
#                                             which needs a board's image with a log
#
# Prints for each target the number of inputs tried, of branches reached, and the size of the corpus
# in target/fuzz/corpus/TARGET. Exit status 1 if an input failed: it is in target/fuzz/failed.
# Repeat it:
#   KBAND_FUZZ=TARGET target/fuzz/x86_64-unknown-linux-gnu/release/fuzz FILE
# tests/fuzz/keep.py copies new inputs into the tree, where the next search begins. The compiler is
# the stable one, with RUSTC_BOOTSTRAP for -Zsanitizer only. If the sanitizer's runtime is missing,
# the search runs without it and prints a message.
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
# Link-time optimization would be slow and useless here.
export CARGO_PROFILE_RELEASE_LTO=off
# --target keeps the build scripts apart from the instrumented program.
RUSTFLAGS=$flags cargo build --locked --release --package kband-fuzz --features libfuzzer --bin fuzz --target "$host" \
    --target-dir "$folder" || exit 1

targets=("$@")
[ $# != 0 ] || targets=(scene settings recipes rows record elf frames bus service store)
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
