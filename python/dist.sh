#!/usr/bin/env bash
# Makes target/dist/cumulo-VERSION-linux-MACHINE.tar.xz of the program that `make build` built: with all its libraries, the
# C library among them, so that it runs on any Linux of this machine's kind that has a /bin/sh.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=target/release/cumulo
version=$(sed -n '/^\[workspace.package\]/,/^\[/ s/^version = "\(.*\)"/\1/p' Cargo.toml)
name=cumulo-$version-linux-$(uname -m)
folder=target/dist/$name
libraries=$folder/lib/cumulo
documents=$folder/share/doc/cumulo

rm -rf target/dist
mkdir -p "$libraries" "$documents"
install -D -m 755 python/launcher.sh "$folder/bin/cumulo"
install -m 755 "$program" "$libraries/program"

# Those that it is linked with, and the allocator that TBB looks for beside itself.
mapfile -t needed < <(ldd "$program" | awk '$2 == "=>" {print $3}')
loader=$(ldd "$program" | awk '$1 ~ /^\/.*\/ld-/ {print $1}')
tbb=$(printf '%s\n' "${needed[@]}" | grep '/libtbb\.so')
allocator=${tbb%/*}/libtbbmalloc.so.2
[ ! -f "$allocator" ] || needed+=("$allocator")
install -m 755 "${needed[@]}" "$loader" "$libraries"
ln -s "${loader##*/}" "$libraries/cumulo"
python/licenses.sh "$documents/licenses" "${needed[@]}"

mkdir -p "$folder/share/man/man1"
install -m 644 target/share/man1/*.1 "$folder/share/man/man1"
install -D -m 644 target/share/completions/cumulo.bash "$folder/share/bash-completion/completions/cumulo"
install -D -m 644 target/share/completions/_cumulo "$folder/share/zsh/site-functions/_cumulo"
install -D -m 644 target/share/completions/cumulo.fish "$folder/share/fish/vendor_completions.d/cumulo.fish"
# As in the sources, so that the pages' links hold; with the volume that the first commands name.
cp --parents README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT src/guide/*.md fixtures/plume.vdb fixtures/readme/*.png \
    tests/benches/RESULTS.md tests/benches/*.svg "$documents"

# The same bytes from the same sources: names in order, one time, no owner.
archive=target/dist/$name.tar.xz
tar --create --directory target/dist --sort=name --owner=0 --group=0 --numeric-owner --mode=u+w,go-w \
    --mtime="@${SOURCE_DATE_EPOCH:-$(stat -c %Y "$program")}" "$name" | xz --threads=2 >"$archive"
ls -l "$archive" >&2
