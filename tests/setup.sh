#!/usr/bin/env bash
# Installs what the tests need on a Debian machine with rustup: the thumb targets, QEMU 9.2 or
# newer, Chromium with its driver, gcc, valgrind, mbpoll, libmodbus and mosquitto. Python packages
# go into a virtual environment below target. Safe to repeat; if nothing is missing it takes about a
# second.
#
#   tests/setup.sh            install what is missing
#   tests/setup.sh --check    install nothing; exit status 1 and one line if something is missing
#
# No step waits without end: standard input is empty and every download has a time limit.
set -u
exec </dev/null
cd "$(dirname "$0")/.." || exit 1

targets=(thumbv7em-none-eabihf thumbv6m-none-eabi)
linked=kband-thumb # toolchain built from Debian's sources; tests/machines/src/images.rs uses it too
wanted=9.2
packages=/usr/lib/rustlib

export DEBIAN_FRONTEND=noninteractive NEEDRESTART_SUSPEND=1 CARGO_NET_RETRY=3 CARGO_HTTP_TIMEOUT=30

say() { printf 'setup: %s\n' "$*"; }
give_up() {
    printf 'setup: %s\n' "$*" >&2
    exit 1
}

# A toolchain compiles for a target if its folder of libraries has the target's core library.
compiles_for() {
    local library
    library=$(timeout 20 rustc ${2:+"+$2"} --print target-libdir --target "$1" 2>/dev/null) &&
        compgen -G "$library/libcore-*.rlib" >/dev/null
}
missing_targets() {
    local target
    for target in "${targets[@]}"; do
        compiles_for "$target" || compiles_for "$target" "$linked" || echo "$target"
    done
}

emulator_version() {
    timeout 20 qemu-system-arm --version 2>/dev/null | sed -n 's/^QEMU emulator version \([0-9.]*\).*/\1/p'
}
emulator_is_new_enough() {
    local version
    version=$(emulator_version)
    [ -n "$version" ] && [ "$(printf '%s\n' "$wanted" "$version" | sort -V | head -n 1)" = "$wanted" ]
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n --preserve-env=DEBIAN_FRONTEND,NEEDRESTART_SUSPEND "$@"; fi
}
# Uses Debian's own sources only: an unreachable server of a third party would cost minutes.
apt_get() {
    local limit=$1
    shift
    as_root timeout --kill-after=20 "$limit" apt-get -y -q \
        -o Acquire::Retries=3 -o Acquire::http::Timeout=20 -o Acquire::https::Timeout=20 \
        -o DPkg::Lock::Timeout=120 -o APT::Get::List-Cleanup=false \
        -o Dpkg::Options::=--force-confdef -o Dpkg::Options::=--force-confold \
        -o Dir::Etc::sourcelist=/dev/null -o Dir::Etc::sourceparts="$sources" "$@"
}
debian_sources() {
    . /etc/os-release
    [ "${ID:-}" = debian ] || return 1
    sources=$(mktemp -d) || return 1
    chmod 755 "$sources"
    trap 'rm -rf "$sources"' EXIT
    local suite=$VERSION_CODENAME line='deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http'
    {
        echo "$line://deb.debian.org/debian $suite main"
        echo "$line://deb.debian.org/debian $suite-updates main"
        echo "$line://deb.debian.org/debian-security $suite-security main"
        # Debian 12's own QEMU is 7.2; Debian 13's is new enough.
        [ "$suite" != bookworm ] || echo "$line://deb.debian.org/debian bookworm-backports main"
    } >"$sources/debian.list"
    apt_get 300 update
}

install_emulator() {
    say "installing QEMU with apt"
    [ -n "${sources:-}" ] || debian_sources || return 1
    if [ "$VERSION_CODENAME" = bookworm ]; then
        apt_get 600 install --no-install-recommends -t bookworm-backports qemu-system-arm
    else
        apt_get 600 install --no-install-recommends qemu-system-arm
    fi
}

install_browser() {
    say "installing Chromium with apt"
    [ -n "${sources:-}" ] || debian_sources || return 1
    apt_get 900 install --no-install-recommends chromium chromium-driver
}
browser_is_there() { command -v chromedriver >/dev/null && command -v chromium >/dev/null; }

# A compiler and a memory checker for the C interface, Modbus masters, and a broker of MQTT.
install_tools() {
    say "installing gcc, valgrind, mbpoll, libmodbus and mosquitto with apt"
    [ -n "${sources:-}" ] || debian_sources || return 1
    apt_get 600 install --no-install-recommends gcc libc6-dev valgrind mbpoll libmodbus-dev mosquitto mosquitto-clients
}
tools_are_there() {
    local tool
    for tool in gcc nm valgrind mbpoll mosquitto mosquitto_sub; do command -v "$tool" >/dev/null || return 1; done
    [ -f /usr/include/modbus/modbus.h ]
}

# A copy of the list of Python packages is written after they are all installed.
python_packages=tests/requirements.txt
venv=${CARGO_TARGET_DIR:-target}/python/venv
python_is_there() { cmp -s "$python_packages" "$venv/requirements.txt"; }
install_python() {
    say "installing Python packages with pip"
    if ! timeout 60 python3 -c 'import ensurepip' 2>/dev/null; then
        [ -n "${sources:-}" ] || debian_sources || return 1
        apt_get 600 install --no-install-recommends python3 python3-venv || return 1
    fi
    rm -rf "$venv"
    timeout --kill-after=10 120 python3 -m venv "$venv" &&
        timeout --kill-after=10 600 "$venv/bin/pip" install --quiet --disable-pip-version-check \
            --retries 3 --timeout 20 --requirement "$python_packages" &&
        cp "$python_packages" "$venv/requirements.txt"
}

# If rustup cannot download: builds core and alloc for the targets once, with Debian's compiler and
# source package, and links that toolchain into rustup.
install_targets_from_debian() {
    say "building the targets' core library with Debian's compiler"
    [ -n "${sources:-}" ] || debian_sources || return 1
    apt_get 600 install --no-install-recommends rustc-web cargo-web rust-web-src rust-web-clippy lld || return 1
    local work target library
    work=$(mktemp -d) || return 1
    mkdir "$work/src"
    printf '#![no_std]\n' >"$work/src/lib.rs"
    printf '[package]\nname = "core-only"\nedition = "2021"\n[workspace]\n' >"$work/Cargo.toml"
    for target in "${targets[@]}"; do
        # Without the embedded bitcode link-time optimization fails: "Can't find section .llvmbc".
        (cd "$work" && env -u RUSTUP_TOOLCHAIN -u CARGO_TARGET_DIR PATH="/usr/bin:$PATH" RUSTC=/usr/bin/rustc \
            RUSTC_BOOTSTRAP=1 CARGO_PROFILE_RELEASE_LTO=fat RUSTFLAGS=-Cembed-bitcode=yes \
            timeout --kill-after=20 600 /usr/bin/cargo build --release -Zbuild-std=core,alloc --target "$target") || return 1
        library=$packages/$target/lib
        as_root mkdir -p "$library" || return 1
        as_root cp "$work/target/$target"/release/deps/lib{core,alloc,compiler_builtins}-*.rlib "$library/" || return 1
    done
    rm -rf "$work"
    as_root mkdir -p "$packages/x86_64-unknown-linux-gnu/bin" &&
        as_root ln -sf /usr/bin/lld "$packages/x86_64-unknown-linux-gnu/bin/rust-lld" &&
        timeout 60 rustup toolchain link "$linked" /usr
}

command -v rustup >/dev/null || PATH="${CARGO_HOME:-${HOME:-/root}/.cargo}/bin:$PATH"
command -v cargo >/dev/null || give_up "no Rust here; install it from https://rustup.rs, then run tests/setup.sh"

missing=$(missing_targets | tr '\n' ' ')
if [ "${1:-}" = --check ]; then
    [ -z "$missing" ] || give_up "no Rust target ${missing% }; run tests/setup.sh"
    emulator_is_new_enough || give_up "no QEMU $wanted or newer (qemu-system-arm); run tests/setup.sh"
    browser_is_there || give_up "no chromium and chromedriver; run tests/setup.sh"
    tools_are_there || give_up "no gcc, nm, valgrind, mbpoll, libmodbus or mosquitto; run tests/setup.sh"
    python_is_there || give_up "no Python packages in $venv; run tests/setup.sh"
    exit 0
fi

for component in rustfmt clippy; do
    timeout 20 "cargo-${component/rust/}" --version >/dev/null 2>&1 ||
        timeout --kill-after=10 60 rustup component add "$component" || give_up "rustup could not add $component"
done
if [ -n "$missing" ]; then
    if [ -z "${KBAND_DEBIAN_ROUTE:-}" ]; then
        # shellcheck disable=SC2086
        timeout --kill-after=10 60 rustup target add $missing || say "rustup could not add $missing"
    fi
    [ -z "$(missing_targets)" ] || install_targets_from_debian ||
        give_up "no Rust target $missing: neither rustup nor Debian's packages could bring it"
    [ -z "$(missing_targets)" ] || give_up "Rust still does not compile for $(missing_targets | tr '\n' ' ')"
fi
emulator_is_new_enough || install_emulator || give_up "QEMU could not be installed; it is the package qemu-system-arm, $wanted or newer"
emulator_is_new_enough || give_up "QEMU is $(emulator_version), older than $wanted"
browser_is_there || install_browser || give_up "Chromium could not be installed; it is the packages chromium and chromium-driver"
tools_are_there || install_tools || give_up "gcc, valgrind, mbpoll, libmodbus and mosquitto could not be installed"
python_is_there || install_python || give_up "the packages of $python_packages could not be installed"
say "ready: ${targets[*]}, QEMU $(emulator_version), Chromium, gcc, valgrind, mbpoll, libmodbus, mosquitto, Python packages"
