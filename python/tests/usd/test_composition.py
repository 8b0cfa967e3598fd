"""Stages of several layers, as usd-core and Cumulo compose them: places, visibility and files at a time code."""

import random

import pytest

from pxr import Usd, UsdGeom, UsdVol

SHOWN = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)


class Layers:
    """Text of layers with a random choice of opinions."""

    def __init__(self, dice):
        self.dice = dice

    def point(self):
        return tuple(self.dice.randint(-5, 5) for _ in range(3))

    def place(self):
        """Transform operations in one of several orders, or none."""
        if self.dice.random() < 0.25:
            return ""
        times = sorted(self.dice.sample(range(30), self.dice.randint(1, 4)))
        samples = ", ".join(f"{time}: {self.point()}" for time in times)
        order = self.dice.choice((
            '"xformOp:translate", "xformOp:scale"', '"xformOp:scale", "xformOp:translate"', '"xformOp:translate"',
            '"!resetXformStack!", "xformOp:translate"',
        ))  # fmt: skip
        default = f"double3 xformOp:translate = {self.point()}\n" if self.dice.random() < 0.6 else ""
        moving = f"double3 xformOp:translate.timeSamples = {{ {samples} }}\n" if self.dice.random() < 0.5 or not default else ""
        scale = f"float3 xformOp:scale = ({self.dice.choice((1, 2, 0.5))}, {self.dice.choice((1, 3))}, 1)\n"
        return f"{default}{moving}{scale}uniform token[] xformOpOrder = [{order}]\n"

    def looks(self):
        """Visibility and purpose, or neither."""
        text = ""
        if self.dice.random() < 0.15:
            text += f'token visibility = "{self.dice.choice(("inherited", "invisible"))}"\n'
        if self.dice.random() < 0.1:
            text += 'token visibility.timeSamples = { 2: "invisible", 12: "inherited" }\n'
        if self.dice.random() < 0.2:
            text += f'uniform token purpose = "{self.dice.choice(("default", "render", "proxy", "guide"))}"\n'
        return text

    def file(self):
        if self.dice.random() < 0.4:
            return f"asset filePath = @{self.dice.choice(('./', 'vdb/', '../'))}f{self.dice.randint(0, 3)}.vdb@\n"
        times = sorted(self.dice.sample(range(30), self.dice.randint(1, 4)))
        return "asset filePath.timeSamples = { " + ", ".join(f"{t}: @./f{self.dice.randint(0, 3)}.vdb@" for t in times) + " }\n"

    def volume(self, name, word="def", at=""):
        types = (" Volume", " OpenVDBAsset") if word == "def" else ("", "")
        related = f"rel field:density = <{at}density>\n" if word == "def" or self.dice.random() < 0.5 else ""
        field = f'{word}{types[1]} "density" {{\n{self.file()}token fieldName = "density"\n}}\n'
        return f'{word}{types[0]} "{name}" {{\n{self.place()}{self.looks()}{related}{field}}}\n'

    def offset(self):
        if self.dice.random() < 0.5:
            return ""
        return f" (offset = {self.dice.randint(-6, 6)}; scale = {self.dice.choice((1, 2, 0.5))})"

    def header(self, *below, more=""):
        rate = f"timeCodesPerSecond = {self.dice.choice((24, 48, 12))}\n" if self.dice.random() < 0.4 else ""
        layers = ", ".join(f"@{layer}@{self.offset()}" for layer in below)
        return f'#usda 1.0\n(\ndefaultPrim = "asset"\n{rate}subLayers = [{layers}]\n{more})\n'

    def variants(self):
        sets = 'prepend variantSets = "look"'
        return f'variants = {{ string look = "{self.dice.choice("xy")}" }}\n{sets}\n'

    def instance(self, number):
        """A prim with an arc to one of the assets, perhaps an instance, inactive, or of a kind without a transform."""
        arc = self.dice.choice((
            f"prepend references = @./a/asset.usda@{self.offset()}", f"payload = @./b/leaf.usda@{self.offset()}",
            "inherits = </_class>", "specializes = </_class>",
            f"references = [@./a/asset.usda@{self.offset()}, @./b/leaf.usda@]",
        ))  # fmt: skip
        instance = "instanceable = true\n" if self.dice.random() < 0.3 else ""
        active = "active = false\n" if self.dice.random() < 0.1 else ""
        chosen = f'variants = {{ string look = "{self.dice.choice("xy")}" }}\n' if self.dice.random() < 0.5 else ""
        kind = self.dice.choice((" Xform", " Xform", " Scope", ""))
        own = self.volume("smoke", "over") if self.dice.random() < 0.4 else ""
        return f'def{kind} "i{number}" (\n{arc}\n{instance}{active}{chosen})\n{{\n{self.place()}{self.looks()}{own}}}\n'

    def write(self, folder):
        """Writes the layers, and some of the files that they name."""
        for name in ("a", "b/vdb"):
            (folder / name).mkdir(parents=True)
        for place in self.dice.sample(("", "a", "b", "b/vdb"), 3):
            for number in self.dice.sample(range(4), 2):
                (folder / place / f"f{number}.vdb").touch()
        inner = {look: self.volume(f"in{look}", at=f"/asset/in{look}/") for look in "xy"}
        (folder / "b/leaf.usda").write_text(
            f'{self.header()}def Xform "asset" (\n{self.variants()})\n{{\n{self.place()}{self.looks()}{self.volume("smoke")}'
            f'variantSet "look" = {{\n"x" {{\n{self.place()}{inner["x"]}}}\n"y" {{\n{self.looks()}{inner["y"]}}}\n}}\n}}\n'
        )
        (folder / "b/sub.usda").write_text(f'{self.header()}over "asset" {{\n{self.place()}{self.volume("smoke", "over")}}}\n')
        (folder / "a/asset.usda").write_text(
            f'{self.header("../b/sub.usda")}def Xform "asset" (\nprepend references = @../b/leaf.usda@{self.offset()}\n)\n'
            f'{{\n{self.place()}{self.looks()}{self.volume("smoke", "over")}}}\n'
        )
        (folder / "weak.usda").write_text(
            f'{self.header()}over "w" {{\nover "i0" {{\n{self.place()}{self.volume("smoke", "over")}}}\n}}\n'
            f'def Xform "alone" {{\n{self.place()}{self.volume("v")}}}\n'
        )
        first = self.dice.choice((0, 3, 7, 10, 12.5, 20))
        root = self.header("./weak.usda", more=f"startTimeCode = {first}\nendTimeCode = 40\n")
        instances = "".join(self.instance(number) for number in range(3))
        (folder / "stage.usda").write_text(
            f'{root}class Xform "_class" {{\n{self.place()}{self.volume("smoke")}}}\n'
            f'def Xform "w" {{\n{self.place()}{self.looks()}{instances}}}\n'
        )
        return folder / "stage.usda"


def file_of(stage, path, time):
    """The file at a time, the number of samples, and the files that do not exist."""
    prim = stage.GetPrimAtPath(path)
    attribute = prim.GetAttribute("filePath") if prim and prim.IsDefined() else None
    if not attribute:
        return None, 0, []
    times = attribute.GetTimeSamples()
    named = [attribute.Get(time) for time in times or [time]]
    missing = {asset.path for asset in named if asset and not asset.resolvedPath}
    value = attribute.Get(time)
    return value.path if value else None, len(times), sorted(missing)


@pytest.mark.parametrize("seed", range(40))
def test_layers_are_composed_as_by_openusd(cumulo, tmp_path, seed):
    path = Layers(random.Random(seed)).write(tmp_path)
    stage = Usd.Stage.Open(str(path))
    time = stage.GetStartTimeCode()
    cache = UsdGeom.XformCache(time)
    found = {volume["path"]: volume for volume in cumulo("info", path)["files"][0]["volumes"]}
    wanted = [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), SHOWN) if prim.IsA(UsdVol.Volume)]
    assert sorted(found) == sorted(str(prim.GetPath()) for prim in wanted)
    for prim in wanted:
        volume, place = found[str(prim.GetPath())], cache.GetLocalToWorldTransform(prim)
        image = UsdGeom.Imageable(prim)
        shown = image.ComputePurpose() in ("default", "render") and image.ComputeVisibility(time) != "invisible"
        assert volume["rendered"] == shown, prim
        rows = sum(volume["local_to_world"], [])
        # A few products of numbers below 100, in double precision.
        assert rows == pytest.approx([place[column][row] for row in range(4) for column in range(4)], abs=1e-9), prim
        fields = {field["name"]: (field["file"], field["samples"], sorted(field["missing_files"])) for field in volume["fields"]}
        related = UsdVol.Volume(prim).GetFieldPaths()
        assert fields == {str(name): file_of(stage, target, time) for name, target in related.items()}, prim
