//! The up axis that a use case works with: that of the settings, or what the input says.

use crate::app::scan::ScanSettings;
use crate::app::{sequence, volume};
use crate::error::Result;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::scene_file;
use crate::formats::usd::Stage;
use crate::formats::vdb::File;
use crate::scene::up::Up;
use crate::wording::worded;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;

/// Choice of the up axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpChoice {
    /// Axis that the metadata of the VDB or of the scene's VDBs (Houdini and Maya: Y, Blender: Z) or the stage's upAxis
    /// state, else Z.
    #[default]
    Auto,
    /// +Y, as in Houdini and Maya.
    Y,
    /// +Z, as in Blender.
    Z,
}

/// Up axis with the reason for it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct ChosenUp {
    /// Axis that points upwards.
    pub axis: Up,
    /// Reason for the axis, in words.
    pub reason: String,
}

impl UpChoice {
    /// Returns the axis that is stated; none for `Auto`.
    pub(crate) fn stated(self) -> Option<Up> {
        match self {
            Self::Auto => None,
            Self::Y => Some(Up::Y),
            Self::Z => Some(Up::Z),
        }
    }

    /// Returns the axis of an input: that of the choice, else what the metadata of a VDB or the stage say, else Z.
    ///
    /// # Errors
    /// If the input has to be asked and cannot be read.
    pub(crate) fn of(self, input: &Path, limits: Limits) -> Result<ChosenUp> {
        if let Some(axis) = self.stated() {
            return Ok(ChosenUp { axis, reason: worded("⟨up⟩ says so").into() });
        }
        if let Some(pattern) = sequence::pattern(input) {
            let first = pattern.numbers()?.first().map(|number| pattern.path(*number));
            return first.map_or_else(|| Ok(unstated()), |first| self.of(&first, limits));
        }
        match volume::format_of(input)?.kind {
            FileKind::Vdb | FileKind::NanoVdb => Ok(of_file(&volume::open(input, &ScanSettings::default(), limits)?)),
            FileKind::Usd => {
                let stage = Stage::open(input, limits)?;
                let reason = match stage.metadata.up_axis {
                    Some(_) => "the stage's upAxis says so",
                    None => "the stage states no upAxis, which means Y",
                };
                Ok(ChosenUp { axis: stage.up_axis().into(), reason: reason.into() })
            }
            FileKind::Capture if input.is_file() => of_scene(input, limits),
            _ => Ok(unstated()),
        }
    }
}

/// Returns the axis on which the VDBs of a scene file agree, else Z. A volume that a transform places tells nothing:
/// the scene's world is not that of its file.
fn of_scene(path: &Path, limits: Limits) -> Result<ChosenUp> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut axes = Vec::new();
    for entry in scene_file::read(path, limits)?.volumes {
        if entry.transform.is_some() {
            return Ok(unstated());
        }
        let up = UpChoice::Auto.of(&folder.join(&entry.file), limits)?;
        axes.push(ChosenUp { reason: format!("{}: {}", entry.file.display(), up.reason), ..up });
    }
    let agreed = axes.windows(2).all(|pair| pair[0].axis == pair[1].axis);
    Ok(axes.into_iter().next().filter(|up| agreed && up.axis == Up::Y).unwrap_or_else(unstated))
}

/// Returns the axis that the metadata of a VDB say, else Z.
pub(crate) fn of_file(file: &File) -> ChosenUp {
    file.up().map_or_else(unstated, |stated| ChosenUp { axis: stated.up, reason: stated.reason.clone() })
}

fn unstated() -> ChosenUp {
    ChosenUp { axis: Up::Z, reason: "nothing in the input states it".into() }
}

impl fmt::Display for ChosenUp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "up axis {}: {}", self.axis.name(), self.reason)
    }
}
