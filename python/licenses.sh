#!/usr/bin/env bash
# licenses.sh FOLDER LIBRARY...: copies the licenses of the packages that these libraries come from into FOLDER, as Debian
# states them, and the texts that those refer to.
set -euo pipefail
folder=$1
shift
mkdir -p "$folder"
for library in "$@"; do
    # Packages name their files by the folders of before and after /lib became a link to /usr/lib.
    package=$(dpkg -S "$(readlink -f "$library")" "$library" "/usr$library" 2>/dev/null | head -1 | cut -d: -f1) || true
    if [ -f "/usr/share/doc/$package/copyright" ]; then
        install -m 644 "/usr/share/doc/$package/copyright" "$folder/$package.txt"
    else
        printf 'note: no package states the license of %s\n' "$library" >&2
    fi
done
{ grep -ohE '/usr/share/common-licenses/[A-Z][A-Za-z]*(-[0-9]+(\.[0-9]+)*)?' "$folder"/*.txt || true; } | sort -u |
    while read -r text; do
        [ ! -f "$text" ] || install -m 644 "$text" "$folder/$(basename "$text")"
    done
