//! Where the motion of a sequence comes from.

use super::names::Names;
use crate::app::motion::{Choices, Tracing};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::exr::{Document, LayerInfo};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::sequence::Pattern;
use crate::formats::{captures, registry, scene_file};
use crate::scene::film::Film;
use crate::text::serde_as_text;
use glam::Vec2;
use std::fmt;
use std::path::{Path, PathBuf};
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
    /// The volume, or one for each frame, and cameras.
    Volume {
        /// Volume, or pattern of one for each frame.
        input: PathBuf,
        /// Capture with the cameras.
        cameras: PathBuf,
    },
    /// Pictures at rest.
    None,
}

impl Motion {
    /// Returns the paths that the motion is read from: a pattern of files, or a volume and its cameras.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        let paths = match self {
            Self::Files(path) => [Some(path), None],
            Self::Volume { input, cameras } => [Some(input), Some(cameras)],
            Self::Auto | Self::Layer(_) | Self::None => [None, None],
        };
        paths.into_iter().flatten().map(PathBuf::as_path)
    }
}

impl Motion {
    /// Returns the files that the motion of a frame is read from, those that a scene file names among them; of a stage
    /// it is the stage alone.
    pub(crate) fn files(&self, number: u32) -> Vec<PathBuf> {
        let frame =
            |path: &Path| Pattern::parse(path).map_or_else(|| path.to_path_buf(), |pattern| pattern.path(number));
        match self {
            Self::Files(path) => vec![frame(path)],
            Self::Volume { input, cameras } => {
                let volume = frame(input);
                let folder = volume.parent().unwrap_or(Path::new(""));
                let is_scene = registry::sniff(&volume).is_ok_and(|format| matches!(format.kind, FileKind::Capture));
                let scene = is_scene.then(|| scene_file::read(&volume, Limits::default()).ok()).flatten();
                let named: Vec<PathBuf> =
                    scene.iter().flat_map(|s| s.files()).map(|f| frame(&folder.join(f))).collect();
                std::iter::once(volume.clone()).chain(named).chain(captures::files(cameras)).collect()
            }
            Self::Auto | Self::Layer(_) | Self::None => Vec::new(),
        }
    }
}

impl fmt::Display for Motion {
    /// Writes the text that [`FromStr`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::None => f.write_str("none"),
            Self::Layer(name) => write!(f, "layer:{name}"),
            Self::Files(path) => write!(f, "files:{}", path.display()),
            Self::Volume { input, cameras } => write!(f, "vdb:{},{}", input.display(), cameras.display()),
        }
    }
}

serde_as_text!(Motion);

impl FromStr for Motion {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text.split_once(':') {
            None if text == "auto" => Ok(Self::Auto),
            None if text == "none" => Ok(Self::None),
            Some(("layer", name)) if !name.is_empty() => Ok(Self::Layer(name.to_owned())),
            Some(("files", path)) if !path.is_empty() => Ok(Self::Files(path.into())),
            Some(("vdb", paths)) => match paths.rsplit_once(',') {
                Some((input, cameras)) if !input.is_empty() && !cameras.is_empty() => {
                    Ok(Self::Volume { input: input.into(), cameras: cameras.into() })
                }
                _ => Err("vdb: takes a volume and its cameras, vdb:smoke.vdb,transforms.json".to_owned()),
            },
            _ => Err("auto, none, layer:NAME, files:'motion.####.exr' or vdb:V.vdb,CAPTURE is expected".to_owned()),
        }
    }
}

/// Motion of a frame in pixels to the right and downwards, by pixel.
#[derive(Debug, Clone, Default)]
pub(super) struct Moved {
    /// The place in the frame denoised before minus that now; `None` if it is not known.
    pub toward: Option<Vec<Vec2>>,
    /// The place in the other neighbour minus that now, where `toward` is not known.
    pub away: Option<Vec<Vec2>>,
    /// Alpha of the files or the volume that the motion comes from, which has no noise.
    pub alpha: Option<Arc<Vec<f32>>>,
}

impl Moved {
    /// True if nothing moves.
    pub(crate) fn is_zero(&self) -> bool {
        let zero = |motion: &Option<Vec<Vec2>>| motion.iter().flatten().all(|motion| *motion == Vec2::ZERO);
        zero(&self.toward) && zero(&self.away)
    }
}

/// Motions of the frames, read or traced one after the other.
pub(super) struct Motions<'m> {
    motion: &'m Motion,
    limits: Limits,
    tracing: Option<Tracing>,
}

/// Frame whose motion is asked for.
pub(super) struct MotionRequest<'a> {
    pub document: &'a Document,
    /// Number of the view among the document's.
    pub view: usize,
    pub size: [usize; 2],
    pub number: u32,
    /// False where the frame is denoised by those after it.
    pub forward: bool,
}

impl<'m> Motions<'m> {
    /// Prepares the motions of the frames with these numbers.
    ///
    /// # Errors
    /// If cameras cannot be read, or do not fit the frames.
    pub(super) fn new(motion: &'m Motion, numbers: &[u32], limits: Limits) -> Result<Self> {
        let tracing = match motion {
            Motion::Volume { input, cameras } => {
                Some(Tracing::new(input, cameras, numbers, Choices::default(), limits)?)
            }
            _ => None,
        };
        Ok(Self { motion, limits, tracing })
    }

    /// Returns the motion of a view of a frame.
    ///
    /// # Errors
    /// If the layer, file or volume that was named is not there, or does not fit.
    pub(crate) fn of(&mut self, asked: &MotionRequest<'_>, cancel: &Cancel) -> Result<Moved> {
        let document = asked.document;
        let name = match self.motion {
            Motion::None => return Ok(Moved::default()),
            Motion::Volume { cameras, .. } => {
                let Some(tracing) = &mut self.tracing else { return Ok(Moved::default()) };
                if let [_, _, ..] = &document.header().views()[..] {
                    return Err(Error::unsupported("the cameras are of one view, and the picture has several").hint(
                        "denoise with motion layers or files for each view, or as pictures at rest: ⟨motion=none⟩",
                    ));
                }
                let film = tracing.film(asked.number, cancel)?;
                return of_film(&film, asked).map_err(|e| e.at(cameras));
            }
            Motion::Files(path) => {
                let path = Names::of(path)?.path(asked.number);
                let moving = Document::read(&path, self.limits)?;
                return of_file(&moving, asked).map_err(|e| e.at(&path));
            }
            Motion::Layer(name) => Some(name.as_str()),
            Motion::Auto => None,
        };
        let layer = match name {
            Some(name) => Some(document.layer(Some(name))?),
            None => document.header().layers().into_iter().find(|layer| is_motion(document, layer)),
        };
        layer.map_or(Ok(Moved::default()), |layer| of_layer(document, &layer, asked.view, asked))
    }
}

/// True for the layer that Cumulo and Blender call `Vector`.
fn is_motion(document: &Document, layer: &LayerInfo) -> bool {
    let name = document.header().name_in_view(layer);
    name.rsplit('.').next() == Some("Vector") && document.component(layer, "X").is_some()
}

/// Returns the motion of a file of its own, in the view of the same name, and the alpha that is with it.
fn of_file(moving: &Document, asked: &MotionRequest<'_>) -> Result<Moved> {
    let header = moving.header();
    let view = match asked.document.header().views().get(asked.view) {
        None => 0,
        Some(name) => header.views().iter().position(|other| other == name).ok_or_else(|| {
            Error::invalid(format!("the motion has no view '{name}', which the picture has"))
                .hint("give motion with a layer Vector for each view, or denoise as pictures at rest: ⟨motion=none⟩")
        })?,
    };
    let vector = header.layers().into_iter().find(|layer| is_motion(moving, layer));
    let vector = vector.map_or_else(|| moving.layer(Some("Vector")), Ok)?;
    let moved = of_layer(moving, &vector, view, asked)?;
    let alpha = moving.layer(None).ok().and_then(|beauty| {
        let beauty = header.counterpart(&beauty, view)?;
        let alpha = moving.component(&beauty, "A")?;
        let fits = moving.size(beauty.part) == asked.size;
        fits.then(|| Arc::new(moving.samples(beauty.part, alpha).into_owned()))
    });
    Ok(Moved { alpha, ..moved })
}

/// Returns the motion from planes of X, Y and, if they are there, Z and W.
fn of_planes([x, y]: [&[f32]; 2], after: Option<[&[f32]; 2]>, forward: bool) -> Moved {
    let before = || Some(x.iter().zip(y).map(|(x, y)| Vec2::new(*x, -y)).collect());
    match after {
        _ if forward => Moved { toward: before(), ..Moved::default() },
        None => Moved { away: before(), ..Moved::default() },
        Some([z, w]) => {
            let toward = z.iter().zip(w).map(|(z, w)| Vec2::new(-z, *w)).collect();
            Moved { toward: Some(toward), ..Moved::default() }
        }
    }
}

/// Returns the motion of a film of `cumulo motion`.
fn of_film(film: &Film, asked: &MotionRequest<'_>) -> Result<Moved> {
    fits([film.width, film.height], asked.size)?;
    let [x, y, z, w] = ["X", "Y", "Z", "W"].map(|name| film.plane(&format!("Vector.{name}")).unwrap_or_default());
    let alpha = film.rgba.iter().map(|pixel| pixel[3]).collect();
    Ok(Moved { alpha: Some(Arc::new(alpha)), ..of_planes([x, y], Some([z, w]), asked.forward) })
}

fn fits(found: [usize; 2], size: [usize; 2]) -> Result<()> {
    if found == size {
        return Ok(());
    }
    let ([width, height], [w, h]) = (found, size);
    Err(Error::invalid(format!("the motion has {width}x{height} pixels, and the colors have {w}x{h}"))
        .hint("motion and colors must have one size"))
}

/// Returns the motion that a layer of a document, or the layer that corresponds to it in a view, has for a frame.
fn of_layer(document: &Document, layer: &LayerInfo, view: usize, asked: &MotionRequest<'_>) -> Result<Moved> {
    let header = document.header();
    let layer = header.counterpart(layer, view).ok_or_else(|| {
        Error::invalid(format!("the view '{}' has no motion that corresponds to it", header.views()[view]))
            .part(format!("layer '{}'", layer.name))
            .hint("add a motion layer for each view, or denoise as pictures at rest: ⟨motion=none⟩")
    })?;
    let part = format!("layer '{}'", layer.name);
    fits(document.size(layer.part), asked.size).map_err(|e| e.part(part.clone()))?;
    let plane = |component: &str| Some(document.samples(layer.part, document.component(&layer, component)?));
    let (Some(x), Some(y)) = (plane("X"), plane("Y")) else {
        return Err(Error::invalid("no components X and Y")
            .part(part)
            .hint("a motion layer has X and Y, pixels to the right and upwards to the place in the frame before"));
    };
    let after = plane("Z").zip(plane("W"));
    Ok(of_planes([&x, &y], after.as_ref().map(|(z, w)| [&z[..], &w[..]]), asked.forward))
}
