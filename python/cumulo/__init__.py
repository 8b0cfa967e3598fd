"""The Python side of Cumulo: thin over the program's `--json`.

`run` calls the program, `capture` reads and writes multi-view captures, `exr` pictures and `transfer`
transfer functions. Three modules need Blender's `bpy` or what comes with it (`pip install
cumulo[blender]`): `blender` renders volumes with Cycles, `noise` measures how noisy its pictures are,
`padding` surrounds volumes with the empty voxels that Cycles needs.
"""
