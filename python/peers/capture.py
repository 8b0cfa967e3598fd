"""Cameras on data sets and the capture folder: `transforms.json`, EXR pictures, the true volume as VDB."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR


@dataclass
class Rig:
    """Cameras that share one raster. A camera looks down its -Z, +Y up, +X right.

    `poses` are camera-to-world, `[views, 4, 4]`; `focal` is in pixels, or in pixels per world unit where
    `orthographic`; the principal point is the middle of the picture.
    """

    poses: np.ndarray
    focal: float
    width: int
    height: int
    orthographic: bool = False

    def rays(self, view, offset=(0.5, 0.5)):
        """World origins and unit directions `[height, width, 3]`, first row at the top of the picture."""
        x = (np.arange(self.width) + offset[0] - self.width / 2) / self.focal
        y = (self.height / 2 - np.arange(self.height) - offset[1]) / self.focal
        y, x = np.meshgrid(y, x, indexing="ij")
        zero, one = np.zeros_like(x), np.ones_like(x)
        if self.orthographic:
            o, d = np.stack([x, y, zero], -1), np.stack([zero, zero, -one], -1)
        else:
            o, d = np.zeros(x.shape + (3,)), np.stack([x, y, -one], -1)
            d /= np.linalg.norm(d, axis=-1, keepdims=True)
        turn, place = self.poses[view][:3, :3], self.poses[view][:3, 3]
        return o @ turn.T + place, d @ turn.T


def pose(right, up, back, origin):
    """Camera-to-world matrix from its axes and place."""
    m = np.eye(4)
    m[:3] = np.stack([right, up, back, origin], 1)
    return m


def write_capture(folder, rig, integrals, volume, lattice, scale):
    """`integrals` are of the density over world length, `[views, height, width]`, first row at the top."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    frames = []
    for i, depth in enumerate(integrals):
        seen = np.exp(-scale * depth)
        picture = np.stack([seen, seen, seen, -np.expm1(-scale * depth)], -1).astype(np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGBA": picture}) as f:
            f.write(str(folder / f"view_{i:03}.exr"))
        frames.append({"file_path": f"view_{i:03}.exr", "transform_matrix": rig.poses[i].tolist()})
    head = {"camera_model": "ORTHOGRAPHIC"} if rig.orthographic else {}
    head |= {
        "fl_x": rig.focal, "fl_y": rig.focal, "cx": rig.width / 2, "cy": rig.height / 2,
        "w": rig.width, "h": rig.height, "model": "absorption", "background": [1.0, 1.0, 1.0],
        "density_scale": scale, "pixel_filter": "point", "lattice": lattice.tolist(),
    }  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps(head | {"frames": frames}, indent=1) + "\n")
    np.save(folder / "integrals.npy", integrals)
    np.save(folder / "truth.npy", volume)
    write = Path(__file__).with_name("write_vdb.py")
    command = ["/usr/bin/python3", write, folder / "truth.npy", folder / "truth.vdb", json.dumps(lattice.tolist())]
    subprocess.run(command, check=True)
