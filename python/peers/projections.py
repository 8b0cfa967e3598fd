"""Data sets of the reconstruction benchmarks: exact f64 projections of the smoke field as captures.

    projections.py b4 OUT [--views 64]    cone beam from views on a sphere (RTK's geometry)
    projections.py b5 OUT                 64 parallel-beam angles over 180 degrees (ASTRA's geometry)
    projections.py b7 OUT                 the same of 256 cubed voxels, the size of Weiss & Westermann's volumes
    projections.py b6 OUT                 16 perspective views around the unit cube (Mitsuba's geometry)

OUT gets `transforms.json`, 32-bit float EXR pictures, `truth.vdb`, and in f64 `integrals.npy`, line
integrals of the density over world length `[views, rows, columns]` with the top row first.
"""

import argparse
import math

import numpy as np
from capture import Rig, pose, write_capture
from exact import line_integrals
from field import smoke, sphere_directions

# RTK's scene: distances and detector in voxels, which are the world's unit here.
CONE_PIXELS, CONE_DISTANCE, CONE_MAGNIFICATION, CONE_WIDTH = 128, 2.4, 1.5, 1.9


def centred(n):
    """Unit voxels with the middle of the grid at the world's origin."""
    m = np.eye(4)
    m[:3, 3] = -(n - 1) / 2
    return m


def cone_angles(directions):
    """RTK's gantry and out-of-plane angles in degrees, `[views, 2]`."""
    gantry = np.degrees(np.arctan2(directions[:, 0], directions[:, 1]))
    return np.stack([gantry, np.degrees(np.arcsin(directions[:, 2]))], 1)


def cone_rig(n, views):
    """RTK turns the world by -gantry about y, then by -out-of-plane about x; then the source lies on +z
    and the detector's u and v run along x and y. The rows of that turn are our camera's axes."""
    poses = []
    for gantry, tilt in np.radians(cone_angles(sphere_directions(views))):
        about_y = np.array([[math.cos(gantry), 0, -math.sin(gantry)], [0, 1, 0], [math.sin(gantry), 0, math.cos(gantry)]])
        about_x = np.array([[1, 0, 0], [0, math.cos(tilt), math.sin(tilt)], [0, -math.sin(tilt), math.cos(tilt)]])
        right, up, back = about_x @ about_y
        poses.append(pose(right, up, back, CONE_DISTANCE * n * back))
    pitch = n * CONE_WIDTH * CONE_MAGNIFICATION / CONE_PIXELS
    return Rig(np.array(poses), CONE_DISTANCE * CONE_MAGNIFICATION * n / pitch, CONE_PIXELS, CONE_PIXELS)


def parallel_rig(n, angles, detector):
    """ASTRA's rays run along (sin a, -cos a) and its detector along (cos a, sin a), but its image rows
    run down its y: with array rows as our y the second components change sign. Slices stack along z."""
    poses = []
    for a in np.linspace(0, np.pi, angles, endpoint=False):
        right, along = np.array([math.cos(a), -math.sin(a), 0]), np.array([math.sin(a), math.cos(a), 0])
        poses.append(pose(right, [0, 0, 1], -along, -2.0 * n * along))
    return Rig(np.array(poses), 1.0, detector, n, orthographic=True)


def look_at(eye, target, up):
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return pose(right, np.cross(back, right), back, eye)


def ring_rig(views, pixels, fov_degrees=40.0):
    """Mitsuba's scene: cameras 2.4 from the middle of the unit cube."""
    middle = np.full(3, 0.5)
    poses = [
        look_at(middle + 2.4 * d, middle, [0, 0, 1] if abs(d[2]) < 0.95 else [0, 1, 0])
        for d in sphere_directions(views)
    ]
    return Rig(np.array(poses), pixels / 2 / math.tan(math.radians(fov_degrees / 2)), pixels, pixels)


def project(rig, volume, lattice, offset=(0.5, 0.5)):
    """Line integrals over world length through one point of every pixel, `[views, height, width]`."""
    to_index = np.linalg.inv(lattice)
    out = []
    for view in range(len(rig.poses)):
        o, d = rig.rays(view, offset)
        out.append(line_integrals(volume, (o - lattice[:3, 3]) @ to_index[:3, :3].T, d @ to_index[:3, :3].T))
    return np.array(out)


def pixel_means(rig, volume, lattice, scale, nodes=4):
    """Transmittance averaged over each pixel's square by a Gauss-Legendre rule: what a path tracer with
    a box filter converges to."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    x, w = (x + 1) / 2, w / 2
    mean = 0
    for i in range(nodes):
        for j in range(nodes):
            mean = mean + w[i] * w[j] * np.exp(-scale * project(rig, volume, lattice, (x[i], x[j])))
    return mean


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("set", choices=["b4", "b5", "b6", "b7"])
    p.add_argument("out")
    p.add_argument("--views", type=int, default=64, help="views of b4")
    a = p.parse_args()
    if a.set == "b6":
        volume, lattice, rig, scale = smoke(64), np.diag([1 / 64, 1 / 64, 1 / 64, 1]), ring_rig(16, 128), 10.0
        lattice[:3, 3] = 0.5 / 64
    else:
        # The thickest line integral is about 55 voxels of 128: optical depths up to about 4.4.
        n = 256 if a.set == "b7" else 128
        volume, lattice, scale = smoke(n), centred(n), 10.24 / n
        rig = cone_rig(n, a.views) if a.set == "b4" else parallel_rig(n, 64, 3 * n // 2)
    integrals = project(rig, volume, lattice)
    write_capture(a.out, rig, integrals, volume, lattice, scale)
    if a.set == "b6":
        np.save(f"{a.out}/pixel_means.npy", pixel_means(rig, volume, lattice, scale))
    print(f"{a.out}: {len(integrals)} views {rig.width}x{rig.height}, optical depth up to {scale * integrals.max():.3f}")


if __name__ == "__main__":
    main()
