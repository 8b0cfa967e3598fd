#!/bin/sh
# Starts the program with the libraries of this folder, the C library and its loader among them, so that it does not
# matter which the system has. What the program starts itself, such as ffmpeg, has the system's.
self=$0
case $self in
*/*) ;;
*) self=$(command -v -- "$self") ;;
esac
case $self in
/*) ;;
*) self=$PWD/$self ;;
esac
# It may be linked to from a folder of the path.
file=$self
while [ -h "$file" ]; do
    target=$(readlink -- "$file")
    case $target in
    /*) file=$target ;;
    *) file=${file%/*}/$target ;;
    esac
done
folder=${file%/*}/../lib/cumulo
# Libraries to preload are those of another C library.
unset LD_PRELOAD LD_AUDIT
# The loader under the program's name, which process lists show; the program starts itself by the word behind --argv0.
exec "$folder/cumulo" --inhibit-cache --library-path "$folder" --argv0 "$self" "$folder/program" "$@"
