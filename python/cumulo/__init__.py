"""The Python side of Cumulo: thin over the program's `--json`.

`run` calls the program, `capture` reads and writes multi-view captures, `blender` (which alone needs
`bpy`) renders volumes with Cycles, `noise` measures how noisy its pictures are.
"""
