//! Deep pictures composited to flat ones.

use super::report::{Image, LayerPlace};
use super::{ConvertSettings, FileReport};
use crate::app::{Context, depths};
use crate::error::Result;
use crate::formats::exr::deep::{self, Flattened, HeldOut};
use crate::formats::exr::{self, Attributes};
use crate::formats::limits::Limits;
use crate::formats::raster::WritePicture;
use crate::wording::all_worded;

/// Attributes that a flat picture takes over: they say of the picture what stays true of it.
const KEPT: [&str; 5] = ["comments", "owner", "software", "worldToCamera", "worldToNDC"];

/// Remedy where the depths of a holdout are not found.
const ONE_LAYER: &str = "write the depths as the only layer of a file, or as one that is named Depth";

impl ConvertSettings {
    /// Composites a deep picture, with the depth of what is seen.
    pub(super) fn flatten_to_exr(&self, context: &Context) -> Result<FileReport> {
        let limits = self.begin_array()?;
        let stage = context.stage("converting");
        // The film, and the picture as bytes before and after it is packed; and what holds it out.
        let quarter = Limits { max_memory: limits.max_memory / 4 };
        let held = self.held_out(quarter)?;
        let Flattened { header, mut film } = deep::flattened(&self.input, held.as_ref(), quarter)?;
        let notes: Vec<String> = self.to_rec_709(&header, &mut film)?.into_iter().collect();
        let kept = |name: &str| KEPT.contains(&name) || name.starts_with("cumulo:");
        let attributes: Attributes = header.attributes().into_iter().filter(|(name, _)| kept(name)).collect();
        exr::write_like(
            &self.output,
            &film,
            &attributes,
            if self.half { exr::Half::Colors } else { exr::Half::None },
            &header,
        )?;
        drop(stage);
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        let channels = ["R", "G", "B", "A", "Z"].map(str::to_owned).to_vec();
        Ok(FileReport::Image(Box::new(Image {
            shape: vec![film.height, film.width],
            axes: vec!["row", "column"],
            layer: Some(LayerPlace { name: String::new(), channels }),
            notes: all_worded(notes),
            ..Image::of(&self.input, &self.output)?
        })))
    }

    /// Reads what holds the deep picture out.
    fn held_out(&self, limits: Limits) -> Result<Option<HeldOut>> {
        let Some(path) = &self.holdout else { return Ok(None) };
        let held = match deep::is_deep(path) {
            true => HeldOut::Deep(deep::read_within(path, limits)?),
            false => {
                let (size, depths) = depths::read(path, None, ONE_LAYER, limits)?;
                HeldOut::Depths(size, depths)
            }
        };
        held.defined().map_err(|e| e.at(path))?;
        Ok(Some(held))
    }

    /// Composites a deep picture for display.
    pub(super) fn flatten_to_picture(&self, write: WritePicture, context: &Context) -> Result<FileReport> {
        let limits = self.begin_array()?;
        // The film, its levels, and the bytes of the file; and what holds it out.
        let most = Limits { max_memory: limits.max_memory / 3 };
        let held = self.held_out(most)?;
        let Flattened { header, film } = deep::flattened(&self.input, held.as_ref(), most)?;
        self.displayed(write, &header, deep::flattened_picture(film), context)
    }
}
