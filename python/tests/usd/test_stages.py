"""Stages that usd-core writes, as usd-core and Cumulo read them: transforms, cameras and files over time."""

import itertools
import json
import random

import pytest

from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, UsdVol, Vt

TIMES = (1, 2.5, 4)


def new_stage(axis, meters, first=1, last=4):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, axis)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    stage.SetStartTimeCode(first)
    stage.SetEndTimeCode(last)
    return stage


def volume(stage, path, vdb):
    smoke = UsdVol.Volume.Define(stage, path)
    field = UsdVol.OpenVDBAsset.Define(stage, f"{path}/density")
    field.CreateFilePathAttr(str(vdb))
    field.CreateFieldNameAttr("density")
    smoke.CreateFieldRelationship("density", field.GetPath())
    return smoke


def write(stage, folder, suffix):
    """The stage in a file of that kind."""
    path = folder / f"stage.{suffix}"
    if suffix == "usdz":
        stage.GetRootLayer().Export(str(folder / "root.usdc"))
        assert UsdUtils.CreateNewUsdzPackage(str(folder / "root.usdc"), str(path))
    else:
        stage.GetRootLayer().Export(str(path))
    return path


def operations(prim, dice, animated):
    """Adds transform operations of all kinds, three of them at a time, and what takes one of them back."""
    kinds = [kind for kind in UsdGeom.XformOp.Type.allValues if kind != UsdGeom.XformOp.TypeInvalid]
    xformable = UsdGeom.Xformable(prim)
    for number, kind in enumerate(dice.sample(kinds, 3)):
        precision = UsdGeom.XformOp.PrecisionDouble if dice.random() < 0.5 else UsdGeom.XformOp.PrecisionFloat
        if kind == UsdGeom.XformOp.TypeTransform:
            precision = UsdGeom.XformOp.PrecisionDouble
        name = f"op{number}"
        op = xformable.AddXformOp(kind, precision, name)
        for time in TIMES[::2] if animated and number < 2 else [Usd.TimeCode.Default()]:
            op.Set(value(op, dice), time)
        if number == 0 and dice.random() < 0.5:
            xformable.AddXformOp(kind, precision, name, isInverseOp=True)


def value(op, dice):
    """A value for an operation: far from singular."""
    some = lambda low, high: dice.uniform(low, high) * dice.choice((-1, 1))  # noqa: E731
    kind, name = op.GetOpType(), op.GetTypeName()
    if kind == UsdGeom.XformOp.TypeTransform:
        turn = Gf.Rotation(Gf.Vec3d(some(0, 1), some(0, 1), 1), some(0, 180))
        return Gf.Matrix4d().SetScale(Gf.Vec3d(1.5, 0.5, 2)) * Gf.Matrix4d(turn, Gf.Vec3d(some(0, 3), 1, 2))
    if kind == UsdGeom.XformOp.TypeOrient:
        turn = Gf.Rotation(Gf.Vec3d(some(0, 1), some(0, 1), 1), some(0, 90)).GetQuat()
        return Gf.Quatd(turn) if name == Sdf.ValueTypeNames.Quatd else Gf.Quatf(turn)
    scale = "scale" in op.GetName()
    numbers = [some(0.5, 2) if scale else some(0, 100) for _ in range(3)]
    if name in (Sdf.ValueTypeNames.Double, Sdf.ValueTypeNames.Float):
        return numbers[0]
    return Gf.Vec3d(numbers) if name in (Sdf.ValueTypeNames.Double3, Sdf.ValueTypeNames.Vector3d) else Gf.Vec3f(numbers)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_transforms(cumulo, fixtures, tmp_path, suffix):
    """Nested transforms of all kinds of operations, at rest and moving, in both axes' and units' conventions."""
    dice = random.Random(7)
    for number, (axis, meters) in enumerate(itertools.product("YZ", (0.01, 1))):
        for time in TIMES:
            stage = new_stage(axis, meters, first=time)
            paths = []
            for tree in range(6):
                path = f"/t{tree}"
                for level in range(3):
                    path += f"/p{level}"
                    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
                    operations(prim, dice, animated=(tree + level) % 2 == 0)
                    if level == 1 and tree == 5:
                        UsdGeom.Xformable(prim).SetResetXformStack(True)
                paths.append(f"{path}/smoke")
                volume(stage, paths[-1], fixtures / "cube.vdb")
            folder = tmp_path / f"{number}-{time}"
            folder.mkdir()
            report = cumulo("info", write(stage, folder, suffix))["files"][0]
            assert (report["up_axis"], report["meters_per_unit"]) == (axis, meters)
            cache = UsdGeom.XformCache(time)
            for path, found in zip(paths, report["volumes"], strict=True):
                wanted = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(path))
                # Rows of a map of column vectors are the columns of one of row vectors.
                wanted = [[wanted[column][row] for column in range(4)] for row in range(4)]
                size = max(abs(v) for row in wanted for v in row)
                apart = max(abs(a - b) for a, b in zip(sum(wanted, []), sum(found["local_to_world"], [])))
                # usd-core interpolates floats in single precision: nine operations, each off by 6e-8, which scales in between
                # enlarge by up to 2^9.
                assert found["path"] == path and apart < 1e-4 * size, (path, time, apart, size)


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_cameras(cumulo, fixtures, tmp_path, suffix, projection):
    """Points of the world fall on the same pixels, at every frame of a camera that moves and zooms."""
    width, height = 24, 18
    stage = new_stage("Y", 0.01)
    rig = UsdGeom.Xform.Define(stage, "/rig")
    rig.AddRotateYOp().Set(25.0)
    camera = UsdGeom.Camera.Define(stage, "/rig/camera")
    move = camera.AddTranslateOp()
    move.Set(Gf.Vec3d(0.4, 0.2, 6), 1)
    move.Set(Gf.Vec3d(-0.6, 0.4, 8), 4)
    camera.AddRotateXYZOp().Set(Gf.Vec3f(-4, 6, 10))
    camera.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    camera.CreateProjectionAttr(projection)
    camera.CreateHorizontalApertureAttr(40.0)
    camera.CreateVerticalApertureAttr(30.0)
    camera.CreateHorizontalApertureOffsetAttr(3.0)
    camera.CreateVerticalApertureOffsetAttr(-2.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.25, 1000))
    lens = camera.CreateFocalLengthAttr()
    lens.Set(30.0, 1)
    lens.Set(60.0, 3)
    volume(stage, "/smoke", fixtures / "cube.vdb")
    out = tmp_path / "out"
    cumulo("render", write(stage, tmp_path, suffix), "--size", f"{width}x{height}", "--frames", "1-4", "--samples", 1, "-o", out)
    frames = json.loads((out / "transforms.json").read_text())
    assert len(frames["frames"]) == 4
    for number, frame in enumerate(frames["frames"], start=1):
        told = frames | frame
        frustum = UsdGeom.Camera(camera).GetCamera(number).frustum
        to_clip = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        pose = Gf.Matrix4d(*itertools.chain(*zip(*frame["transform_matrix"])))
        for point in ((0, 0, 0), (0.7, -0.4, 0.3), (-0.5, 0.8, -0.9)):
            ndc = to_clip.Transform(Gf.Vec3d(point))
            wanted = (0.5 * (1 + ndc[0]) * width, 0.5 * (1 - ndc[1]) * height)
            local = pose.GetInverse().Transform(Gf.Vec3d(point))
            depth = -local[2] if projection == "perspective" else 1.0
            found = (told["cx"] + told["fl_x"] * local[0] / depth, told["cy"] - told["fl_y"] * local[1] / depth)
            # Apertures are single precision.
            assert found == pytest.approx(wanted, abs=1e-3), (number, point)
        assert told.get("near", 0) == pytest.approx(0.25)


def test_files_over_time(cumulo, fixtures, tmp_path):
    """Files of a sequence, some of which are missing, and the frame at which a file is rendered."""
    stage = new_stage("Z", 1, 1, 3)
    smoke = volume(stage, "/smoke", "./a.0001.vdb")
    attribute = UsdVol.OpenVDBAsset(stage.GetPrimAtPath("/smoke/density")).GetFilePathAttr()
    for number in (1, 2, 3):
        attribute.Set(f"./a.{number:04d}.vdb", number)
    (tmp_path / "a.0001.vdb").write_bytes((fixtures / "cube.vdb").read_bytes())
    (tmp_path / "a.0003.vdb").write_bytes((fixtures / "plume.vdb").read_bytes())
    path = write(stage, tmp_path, "usda")
    # The samples are there as usd-core sees them.
    read = Usd.Stage.Open(str(path))
    again = read.GetPrimAtPath("/smoke/density").GetAttribute("filePath")
    assert [again.Get(number).path for number in (1, 2, 3)] == ["./a.0001.vdb", "./a.0002.vdb", "./a.0003.vdb"]
    (found,) = cumulo("info", path)["files"][0]["volumes"][0]["fields"]
    assert (found["samples"], found["frames"], found["missing_files"]) == (3, [1, 3], ["./a.0002.vdb"])
    assert smoke.GetFieldPath("density") == "/smoke/density"
    checked = cumulo("validate", path)["files"][0]
    assert not checked["valid"] and "a.0002.vdb" in checked["findings"][0]["what"]


@pytest.mark.parametrize("suffix", ("usda", "usdc", "usdz"))
def test_arrays_of_any_length_are_read(cumulo, fixtures, tmp_path, suffix):
    """Binary files state no place for empty ones of text, and pack those of 64-bit integers in a way of their own."""
    stage = new_stage("Y", 1)
    prim = volume(stage, "/smoke", fixtures / "cube.vdb").GetPrim()
    names = prim.CreateAttribute("names", Sdf.ValueTypeNames.StringArray)
    names.Set([])
    files = prim.CreateAttribute("files", Sdf.ValueTypeNames.AssetArray)
    files.Set(Sdf.AssetPathArray([]), 1)
    files.Set(Sdf.AssetPathArray([Sdf.AssetPath(str(fixtures / "cube.vdb"))]), 2)
    prim.CreateAttribute("tokens", Sdf.ValueTypeNames.TokenArray).Set([])
    prim.CreateAttribute("numbers", Sdf.ValueTypeNames.FloatArray).Set([])
    large = Vt.Int64Array([2**33 * i * i - 7 for i in range(100)])
    prim.CreateAttribute("large", Sdf.ValueTypeNames.Int64Array).Set(large)
    if suffix != "usda":  # of text, the reader takes no arrays of uint64
        over = prim.CreateAttribute("over", Sdf.ValueTypeNames.UInt64Array)
        over.Set(Vt.UInt64Array([2**64 - 1 - 3**i for i in range(40)]), 1)
    prim.CreateAttribute("one", Sdf.ValueTypeNames.StringArray).Set(["a", "b"])
    prim.SetCustomDataByKey("none", Vt.StringArray())
    prim.SetCustomDataByKey("some", "text")
    report = cumulo("info", write(stage, tmp_path, suffix))
    assert report["files"][0]["volumes"][0]["path"] == "/smoke", report
