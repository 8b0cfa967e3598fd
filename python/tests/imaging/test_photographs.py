"""Videos of smoke in a dark room: a twin of what is filmed, from the cameras to the volume."""

import json
import subprocess

import numpy as np
import pytest
import SimpleITK

FRAMES, FRAME = 12, 8
WIDTH, HEIGHT = 120, 216
# Cameras over 120 degrees, and two that no reconstruction sees.
FILMED, UNSEEN = (-60, -30, 0, 30, 60), (-45, 15)
# Errors of the poses: the root mean square in pixels.
JITTER = 3.0


@pytest.fixture(scope="module")
def filmed(tmp_path_factory, cumulo, fixtures):
    """Folder with `take_0.mp4` to `take_4.mp4`, `poses.json` that is off by some pixels, `true.json` with the cameras of
    all views, and what they show in `shots/view_###.png`."""
    folder = tmp_path_factory.mktemp("filmed")
    low, high = box(cumulo, fixtures / "plume.vdb")
    centre, size = (low + high) / 2, (high - low).max()
    cameras = [look_at(centre, centre + 4 * size * direction(np.radians(angle))) for angle in FILMED + UNSEEN]
    focal = 0.62 * HEIGHT * 4
    write(folder / "true.json", focal, [f"view_{i:03}.png" for i in range(7)], cameras)
    cumulo(
        "render", fixtures / "plume.vdb", "--cameras", folder / "true.json", "--albedo", 0.9, "--density-scale", "auto",
        "--sun", "0.5,1,1", "--sun-angle", 90, "--sun-color", "1.5,1.5,1.5", "--background", "0,0,0", "--samples", 128,
        "--png", "-o", folder / "shots",
    )  # fmt: skip
    rng = np.random.default_rng(1)
    wrong = []
    for i, camera in enumerate(cameras[: len(FILMED)]):
        grain = f"noise=alls=4:allf=t:all_seed={i}"
        subprocess.run(
            ["ffmpeg", "-v", "error", "-nostdin", "-loop", "1", "-i", folder / f"shots/view_{i:03}.png", "-vf", grain,
             "-frames:v", str(FRAMES), "-pix_fmt", "yuv420p", "-c:v", "libx264", "-crf", "18", folder / f"take_{i}.mp4"],
            check=True,
        )  # fmt: skip
        turn = rotation(rng.normal(size=3) * JITTER / np.sqrt(2) / focal)
        wrong.append(camera @ turn)
    write(folder / "poses.json", focal, [f"take_{i}" for i in range(5)], wrong)
    return folder


def box(cumulo, vdb):
    """Corners of what a VDB holds, in the world."""
    bounds = cumulo("info", vdb)["files"][0]["grids"][0]["world_bounds"]
    return np.array(bounds["min"]), np.array(bounds["max"])


def direction(angle):
    return np.array([np.sin(angle), -np.cos(angle), 0.15])


def look_at(at, eye):
    """Camera-to-world matrix, z up, looking down -Z."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], 1)
    return matrix


def rotation(vector):
    """Rotation about a vector by its length in radians, as a 4x4 matrix."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def write(path, focal, names, cameras):
    frames = [{"file_path": n, "transform_matrix": c.tolist()} for n, c in zip(names, cameras, strict=True)]
    path.write_text(json.dumps({"w": WIDTH, "h": HEIGHT, "fl_x": focal, "frames": frames}))


def read(path):
    """An 8-bit picture from 0 to 1."""
    return SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))[..., :3] / 255.0


def psnr(a, b):
    return -10 * np.log10(np.mean((a - b) ** 2))


def test_a_plume_of_five_cameras(cumulo, filmed, fixtures):
    takes = [filmed / f"take_{i}.mp4" for i in range(5)]
    shot = cumulo(
        "capture", "convert", filmed / "poses.json", "--pictures", *takes, "--frame", FRAME, "--photographs",
        "-o", filmed / "shot",
    )  # fmt: skip
    assert "light medium" in shot["setting"] and not shot["warnings"]
    found = cumulo("reconstruct", "density", filmed / "shot", "--refine-cameras", "-o", filmed / "found.vdb")
    moved = [camera["displaced_pixels"] for camera in found["cameras"]["motions"]]
    assert 0.5 < np.sqrt(np.mean(np.square(moved))) < 5.0, moved

    # The region is about that of the plume, however many levels of black there are around it.
    boxes = [box(cumulo, path) for path in (filmed / "found.vdb", fixtures / "plume.vdb")]
    size, true = (high - low for low, high in boxes)
    assert (size < 1.35 * true).all(), (size, true)

    # Views that no camera filmed, seen by the true cameras: the given ones were off by pixels.
    capture = json.loads((filmed / "shot/transforms.json").read_text())
    emission = ",".join(map(str, capture["emission"]))
    cumulo(
        "render", filmed / "found.vdb", "--cameras", filmed / "true.json", "--model", capture["model"],
        "--emission", emission, "--background", "0,0,0", "--png", "-o", filmed / "seen",
    )  # fmt: skip
    for view in (5, 6):
        seen, real = (read(filmed / folder / f"view_{view:03}.png") for folder in ("seen", "shots"))
        assert psnr(seen, real) > 32, (view, psnr(seen, real))
        # No ghosts: where there is nothing, nothing is seen.
        ghosts = seen[real.max(axis=-1) == 0]
        assert ghosts.mean() < 0.01 and ghosts.max() < 0.25, (ghosts.mean(), ghosts.max())


def test_a_video_without_that_frame_is_refused(cumulo, filmed):
    takes = [filmed / f"take_{i}.mp4" for i in range(5)]
    with pytest.raises(RuntimeError, match="take_0.mp4: the video has no frame 12"):
        cumulo("capture", "convert", filmed / "poses.json", "--pictures", *takes, "--frame", FRAMES, "--photographs",
               "-o", filmed / "no")  # fmt: skip
    assert not list(filmed.glob("no*")) and not list(filmed.glob(".cumulo-*"))


def test_light_outside_of_the_region_is_told(cumulo, filmed, fixtures):
    takes = [filmed / f"take_{i}.mp4" for i in range(5)]
    shot = filmed / "cut"
    cumulo("capture", "convert", filmed / "poses.json", "--pictures", *takes, "--frame", FRAME, "--photographs", "-o", shot)

    def told(*region):
        found = cumulo("reconstruct", "density", shot, *region, "--iterations", 1, "-o", filmed / "cut.vdb")
        return [warning["what"] for warning in found["warnings"] if "outside of the region" in warning["what"]]

    assert not told()
    low, high = box(cumulo, fixtures / "plume.vdb")
    upper = [*low[:2], (low[2] + high[2]) / 2, *high]
    (what,) = told("--bounds=" + ",".join(map(str, upper)))
    assert float(what.split(" %")[0]) > 10, what
