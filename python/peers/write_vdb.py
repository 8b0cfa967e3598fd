"""Writes a `[z, y, x]` volume as a fog volume named `density`: NPY VDB LATTICE_JSON.

Runs under the Python that has OpenVDB's bindings (Debian: python3-openvdb), which need another numpy
than the peers do. Index coordinates of the grid are those of the array; zeros stay inactive.
"""

import json
import sys

import numpy as np
import pyopenvdb as vdb


def main(source, target, lattice):
    volume = np.load(source)
    grid = vdb.FloatGrid()
    grid.copyFromArray(np.ascontiguousarray(volume.transpose(2, 1, 0), np.float32))
    grid.name, grid.gridClass = "density", vdb.GridClass.FOG_VOLUME
    # OpenVDB's matrices act on row vectors.
    grid.transform = vdb.createLinearTransform(np.array(json.loads(lattice)).T.tolist())
    vdb.write(target, grids=[grid])


if __name__ == "__main__":
    main(*sys.argv[1:4])
