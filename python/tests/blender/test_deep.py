"""OpenImageIO reads the deep pictures that are written, writes others, and splits samples as they are split here."""

import math
import random

import pytest

import cumulo.blender  # noqa: F401  exposes OpenImageIO
import OpenImageIO as oiio  # isort: skip

SIZE = (13, 9)
CHANNELS = ("R", "G", "B", "A", "Z", "ZBack")


def pixel(dice):
    """Samples of a pixel: volumes that overlap, and points, some at the same place."""
    samples = []
    for _ in range(dice.randrange(6)):
        z = dice.randrange(1, 60) / 8
        z_back = z + dice.choice((0, 0.5, 3.25))
        alpha = dice.choice((0.0, 0.25, 0.5, 0.875))
        color = [alpha * dice.randrange(9) / 4 for _ in range(3)]
        samples.append((*color, alpha, z, z_back))
    return samples


def write(path, pixels, tile, compression):
    spec = oiio.ImageSpec(*SIZE, len(CHANNELS), "float")
    spec.channelnames = CHANNELS
    spec.deep = True
    spec.attribute("compression", compression)
    if tile:
        spec.tile_width, spec.tile_height = tile
    deep = oiio.DeepData()
    deep.init(spec)
    for number, samples in enumerate(pixels):
        deep.set_samples(number, len(samples))
        for place, sample in enumerate(samples):
            for channel, value in enumerate(sample):
                deep.set_deep_value(number, channel, place, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    if tile:
        assert output.write_deep_tiles(0, SIZE[0], 0, SIZE[1], 0, 1, deep), output.geterror()
    else:
        assert output.write_deep_scanlines(0, SIZE[1], 0, deep), output.geterror()
    output.close()
    return deep


def merged(deep, number):
    """Color and opacity of a pixel that OpenImageIO made tidy, composited from front to back in double precision."""
    depths = sorted({deep.deep_value(number, c, s) for s in range(deep.samples(number)) for c in (4, 5)})
    for depth in depths:
        deep.split(number, depth)
    # OpenImageIO 3.0 sorts by the front alone, but a point comes before a volume that begins there.
    parts = [[deep.deep_value(number, c, s) for c in range(len(CHANNELS))] for s in range(deep.samples(number))]
    for place, part in enumerate(sorted(parts, key=lambda part: part[4:])):
        for channel, value in enumerate(part):
            deep.set_deep_value(number, channel, place, value)
    deep.merge_overlaps(number)
    color, through = [0.0] * 4, 1.0
    for place in range(deep.samples(number)):
        values = [deep.deep_value(number, channel, place) for channel in range(4)]
        color = [sum + through * value for sum, value in zip(color, values)]
        through *= 1 - values[3]
    return color


@pytest.mark.parametrize("tile", [None, (5, 4)])
@pytest.mark.parametrize("compression", ["none", "rle", "zips"])
def test_pictures_of_openimageio_are_flattened_alike(tmp_path, cumulo, tile, compression):
    dice = random.Random(5)
    pixels = [pixel(dice) for _ in range(SIZE[0] * SIZE[1])]
    deep = write(tmp_path / "deep.exr", pixels, tile, compression)
    info = cumulo("info", str(tmp_path / "deep.exr"))["files"][0]
    counts = [len(samples) for samples in pixels]
    assert info["samples"] == sum(counts) and info["tiled"] == (tile is not None)
    assert info["samples_per_pixel"]["max"] == max(counts) and info["empty_pixels"] == counts.count(0)
    cumulo("convert", str(tmp_path / "deep.exr"), str(tmp_path / "flat.exr"), "--flatten")
    flat = oiio.ImageInput.open(str(tmp_path / "flat.exr"))
    names = list(flat.spec().channelnames)
    values = flat.read_image("float")
    seen = 0
    for number, samples in enumerate(pixels):
        found = values[number // SIZE[0]][number % SIZE[0]]
        expected = merged(deep, number)
        seen += any(expected)
        for name, value in zip(CHANNELS, expected):
            # OpenImageIO rounds each part to single precision: 12 parts of 2^-24 with colors up to 2.
            assert math.isclose(found[names.index(name)], value, rel_tol=4e-6, abs_tol=4e-6), (number, name, samples)
        visible = [sample[4] for sample in samples if sample[3] > 0]
        assert found[names.index("Z")] == (min(visible) if visible else pytest.approx(1e10))
    assert seen > 60
