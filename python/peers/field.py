"""The test volume every peer reconstructs, the view directions, and the one-line JSON report.

Needs numpy alone, so that each peer's environment can import it.
"""

import json
import os
import resource

import numpy as np


def smoke(n, seed=7):
    """Smoke-like plume rising along z: float32 `[z, y, x]`, 0..1, about 86 % of it empty.

    The noise comes from one 64-cubed random field, resampled through its Fourier coefficients, so the
    volume is the same one at every resolution.
    """
    rng = np.random.default_rng(seed)
    f = np.fft.fftfreq(n) * n
    kz, ky, kx = np.meshgrid(f, f, np.fft.rfftfreq(n) * n, indexing="ij")
    k = np.sqrt(kx * kx + ky * ky + kz * kz)
    k[0, 0, 0] = 1
    low = np.fft.rfftn(rng.standard_normal((64, 64, 64)))
    m = min(n, 64) // 2
    keep = np.ix_(np.r_[0:m, -m + 1 : 0], np.r_[0:m, -m + 1 : 0], np.arange(m))
    spectrum = np.zeros((n, n, n // 2 + 1), complex)
    spectrum[keep] = low[keep]
    spectrum *= k**-1.8 * np.exp(-((k / 24.0) ** 2))
    spectrum[0, 0, 0] = 0
    noise = np.fft.irfftn(spectrum, s=(n, n, n))
    noise /= noise.std()
    c = (np.arange(n) + 0.5) / n
    z, y, x = np.meshgrid(c, c, c, indexing="ij")
    radius = np.hypot(x - (0.5 + 0.08 * np.sin(6 * z)), y - (0.5 + 0.08 * np.cos(5 * z))) / (0.10 + 0.22 * z)
    envelope = np.clip(1.3 - radius * radius, 0, 1)
    envelope = envelope * np.clip((z - 0.05) / 0.1, 0, 1) * np.clip((0.95 - z) / 0.15, 0, 1)
    return np.clip(envelope * np.clip(0.45 + 0.33 * noise, 0, None), 0, 1).astype(np.float32)


def sphere_directions(n):
    """`n` unit vectors spread evenly over the sphere (golden-angle spiral), `[n, 3]`."""
    i = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], 1)


def psnr(a, b, peak=1.0):
    """Peak signal-to-noise ratio in dB over the whole array."""
    error = np.mean((np.asarray(a, np.float64) - b) ** 2)
    return float(10 * np.log10(peak * peak / max(error, 1e-20)))


def emit(**result):
    """Prints one JSON line with the load average and peak memory beside the result."""
    result["peak_rss_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)
    result["loadavg"] = round(os.getloadavg()[0], 2)
    print(json.dumps(result), flush=True)
