"""Pictures of arrays are those of files bit for bit, and their derivatives those of `cumulo gradient`."""

import cumulo
import cumulo.torch as ct
import numpy as np
import pytest
import torch
from cumulo import arrays, pictures, transfer
from cumulo.capture import Capture
from cumulo.fields import Cameras, Gaussians, Lattice, Piecewise, Texture

PLACE = {"voxel_size": 0.1, "origin": (0.1, 0.2, 0.3)}
SIZE = (21, 16)
FUNCTIONS = {
    "texture": Texture(np.array([[0.9, 0.2, 0.1, 0.0], [0.3, 0.8, 0.2, 9.0], [0.1, 0.3, 0.7, 2.0], [0.6, 0.5, 0.9, 12.0]])),
    "piecewise": Piecewise(np.array([[0, 0.9, 0.2, 0.1, 0], [0.4, 0.3, 0.9, 0.4, 8], [0.7, 0.2, 0.3, 0.8, 1], [1, 0.7, 0.6, 0.2, 12.0]])),
    "gaussians": Gaussians(np.array([[0.35, -2.6, 0.9, 0.4, 0.1, 7.0], [0.8, -2.2, 0.2, 0.5, 0.8, 9.0]])),
}  # fmt: skip
QUADRATURES = [None, "exact", "preintegrated", "preintegrated:0.001", "midpoint:0.5", "riemann:0.7"]


def document(function):
    """A transfer function as `.tf.json` holds it."""
    held = {"kind": function.kind}
    if function.kind == "texture":
        held |= {"domain": function.domain, "texels": function.texels.tolist()}
    elif function.kind == "piecewise":
        held |= {"points": function.points.tolist()}
    else:
        lobes = [{"mean": row[0], "ln_width": row[1], "rgbs": row[2:]} for row in function.lobes.tolist()]
        held |= {"domain": function.domain, "lobes": lobes}
    return {"format": "cumulo-transfer-function", "version": 1, "transfer": held}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A volume, `random.vdb`, its functions, and cameras around it, `shots`."""
    found = tmp_path_factory.mktemp("same")
    density = np.random.default_rng(0).random((12, 9, 10), dtype=np.float32)
    density[density < 0.3] = 0
    # The box of the active voxels is that of the array.
    density[0, 0, 0] = density[-1, -1, -1] = 0.5
    np.save(found / "random.npy", density)
    arrays.write_volume(found / "random.vdb", density, **PLACE)
    for name, function in FUNCTIONS.items():
        transfer.write_transfer(found / f"{name}.tf.json", document(function))
    cumulo.render(found / "random.vdb", found / "shots", views=3, size=SIZE, density_scale=2.5)
    return found


def rendered(folder, output, **options):
    """The program's pictures, [views, rows, columns, 4]."""
    made = cumulo.render(folder / "random.vdb", output, cameras=folder / "shots", **options)
    return np.stack([arrays.read_picture(picture).values for _, picture in Capture.read(made.output).frames])


def given(folder):
    """Densities, their places, and the cameras."""
    density = np.load(folder / "random.npy")
    frames = Capture.read(folder / "shots").frames
    return density, {"lattice": Lattice.box(density.shape, **PLACE)}, Cameras.of([camera for camera, _ in frames])


def same(ours, theirs):
    """Expects the same bits."""
    assert ours.dtype == theirs.dtype == np.float32 and ours.shape == theirs.shape
    assert ours[..., 3].min() < 0.1 and ours[..., 3].max() > 0.5
    assert np.array_equal(ours.view(np.int32), theirs.view(np.int32)), np.abs(ours - theirs).max()


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("supersample", [1, 2])
def test_absorption(folder, tmp_path, quadrature, supersample):
    density, settings, cameras = given(folder)
    settings |= {"density_scale": 2.5, "background": (1, 1, 1), "quadrature": quadrature, "supersample": supersample}
    program = rendered(folder, tmp_path / "out", model="absorption", density_scale=2.5, background=(1, 1, 1), quadrature=quadrature,
                       supersample=supersample)  # fmt: skip
    same(pictures.render(density, cameras, **settings), program)
    same(ct.render(torch.from_numpy(density), cameras, **settings).numpy(), program)
    places, values = Lattice.read(folder / "random.vdb")
    same(pictures.render(values, cameras, **{**settings, "lattice": places}), program)
    double = pictures.render(density.astype(np.float64), cameras, **settings)
    assert double.dtype == np.float64 and np.abs(double - program).max() < 1e-5


@pytest.mark.parametrize("model", ["grey", "linear"])
def test_emission(folder, tmp_path, model):
    density, settings, cameras = given(folder)
    light = {"density_scale": 2.5, "emission": (0.9, 0.4, 0.1), "background": (0.1, 0.2, 0.3)}
    program = rendered(folder, tmp_path / "out", model="emission-absorption", emission_model=model, **light)
    same(pictures.render(density, cameras, **settings, **light, emission_model=model), program)


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(folder, tmp_path, name, quadrature):
    density, _, cameras = given(folder)
    light = {"density_scale": 1.2, "background": (0.1, 0.2, 0.3), "quadrature": quadrature}
    program = rendered(folder, tmp_path / "out", tf=folder / f"{name}.tf.json", **light)
    places, values = Lattice.read(folder / "random.vdb")
    same(pictures.render(values, cameras, lattice=places, function=FUNCTIONS[name], **light), program)


def test_the_derivatives_are_those_of_the_command(folder, tmp_path):
    density, settings, cameras = given(folder)
    # The target is the same volume, twice as dense.
    rendered(folder, tmp_path / "target", model="absorption", density_scale=5.0, background=(1, 1, 1))
    target = np.stack([arrays.read_picture(picture).values for _, picture in Capture.read(tmp_path / "target").frames])
    found = cumulo.gradient(
        folder / "random.vdb", wrt="density,extinction", loss="l2", target=tmp_path / "target", density_scale=2.5,
        output=tmp_path / "slopes.vdb",
    )  # fmt: skip
    # Voxels around the active ones have derivatives too.
    derivatives, own = (arrays.read_volume(path) for path in (tmp_path / "slopes.vdb", folder / "random.vdb"))
    low = np.subtract(own.index_origin, derivatives.index_origin)
    slopes = derivatives.values[tuple(slice(a, a + n) for a, n in zip(low, density.shape, strict=True))]

    values = torch.from_numpy(density).requires_grad_()
    scale = torch.tensor(2.5, dtype=torch.float64, requires_grad=True)
    picture = ct.render(values, cameras, density_scale=scale, background=(1, 1, 1), **settings)
    loss = (picture - torch.from_numpy(target))[..., :3].square().mean()
    loss.backward()
    assert loss.item() == pytest.approx(found.value, rel=1e-5) and found.value > 1e-3
    assert slopes.shape == density.shape and np.abs(slopes).max() > 1e-4
    assert np.abs(values.grad.numpy() - slopes)[density > 0].max() < 1e-5 * np.abs(slopes).max()
    [by_scale] = [row.gradient for row in found.rows if row.name == "extinction"]
    assert scale.grad.item() == pytest.approx(by_scale, rel=1e-5)
