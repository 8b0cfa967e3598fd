//! `cumulo schema`: the documents of every command, in success and failure, are what their schemas say.

use crate::common::work::{Work, errors};
use serde_json::{Map, Value};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// Keys of an object that a schema describes, or how a value departs from the schema.
type Described = Result<BTreeSet<String>, String>;

/// A JSON schema (draft 2020-12), as far as this program's have its keywords; others fail the test.
struct Schema<'s> {
    definitions: Option<&'s Map<String, Value>>,
}

impl Schema<'_> {
    /// Holds a document against a schema. Beyond what the standard asks for, every key of every object is described.
    fn check(schema: &Value, document: &Value) -> Result<(), String> {
        Schema { definitions: schema["$defs"].as_object() }.whole(schema, document, "$")
    }

    fn whole(&self, schema: &Value, value: &Value, place: &str) -> Result<(), String> {
        let described = self.part(schema, value, place)?;
        match value.as_object().and_then(|object| object.keys().find(|key| !described.contains(*key))) {
            Some(key) => Err(format!("{place}.{key} is not described")),
            None => Ok(()),
        }
    }

    fn part(&self, schema: &Value, value: &Value, place: &str) -> Described {
        let keys = || value.as_object().map(|object| object.keys().cloned().collect()).unwrap_or_default();
        let Some(schema) = schema.as_object() else {
            return if *schema == Value::Bool(true) { Ok(keys()) } else { Err(format!("{place}: nothing is allowed")) };
        };
        let mut described = BTreeSet::new();
        if !schema.keys().any(|key| !["description", "title", "default"].contains(&key.as_str())) {
            return Ok(keys());
        }
        for (keyword, rule) in schema {
            match keyword.as_str() {
                "$schema" | "$defs" | "title" | "description" | "format" | "default" | "deprecated" => {}
                "$ref" => {
                    let name = rule.as_str().and_then(|name| name.strip_prefix("#/$defs/")).unwrap();
                    described.extend(self.part(&self.definitions.unwrap()[name], value, place)?);
                }
                "type" => {
                    let types = rule.as_array().cloned().unwrap_or_else(|| vec![rule.clone()]);
                    if !types.iter().any(|name| is_of(value, name.as_str().unwrap())) {
                        return Err(format!("{place}: {value} is not of type {rule}"));
                    }
                }
                "const" if rule != value => return Err(format!("{place}: {value} is not {rule}")),
                "enum" if !rule.as_array().unwrap().contains(value) => {
                    return Err(format!("{place}: {value} is none of {rule}"));
                }
                "minimum" | "maximum" => {
                    let (Some(number), Some(bound)) = (value.as_f64(), rule.as_f64()) else { continue };
                    if if keyword == "minimum" { number < bound } else { number > bound } {
                        return Err(format!("{place}: {number} against the {keyword} {bound}"));
                    }
                }
                "const" | "enum" => {}
                "required" => {
                    let missing = |key: &&Value| value.get(key.as_str().unwrap()).is_none();
                    let absent = rule.as_array().unwrap().iter().find(missing).filter(|_| value.is_object());
                    if let Some(key) = absent {
                        return Err(format!("{place}: {key} is required"));
                    }
                }
                "properties" => {
                    for (key, rule) in rule.as_object().unwrap() {
                        if let Some(own) = value.get(key) {
                            self.whole(rule, own, &format!("{place}.{key}"))?;
                            described.insert(key.clone());
                        }
                    }
                }
                "additionalProperties" => {
                    let named = schema.get("properties").and_then(Value::as_object);
                    for (key, own) in value.as_object().into_iter().flatten() {
                        if named.is_none_or(|named| !named.contains_key(key)) {
                            self.whole(rule, own, &format!("{place}.{key}"))?;
                            described.insert(key.clone());
                        }
                    }
                }
                "items" | "prefixItems" => {
                    for (i, own) in value.as_array().into_iter().flatten().enumerate() {
                        let rule = rule.as_array().map_or(Some(rule), |rules| rules.get(i));
                        rule.map_or(Ok(()), |rule| self.whole(rule, own, &format!("{place}[{i}]")))?;
                    }
                }
                "minItems" | "maxItems" => {
                    let (Some(items), Some(bound)) = (value.as_array(), rule.as_u64()) else { continue };
                    let count = items.len() as u64;
                    if if keyword == "minItems" { count < bound } else { count > bound } {
                        return Err(format!("{place}: {count} items against {keyword} {bound}"));
                    }
                }
                "allOf" | "anyOf" | "oneOf" => {
                    let all: Vec<Described> =
                        rule.as_array().unwrap().iter().map(|rule| self.part(rule, value, place)).collect();
                    let fit = all.iter().filter(|result| result.is_ok()).count();
                    let fits = match keyword.as_str() {
                        "allOf" => fit == all.len(),
                        "anyOf" => fit > 0,
                        _ => fit == 1,
                    };
                    if !fits {
                        let told: Vec<_> = all.iter().filter_map(|result| result.as_ref().err()).collect();
                        return Err(format!("{place}: {fit} of {} schemas of {keyword} fit: {told:?}", all.len()));
                    }
                    described.extend(all.into_iter().flatten().flatten());
                }
                unknown => panic!("the keyword '{unknown}' at {place}"),
            }
        }
        Ok(described)
    }
}

fn is_of(value: &Value, name: &str) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        unknown => panic!("the type '{unknown}'"),
    }
}

/// Commands whose documents are held against their schemas.
struct Documents {
    work: Work,
    schemas: RefCell<BTreeMap<String, Value>>,
}

impl Documents {
    fn schema(&self, kind: &str) -> Value {
        let read = || serde_json::from_str(&self.work.text(&format!("schema {kind}"))).unwrap();
        self.schemas.borrow_mut().entry(kind.to_owned()).or_insert_with(read).clone()
    }

    /// Runs a command, and checks its exit code and its document.
    fn check(&self, kind: &str, words: &str, code: i32) -> Value {
        let out = self.work.command(words).arg("--json").output().unwrap();
        assert_eq!(out.status.code(), Some(code), "{words}: {}", errors(&out));
        let document: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{words}: {e}"));
        let checked = Schema::check(&self.schema(kind), &document);
        assert!(checked.is_ok(), "{words}: {}\n{document:#}", checked.unwrap_err());
        document
    }
}

#[test]
fn documents_of_every_command_are_what_their_schemas_say() {
    let all = Documents { work: Work::new(), schemas: RefCell::default() };
    let work = &all.work;
    std::fs::write(work.path("bad.vdb"), "nothing of the kind").unwrap();
    let ok = |kind: &str, words: &str| all.check(kind, words, 0);
    let auto = "--density-scale auto";
    ok("render", &format!("render @plume.vdb --views 4 --size 16x16 {auto} --png -o cap"));
    ok("convert", "convert @plume.vdb s.0001.vdb --half --up y");
    ok("convert", "convert @plume.vdb s.0003.vdb --resample 0.1");
    std::fs::write(work.path("s.0004.vdb"), "no").unwrap();
    all.check("convert", "convert s.####.vdb t.####.vdb", 2);
    ok("convert", "convert @plume.vdb a.npy");
    ok("convert", "convert a.npy b.vdb --voxel-size 0.1");
    ok("convert", "convert @plume.vdb a.nvdb");
    ok("convert", "convert @head.nii.gz head.vdb --map -1024,3071");
    ok("convert", "convert cap/view_000.exr c.npy");
    ok("convert", "convert @sphere_level_set.vdb fog.vdb --to fog");
    ok("info", "info @plume.vdb @kinds.vdb @sphere_level_set.vdb @exr/nan.exr @exr/blender.exr cap a.nvdb");
    all.check("info", "info @plume.vdb bad.vdb s.####.vdb", 2);
    ok("validate", "validate @plume.vdb cap @kinds.vdb");
    all.check("validate", "validate @plume.vdb s.####.vdb bad.vdb none.vdb", 2);
    ok("diff", "diff @plume.vdb @plume.vdb");
    all.check("diff", "diff @plume.vdb b.vdb", 1);
    all.check("diff", "diff s.####.vdb s.####.vdb", 2);
    let lit = format!(
        "render @plume.vdb --views 1 --size 12x12 {auto} --albedo 0.9 --sky 0.1 --samples 4 --aov variance,samples"
    );
    ok("render", &format!("{lit} -o lit.exr"));
    ok("render", &format!("{lit} --seed 3 -o lit.png"));
    ok("render", &format!("{lit} --seed 3 -o other.exr"));
    all.check("render", &format!("render s.####.vdb --views 1 --size 8x8 {auto} -o frames"), 2);
    ok("compare", "compare cap/view_000.exr cap/view_000.exr --flip");
    all.check("compare", "compare cap/view_000.exr cap/view_001.exr --heatmap heat.png", 1);
    ok("compare", "compare cap cap/view_###.exr --report page");
    ok("compare", "compare --statistical lit.exr other.exr");
    ok("plan", "plan @plume.vdb --albedo 0.9 --sky 0.1");
    ok("gradient", "gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt camera --check");
    ok("gradient", "gradient @plume.vdb --wrt density --loss l2 --target cap -o slopes.vdb --report grad");
    ok("viewpoint", &format!("viewpoint @plume.vdb --size 8x8 {auto} --starts 2 --pictures best -o best.json"));
    ok("pose", "pose cap --volume @plume.vdb --iterations 2 -o posed.json");
    ok("reconstruct-density", "reconstruct density cap -o d.vdb --resolution 8 --iterations 2 --report recon");
    ok("report", "report recon --reference @plume.vdb");
    let bright = "--model emission-absorption --emission 1,0.5,0.2";
    ok("render", &format!("render @plume.vdb --views 4 --size 12x12 {auto} {bright} -o bright"));
    ok("reconstruct-color", "reconstruct color bright -o e.vdb --resolution 8 --iterations 2");
    ok("render", &format!("render @plume.vdb --views 4 --size 12x12 {auto} --tf ct-bone --tf-range 0,1 -o bones"));
    ok("reconstruct-tf", "reconstruct tf bones --volume @plume.vdb --texels 6 --iterations 2 -o f.tf.json --report tf");
    ok("report", "report tf --reference f.tf.json");
    ok("transfer", "transfer --list");
    ok("transfer", "transfer f.tf.json -o g.tf.json");
    all.check("denoise", "denoise frames/frame.####.exr -o quiet/frame.####.exr", 2);
    ok("motion", "motion @plume.vdb --cameras cap --frames 0-1 --samples 1 -o motion.####.exr");
    ok("capture-convert", "capture convert cap -o flat");
    ok("usd-author", "usd author @plume.vdb -o s.usda");
    ok("usd-lint", "usd lint s.usda");
    ok("info", "info s.usda");
    ok("man", "man -o pages");
    for words in ["@plume.vdb", "@kinds.vdb", "@exr/blender.exr", "cap", "cap/view_000.png"] {
        ok("view", &format!("view {words} --size 32 -o sheet.png"));
    }
    all.check("view", "view frames/frame.####.exr --size 32 -o sheet.png", 2);
}

#[test]
fn documents_of_failures_are_what_their_schemas_say() {
    let all = Documents { work: Work::new(), schemas: RefCell::default() };
    std::fs::write(all.work.path("bad.vdb"), "nothing of the kind").unwrap();
    for (kind, words) in [
        ("capture-convert", "capture convert none -o out"),
        ("compare", "compare none.exr none.exr"),
        ("convert", "convert bad.vdb out.vdb"),
        ("denoise", "denoise none.####.exr -o out.####.exr"),
        ("diff", "diff bad.vdb @plume.vdb"),
        ("gradient", "gradient bad.vdb --views 1 --loss mean --wrt camera"),
        ("info", "info"),
        ("man", "man -o bad.vdb"),
        ("motion", "motion bad.vdb --cameras none --frames 0-1 -o out.####.exr"),
        ("plan", "plan none.vdb"),
        ("pose", "pose none --volume @plume.vdb -o out.json"),
        ("reconstruct-color", "reconstruct color none -o out.vdb"),
        ("reconstruct-density", "reconstruct density"),
        ("reconstruct-tf", "reconstruct tf none --volume @plume.vdb -o out.tf.json"),
        ("render", "render @plume.vdb --views 1 --grid none -o out"),
        ("report", "report none"),
        ("transfer", "transfer none.tf.json"),
        ("usd-author", "usd author bad.vdb -o out.usda"),
        ("usd-lint", "usd lint none.usda"),
        ("validate", "validate none.vdb"),
        ("view", "view none.vdb -o out.png"),
        ("viewpoint", "viewpoint none.vdb -o out.json"),
    ] {
        let document = all.check(kind, words, 2);
        assert_eq!(document["command"], kind.replace('-', " "), "{words}");
        if let Err(error) = Schema::check(&all.schema("error"), &document) {
            panic!("{words}: {error}");
        }
    }
    for words in ["nonsense", "reconstruct", "--threads 4 --nonsense"] {
        all.check("error", words, 2);
    }
}

/// The validator tells what does not fit.
#[test]
fn what_does_not_fit_is_told() {
    let schema = serde_json::json!({
        "type": "object",
        "properties": { "a": { "type": ["number", "null"], "minimum": 0 }, "b": { "$ref": "#/$defs/b" } },
        "required": ["a"],
        "anyOf": [{ "properties": { "c": { "const": 1 } }, "required": ["c"] }, { "properties": { "d": true } }],
        "$defs": { "b": { "items": { "enum": ["x", "y"] }, "maxItems": 2 } }
    });
    let fits = |document: Value| Schema::check(&schema, &document).is_ok();
    let yes = [
        serde_json::json!({ "a": null }),
        serde_json::json!({ "a": 1.5, "b": ["x", "y"], "c": 1 }),
        serde_json::json!({ "a": 1, "d": { "any": 1 } }),
    ];
    assert!(yes.into_iter().all(fits));
    for no in [
        serde_json::json!({}),
        serde_json::json!({ "a": "1" }),
        serde_json::json!({ "a": -1 }),
        serde_json::json!({ "a": 1, "b": ["z"] }),
        serde_json::json!({ "a": 1, "b": ["x", "x", "x"] }),
        serde_json::json!({ "a": 1, "e": 2 }),
    ] {
        assert!(Schema::check(&schema, &no).is_err(), "{no}");
    }
}
