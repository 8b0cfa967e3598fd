"""The committed phantom of a head is what its generator makes."""

import gzip
import pathlib
import subprocess
import sys

FIXTURES = pathlib.Path(__file__).resolve().parents[2] / "fixtures"


def test_generator_makes_the_committed_phantom(tmp_path):
    made = tmp_path / "head.nii.gz"
    subprocess.run([sys.executable, FIXTURES / "make_head.py", made], check=True, capture_output=True)
    # Compressed bytes differ between versions of zlib.
    assert gzip.decompress(made.read_bytes()) == gzip.decompress((FIXTURES / "head.nii.gz").read_bytes())
