"""Arrays that zarr writes, and images of ome-zarr, land where their metadata say."""

import cubes
import numpy as np
import pytest
import zarr
from numcodecs import LZ4, Blosc, GZip, Zlib, Zstd
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, TransposeCodec, ZstdCodec

TWO = {
    "plain": None,
    "gzip": GZip(),
    "zlib": Zlib(),
    "zstd": Zstd(),
    "lz4": LZ4(),
} | {
    f"blosc-{name}-{shuffle}": Blosc(cname=name, shuffle=shuffle)
    for name in ("lz4", "lz4hc", "zlib", "zstd")
    for shuffle in (Blosc.NOSHUFFLE, Blosc.SHUFFLE, Blosc.BITSHUFFLE)
}

THREE = {
    "plain": None,
    "gzip": GzipCodec(),
    "zstd": ZstdCodec(checksum=True),
    "blosc": BloscCodec(cname="zstd", shuffle="bitshuffle"),
    "crc": [ZstdCodec(), Crc32cCodec()],
}


def numbers(kind):
    values = np.random.default_rng(3).integers(0, 100, (13, 21, 34)) - (50 if np.dtype(kind).kind != "u" else 0)
    return values.astype(kind)


def seen(cumulo, path, folder, *options):
    """Values that are not 0, and 0 where there are none."""
    cumulo("convert", path, folder / "z.vdb", "--spacing=0.5,0.75,1.25", *options)
    made = cumulo("convert", folder / "z.vdb", folder / "z.npy", "--axes=zyx")
    low, found = made["grid"]["index_origin"], np.load(folder / "z.npy")
    return tuple(slice(start, start + size) for start, size in zip(low[::-1], found.shape)), found


def same(cumulo, path, folder, wanted, *options):
    part, found = seen(cumulo, path, folder, *options)
    assert (found == wanted[part]).all()
    assert np.count_nonzero(found) == np.count_nonzero(wanted)


@pytest.mark.parametrize("codec", TWO)
@pytest.mark.parametrize("kind, order", [("<i2", "C"), (">f4", "F"), ("|u1", "C"), (">f8", "C")])
def test_version_two(cumulo, tmp_path, codec, kind, order):
    values = numbers(kind)
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=values.shape, chunks=(4, 8, 16), dtype=kind, order=order, compressors=TWO[codec],
        zarr_format=2, fill_value=0,
    )
    array[:] = values
    same(cumulo, tmp_path / "a.zarr", tmp_path, values, "--as=double")


@pytest.mark.parametrize("codec", THREE)
@pytest.mark.parametrize("shards", [None, (8, 16, 16)])
@pytest.mark.parametrize("turned", [False, True])
def test_version_three(cumulo, tmp_path, codec, shards, turned):
    values = numbers("float32")
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=values.shape, chunks=(4, 8, 16), shards=shards, dtype="float32", zarr_format=3,
        compressors=THREE[codec], filters=[TransposeCodec(order=(2, 0, 1))] if turned else None,
        serializer=BytesCodec(endian="big"), fill_value=0,
    )
    array[:] = values
    same(cumulo, tmp_path / "a.zarr", tmp_path, values)


def test_missing_chunks_have_the_fill_value(cumulo, tmp_path):
    values = numbers("int16")
    values[4:] = -5
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=values.shape, chunks=(4, 8, 16), dtype="int16", zarr_format=3, fill_value=-5
    )
    array[:4] = values[:4]
    same(cumulo, tmp_path / "a.zarr", tmp_path, values)


@pytest.mark.parametrize("version", [2, 3])
def test_images(cumulo, tmp_path, version):
    """An image of several levels, channels and points in time, with uneven scales and a translation."""
    from ome_zarr.format import FormatV04, FormatV05
    from ome_zarr.writer import write_multiscale

    cube = cubes.array().transpose(2, 1, 0)
    image = np.zeros((2, 3, *cube.shape), np.int16)
    image[1, 2] = cube
    scale, first = np.diag(cubes.STRAIGHT)[:3][::-1], cubes.STRAIGHT[:3, 3][::-1]

    def placed(factor):
        return [
            {"type": "scale", "scale": [1.0, 1.0, *(factor * scale)]},
            {"type": "translation", "translation": [0.0, 0.0, *first]},
        ]

    axes = [{"name": n, "type": k} for n, k in zip("tczyx", ["time", "channel", "space", "space", "space"])]
    for axis in axes[2:]:
        axis["unit"] = "micrometer"
    group = zarr.open_group(tmp_path / "image.zarr", mode="w", zarr_format=version)
    write_multiscale(
        [image, image[:, :, ::2, ::2, ::2]],
        group,
        fmt=FormatV04() if version == 2 else FormatV05(),
        axes=axes,
        coordinate_transformations=[placed(1), placed(2)],
    )
    options = ["--time=1", "--channel=2"]
    cubes.passes(cumulo, tmp_path / "image.zarr", cubes.STRAIGHT, tmp_path, *options, tolerance=cubes.DOUBLE)
    report = cumulo("convert", tmp_path / "image.zarr", tmp_path / "l.vdb", *options, "--level=1")
    assert report["grids"][0]["shape"] == [-(-size // 2) for size in cubes.SIZE]
