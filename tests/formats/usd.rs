//! USD stages: composition, values over time, transforms, lights and cameras, each by its closed form, and damaged
//! stages.

use crate::common::stages::{Stages, binary, open, package};
use crate::common::work::fixture_text;
use cumulo::formats::limits::Limits;
use cumulo::formats::usd::{Overrides, Role, ScatteringOverride, UpAxis, Value, Views, scene};
use cumulo::scene::camera::Projection;
use cumulo::scene::light::Light;
use cumulo::scene::phase::Phase;
use glam::{DMat4, DQuat, DVec2, DVec3, Vec3};
use std::f64::consts::PI;
use std::path::Path;

/// A volume with its density.
fn volume(file: &str, more: &str) -> String {
    format!(
        "def Volume \"smoke\" {{\n rel field:density = </smoke/density>\n {more}\n def OpenVDBAsset \"density\" {{\n  token \
         fieldName = \"density\"\n  asset filePath = @{file}@\n }}\n}}\n"
    )
}

#[test]
fn metadata_has_the_fallbacks_of_openusd() {
    let stages = Stages::new();
    let stage = stages.open("def \"a\" {}");
    assert_eq!((stage.up_axis(), stage.meters_per_unit(), stage.time_codes_per_second()), (UpAxis::Y, 0.01, 24.0));
    assert_eq!((stage.first_time(), stage.last_time(), stage.metadata.default_prim.clone()), (0.0, 0.0, None));
    let stage = stages.open(
        "(\n defaultPrim = \"a\"\n upAxis = \"Z\"\n metersPerUnit = 1\n startTimeCode = 3\n endTimeCode = 9\n \
         framesPerSecond = 30\n doc = \"Blender v5.0.1\"\n customLayerData = { string note = \"x\" }\n)\ndef \"a\" {}",
    );
    assert_eq!((stage.up_axis(), stage.meters_per_unit(), stage.time_codes_per_second()), (UpAxis::Z, 1.0, 30.0));
    assert_eq!((stage.first_time(), stage.last_time()), (3.0, 9.0));
    assert_eq!(stage.metadata.default_prim.as_deref(), Some("/a"));
    assert_eq!(stage.metadata.documentation.as_deref(), Some("Blender v5.0.1"));
    assert_eq!(stage.metadata.custom_data.as_ref().unwrap().entry("note").unwrap().text(), Some("x"));
}

/// Attributes of each kind, and what holds between time samples.
#[test]
fn values_hold_or_are_linear_over_time() {
    let stages = Stages::new();
    let stage = stages.open(
        "def Volume \"a\" {\n float f.timeSamples = { 1: 0, 5: 8, 3: 2 }\n double3 v.timeSamples = { 0: (0, 0, 0), 2: (2, 4, 6) }\n \
         token t.timeSamples = { 1: \"x\", 2: \"y\" }\n bool b = 1\n int i = -7\n string s = \"a \\\"b\\\"\\n\"\n \
         asset file.timeSamples = { 1: @./one.vdb@, 2: @sub/two.vdb@ }\n asset[] files = [@a@, @b@]\n \
         float blocked = None\n color3f c = (.5, 1., 2)\n}",
    );
    let prim = stage.prim("/a").unwrap();
    let at = |name: &str, time: f64| prim.number(name, time);
    assert_eq!([at("f", 0.0), at("f", 2.0), at("f", 4.0), at("f", 9.0)], [Some(0.0), Some(1.0), Some(5.0), Some(8.0)]);
    assert_eq!(prim.tuple::<3>("v", 1.0), Some([1.0, 2.0, 3.0]));
    assert_eq!([prim.text("t", 1.9).unwrap(), prim.text("t", 2.0).unwrap()], ["x", "y"]);
    assert_eq!((prim.bool("b", 0.0), prim.value("i", 0.0)), (Some(true), Some(Value::Int(-7))));
    assert_eq!(prim.text("s", 0.0).as_deref(), Some("a \"b\"\n"));
    assert_eq!((prim.value("blocked", 0.0), prim.tuple::<3>("c", 0.0)), (None, Some([0.5, 1.0, 2.0])));
    let file = prim.attribute("file").unwrap();
    assert_eq!(file.times().collect::<Vec<_>>(), [1.0, 2.0]);
    let asset = file.at(1.7).unwrap().asset().unwrap().clone();
    assert_eq!((asset.authored.as_str(), asset.path.clone()), ("./one.vdb", stages.path("one.vdb")));
    assert_eq!(file.at(2.0).unwrap().asset().unwrap().path, stages.path("sub/two.vdb"));
    assert_eq!(prim.value("files", 0.0).unwrap().list().unwrap().len(), 2);
}

/// Sublayers, references, payloads, inherits and variants; files are found from the layer that states them.
#[test]
fn stages_are_composed() {
    let stages = Stages::new();
    stages.write(
        "assets/smoke.usda",
        "(\n defaultPrim = \"Smoke\"\n)\ndef Volume \"Smoke\" {\n rel field:density = <density>\n def OpenVDBAsset \
         \"density\" {\n asset filePath.timeSamples = { 1: @./vdb/s.0001.vdb@ }\n token fieldName = \"density\"\n }\n}",
    );
    stages.write("under.usda", "def Xform \"World\" {\n double weak = 1\n double strong = 1\n double sampled = 7\n}");
    let text = "(\n subLayers = [@./under.usda@]\n)\nclass \"_base\" {\n double inherited = 4\n}\nover \"World\" {\n double strong = 2\n \
                double sampled.timeSamples = { 1: 1 }\n def \"fire\" (references = @./assets/smoke.usda@) {}\n def \"cloud\" (payload = \
                @./assets/smoke.usda@</Smoke>) {}\n def \"kind\" (inherits = </_base>) {}\n def \"choice\" (\n  variants = { \
                string size = \"big\" }\n  prepend variantSets = \"size\"\n ) {\n  variantSet \"size\" = {\n   \"big\" { double w = 9 \
                }\n   \"small\" { double w = 1 }\n  }\n }\n}\ndef \"off\" (active = false) {}";
    let stage = stages.open(text);
    assert!(stage.faults.is_empty(), "{:?}", stage.faults);
    let world = stage.prim("/World").unwrap();
    assert_eq!((world.number("weak", 0.0), world.number("strong", 0.0)), (Some(1.0), Some(2.0)));
    assert_eq!(world.number("sampled", 5.0), Some(1.0));
    for path in ["/World/fire", "/World/cloud"] {
        let volume = stage.prim(path).unwrap();
        assert_eq!(volume.type_name, "Volume");
        let fields = stage.fields(volume, 1.0);
        assert_eq!(fields[0].prim, format!("{path}/density"));
        assert_eq!(fields[0].role, Role::Density);
        // The folder of the layer that is referenced, not that of the stage.
        assert_eq!(fields[0].file.as_ref().unwrap().path, stages.path("assets/vdb/s.0001.vdb"));
    }
    assert_eq!(stage.prim("/World/kind").unwrap().number("inherited", 0.0), Some(4.0));
    assert_eq!(stage.prim("/World/choice").unwrap().number("w", 0.0), Some(9.0));
    assert!(stage.prim("/off").is_none() && stage.prim("/_base").is_none());
    assert_eq!(stage.layers.len(), 3, "{:?}", stage.layers);
    // A stronger layer's value goes before a weaker layer's samples.
    stages.write("under.usda", "def \"a\" {\n double x.timeSamples = { 0: 1, 9: 1 }\n}");
    let stage = stages.open("(\n subLayers = [@./under.usda@]\n)\nover \"a\" {\n double x = 5\n}");
    assert_eq!(stage.prim("/a").unwrap().number("x", 3.0), Some(5.0));
}

/// Text, binary and package give the same stage.
#[test]
fn encodings_agree() {
    let stages = Stages::new();
    let text = volume(
        "./smoke.vdb",
        "double3 xformOp:translate.timeSamples = { 1: (1, 2, 3), 2: (3, 2, 1) }\n uniform token[] \
                                      xformOpOrder = [\"xformOp:translate\"]",
    );
    let first = stages.open(&text);
    std::fs::write(stages.path("stage.usdc"), binary(&text)).unwrap();
    std::fs::write(stages.path("stage.usd"), binary(&text)).unwrap();
    let vdb = std::fs::read(fixture_text("cube.vdb")).unwrap();
    std::fs::write(stages.path("p.usdz"), package(&[("root.usdc", &binary(&text)), ("smoke.vdb", &vdb)])).unwrap();
    let text = format!(
        "#usda 1.0\n{}",
        text.replace("asset filePath = @./smoke.vdb@", "asset filePath.timeSamples = { 1: @smoke.vdb@ }")
    );
    std::fs::write(stages.path("q.usdz"), package(&[("root.usda", text.as_bytes()), ("smoke.vdb", &vdb)])).unwrap();
    for name in ["stage.usdc", "stage.usd", "p.usdz", "q.usdz"] {
        let stage = open(&stages.path(name)).unwrap();
        let (a, b) = (first.prim("/smoke").unwrap(), stage.prim("/smoke").unwrap());
        assert_eq!(a.relationships, b.relationships, "{name}");
        let map = |time| stage.local_to_world(b, time).unwrap();
        assert_eq!(map(1.5), DMat4::from_translation(DVec3::new(2.0, 2.0, 2.0)));
        let field = &stage.fields(b, 1.0)[0];
        let asset = field.file.as_ref().unwrap();
        assert_eq!(stage.exists(asset), name.ends_with("usdz"), "{name}: {asset:?}");
        if name.ends_with("usdz") {
            assert_eq!(std::fs::read(stage.file(asset).unwrap()).unwrap(), vdb);
        }
    }
}

/// Every operation, against the matrix that it stands for.
#[test]
fn operations_are_their_matrices() {
    let stages = Stages::new();
    let (rx, ry, rz) = (DMat4::from_rotation_x, DMat4::from_rotation_y, DMat4::from_rotation_z);
    let [a, b, c] = [0.3_f64, -0.7, 1.1];
    let degrees = format!("({}, {}, {})", a.to_degrees(), b.to_degrees(), c.to_degrees());
    let q = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-0.9);
    let quaternion = format!("({}, {}, {}, {})", q.w, q.x, q.y, q.z);
    let translation = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0));
    let scale = DMat4::from_scale(DVec3::new(2.0, 3.0, 4.0));
    let cases = [
        ("double3", "translate", "(1, 2, 3)".to_owned(), translation),
        ("float3", "scale", "(2, 3, 4)".into(), scale),
        ("double", "rotateX", a.to_degrees().to_string(), rx(a)),
        ("double", "rotateY", b.to_degrees().to_string(), ry(b)),
        ("double", "rotateZ", c.to_degrees().to_string(), rz(c)),
        ("double3", "rotateXYZ", degrees.clone(), rz(c) * ry(b) * rx(a)),
        ("double3", "rotateXZY", degrees.clone(), ry(b) * rz(c) * rx(a)),
        ("double3", "rotateYXZ", degrees.clone(), rz(c) * rx(a) * ry(b)),
        ("double3", "rotateYZX", degrees.clone(), rx(a) * rz(c) * ry(b)),
        ("double3", "rotateZXY", degrees.clone(), ry(b) * rx(a) * rz(c)),
        ("double3", "rotateZYX", degrees, rx(a) * ry(b) * rz(c)),
        ("quatd", "orient", quaternion, DMat4::from_quat(q)),
        // Rows of a map of row vectors, with the translation in the last one.
        ("matrix4d", "transform", "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (1, 2, 3, 1))".into(), translation),
    ];
    for (kind, name, value, expected) in cases {
        let stage = stages.open(&format!(
            "def Xform \"a\" {{\n {kind} xformOp:{name}:own = {value}\n uniform token[] xformOpOrder = [\"xformOp:{name}:own\"]\n}}"
        ));
        let found = stage.local_to_world(stage.prim("/a").unwrap(), 0.0).unwrap();
        assert!(found.abs_diff_eq(expected, 1e-12), "{name}: {found} {expected}");
    }
    // The order's product from left to right; an inverse; a nested prim, and one that leaves its parents behind.
    let stage = stages.open(
        "def Xform \"a\" {\n double3 xformOp:translate = (1, 2, 3)\n float3 xformOp:scale = (2, 3, 4)\n uniform token[] \
         xformOpOrder = [\"xformOp:translate\", \"xformOp:scale\", \"!invert!xformOp:translate\"]\n def Xform \"b\" {\n float3 \
         xformOp:scale = (2, 3, 4)\n uniform token[] xformOpOrder = [\"xformOp:scale\"]\n }\n def Xform \"c\" {\n double3 \
         xformOp:translate = (1, 2, 3)\n float3 xformOp:scale = (7, 7, 7)\n uniform token[] xformOpOrder = [\"xformOp:scale\", \
         \"!resetXformStack!\", \"xformOp:translate\"]\n }\n}",
    );
    let map = |path: &str| stage.local_to_world(stage.prim(path).unwrap(), 0.0).unwrap();
    let outer = translation * scale * translation.inverse();
    assert!(map("/a").abs_diff_eq(outer, 1e-12));
    assert!(map("/a/b").abs_diff_eq(outer * scale, 1e-12));
    assert!(map("/a/c").abs_diff_eq(translation, 1e-12));
    for (operations, word) in [
        ("float3 xformOp:scale = (0, 1, 1)\n uniform token[] xformOpOrder = [\"!invert!xformOp:scale\"]", "singular"),
        ("uniform token[] xformOpOrder = [\"xformOp:scale\"]", "no value"),
        ("float3 xformOp:bend = (0, 1, 1)\n uniform token[] xformOpOrder = [\"xformOp:bend\"]", "unknown"),
    ] {
        let stage = stages.open(&format!("def Xform \"a\" {{\n {operations}\n}}"));
        let error = stage.local_to_world(stage.prim("/a").unwrap(), 0.0).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains("stage.usda") && error.contains("/a"), "{error}");
    }
}

/// A light of a stage with one volume, and what is said of it.
fn light(body: &str, header: &str) -> (Vec<Light>, [f32; 3], Vec<String>) {
    let stages = Stages::new();
    let stage = stages.open(&format!("{header}\n{}{body}", volume(&fixture_text("cube.vdb"), "")));
    let loaded = scene::load(&stage, 0.0, Limits::default(), &Overrides::default()).unwrap();
    let remarks = loaded.remarks.into_iter().filter(|r| !r.contains("no medium")).collect();
    (loaded.lights, loaded.environment.radiance, remarks)
}

fn close(found: Vec3, expected: [f64; 3]) {
    let expected = DVec3::from_array(expected);
    let apart = (found.as_dvec3() - expected).abs().max_element();
    assert!(apart <= 1e-6 * expected.max_element(), "{found} {expected}");
}

/// Radiance and what follows from it, for each type of light, size and exponent.
#[test]
fn lights_have_the_radiance_of_usdlux() {
    let one = |body: &str| {
        let (lights, _, remarks) = light(body, "");
        assert_eq!((lights.len(), remarks), (1, Vec::new()), "{body}");
        lights[0]
    };
    let color = "color3f inputs:color = (1, 0.5, 0.25)\n float inputs:intensity = 3\n float inputs:exposure = 1";
    let scaled = [6.0, 3.0, 1.5];
    let times = |by: f64| scaled.map(|v| v * by);
    // Suns: irradiance is the intensity where normalized or of no extent, else π sin²(angle / 2) of it.
    let turned = "double xformOp:rotateX = 90\n uniform token[] xformOpOrder = [\"xformOp:rotateX\"]";
    for (angle, normalized, expected) in
        [(0.0, 0, 1.0), (30.0, 1, 1.0), (30.0, 0, PI * 15_f64.to_radians().sin().powi(2))]
    {
        let sun = one(&format!(
            "def DistantLight \"l\" {{\n {color}\n {turned}\n float inputs:angle = {angle}\n bool inputs:normalize = {normalized}\n}}"
        ));
        let Light::Sun { direction, irradiance, angle: found } = sun else { unreachable!() };
        // Light travels along -Z, which points to +Y after the turn: the sun is below.
        assert!((direction - DVec3::NEG_Y).length() < 1e-12, "{direction}");
        assert!((found.to_degrees() - angle).abs() < 1e-9);
        close(irradiance, times(expected));
    }
    let placed = "double3 xformOp:translate = (1, 2, 3)\n float3 xformOp:scale = (2, 2, 2)\n uniform token[] xformOpOrder = \
                  [\"xformOp:translate\", \"xformOp:scale\"]\n float inputs:radius = 0.25";
    for (normalized, expected) in [(0, 1.0), (1, 1.0 / (4.0 * PI * 0.25))] {
        let sphere =
            one(&format!("def SphereLight \"l\" {{\n {color}\n {placed}\n bool inputs:normalize = {normalized}\n}}"));
        let Light::Sphere { centre, radius, radiance } = sphere else { unreachable!() };
        assert_eq!((centre, radius), (DVec3::new(1.0, 2.0, 3.0), 0.5));
        close(radiance, times(expected));
        // The power of the sphere, 4 π r² π L, is that of the point, 4 π I.
        let point = one(&format!(
            "def SphereLight \"l\" {{\n {color}\n {placed}\n bool treatAsPoint = 1\n bool inputs:normalize = {normalized}\n}}"
        ));
        let Light::Point { position, intensity } = point else { unreachable!() };
        assert_eq!(position, centre);
        close(intensity, times(expected * PI * 0.25));
    }
    for (normalized, expected) in [(0, 1.0), (1, 1.0 / 24.0)] {
        let rectangle = one(&format!(
            "def RectLight \"l\" {{\n {color}\n {placed}\n float inputs:width = 2\n float inputs:height = 3\n bool inputs:normalize = \
             {normalized}\n}}"
        ));
        let Light::Rectangle { corner, edges: [u, v], radiance } = rectangle else { unreachable!() };
        assert_eq!(corner, DVec3::new(1.0 - 2.0, 2.0 - 3.0, 3.0));
        assert!((u.cross(v) - DVec3::new(0.0, 0.0, -24.0)).length() < 1e-12, "light leaves towards -Z: {u} {v}");
        close(radiance, times(expected));
    }
    // A map that mirrors keeps the front where -Z goes.
    let mirrored = "float3 xformOp:scale = (-1, 1, 1)\n uniform token[] xformOpOrder = [\"xformOp:scale\"]";
    let Light::Rectangle { edges: [u, v], .. } = one(&format!("def RectLight \"l\" {{\n {mirrored}\n}}")) else {
        unreachable!()
    };
    assert!(u.cross(v).z < 0.0);
    let (lights, radiance, _) = light(&format!("def DomeLight \"l\" {{\n {color}\n}}"), "");
    assert!(lights.is_empty());
    close(Vec3::from_array(radiance), scaled);
    // A temperature gives a color of luminance 1.
    let warm =
        "float inputs:intensity = 1\n bool inputs:enableColorTemperature = 1\n float inputs:colorTemperature = 3000";
    let Light::Sphere { radiance, .. } = one(&format!("def SphereLight \"l\" {{\n {warm}\n}}")) else { unreachable!() };
    let luminance = radiance.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722));
    assert!((luminance - 1.0).abs() < 1e-3 && radiance.x > 1.7 && radiance.z < 0.3, "{radiance}");
}

/// A cone falls off from its angle less the softness to its angle; of Blender's spots the softness is the blend.
#[test]
fn spheres_with_a_cone_are_spots() {
    let of = |body: &str, stage: &str| {
        let (lights, _, remarks) =
            light(&format!("def SphereLight \"l\" (apiSchemas = [\"ShapingAPI\"]) {{\n {body}\n}}"), stage);
        assert!(lights.len() == 1 && remarks.is_empty(), "{body}: {lights:?} {remarks:?}");
        lights[0]
    };
    let turned = "float xformOp:rotateX = 90\n uniform token[] xformOpOrder = [\"xformOp:rotateX\"]";
    let shaped = format!("{turned}\n float inputs:shaping:cone:angle = 60\n float inputs:shaping:cone:softness = 0.25");
    let Light::Spot { radius, soft, intensity, cone, .. } = of(&format!("{shaped}\n float inputs:radius = 0.5"), "")
    else {
        panic!("no spot")
    };
    assert_eq!((radius, soft), (0.5, false));
    assert!((intensity - Vec3::splat((0.25 * PI) as f32)).abs().max_element() < 1e-6, "{intensity}");
    // -Z is turned to +Y; light falls off from 45 degrees on.
    assert!((cone.axis() - DVec3::Y).length() < 1e-9 && (cone.angle().to_degrees() - 60.0).abs() < 1e-6);
    let along = |degrees: f64| DVec3::new(degrees.to_radians().sin(), degrees.to_radians().cos(), 0.0);
    assert!(cone.share(along(44.9)) == 1.0 && cone.share(along(46.0)) < 1.0 && cone.share(along(60.1)) == 0.0);
    let point = of(&format!("{shaped}\n bool treatAsPoint = 1\n custom bool cumulo:softFalloff = 1"), "");
    assert!(matches!(point, Light::Spot { radius: 0.0, .. }), "{point:?}");
    let of_blender = of(&shaped, "(\n doc = \"Blender v5.0.1\"\n)");
    assert!(matches!(of_blender, Light::Spot { cone, .. } if (cone.blend() - 0.25).abs() < 1e-7), "{of_blender:?}");
    // A cone of all directions is none, and a disc has an attribute of its own.
    assert!(matches!(of("float inputs:shaping:cone:angle = 180", ""), Light::Sphere { .. }));
    assert!(matches!(of("custom bool cumulo:softFalloff = 1", ""), Light::Disc { radius: 0.5, .. }));
    let stages = Stages::new();
    let odd =
        "def SphereLight \"l\" {\n float inputs:shaping:cone:angle = 30\n float inputs:shaping:cone:softness = 2\n}";
    let stage = stages.open(&format!("{}{odd}", volume(&fixture_text("cube.vdb"), "")));
    let error = scene::load(&stage, 0.0, Limits::default(), &Overrides::default()).unwrap_err().to_string();
    assert!(error.contains("/l") && error.contains("fall off"), "{error}");
}

/// Suns of Blender have a quarter of the strength and half of the angle, and no temperature unless one is stated.
#[test]
fn lights_of_blender_are_read_as_it_writes_them() {
    let sun = "def DistantLight \"l\" {\n float inputs:intensity = 0.75\n float inputs:angle = 0.265\n bool inputs:normalize = 1\n \
               bool inputs:enableColorTemperature = 1\n}";
    let (lights, _, remarks) = light(sun, "(\n doc = \"Blender v5.0.1\"\n)");
    let Light::Sun { irradiance, angle, .. } = lights[0] else { unreachable!() };
    assert_eq!(irradiance, Vec3::splat(3.0));
    // Twice 0.265 in single precision.
    assert!((angle.to_degrees() - 0.53).abs() < 1e-6);
    assert!(remarks.len() == 1 && remarks[0].contains("Blender v5.0.1"), "{remarks:?}");
    let (lights, _, _) = light(sun, "");
    let Light::Sun { irradiance, .. } = lights[0] else { unreachable!() };
    // The color of 6500 K.
    assert!((irradiance / 0.75 - Vec3::new(1.043, 0.984, 1.035)).abs().max_element() < 3e-3, "{irradiance}");
}

/// Lights that cannot be simulated are named, and why.
#[test]
fn lights_that_are_left_out_are_told() {
    for (body, word) in [
        ("def DiskLight \"l\" {}", "DiskLight"),
        ("def CylinderLight \"l\" {}", "CylinderLight"),
        ("def RectLight \"l\" (apiSchemas = [\"ShapingAPI\"]) {\n float inputs:shaping:cone:angle = 30\n}", "cone"),
        ("def SphereLight \"l\" {\n asset inputs:shaping:ies:file = @a.ies@\n}", "profile"),
        ("def RectLight \"l\" {\n asset inputs:texture:file = @a.exr@\n}", "textures"),
        ("def SphereLight \"l\" {\n rel light:filters = </smoke>\n}", "filters"),
        (
            "def DomeLight \"l\" {\n asset inputs:texture:file = @a.exr@\n token inputs:texture:format = \"angular\"\n}",
            "angular",
        ),
        ("def SphereLight \"l\" {\n float inputs:intensity = 0\n}", "dark"),
    ] {
        let (lights, _, remarks) = light(body, "");
        assert!(lights.is_empty() && remarks.len() == 1, "{body}: {lights:?} {remarks:?}");
        assert!(remarks[0].contains("/l") && remarks[0].contains(word), "{body}: {remarks:?}");
    }
    let (lights, _, remarks) = light(
        "def SphereLight \"l\" {\n rel collection:lightLink:excludes = </smoke>\n float inputs:diffuse = 0.5\n bool \
         inputs:shadow:enable = 0\n}\ndef Mesh \"m\" {}\ndef SphereLight \"hidden\" {\n token visibility = \"invisible\"\n}",
        "",
    );
    assert_eq!((lights.len(), remarks.len()), (1, 4), "{remarks:?}");
}

/// A camera's pixels, from apertures, offsets and focal length in tenths of a unit.
#[test]
fn cameras_have_their_window() {
    let stages = Stages::new();
    let camera = |body: &str, size: [u32; 2]| {
        let stage = stages.open(&format!(
            "def Camera \"c\" {{\n float horizontalAperture = 36\n float verticalAperture = 24\n {body}\n}}"
        ));
        let prim = stage.camera(None).unwrap();
        stage.view(prim, 0.0, size).unwrap()
    };
    let view = camera(
        "float focalLength = 50\n float horizontalApertureOffset = 3.6\n float verticalApertureOffset = 2.4",
        [72, 48],
    );
    assert_eq!((view.projection, view.near), (Projection::Perspective, 1.0));
    // Two pixels for each unit of the aperture: the window moves by 7.2 to the right and 4.8 upwards.
    let near = |a: DVec2, x: f64, y: f64| assert!((a - DVec2::new(x, y)).length() < 1e-5, "{a} {x} {y}");
    near(view.focal, 100.0, 100.0);
    near(view.centre, 36.0 - 7.2, 24.0 + 4.8);
    // The left edge of the window lies at (3.6 - 18) / 50 of the distance.
    let left = view.ray(0.0, view.centre.y);
    assert!((left.direction.x / -left.direction.z + 14.4 / 50.0).abs() < 1e-7);
    // Other proportions keep the horizontal aperture, which is the larger one.
    near(camera("float focalLength = 50", [72, 72]).focal, 100.0, 100.0);
    near(camera("float focalLength = 50\n float verticalAperture = 72", [72, 72]).focal, 50.0, 50.0);
    // An orthographic window of 36 tenths of a unit.
    let flat = camera("token projection = \"orthographic\"\n float2 clippingRange = (0.1, 10)", [72, 48]);
    assert_eq!(flat.projection, Projection::Orthographic);
    near(flat.focal, 20.0, 20.0);
    assert!((flat.near - 0.1).abs() < 1e-7);
}

#[test]
fn cameras_are_chosen_and_move() {
    let stages = Stages::new();
    let stage = stages.open(
        "(\n startTimeCode = 1\n endTimeCode = 4\n)\ndef Xform \"rig\" {\n double3 xformOp:translate.timeSamples = { 1: (0, 0, 1), 4: \
         (0, 0, 4) }\n uniform token[] xformOpOrder = [\"xformOp:translate\"]\n def Camera \"a\" {\n int2 cumulo:resolution = (40, 30)\n \
         float fStop = 2\n }\n}\ndef Camera \"b\" {\n float horizontalAperture = 20\n float verticalAperture = 10\n}",
    );
    let error = stage.camera(None).unwrap_err().to_string();
    assert!(error.contains("/rig/a, /b") && error.contains("`camera`"), "{error}");
    assert!(stage.camera(Some("c")).unwrap_err().to_string().contains("/rig/a, /b"));
    let capture = stage.capture(&Views { camera: Some("/rig/a"), ..Views::default() }).unwrap();
    assert_eq!(capture.frames.len(), 4);
    assert_eq!(capture.frames[2].camera.position(), DVec3::new(0.0, 0.0, 3.0));
    assert_eq!((capture.frames[0].camera.width, capture.frames[0].camera.height), (40, 30));
    assert_eq!(capture.frames[2].picture, stages.path("stage.0003.exr"));
    assert!(capture.remarks[0].contains("depth of field"), "{:?}", capture.remarks);
    let still = stage.capture(&Views { camera: Some("b"), ..Views::default() }).unwrap();
    assert_eq!((still.frames.len(), still.frames[0].camera.width, still.frames[0].camera.height), (1, 256, 128));
    let some = Views { camera: Some("a"), size: Some([8, 8]), frames: Some(vec![2]) };
    assert_eq!(stage.capture(&some).unwrap().frames[0].camera.position(), DVec3::new(0.0, 0.0, 2.0));
}

/// The medium comes from attributes, from shaders that are understood, or is assumed with a remark.
#[test]
fn media_are_read_or_told() {
    let stages = Stages::new();
    let load = |more: &str, material: &str, overrides: &Overrides| {
        let stage = stages.open(&format!("{}{material}", volume(&fixture_text("plume.vdb"), more)));
        scene::load(&stage, 0.0, Limits::default(), overrides).unwrap()
    };
    let own = "custom double cumulo:densityScale = 3\n custom color3f cumulo:albedo = (0.5, 0.25, 0.75)\n custom double \
               cumulo:anisotropy = 0.25\n custom token cumulo:model = \"scattering\"\n custom int cumulo:other = 1";
    let scene = load(own, "", &Overrides::default());
    let medium = &scene.volumes[0].medium;
    assert_eq!((medium.extinction, medium.scattering.unwrap().albedo), (3.0, [0.5, 0.25, 0.75]));
    assert!(scene.remarks.len() == 1 && scene.remarks[0].contains("cumulo:other"), "{:?}", scene.remarks);
    let bound = "rel material:binding = </m>";
    let material = |shader: &str| {
        format!(
            "def Material \"m\" {{\n token outputs:volume.connect = </m/s.outputs:out>\n def Shader \"s\" {{\n {shader}\n token outputs:out\n }}\n}}"
        )
    };
    let cycles = "uniform token info:id = \"cycles_principled_volume\"\n float inputs:density = 2\n color3f inputs:color = (0.5, 0.5, 0.5)";
    let scene = load(bound, &material(cycles), &Overrides::default());
    assert_eq!((scene.volumes[0].medium.extinction, scene.remarks.len()), (2.0, 0), "{:?}", scene.remarks);
    let scene = load(bound, &material("uniform token info:id = \"ND_curious\""), &Overrides::default());
    assert_eq!(scene.volumes[0].medium.extinction, 1.0);
    assert!(
        scene.remarks[0].contains("ND_curious") && scene.remarks[1].contains("⟨density_scale⟩"),
        "{:?}",
        scene.remarks
    );
    let scattering = ScatteringOverride { albedo: [0.9; 3], ..ScatteringOverride::default() };
    let overrides = Overrides { density_scale: Some(7.0), scattering: Some(scattering), ..Overrides::default() };
    let scene = load("", "", &overrides);
    assert_eq!((scene.volumes[0].medium.extinction, scene.remarks.len()), (7.0, 0), "{:?}", scene.remarks);
    // What the options leave out stays as the stage states it.
    let scene = load(&format!("{own}\n custom color3f cumulo:extinctionColor = (1, 0.5, 0.25)"), "", &overrides);
    let medium = &scene.volumes[0].medium;
    assert_eq!((medium.scattering.unwrap().albedo, medium.color), ([0.9; 3], [1.0, 0.5, 0.25]));
    assert_eq!(medium.scattering.unwrap().phase, Phase::of_anisotropy(0.25));
    // The volume's place: its own and that of its grid.
    let moved = "double3 xformOp:translate = (10, 0, 0)\n uniform token[] xformOpOrder = [\"xformOp:translate\"]";
    let (here, there) = (&load("", "", &overrides).volumes[0].grid, &load(moved, "", &overrides).volumes[0].grid);
    let by = there.transform.matrix() * here.transform.matrix().inverse();
    assert!(by.abs_diff_eq(DMat4::from_translation(DVec3::new(10.0, 0.0, 0.0)), 1e-12));
}

#[test]
fn stages_that_cannot_be_shown_say_why() {
    let stages = Stages::new();
    let fault = |text: &str| {
        let stage = stages.open(text);
        scene::load(&stage, 0.0, Limits::default(), &Overrides::default()).unwrap_err().to_string()
    };
    for (text, words) in [
        ("def \"a\" {}", ["stage.usda", "no prim of type Volume"]),
        ("def Volume \"a\" {}", ["/a", "density"]),
        ("def Volume \"a\" {\n token visibility = \"invisible\"\n}", ["stage.usda", "visible"]),
        (&volume("./missing.vdb", ""), ["/smoke/density", "missing.vdb"]),
        ("def Volume \"a\" {\n rel field:density = </a/f>\n def Field3DAsset \"f\" {}\n}", ["/a/f", "Field3DAsset"]),
        ("def Volume \"a\" {\n rel field:density = </b>\n}", ["/b", "no prim"]),
        ("def Volume \"a\" {\n rel field:density = </a/f>\n def OpenVDBAsset \"f\" {}\n}", ["/a/f", "filePath"]),
    ] {
        let error = fault(text);
        assert!(words.iter().all(|word| error.contains(word)) && error.lines().count() == 2, "{text}: {error}");
    }
    for (name, bytes, word) in [
        ("empty.usda", &b""[..], "valid USD"),
        ("text.usda", b"#usda 1.0\ndef \"a\" {\n float x = \n}\n", "line"),
        ("none.usda", b"#usda 1.0\n", "no prims"),
        ("binary.usdc", b"PXR-USDC\0\x08", "damaged"),
        ("latin.usda", b"#usda 1.0\n# \xff\n", "UTF-8"),
        ("package.usdz", b"PK\x03\x04", "package"),
    ] {
        let path = stages.path(name);
        std::fs::write(&path, bytes).unwrap();
        let error = open(&path).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(name) && error.remedy().is_some(), "{text}");
        assert!(text.contains(word) || word == "damaged", "{text}");
    }
    // Cycles and what is missing are faults, and the rest is there.
    stages.write("other.usda", "def \"a\" (references = @./stage.usda@</a>) {}");
    let stage =
        stages.open("def \"a\" (references = @./other.usda@</a>) {}\ndef \"b\" (references = @./missing.usda@</a>) {}");
    assert!(stage.prim("/a").is_some() && stage.faults.len() >= 2, "{:?}", stage.faults);
    assert!(stage.faults.iter().any(|fault| fault.what.contains("@missing.usda@")), "{:?}", stage.faults);
    let deep = format!("{}{}", "def \"a\" {\n".repeat(500), "}\n".repeat(500));
    let error = open(&stages.write("deep.usda", &deep)).unwrap_err().to_string();
    assert!(error.contains("deep.usda") && error.contains("nested"), "{error}");
}

/// Returns the error of the program about a stage, whose allocator reports what damaged tables ask for.
fn refusal(stage: &Path) -> Option<String> {
    let program = env!("CARGO_BIN_EXE_cumulo");
    let out =
        std::process::Command::new(program).arg("info").arg(stage).args(["--max-memory", "256M"]).output().unwrap();
    let text = String::from_utf8(out.stderr).unwrap();
    match out.status.code() {
        Some(0) => None,
        Some(2) => Some(text),
        code => panic!("{code:?}: {text}"),
    }
}

/// More than 200 stages that cannot be whole: each gives an error that names the file and a remedy, and none a panic.
/// Others, with bytes turned over, may be read or not.
#[test]
fn damaged_stages_are_refused() {
    let stages = Stages::new();
    let text = volume(
        "./smoke.vdb",
        "double3 xformOp:translate.timeSamples = { 1: (1, 2, 3) }\n custom string note = \"a 'b'\"",
    );
    let whole = format!("#usda 1.0\n(\n defaultPrim = \"smoke\"\n upAxis = \"Z\"\n)\n{text}");
    let crate_file = binary(&text);
    let packed = package(&[("root.usdc", &crate_file), ("smoke.vdb", b"x")]);
    let mut refused = 0;
    let mut expect = |name: &str, bytes: &[u8], must: bool| {
        let path = stages.path(name);
        std::fs::write(&path, bytes).unwrap();
        let error = if name.ends_with("usda") { open(&path).err().map(|e| e.to_string()) } else { refusal(&path) };
        match error {
            None => assert!(!must, "{name} of {} bytes is read", bytes.len()),
            Some(shown) => {
                let lines = shown.lines().count();
                assert!(shown.contains(name) && lines == 2 && shown.len() < 2000, "{shown}");
                refused += 1;
            }
        }
    };
    // Text that ends too early has brackets open, down to the last one.
    let last = whole.rfind('}').unwrap();
    for cut in (12..last).step_by(3) {
        expect("cut.usda", &whole.as_bytes()[..cut], cut > 60);
    }
    for cut in (0..crate_file.len()).step_by(9) {
        expect("cut.usdc", &crate_file[..cut], true);
    }
    for cut in (0..packed.len()).step_by(12) {
        expect("cut.usdz", &packed[..cut], true);
    }
    for (at, c) in whole.char_indices().filter(|(_, c)| "{}()<>@\"".contains(*c)) {
        let spoiled = format!("{}{}", &whole[..at], &whole[at + c.len_utf8()..]);
        expect("spoiled.usda", spoiled.as_bytes(), false);
    }
    let mut state = 7_u32;
    let mut next = |below: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize % below
    };
    for (name, bytes) in [("flipped.usda", whole.as_bytes()), ("flipped.usdc", &crate_file), ("flipped.usdz", &packed)]
    {
        for _ in 0..100 {
            let mut spoiled = bytes.to_vec();
            for _ in 0..1 + next(4) {
                let at = next(spoiled.len());
                spoiled[at] = next(256) as u8;
            }
            expect(name, &spoiled, false);
        }
    }
    assert!(refused >= 200, "{refused}");
}
