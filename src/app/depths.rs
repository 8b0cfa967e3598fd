//! Depths of pictures of other renderers.

use crate::error::{Code, Error, Result};
use crate::formats::exr::{self, Header, LayerInfo};
use crate::formats::limits::Limits;
use std::path::Path;

/// Reads the size and the depths of a picture, row by row from the top; infinite where nothing was rendered. `layer` is
/// the name of the layer that has them, none for the only one that is plainly that, and `remedy` says how to choose it.
///
/// # Errors
/// If the picture cannot be read, or no layer, or several, may be that of depths. The error names the picture.
pub(crate) fn read(
    path: &Path,
    layer: Option<&str>,
    remedy: &'static str,
    limits: Limits,
) -> Result<([usize; 2], Vec<f32>)> {
    of_layer(path, layer, remedy, limits).map_err(|e| e.at(path))
}

fn of_layer(path: &Path, layer: Option<&str>, remedy: &'static str, limits: Limits) -> Result<([usize; 2], Vec<f32>)> {
    let header = exr::header(path)?;
    let name = match layer {
        Some(name) => name.to_owned(),
        None => plainly_depths(&header).map_err(|e| e.hint(remedy))?,
    };
    let found = exr::layer_within(path, Some(&name), limits)
        .map_err(|e| if e.code() == Code::NoSuchLayer { e.instead(remedy) } else { e })?;
    let at = match &found.channels[..] {
        [_] => 0,
        several => {
            let place = |name: &str| several.iter().position(|channel| channel.eq_ignore_ascii_case(name));
            // X, Y and Z are a vector.
            place("z").filter(|_| place("x").is_none()).ok_or_else(|| {
                let channels = several.join(", ");
                Error::invalid(format!("the layer '{name}' has the channels {channels}, and none is a depth"))
                    .hint(remedy)
            })?
        }
    };
    let mut depths: Vec<f32> = found.values.iter().skip(at).step_by(found.channels.len()).copied().collect();
    // Beside what was rendered nothing stands.
    let part = header.layers().into_iter().find(|layer| layer.name == found.name).map_or(0, |layer| layer.part);
    let (window, display) = (header.parts[part].data_window, header.display_window);
    for (place, depth) in depths.iter_mut().enumerate() {
        let at = [place % found.width, place / found.width];
        let from = [0, 1].map(|a| i64::from(display.min[a]) + at[a] as i64 - i64::from(window.min[a]));
        if (0..2).any(|a| from[a] < 0 || from[a] >= window.size[a] as i64) {
            *depth = f32::INFINITY;
        }
    }
    Ok(([found.width, found.height], depths))
}

/// Returns the name of the only layer that has depths by its name.
fn plainly_depths(header: &Header) -> Result<String> {
    let layers = header.layers();
    let components = |layer: &LayerInfo| -> Vec<String> {
        let channels = &header.parts[layer.part].channels;
        layer.channels.iter().map(|channel| channels[*channel].component.to_ascii_lowercase()).collect()
    };
    let of_depth = |layer: &&LayerInfo| {
        let last = layer.name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        let components = components(layer);
        match last.as_str() {
            "depth" | "z" => components.len() == 1 || components.iter().any(|c| c == "z"),
            "" => components.iter().any(|c| c == "z" || c == "depth"),
            _ => false,
        }
    };
    let found: Vec<&LayerInfo> = layers.iter().filter(of_depth).collect();
    match (&found[..], &layers[..]) {
        ([only], _) => Ok(only.name.clone()),
        ([], [only]) if only.channels.len() == 1 => Ok(only.name.clone()),
        _ => {
            let names = layers.iter().map(|layer| format!("'{}'", layer.name)).collect::<Vec<_>>().join(", ");
            let what =
                if found.is_empty() { "no layer is plainly that of depths" } else { "several layers have depths" };
            Err(Error::invalid(format!("{what}: the file has {names}")))
        }
    }
}
