//! Where the motion of a sequence comes from.

use crate::cli::denoise::pattern;
use crate::error::{Error, Result};
use crate::formats::exr::Document;
use crate::formats::limits::Limits;
use glam::Vec2;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// Source of the motion.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Motion {
    /// The layer `Vector`, if there is one.
    Auto,
    /// A layer by its name.
    Layer(String),
    /// Files of their own.
    Files(PathBuf),
    /// Pictures at rest.
    None,
}

impl FromStr for Motion {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text.split_once(':') {
            None if text == "auto" => Ok(Self::Auto),
            None if text == "none" => Ok(Self::None),
            Some(("layer", name)) if !name.is_empty() => Ok(Self::Layer(name.to_owned())),
            Some(("files", path)) if !path.is_empty() => Ok(Self::Files(path.into())),
            _ => Err("auto, none, layer:NAME or files:'motion.####.exr' is expected".to_owned()),
        }
    }
}

/// Motion of a frame in pixels to the right and downwards, by pixel: the place in the frame before, and in the frame after,
/// minus that now.
#[derive(Debug, Clone, Default)]
pub struct Moved {
    pub before: Option<Vec<Vec2>>,
    pub after: Option<Vec<Vec2>>,
    /// Alpha of the files that the motion comes from, which has no noise.
    pub alpha: Option<Arc<Vec<f32>>>,
}

impl Moved {
    /// True if nothing moves.
    pub fn is_zero(&self) -> bool {
        let zero = |motion: &Option<Vec<Vec2>>| motion.iter().flatten().all(|motion| *motion == Vec2::ZERO);
        zero(&self.before) && zero(&self.after)
    }
}

impl Motion {
    /// Returns the motion of a frame of `size`.
    ///
    /// # Errors
    /// If the layer or file that was named is not there, or does not fit.
    pub fn of(&self, document: &Document, size: [usize; 2], number: u32, limits: Limits) -> Result<Moved> {
        let name = match self {
            Self::None => return Ok(Moved::default()),
            Self::Files(path) => {
                let path = pattern(path, "the frames' motions")?.path(number);
                let document = Document::read(&path, limits)?;
                let moved = of_layer(&document, "Vector", size).map_err(|e| e.at(&path))?;
                let alpha = document.layer(None).ok().and_then(|layer| {
                    let alpha = document.component(&layer, "A")?;
                    (document.size(layer.part) == size).then(|| Arc::new(document.samples(layer.part, alpha)))
                });
                return Ok(Moved { alpha, ..moved });
            }
            Self::Layer(name) => name,
            Self::Auto => {
                let found = document.header().layers().into_iter().find(|layer| {
                    let last = layer.name.rsplit('.').next().unwrap_or_default();
                    last == "Vector" && document.component(layer, "X").is_some()
                });
                match found {
                    Some(layer) => return of_layer(document, &layer.name, size),
                    None => return Ok(Moved::default()),
                }
            }
        };
        of_layer(document, name, size)
    }
}

fn of_layer(document: &Document, name: &str, size: [usize; 2]) -> Result<Moved> {
    let layer = document.layer(Some(name))?;
    let plane = |component: &str| Some(document.samples(layer.part, document.component(&layer, component)?));
    let found = document.size(layer.part);
    if found != size {
        return Err(Error::invalid(format!(
            "{}x{} pixels, and the colors have {}x{}",
            found[0], found[1], size[0], size[1]
        ))
        .part(format!("layer '{name}'"))
        .hint("motion and colors must have one size"));
    }
    let (Some(x), Some(y)) = (plane("X"), plane("Y")) else {
        return Err(Error::invalid("no components X and Y")
            .part(format!("layer '{name}'"))
            .hint("a motion layer has X and Y, pixels to the right and upwards to the place in the frame before"));
    };
    let before = x.iter().zip(&y).map(|(x, y)| Vec2::new(*x, -y)).collect();
    let after = plane("Z").zip(plane("W")).map(|(z, w)| z.iter().zip(&w).map(|(z, w)| Vec2::new(-z, *w)).collect());
    Ok(Moved { before: Some(before), after, alpha: None })
}
