//! Level sets to fog volumes, and back.

use crate::error::{Error, Result};
use crate::formats::vdb::{GridInfo, NativeGrid};
use crate::scene::grid::GridClass;
use serde::{Deserialize, Serialize};

/// Form that a volume takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// Densities: 0 outside, 1 inside, with a ramp across the inner half of the narrow band.
    Fog,
    /// Distances to the surface of one density, negative inside.
    LevelSet,
}

/// Form that a grid was given.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
pub(crate) struct Formed {
    /// Form of the grid now.
    pub form: Form,
    /// Density of the surface; none for a fog volume.
    pub iso: Option<f64>,
}

impl Form {
    /// Name of the form in sentences.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Fog => "fog volume",
            Self::LevelSet => "level set",
        }
    }

    /// Gives a grid this form, where it holds the other one; `room` refuses bytes that are not to be had. Fog volumes
    /// and grids of no class hold densities, level sets distances; vectors, integers and points are left alone. Returns
    /// `None` for a grid that stays as it is.
    ///
    /// # Errors
    /// If no surface has the value `iso`, the voxels of a level set would be no cubes, or memory does not suffice.
    pub(crate) fn give(
        self,
        native: &mut NativeGrid,
        info: &GridInfo,
        iso: Option<f64>,
        room: &dyn Fn(u64) -> Result<()>,
    ) -> Result<Option<Formed>> {
        let real = matches!(info.value_type.as_str(), "float" | "double");
        match (self, info.class) {
            _ if !real => Ok(None),
            (Self::Fog, GridClass::LevelSet) => {
                room(0)?;
                native.make_fog()?;
                Ok(Some(Formed { form: self, iso: None }))
            }
            (Self::LevelSet, GridClass::FogVolume | GridClass::Unknown) => {
                let iso = surface(native, iso)?;
                room(native.level_set_bytes(iso)?)?;
                native.make_level_set(iso)?;
                Ok(Some(Formed { form: self, iso: Some(iso) }))
            }
            _ => Ok(None),
        }
    }
}

/// Returns the density of the surface: `iso`, else half of the largest.
fn surface(native: &NativeGrid, iso: Option<f64>) -> Result<f64> {
    let (_, largest) = native.value_range()?;
    let iso = iso.unwrap_or(0.5 * largest);
    if largest.is_finite() && iso <= largest && iso.is_finite() {
        return Ok(iso);
    }
    let found = if largest.is_finite() { format!("the largest density is {largest}") } else { "there is none".into() };
    Err(Error::invalid(format!("no density is ⟨iso={iso}⟩ or more: {found}"))
        .hint("give an ⟨iso⟩ between the density outside and the largest one; cumulo info shows both"))
}
