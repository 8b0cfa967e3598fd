#!/usr/bin/env bash
# debian.sh SUITE: makes target/debian/cumulo_*.deb for another release of Debian, such as trixie: by `make deb` in a root
# file system of it, with the Rust toolchain of this machine. A second run finds the root file system and its build there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
suite=$1
root=$PWD/target/debian/root-$suite
die() { printf 'error: %s\n' "$*" >&2; exit 2; }
[ "$(id -u)" = 0 ] || die "a root file system of $suite is made by root; run this as root, or 'make deb' on $suite itself"
python/setup.sh debian

if [ ! -f "$root/complete" ]; then
    rm -rf "$root"
    mkdir -p "$root"
    debootstrap --variant=minbase --include=make,ca-certificates,dpkg-dev "$suite" "$root" >&2
    touch "$root/complete"
fi
# Where the container of the build may not make device files.
[ -c "$root/dev/null" ] || die "$root has no devices: debootstrap needs the right to make them"
mkdir -p "$root/build" "$root/root/.cargo" "$root/root/.rustup"
tar --create --exclude=./target --exclude=./.venvs --exclude=./.git . | tar --extract --directory "$root/build"

# Mounts end with their namespace.
export root
unshare --mount --fork bash -euo pipefail -c '
    mount --bind "${CARGO_HOME:-$HOME/.cargo}" "$root/root/.cargo"
    mount --bind "${RUSTUP_HOME:-$HOME/.rustup}" "$root/root/.rustup"
    mount -t proc proc "$root/proc"
    # The certificates that this machine trusts may be more than those of the release.
    certificates=/etc/ssl/certs/ca-certificates.crt
    [ ! -f "$certificates" ] || mount --bind --read-only "$certificates" "$root$certificates"
    # What cargo installs there runs with the libraries of that release, and must not replace programs of this machine.
    exec chroot "$root" env -u CARGO_HOME -u RUSTUP_HOME -u CUMULO -u CARGO_TARGET_DIR HOME=/root \
        CARGO_INSTALL_ROOT=/root/tools PATH=/root/tools/bin:/root/.cargo/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        make -C /build deb DEBIAN='
install -m 644 "$root"/build/target/debian/cumulo_*.deb target/debian/
