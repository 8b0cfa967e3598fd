"""Stages of `cumulo usd author`, judged by OpenUSD itself."""

import shutil

import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade, UsdValidation, UsdVol


@pytest.fixture
def smoke(fixtures, tmp_path):
    """A folder with a sequence of three frames."""
    for number, name in enumerate(("plume", "cube", "slab"), 1):
        shutil.copy(fixtures / f"{name}.vdb", tmp_path / f"smoke.{number:04}.vdb")
    return tmp_path


def faults(stage):
    """What OpenUSD's validators find."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    return [f"{fault.GetName()}: {fault.GetMessage()}" for fault in found]


LIGHT = ("--albedo", "0.9,0.8,0.7", "--emission", "1", "--sun=-1,0.6,0.7", "--sun-color", "3,2,1", "--sky", "0.1")


def test_authored_stages_are_valid(cumulo, fixtures, smoke):
    cumulo("render", smoke / "smoke.0001.vdb", "--views", "3", "--size", "16x12", "-o", smoke / "shots")
    cumulo("usd", "author", smoke / "smoke.####.vdb", *LIGHT, "--camera", smoke / "shots", "-o", smoke / "moving.usda")
    cumulo("usd", "author", fixtures / "kinds.vdb", "-o", smoke / "kinds.usda")
    cumulo("usd", "author", fixtures / "blob_sheared.vdb", "--up", "y", "-o", smoke / "blob.usda")
    for name in ("moving", "kinds", "blob"):
        stage = Usd.Stage.Open(str(smoke / f"{name}.usda"))
        assert faults(stage) == [], name


def test_openusd_reads_what_was_asked_for(cumulo, smoke):
    cumulo("usd", "author", smoke / "smoke.####.vdb", "--fps", "25", *LIGHT, "-o", smoke / "stage.usda")
    stage = Usd.Stage.Open(str(smoke / "stage.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (1, 3, 25)
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    volume = UsdVol.Volume(stage.GetDefaultPrim().GetChild("smoke"))
    assert volume.GetFieldPaths() == {"density": volume.GetPath().AppendChild("density")}
    field = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(volume.GetFieldPath("density")))
    for frame in (1, 2, 3):
        path = field.GetFilePathAttr().Get(frame)
        assert path.path == f"./smoke.{frame:04}.vdb" and path.resolvedPath == str(smoke / f"smoke.{frame:04}.vdb")
    # 16³ voxels of 1/8 from 0 on: half a voxel around their centers.
    low, high = volume.GetExtentAttr().Get(2)
    assert Gf.IsClose(low, Gf.Vec3f(-0.0625), 1e-6) and Gf.IsClose(high, Gf.Vec3f(1.9375), 1e-6)
    sun, = (UsdLux.DistantLight(prim) for prim in stage.Traverse() if prim.IsA(UsdLux.DistantLight))
    irradiance = Gf.Vec3f(sun.GetColorAttr().Get()) * sun.GetIntensityAttr().Get()
    assert sun.GetNormalizeAttr().Get() and Gf.IsClose(irradiance, Gf.Vec3f(3, 2, 1), 1e-5)
    # Its light travels along -Z, away from the sun.
    towards = UsdGeom.XformCache().GetLocalToWorldTransform(sun.GetPrim()).TransformDir(Gf.Vec3d(0, 0, 1))
    assert Gf.IsClose(towards.GetNormalized(), Gf.Vec3d(-1, 0.6, 0.7).GetNormalized(), 1e-6)


def test_materials_are_chosen_by_variant(cumulo, smoke):
    cumulo("usd", "author", smoke / "smoke.0001.vdb", "--albedo", "0.9", "-o", smoke / "stage.usda")
    stage = Usd.Stage.Open(str(smoke / "stage.usda"))
    prim = stage.GetDefaultPrim().GetChild("smoke")
    renderers = prim.GetVariantSets().GetVariantSet("renderer")
    assert sorted(renderers.GetVariantNames()) == ["arnold", "cycles", "materialx", "none"]
    assert renderers.GetVariantSelection() == "none"
    outputs = {"arnold": "outputs:arnold:volume", "cycles": "outputs:cycles:volume", "materialx": "outputs:mtlx:volume"}
    for renderer, name in outputs.items():
        assert renderers.SetVariantSelection(renderer)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        output = material.GetPrim().GetAttribute(name)
        source, = output.GetConnections()
        assert UsdShade.Shader(stage.GetPrimAtPath(source.GetPrimPath())).GetShaderId(), renderer
        # Whatever a renderer's own shaders are, OpenUSD knows none of them, and nothing else is wrong.
        assert {fault.split(":")[0] for fault in faults(stage)} == {"MissingShaderIdInRegistry"}, renderer


def test_stages_of_openusd_are_linted(cumulo, smoke):
    """A stage written by OpenUSD is clean; one with faults is not, and the layer over it is what OpenUSD sees."""
    stage = Usd.Stage.CreateNew(str(smoke / "made.usdc"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    volume = UsdVol.Volume.Define(stage, "/cloud")
    stage.SetDefaultPrim(volume.GetPrim())
    field = UsdVol.OpenVDBAsset.Define(stage, "/cloud/density")
    field.CreateFilePathAttr("./smoke.0002.vdb")
    field.CreateFieldNameAttr("density")
    volume.CreateFieldRelationship("density", field.GetPath())
    volume.CreateExtentAttr([(-0.0625,) * 3, (1.9375,) * 3])
    stage.Save()
    assert cumulo("usd", "lint", smoke / "made.usdc")["clean"]

    field.CreateFieldDataTypeAttr("double")
    stage.ClearDefaultPrim()
    stage.Save()
    report = cumulo("usd", "lint", smoke / "made.usdc", "--fix", smoke / "layer.usda")
    assert sorted(f["id"] for f in report["stages"][0]["findings"]) == ["data-type", "default-prim"]
    assert report["clean"]
    fixed = Usd.Stage.Open(str(smoke / "layer.usda"))
    assert fixed.GetDefaultPrim().GetPath() == "/cloud" and UsdGeom.GetStageMetersPerUnit(fixed) == 0.01
    assert UsdVol.OpenVDBAsset.Get(fixed, "/cloud/density").GetFieldDataTypeAttr().Get() == "float"
    assert faults(fixed) == []
