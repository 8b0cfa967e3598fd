"""Job bundles, checked and run by `openjd`, beside the results of the commands themselves."""

import json
import pathlib
import signal
import subprocess
import sys
import time

import pytest

OPENJD = pathlib.Path(sys.executable).with_name("openjd")
LIT = "--albedo 0.9 --sky 0.3 --samples 4 --size 24x24 --density-scale auto --quiet"


class Shop:
    """A folder with a volume and a sequence of volumes, in which commands and jobs run."""

    def __init__(self, folder, program, fixtures):
        self.folder, self.program = folder, program
        for name, source in [("smoke", "plume"), ("s.0001", "plume"), ("s.0002", "cube"), ("s.0003", "plume")]:
            (folder / f"{name}.vdb").write_bytes((fixtures / f"{source}.vdb").read_bytes())

    def run(self, words, code=0):
        out = subprocess.run([self.program, *words.split()], cwd=self.folder, capture_output=True, text=True)
        assert out.returncode == code, out.stdout + out.stderr
        return out.stdout

    def bundle(self, words, name="job"):
        """Writes a bundle, has it checked, and returns its template."""
        self.run(f"{words} --openjd {name}")
        template = self.folder / name / "template.json"
        check = subprocess.run([OPENJD, "check", template], capture_output=True, text=True)
        assert check.returncode == 0, check.stdout + check.stderr
        return json.loads(template.read_text())

    def job(self, *words, name="job", fails=False):
        folder = self.folder / name
        command = [OPENJD, "run", folder / "template.json", "-p", f"file://{folder / 'parameters.json'}"]
        # A session has a folder of its own: no path may be relative to this one.
        out = subprocess.run(
            [*command, "-p", f"Cumulo={self.program}", *words], cwd="/", capture_output=True, text=True
        )
        assert (out.returncode != 0) == fails, out.stdout + out.stderr
        return out.stdout + out.stderr

    def same(self, a, b):
        self.run(f"compare {a} {b} --tolerance 0 --quiet")

    def pictures(self, folder):
        return {path.name: path.stat().st_mtime_ns for path in (self.folder / folder).glob("*.exr")}


@pytest.fixture
def shop(tmp_path, program, fixtures):
    return Shop(tmp_path, program, fixtures)


def listed(folder):
    return [frame["file_path"] for frame in json.loads((folder / "transforms.json").read_text())["frames"]]


def samples(png):
    """The compressed samples of a PNG, without its texts."""
    data, at, found = png.read_bytes(), 8, []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if data[at + 4 : at + 8] == b"IDAT":
            found.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    return found


def test_frames_are_those_of_the_command(shop):
    words = f"render smoke.vdb --views 1 --frames 1-9 {LIT} -o"
    template = shop.bundle(f"{words} out --openjd-chunk 4")
    [step] = template["steps"]
    tasks = step["parameterSpace"]["taskParameterDefinitions"][0]
    assert (template["extensions"], tasks["type"]) == (["TASK_CHUNKING"], "CHUNK[INT]")
    log = shop.job()
    assert "openjd_progress: 100.0" in log and "openjd_status: render" in log
    shop.run(f"{words} whole")
    shop.same("out", "whole")
    assert len(listed(shop.folder / "out")) == 9


def test_a_task_that_was_killed_does_what_is_missing(shop):
    # Runs know each other's settings by the paths of their inputs.
    words = f"render {shop.folder / 'smoke.vdb'} --views 1 --frames 1-6 {LIT.replace('24x24', '96x96')} -o"
    shop.bundle(f"{words} out --openjd-chunk 6")
    task = subprocess.Popen([shop.program, *f"{words} {shop.folder / 'out'} --resume".split()], cwd=shop.folder)
    while len(list(shop.folder.glob("out/frame.*.exr"))) < 2:
        assert task.poll() is None, "it ended before it could be killed"
        time.sleep(0.01)
    task.send_signal(signal.SIGKILL)
    task.wait()
    # What a file system may leave of a picture.
    whole = sorted(shop.folder.glob("out/frame.*.exr"))
    whole[-1].write_bytes(whole[-1].read_bytes()[:100])
    before = shop.pictures("out")
    shop.job()
    after = shop.pictures("out")
    assert len(after) == 6
    shop.run(f"{words} whole")
    shop.same("out", "whole")
    again = shop.job("--step", "Render", "-tp", "Frame=1-6")
    assert "6 that were there" in again and shop.pictures("out") == after
    assert any(before[name] != after[name] for name in before)


def test_views_of_a_capture(shop):
    words = "render smoke.vdb --views 5 --size 24x24 --quiet -o"
    shop.bundle(f"{words} out --openjd-chunk 2")
    shop.job()
    shop.run(f"{words} whole")
    shop.same("out", "whole")
    assert listed(shop.folder / "out") == listed(shop.folder / "whole")
    before = shop.pictures("out")
    shop.job()
    assert shop.pictures("out") == before


def test_a_sequence_is_denoised_when_all_frames_are_there(shop):
    words = f"render s.####.vdb --views 1 {LIT} --png --denoise -o"
    template = shop.bundle(f"{words} out --openjd-chunk 2")
    assert [step["name"] for step in template["steps"]] == ["Render", "Denoise"]
    assert template["steps"][1]["dependencies"] == [{"dependsOn": "Render"}]
    shop.job("--step", "Denoise", "--run-dependencies")
    shop.run(f"{words} whole")
    for part in ["", "/noisy"]:
        shop.same(f"out{part}", f"whole{part}")
        assert listed(shop.folder / f"out{part}") == listed(shop.folder / f"whole{part}")
    for number in [1, 2, 3]:
        name = f"frame.{number:04}.png"
        assert samples(shop.folder / "out" / name) == samples(shop.folder / "whole" / name)


def test_chunks_of_a_sequence_are_denoised_apart(shop):
    shop.run(f"render smoke.vdb --views 1 --frames 1-7 {LIT} -o noisy")
    words = "denoise noisy/frame.####.exr --chunk 3 --overlap 2 --quiet -o"
    template = shop.bundle(f"{words} out/frame.####.exr")
    tasks = template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]
    assert tasks == {"name": "Frames", "type": "STRING", "range": ["1-3", "4-6", "7"]}
    shop.job()
    shop.run(f"{words} whole/frame.####.exr")
    shop.same("out/frame.####.exr", "whole/frame.####.exr")
    # Without chunks a frame learns from all those before it.
    assert "parameterSpace" not in shop.bundle("denoise noisy/frame.####.exr -o one/frame.####.exr", "one-job")["steps"][0]


def test_replicates_of_a_still_are_merged(shop):
    words = f"render smoke.vdb --views 1 --replicates 0-9 {LIT} -o"
    template = shop.bundle(f"{words} out.exr --openjd-chunk 4")
    assert [step["name"] for step in template["steps"]] == ["Render", "Merge"]
    shop.job("--step", "Merge", "--run-dependencies")
    shop.run(f"{words} whole.exr")
    shop.same("out.exr", "whole.exr")


def test_the_last_step_compares(shop):
    words = f"render smoke.vdb --views 1 {LIT} -o"
    shop.run(f"{words} whole --frames 1-5")
    compared = f"--frames 1-3 --openjd-reference {shop.folder / 'whole'} --openjd-tolerance"
    template = shop.bundle(f"{words} out {compared} 0")
    assert [step["name"] for step in template["steps"]] == ["Render", "Compare"]
    assert template["steps"][1]["dependencies"] == [{"dependsOn": "Render"}]
    # The frames may be changed when the job is submitted.
    shop.job("--step", "Compare", "--run-dependencies", "-p", "Frames=2-3")
    assert {path.name for path in shop.folder.glob("out/*.exr")} == {"frame.0002.exr", "frame.0003.exr"}
    # Other random numbers are another picture.
    for tolerance, fails in [(1e-3, True), (1e3, False)]:
        name = f"job{tolerance}"
        shop.bundle(f"{words} other --seed 7 {compared} {tolerance}", name)
        log = shop.job("--step", "Compare", "--run-dependencies", name=name, fails=fails)
        assert ("differ" in log) == fails


@pytest.mark.parametrize(
    "words",
    [
        "render smoke.vdb --views 5 --view 1-2 --size 8x8 -o {}",
        "render smoke.vdb --views 1 --frames 1-5x2 --size 8x8 -o {}",
        f"render s.####.vdb --views 1 {LIT} --denoise -o {{}}",
        f"render smoke.vdb --views 1 --replicates 0-3 {LIT} -o {{}}.exr",
        "denoise noisy/frame.####.exr --chunk 2 -o {}/f.####.exr",
        "denoise noisy/frame.####.exr --frames 1-2 -o {}/f.####.exr",
    ],
)
def test_every_kind_of_work_is_compared_with_what_may_have_more(shop, words):
    shop.run(f"render smoke.vdb --views 1 --frames 1-3 {LIT} -o noisy")
    # The reference of views and frames has all of them.
    shop.run(words.format("whole").replace("--view 1-2 ", "").replace("1-5x2", "1-5"))
    reference = words.format("whole").split()[-1]
    template = shop.bundle(f"{words.format('out')} --openjd-reference {reference}")
    assert template["steps"][-1]["dependencies"] == [{"dependsOn": template["steps"][-2]["name"]}]
    shop.job("--step", "Compare", "--run-dependencies")


def test_a_reconstruction_is_one_task(shop):
    shop.run("render smoke.vdb --views 8 --size 24x24 --quiet -o shots")
    words = "reconstruct density shots --resolution 12 --iterations 2 --quiet -o"
    template = shop.bundle(f"{words} out.vdb --max-memory 1G")
    [step] = template["steps"]
    assert step["hostRequirements"] == {"amounts": [{"name": "amount.worker.memory", "min": 1024}]}
    shop.job()
    shop.run(f"{words} whole.vdb")
    shop.run("diff out.vdb whole.vdb")


def test_paths_are_mapped(shop, tmp_path_factory):
    words = "render smoke.vdb --views 2 --size 8x8 --quiet -o out"
    shop.bundle(words)
    there = tmp_path_factory.mktemp("there")
    (there / "smoke.vdb").write_bytes((shop.folder / "smoke.vdb").read_bytes())
    rule = {"source_path_format": "POSIX", "source_path": str(shop.folder), "destination_path": str(there)}
    shop.job("--path-mapping-rules", json.dumps({"version": "pathmapping-1.0", "path_mapping_rules": [rule]}))
    assert len(listed(there / "out")) == 2 and not (shop.folder / "out").exists()


def test_failures_are_told(shop):
    shop.bundle("render smoke.vdb --views 2 --size 8x8 --quiet -o out")
    (shop.folder / "smoke.vdb").unlink()
    folder = shop.folder / "job"
    command = [OPENJD, "run", folder / "template.json", "-p", f"file://{folder / 'parameters.json'}"]
    out = subprocess.run([*command, "-p", f"Cumulo={shop.program}"], capture_output=True, text=True)
    assert out.returncode != 0
    assert "openjd_fail: " in out.stdout + out.stderr and "smoke.vdb" in out.stdout + out.stderr


def test_another_job_is_not_replaced(shop):
    words = "render smoke.vdb --views 2 --size 8x8 -o out --openjd job"
    shop.run(words)
    shop.run(words)
    other = words.replace("views 2", "views 3")
    shop.run(other, code=2)
    shop.run(f"{other} --overwrite")
    shop.run("render smoke.vdb --frames 1-4 --views 1 --albedo 0.9 --time 5s -o timed --openjd t", code=2)
