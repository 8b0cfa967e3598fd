//! Report of two files.

use super::grids::Compared;
use crate::app::up::ChosenUp;
use crate::metrics::volume::Multiple;
use crate::text::printable;
use crate::wording::worded;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt;

/// Report of two files.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FilesReport {
    pub(super) same: bool,
    pub(super) grids: Vec<Compared>,
    pub(super) only_in_a: Vec<String>,
    pub(super) only_in_b: Vec<String>,
    /// Names of point grids in both files, which are neither same nor different.
    pub(super) not_compared: Vec<String>,
    /// Names of grids that hold points in one file and values in the other: a difference.
    pub(super) of_other_kind: Vec<String>,
    /// Up axes, if they differ: a difference if both files state theirs. What states no axis is taken for Z-up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) up: Option<Sides<ChosenUp>>,
    /// Creators that the metadata state, if they differ; no difference of the grids.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) creator: Option<Sides<Option<String>>>,
    /// Differences between the files, in words.
    pub(super) differences: Vec<String>,
}

/// Something that differs between the two files.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Sides<T> {
    a: T,
    b: T,
}

impl<T: PartialEq> Sides<T> {
    /// Returns both, if `key` of them differs.
    pub(super) fn differing<K: PartialEq>(a: T, b: T, key: impl Fn(&T) -> K) -> Option<Self> {
        (key(&a) != key(&b)).then_some(Self { a, b })
    }
}

impl FilesReport {
    /// Writes what the metadata of the files state differently.
    fn fmt_stated(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(Sides { a, b }) = &self.creator {
            let shown = |creator: &Option<String>| match creator {
                Some(creator) => format!("'{}'", printable(creator)),
                None => "not stated".to_owned(),
            };
            writeln!(f, "creators differ: {} in the first file, {} in the second", shown(a), shown(b))?;
        }
        if let Some(Sides { a, b }) = &self.up {
            writeln!(f, "up axes differ: first file {} ({})", a.axis.name(), printable(&a.reason))?;
            writeln!(
                f,
                "  second file {} ({}); {}",
                b.axis.name(),
                printable(&b.reason),
                worded("cumulo convert ⟨up⟩ turns a file, or states its axis")
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for FilesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for grid in &self.grids {
            let d = &grid.difference;
            let values = match d.psnr_db {
                Some(db) => format!("psnr {db:.2} dB"),
                None if d.rms == 0.0 => "equal values".into(),
                None => "psnr undefined (A is zero)".into(),
            };
            writeln!(
                f,
                "'{}'{}: {values}, rms {:.4e}, max abs {:.4e}, topology IoU {:.4}, transforms {:.4e} apart, {} voxels",
                printable(&grid.name),
                grid.name_in_b
                    .as_ref()
                    .map(|name| format!(", in the second file '{}'", printable(name)))
                    .unwrap_or_default(),
                d.rms,
                d.max_abs,
                d.topology_iou,
                d.transform_difference,
                d.voxels
            )?;
            if let Some(turned) = &grid.agrees_after_turn {
                writeln!(f, "  {turned}")?;
            }
            if let Some(Multiple { factor, psnr_db }) = d.explained() {
                let left = psnr_db.map_or_else(|| "nothing is left".to_owned(), |db| format!("psnr is {db:.2} dB"));
                let scale = worded("cumulo convert ⟨scale⟩");
                writeln!(
                    f,
                    "  B is {factor:.4} times A, and {left} after a division by that: a density scale or a unit of \
                     length that one of them holds and the other does not; {scale} {:.4} takes it out of B",
                    1.0 / factor
                )?;
            }
            if d.sampled {
                let all = worded("⟨voxels=all⟩");
                writeln!(
                    f,
                    "  figures are of {} voxels, evenly spread: the transforms differ; {all} compares all of them",
                    d.compared
                )?;
            }
            if grid.differs_beyond_f32 {
                writeln!(f, "  equal as 32-bit floats only")?;
            }
            if d.incomparable > 0 {
                writeln!(f, "  {} values are finite on one side only", d.incomparable)?;
            }
        }
        for name in &self.not_compared {
            writeln!(f, "'{}' holds points and was not compared", printable(name))?;
        }
        self.fmt_stated(f)?;
        match &self.differences[..] {
            [] => writeln!(f, "same"),
            all => writeln!(f, "different: {}", printable(&all.join("; "))),
        }
    }
}
