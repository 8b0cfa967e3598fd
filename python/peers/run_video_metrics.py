"""B9: denoised sequences as viewers see them: ColorVideoVDP (`cvvdp`), which knows flicker, and shift-tolerant LPIPS.

    run_video_metrics.py FOLDER [--only VOLUME-SCENARIO ...] [--methods NAME ...] [--fps 24] [--markdown OUT.md]

FOLDER holds what `scenarios.py` rendered and `run_denoisers.py` denoised. ColorVideoVDP is in JOD: 10 for no visible difference,
one less where three of four viewers would choose the reference. ST-LPIPS is a distance, 0 for equal frames. Both get display
values (sRGB) of the frames that the reference has. Needs torch, which `requirements-denoisers.txt` names.
"""

import argparse
import pathlib
import statistics

import numpy as np
import OpenEXR
import pycvvdp
import torch
from stlpips_pytorch import stlpips


def display(folder):
    """Display values of frames by name, each `[height, width, 3]`."""
    frames = {}
    for path in sorted(folder.glob("frame.*.exr")):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            linear = np.stack([file.channels()[c].pixels for c in "RGB"], -1)
        linear = np.clip(np.nan_to_num(linear), 0, 1)
        frames[path.name] = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return frames


def tensor(picture):
    """A picture from -1 to 1 as `[1, 3, height, width]`."""
    return torch.from_numpy(picture.astype(np.float32)).permute(2, 0, 1)[None] * 2 - 1


def main():
    """Prints a table by sequence and method."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path)
    p.add_argument("--only", nargs="+")
    p.add_argument("--methods", nargs="+", default=["noisy", "wrls2", "wrls", "svgf", "ema", "oidn", "oidn-albedo", "oidn-ema"])
    p.add_argument("--fps", type=float, default=24)
    p.add_argument("--markdown", type=pathlib.Path)
    a = p.parse_args()
    vdp = pycvvdp.cvvdp(display_name="standard_fhd", device=torch.device("cpu"))
    distance = stlpips.LPIPS(net="alex", variant="shift_tolerant", verbose=False).eval()
    rows = {}
    for folder in sorted(path.parent for path in a.folder.glob("*/reference")):
        if a.only and folder.name not in a.only:
            continue
        reference = display(folder / "reference")
        for method in a.methods:
            frames = display(folder / method)
            pairs = [(frames[name].astype(np.float32), picture.astype(np.float32)) for name, picture in reference.items()]
            shown, wanted = (np.stack(side) for side in zip(*pairs))
            jod, _ = vdp.predict(shown, wanted, dim_order="FHWC", frames_per_second=a.fps)
            with torch.no_grad():
                apart = statistics.mean(float(distance(tensor(x), tensor(y))) for x, y in pairs)
            rows.setdefault(folder.name, {})[method] = (float(jod), apart)
    parts = []
    for title, which, form in (("ColorVideoVDP, JOD", 0, ".2f"), ("ST-LPIPS", 1, ".4f")):
        lines = ["| sequence | " + " | ".join(a.methods) + " |", "|---|" + "---|" * len(a.methods)]
        lines += [f"| {name} | " + " | ".join(f"{of[m][which]:{form}}" for m in a.methods) + " |" for name, of in rows.items()]
        parts.append(f"{title}\n\n" + "\n".join(lines))
    text = "\n\n".join(parts) + "\n"
    print(text)
    if a.markdown:
        a.markdown.write_text(text)


if __name__ == "__main__":
    main()
