//! Layers of pictures as NumPy arrays and as PNGs, and arrays as pictures.

use super::report::{Image, LayerPlace};
use super::{ConvertSettings, FileReport};
use crate::app::Context;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::png::ToneMapping;
use crate::formats::raster::WritePicture;
use crate::formats::{atomic, exr, npy};
use crate::scene::film::Film;
use crate::scene::primaries::Primaries;
use crate::wording::all_worded;
use std::path::Path;

impl ConvertSettings {
    /// Checks that the output can be written, and returns the memory that the work may take.
    pub(super) fn begin_array(&self) -> Result<Limits> {
        atomic::probe(&self.output)?;
        Ok(self.limits)
    }

    fn report_array(&self, shape: Vec<usize>, layer: Option<LayerPlace>) -> Result<FileReport> {
        let axes = ["row", "column", "channel"][..shape.len().min(3)].to_vec();
        Ok(FileReport::Image(Box::new(Image { shape, axes, layer, ..Image::of(&self.input, &self.output)? })))
    }

    /// Writes a layer of a picture.
    pub(super) fn layer_to_array(&self, context: &Context) -> Result<FileReport> {
        let limits = self.begin_array()?;
        let stage = context.stage("converting");
        let layer = exr::layer_within(&self.input, self.layer.as_deref(), limits)?;
        let shape = vec![layer.height, layer.width, layer.channels.len()];
        npy::write(&self.output, &shape, &layer.values)?;
        drop(stage);
        self.report_array(shape, Some(LayerPlace { name: layer.name, channels: layer.channels }))
    }

    /// Writes a layer of a picture for display.
    pub(super) fn layer_to_picture(&self, write: WritePicture, context: &Context) -> Result<FileReport> {
        let limits = self.begin_array()?;
        let stage = context.stage("converting");
        // The film, its levels, and the bytes of the file.
        let most = Limits { max_memory: limits.max_memory / 2 };
        let (header, layer) = (exr::header(&self.input)?, self.layer.as_deref());
        let picture = exr::picture_within(&self.input, layer, most)?;
        drop(stage);
        self.displayed(write, &header, picture, context)
    }

    /// Writes the pixels of a picture for display.
    pub(super) fn displayed(
        &self,
        write: WritePicture,
        header: &exr::Header,
        picture: exr::Picture,
        context: &Context,
    ) -> Result<FileReport> {
        let stage = context.stage("converting");
        let is_color = picture.is_color();
        let exr::Picture { mut film, layer, non_finite, channels } = picture;
        let mut notes = Vec::new();
        if non_finite > 0 {
            notes.push(format!("samples that are NaN or infinite: {non_finite}; NaN becomes black, infinity white"));
        }
        if is_color {
            notes.extend(self.to_rec_709(header, &mut film)?);
        }
        let tone = ToneMapping { exposure: self.exposure.unwrap_or(0.0) };
        write(&self.output, &film, tone, &exr::Attributes::new())?;
        drop(stage);
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        Ok(FileReport::Image(Box::new(Image {
            shape: vec![film.height, film.width],
            axes: vec!["row", "column"],
            layer: Some(LayerPlace { name: layer, channels }),
            tone_mapping: Some(tone),
            notes: all_worded(notes),
            ..Image::of(&self.input, &self.output)?
        })))
    }

    /// Converts colors to the primaries of sRGB, and returns a note if they had others.
    pub(super) fn to_rec_709(&self, header: &exr::Header, film: &mut Film) -> Result<Option<String>> {
        let from = header.primaries();
        if from.is_same(&Primaries::REC_709) {
            return Ok(None);
        }
        let matrix = from.matrix_to(Primaries::REC_709).ok_or_else(|| {
            Error::invalid(format!("the chromaticities span no color space: {from}"))
                .at(&self.input)
                .hint("correct the attribute `chromaticities`")
        })?;
        film.convert(matrix);
        Ok(Some(format!("colors are converted from primaries {from} to those of sRGB, Rec.709")))
    }

    /// Writes an array of one, three or four channels as a picture.
    pub(super) fn array_to_picture(&self, context: &Context) -> Result<FileReport> {
        let limits = self.begin_array()?;
        let stage = context.stage("converting");
        // The array, the film, and the picture as bytes before it is packed.
        let third = Limits { max_memory: limits.max_memory / 6 };
        let array = npy::read(&self.input, third)?;
        let film = film(&array, &self.input)?;
        exr::write_picture(
            &self.output,
            &film,
            &exr::Attributes::new(),
            if self.half { exr::Half::All } else { exr::Half::None },
        )?;
        drop(stage);
        self.report_array(array.shape, None)
    }
}

/// Film of an array: [row, column] or [row, column, channel] of grey, RGB or RGBA; alpha is 1 where there is none.
fn film(array: &npy::Array, path: &Path) -> Result<Film> {
    let (height, width, channels) = match array.shape[..] {
        [height, width] if height * width > 0 => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] if height * width > 0 => (height, width, channels),
        _ => {
            return Err(Error::invalid(format!("an array of shape {:?} is no picture", array.shape)).at(path).hint(
                "[row, column] and [row, column, channel] with 1, 3 or 4 channels (grey, RGB, RGBA) are pictures",
            ));
        }
    };
    let pixel = |p: &[f32]| match *p {
        [r, g, b, a] => [r, g, b, a],
        [r, g, b] => [r, g, b, 1.0],
        _ => [p[0], p[0], p[0], 1.0],
    };
    Ok(Film::of(width, height, array.values.chunks_exact(channels).map(pixel).collect()))
}
