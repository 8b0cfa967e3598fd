#!/usr/bin/env bash
# Makes target/debian/cumulo_*.deb of the program that `make build` built, for the release of this machine. Its revision
# names the release: that of a later one is newer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
PATH=$PATH:${HOME:-/root}/.cargo/bin
version=$(sed -n '/^\[workspace.package\]/,/^\[/ s/^version = "\(.*\)"/\1/p' Cargo.toml)
maintainer=$(sed -n 's/^maintainer = "\(.*\)"/\1/p' Cargo.toml)
release=$(. /etc/os-release && printf '%s%s' "$ID" "${VERSION_ID:-}")
revision=1~$release

# What Debian's policy asks for: its own changelog, and of common licenses a reference.
{
    cat LICENSE-MIT
    printf '\nThe Apache License 2.0 is in /usr/share/common-licenses/Apache-2.0.\n'
} >target/share/license
cat >target/share/changelog <<EOF
cumulo ($version-$revision) unstable; urgency=medium

  * The changes of this version are in changelog.gz.

 -- $maintainer  $(date --utc --rfc-email --date="@${SOURCE_DATE_EPOCH:-$(date +%s)}")
EOF

command -v cargo-deb >/dev/null || cargo install --locked cargo-deb
rm -f "target/debian/cumulo_"*"~${release}_"*.deb
cargo deb --no-build --locked --deb-revision "$revision"
