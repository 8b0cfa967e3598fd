//! `cumulo schema`: the documents of every command, in success and failure, are what their schemas say.

use crate::common::work::{Work, errors};
use jsonschema::Validator;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Validator of a schema that forbids, beyond what the standard asks for, every key that the schema does not describe.
fn validator(mut schema: Value) -> Validator {
    close(&mut schema, true);
    jsonschema::validator_for(&schema).unwrap()
}

/// Closes a schema to keys that it does not describe. What it says of the object at hand may be spread over the schemas
/// that it combines, and over definitions, which are therefore closed where they are used as a whole.
fn close(schema: &mut Value, whole: bool) {
    if *schema == Value::Bool(true) {
        *schema = json!({});
    }
    let Some(keywords) = schema.as_object_mut() else { return };
    let open = keywords.keys().all(|key| ["description", "title", "default"].contains(&key.as_str()));
    for (keyword, rule) in keywords.iter_mut() {
        match (keyword.as_str(), rule) {
            ("properties", Value::Object(rules)) => rules.values_mut().for_each(|rule| close(rule, true)),
            ("$defs", Value::Object(rules)) => rules.values_mut().for_each(|rule| close(rule, false)),
            ("prefixItems", Value::Array(rules)) => rules.iter_mut().for_each(|rule| close(rule, true)),
            // A part that may be left out describes nothing.
            ("allOf" | "anyOf" | "oneOf", Value::Array(rules)) => {
                rules.iter_mut().filter(|rule| **rule != json!({})).for_each(|rule| close(rule, false));
            }
            ("items" | "additionalProperties", rule) => close(rule, true),
            _ => {}
        }
    }
    if open {
        keywords.insert("additionalProperties".into(), true.into());
    } else if whole {
        keywords.insert("unevaluatedProperties".into(), false.into());
    }
}

/// Commands whose documents are held against their schemas.
struct Documents {
    work: Work,
    schemas: RefCell<BTreeMap<String, Rc<Validator>>>,
}

impl Documents {
    fn schema(&self, kind: &str) -> Rc<Validator> {
        let read = || Rc::new(validator(self.work.json(&format!("schema {kind}"))));
        self.schemas.borrow_mut().entry(kind.to_owned()).or_insert_with(read).clone()
    }

    /// Runs a command, and checks its exit code and its document.
    fn check(&self, kind: &str, words: &str, code: i32) -> Value {
        let out = self.work.command(words).arg("--json").output().unwrap();
        assert_eq!(out.status.code(), Some(code), "{words}: {}", errors(&out));
        let document: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{words}: {e}"));
        if let Err(error) = self.schema(kind).validate(&document) {
            panic!("{words}: {error} at {}\n{document:#}", error.instance_path());
        }
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
    ok("convert", "convert @sphere_level_set.vdb a.ply");
    ok("convert", "convert a.ply a.vdb --voxel-size 0.5");
    ok("convert", "convert @head.nii.gz head.vdb --map -1024,3071");
    ok("convert", "convert cap/view_000.exr c.npy");
    ok("convert", "convert @exr/deep_tiles.exr flat.exr --flatten");
    ok("convert", "convert @sphere_level_set.vdb fog.vdb --to fog");
    ok(
        "info",
        "info @plume.vdb @kinds.vdb @sphere_level_set.vdb @exr/nan.exr @exr/blender.exr @exr/deep_tiles.exr cap a.nvdb",
    );
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
    ok("study-render", &format!("study render @plume.vdb --size 12x12 {auto} --repeats 1 --knobs quadrature -o study"));
    ok("study-gradient", "study gradient @plume.vdb --size 8x8 --repeats 1 --knobs precision -o slow");
    ok("study-denoise", "study denoise lit.exr --reference other.exr --repeats 1 --knobs method -o filters");
    ok("render", &format!("render @plume.vdb --views 6 --size 12x12 {auto} -o six"));
    ok("plan", "plan six --resolution 8 --iterations 2 --machines 1,2");
    ok("study-reconstruct", "study reconstruct six --knobs noise --resolution 8 --repeats 1 -o volumes");
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
    ok("transfer", "transfer --suggest @plume.vdb --sheet sheet.png -o suggested.tf.json");
    all.check("denoise", "denoise frames/frame.####.exr -o quiet/frame.####.exr", 2);
    for seed in [3, 4] {
        ok("render", &format!("render @plume.vdb --views 1 --size 8x8 --albedo 0.9 --seed {seed} -o seed{seed}.exr"));
    }
    ok("merge", "merge seed3.exr seed4.exr -o both.exr");
    for output in ["figure.svg", "figure.png"] {
        ok("figure", &format!("figure both.exr seed3.exr --scale-bar --orientation axes --tf viridis -o {output}"));
    }
    ok("motion", "motion @plume.vdb --cameras cap --frames 0-1 --samples 1 -o motion.####.exr");
    ok("capture-convert", "capture convert cap -o flat");
    ok("capture-new", "capture new @plume.vdb --views 3 --size 8x8 -o cameras.json");
    ok("render", "render @plume.vdb --frames 1-9 --views 1 --size 8x8 -o farm --openjd job");
    ok("denoise", "denoise cap/view_###.exr -o q_###.exr --chunk 2 --openjd job2");
    ok("reconstruct-density", "reconstruct density cap -o d.vdb --openjd job3");
    ok("usd-author", "usd author @plume.vdb -o s.usda");
    ok("usd-lint", "usd lint s.usda");
    ok("info", "info s.usda");
    ok("man", "man -o pages");
    ok("selftest", "selftest");
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
        ("capture-new", "capture new none.vdb -o out.json"),
        ("compare", "compare none.exr none.exr"),
        ("convert", "convert bad.vdb out.vdb"),
        ("denoise", "denoise none.####.exr -o out.####.exr"),
        ("diff", "diff bad.vdb @plume.vdb"),
        ("figure", "figure none.exr -o out.svg"),
        ("gradient", "gradient bad.vdb --views 1 --loss mean --wrt camera"),
        ("info", "info"),
        ("man", "man -o bad.vdb"),
        ("merge", "merge none.exr -o out.exr"),
        ("motion", "motion bad.vdb --cameras none --frames 0-1 -o out.####.exr"),
        ("plan", "plan none.vdb"),
        ("pose", "pose none --volume @plume.vdb -o out.json"),
        ("reconstruct-color", "reconstruct color none -o out.vdb"),
        ("reconstruct-density", "reconstruct density"),
        ("reconstruct-tf", "reconstruct tf none --volume @plume.vdb -o out.tf.json"),
        ("render", "render @plume.vdb --views 1 --grid none -o out"),
        ("report", "report none"),
        ("selftest", "selftest none"),
        ("study-denoise", "study denoise none.exr --reference none.exr -o page"),
        ("study-gradient", "study gradient none.vdb -o page"),
        ("study-reconstruct", "study reconstruct none -o page"),
        ("study-render", "study render none.vdb -o page"),
        ("transfer", "transfer none.tf.json"),
        ("usd-author", "usd author bad.vdb -o out.usda"),
        ("usd-lint", "usd lint none.usda"),
        ("validate", "validate none.vdb"),
        ("view", "view none.vdb -o out.png"),
        ("viewpoint", "viewpoint none.vdb -o out.json"),
    ] {
        let document = all.check(kind, words, 2);
        assert_eq!(document["command"], kind.replace('-', " "), "{words}");
        if let Err(error) = all.schema("error").validate(&document) {
            panic!("{words}: {error} at {}", error.instance_path());
        }
    }
    for words in ["nonsense", "reconstruct", "--threads 4 --nonsense"] {
        all.check("error", words, 2);
    }
}

/// Keys that are not described are told, at any depth.
#[test]
fn what_is_not_described_is_told() {
    let schema = json!({
        "type": "object",
        "properties": { "a": { "type": ["number", "null"] }, "b": { "$ref": "#/$defs/b" } },
        "required": ["a"],
        "anyOf": [{ "properties": { "c": { "const": 1 } }, "required": ["c"] }, { "properties": { "d": true } }, {}],
        "$defs": { "b": { "properties": { "x": { "type": "integer" } } } }
    });
    let validator = validator(schema);
    for yes in
        [json!({ "a": null }), json!({ "a": 1.5, "b": { "x": 1 }, "c": 1 }), json!({ "a": 1, "d": { "any": 1 } })]
    {
        assert!(validator.is_valid(&yes), "{yes}");
    }
    for no in [json!({}), json!({ "a": "1" }), json!({ "a": 1, "b": { "y": 1 } }), json!({ "a": 1, "e": 2 })] {
        assert!(!validator.is_valid(&no), "{no}");
    }
}
