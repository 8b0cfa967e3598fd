//! Settings as the words of a command line.

use crate::text::shell_quoted;
use crate::wording::worded;
use serde::Serialize;
use serde_json::{Map, Value};

/// Returns the settings that differ from their defaults as options, in the words of the process's face. Those whose
/// names are `left_out` are said otherwise.
pub(super) fn stated(settings: &impl Serialize, defaults: &impl Serialize, left_out: &[&str]) -> Vec<String> {
    let [settings, defaults] = [object(settings), object(defaults)];
    let differs = |(name, value): &(&String, &Value)| {
        !left_out.contains(&name.as_str()) && defaults.get(name.as_str()) != Some(value)
    };
    settings.iter().filter(differs).filter_map(|(name, value)| option(name, value)).collect()
}

fn object(settings: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(settings) {
        Ok(Value::Object(all)) => all,
        _ => Map::new(),
    }
}

/// Returns a setting as an option; none for one that is not given.
pub(super) fn option(name: &str, value: &Value) -> Option<String> {
    let text = match (name, value) {
        (_, Value::Null | Value::Bool(false)) => return None,
        (_, Value::Bool(true)) => return Some(worded(&format!("⟨{name}⟩")).into_owned()),
        ("size", Value::Array(size)) => texts(size).join("x"),
        ("crop", Value::Object(window)) => {
            let of = |key: &str| window.get(key).and_then(Value::as_array).map(|all| texts(all)).unwrap_or_default();
            format!("{},{}", of("origin").join(","), of("size").join("x"))
        }
        (_, Value::Array(all)) if all.is_empty() => return None,
        (_, Value::Array(all)) => texts(all).join(","),
        (_, value) => text(value),
    };
    Some(worded(&format!("⟨{name}={}⟩", shell_quoted(&text))).into_owned())
}

fn texts(all: &[Value]) -> Vec<String> {
    all.iter().map(text).collect()
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => match number.as_f64() {
            // Colors are numbers of 32 bits.
            Some(v) if f64::from(v as f32) == v => (v as f32).to_string(),
            _ => number.to_string(),
        },
        Value::Array(all) => texts(all).join(","),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::pictures::{DensityScale, PictureSettings};
    use crate::scene::camera::Window;

    #[test]
    fn settings_that_are_not_the_defaults_are_options() {
        let mut pictures = PictureSettings {
            input: "smoke.vdb".into(),
            views: Some(2),
            size: Some([64, 48]),
            crop: Some(Window { origin: [1, 2], size: [3, 4] }),
            density_scale: Some(DensityScale::Auto),
            early_stop: 0.01,
            ..PictureSettings::default()
        };
        pictures.scattering.albedo = Some([0.9; 3]);
        pictures.transfer.tf = Some("my function.json".into());
        let options = stated(&pictures, &PictureSettings::default(), &["input"]);
        // Without a face, settings have the library's words.
        assert_eq!(
            options,
            [
                "`albedo=0.9,0.9,0.9`",
                "`crop=1,2,3x4`",
                "`density_scale=auto`",
                "`early_stop=0.01`",
                "`size=64x48`",
                "`tf='my function.json'`",
                "`views=2`"
            ]
        );
    }
}
