//! Scans and arrays: their headers and their values.

use crate::app::scan::ScanSettings;
use crate::app::scan::values::{Measured, ValueStatistics, measured};
use crate::error::Result;
use crate::formats::format::Format;
use crate::formats::imaging::ImageFormat;
use crate::formats::imaging::image::Values;
use crate::formats::limits::Limits;
use crate::math::Affine;
use crate::text::printable;
use crate::wording::{all_worded, worded};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Content of a file or folder of images.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Summary {
    /// Name of the format.
    kind: &'static str,
    images: Vec<Entry>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Entry {
    /// Name of the quantity; none if the file has none.
    name: Option<String>,
    /// Number of voxels along x, y and z.
    size: [usize; 3],
    /// Number of values per voxel.
    components: usize,
    values: Values,
    /// Type of the stored numbers, such as i16; none where the reader does not tell.
    value_type: Option<&'static str>,
    /// Unit of the values, such as HU for Hounsfield units; none if the file states none.
    unit: Option<String>,
    /// Slope and intercept that make values of stored numbers; none where they are the same, or differ by slice.
    rescale: Option<[f64; 2]>,
    /// Edges of a voxel in world units; none if neither the file nor the settings say.
    voxel_size: Option<[f64; 3]>,
    /// World position of the centre of the voxel (0, 0, 0).
    origin: [f64; 3],
    /// Index-to-world matrix for column vectors, by rows.
    matrix: [[f64; 4]; 4],
    /// Directions in which the indices grow; none where the file's space is not that of a body.
    orientation: Option<Orientation>,
    statistics: ValueStatistics,
    /// Assumptions and omissions of the reader.
    notes: Vec<String>,
}

/// Directions in which indices grow, in a body.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
struct Orientation {
    /// A letter for each index axis: Right, Left, Anterior, Posterior, Superior or Inferior.
    letters: String,
    /// Largest angle between an index axis and the direction of its letter, in degrees.
    oblique_degrees: f64,
}

impl Orientation {
    /// Returns the directions of a map to right, anterior and superior. The axis that is clearest comes first.
    fn of(map: &Affine) -> Self {
        let matrix = map.matrix();
        let columns =
            [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|c| c.truncate().normalize_or_zero().to_array());
        let mut pairs: Vec<(usize, usize)> = (0..9).map(|i| (i / 3, i % 3)).collect();
        pairs.sort_by(|a, b| columns[b.0][b.1].abs().total_cmp(&columns[a.0][a.1].abs()));
        let (mut letters, mut taken, mut angle) = ([' '; 3], [false; 3], 0.0_f64);
        for (index, world) in pairs {
            if letters[index] == ' ' && !taken[world] {
                let along = columns[index][world];
                letters[index] = [['R', 'L'], ['A', 'P'], ['S', 'I']][world][usize::from(along < 0.0)];
                taken[world] = true;
                angle = angle.max(along.abs().min(1.0).acos().to_degrees());
            }
        }
        Self { letters: letters.iter().collect(), oblique_degrees: angle }
    }
}

/// Reads the images in a file or folder.
///
/// # Errors
/// If the file cannot be read, or is damaged or incomplete.
pub(crate) fn summary(
    path: &Path,
    (format, reader): (&'static Format, &ImageFormat),
    scan: &ScanSettings,
    limits: Limits,
) -> Result<Summary> {
    let images = measured(path, (format, reader), scan, limits)?;
    Ok(Summary { kind: format.name, images: images.into_iter().map(entry).collect() })
}

fn entry(Measured { header, spacing, statistics }: Measured) -> Entry {
    let (map, about) = (header.index_to_world, header.about);
    Entry {
        name: header.name,
        size: header.size,
        components: header.components,
        values: header.values,
        value_type: about.sample.map(crate::formats::sample::Sample::name),
        unit: about.unit,
        rescale: about.rescale.map(|(slope, intercept)| [slope, intercept]),
        voxel_size: spacing.then(|| map.voxel_size().to_array()),
        origin: map.to_world(glam::DVec3::ZERO).to_array(),
        matrix: map.matrix().transpose().to_cols_array_2d(),
        orientation: about.anatomical.then(|| Orientation::of(&map)),
        statistics,
        notes: all_worded(header.notes),
    }
}

impl Summary {
    /// Returns the images in a line.
    pub(super) fn line(&self) -> String {
        let of = |entry: &Entry| {
            let [x, y, z] = entry.size;
            let range = entry.statistics.min.zip(entry.statistics.max);
            let range = range.map(|(min, max)| format!(", min {min}, max {max}")).unwrap_or_default();
            format!("{x} x {y} x {z} voxels{range}")
        };
        self.images.iter().map(of).collect::<Vec<_>>().join("; ")
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.kind)?;
        self.images.iter().try_for_each(|image| image.fmt(f))
    }
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: [nx, ny, nz], components, origin: [x, y, z], statistics: s, .. } = self;
        let name = self.name.as_ref().map_or_else(|| "image".to_owned(), |name| format!("image '{}'", printable(name)));
        let values = match self.values {
            Values::Real => "real values",
            Values::Integer => "integers",
        };
        let stored = self.value_type.map_or_else(String::new, |kind| format!(", stored as {kind}"));
        writeln!(f, "{name}: {nx} x {ny} x {nz} voxels, {components} {values} each{stored}")?;
        match self.voxel_size {
            Some([dx, dy, dz]) => {
                writeln!(f, "  voxels of {dx} x {dy} x {dz} world units, the first one at ({x}, {y}, {z})")?;
            }
            None => writeln!(f, "  spacing unknown: {}", worded("give it with ⟨voxel_size⟩ or ⟨spacing⟩"))?,
        }
        if let Some(Orientation { letters, oblique_degrees: angle }) = &self.orientation {
            let oblique = if *angle > 0.05 { format!(", oblique by up to {angle:.1} degrees") } else { String::new() };
            writeln!(f, "  orientation {letters}{oblique}")?;
        }
        if let Some([slope, intercept]) = self.rescale {
            writeln!(f, "  values are stored numbers times {slope} plus {intercept}")?;
        }
        if let (Some(min), Some(max), Some(mean)) = (s.min, s.max, s.mean) {
            let unit = self.unit.as_ref().map_or_else(String::new, |unit| format!(" {}", printable(unit)));
            writeln!(f, "  min {min}, max {max}, mean {mean:.6}{unit}; histogram {:?}", s.histogram)?;
            let percentiles: Vec<String> =
                s.percentiles.iter().map(|p| format!("{} % {}", p.percent, short(p.value))).collect();
            writeln!(f, "  percentiles: {}", percentiles.join(", "))?;
        }
        for (count, what) in [(s.negative, "negative"), (s.nan, "NaN"), (s.infinite, "infinite")] {
            if count > 0 {
                writeln!(f, "  {count} of {} values are {what}", s.count)?;
            }
        }
        self.notes.iter().try_for_each(|note| writeln!(f, "  note: {}", printable(note)))
    }
}

/// Number with as many digits as percentiles have.
fn short(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value}") } else { format!("{value:.6}") }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::{DMat4, DVec3, DVec4};

    #[test]
    fn letters_say_where_indices_lead() {
        let of = |map: DMat4| Orientation::of(&Affine::new(map).unwrap());
        assert_eq!(of(DMat4::IDENTITY), Orientation { letters: "RAS".into(), oblique_degrees: 0.0 });
        assert_eq!(of(DMat4::from_scale(DVec3::new(-2.0, -2.0, 3.0))).letters, "LPS");
        let sagittal = DMat4::from_cols(-DVec4::Y, -DVec4::Z, DVec4::X, DVec4::W);
        assert_eq!(of(sagittal).letters, "PIR");
        let turned = of(DMat4::from_rotation_z(0.2));
        assert_eq!(turned.letters, "RAS");
        assert!((turned.oblique_degrees - 0.2_f64.to_degrees()).abs() < 1e-9);
    }
}
