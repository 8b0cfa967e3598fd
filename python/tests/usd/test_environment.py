"""The environment for USD work: the library of the pinned release, not the one inside Blender."""

from pxr import Usd, UsdVol


def test_the_pinned_usd_writes_a_volume_stage():
    assert Usd.GetVersion() == (0, 26, 11)
    stage = Usd.Stage.CreateInMemory()
    volume = UsdVol.Volume.Define(stage, "/smoke")
    field = UsdVol.OpenVDBAsset.Define(stage, "/smoke/density")
    field.CreateFilePathAttr("smoke.vdb")
    volume.CreateFieldRelationship("density", field.GetPath())
    assert 'asset filePath = @smoke.vdb@' in stage.GetRootLayer().ExportToString()
