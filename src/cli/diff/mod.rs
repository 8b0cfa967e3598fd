//! `cumulo diff`: how far the grids of two VDB files are apart.

mod frames;
mod turn;

use super::memory::Memory;
use super::output::Output;
use crate::app::Context;
use crate::app::sequence::FrameSelection;
use crate::app::up::{self, ChosenUp};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, GridInfo, NativeGrid, RawGrid};
use crate::math::Affine;
use crate::metrics::volume::{Difference, Effort, Field, Multiple, compare_within};
use crate::scene::grid::MetaValue;
use crate::text::bytes as human;
use crate::text::printable;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use turn::Turned;

/// Compare the grids of two VDBs, or of two sequences of them; exit code 1 if they differ
#[derive(Debug, clap::Args)]
#[command(after_help = "PSNR is taken over the union of the two boxes of active voxels on A's lattice, with the \
    largest |A| as its peak; it is null in JSON for grids of equal values. Where the transforms differ, B \
    is sampled trilinearly at A's voxel centers, of which --voxels are compared, evenly spread, if there are more. \
    Differences are measured in 32-bit floats; values of wider types that agree in these alone are told. Grids are \
    paired by name; the only grids of both files are compared whatever their names, but names that differ are a \
    difference, unless the grid is chosen with --grid. Where scalars differ as they lie and agree after a turn by 90 \
    degrees about x, Y-up against Z-up, the report says so. Up axes and creators that differ are told; files that \
    state different up axes differ.")]
pub struct Diff {
    /// The reference
    a: PathBuf,
    /// VDB to compare with the reference
    b: PathBuf,
    /// Compare only this grid
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Largest absolute difference that counts as equal
    #[arg(long, value_name = "MAX_ABS", default_value_t = 0.0)]
    tolerance: f64,
    /// Voxels to compare where the transforms differ: a number such as 1e8, or all (default: 6.7e7)
    #[arg(long, value_name = "N|all", value_parser = voxels)]
    voxels: Option<Effort>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Report of two files, or of two sequences.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
pub(in crate::cli) enum AnyReport {
    Files(Report),
    Sequences(frames::Sequences),
}

/// Parses a number of voxels, or `all`.
fn voxels(text: &str) -> Result<Effort, String> {
    if text == "all" {
        return Ok(Effort::ALL);
    }
    super::parse::positive(text).map(|voxels| Effort::voxels(voxels as u64))
}

#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Report {
    same: bool,
    grids: Vec<Compared>,
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    /// Names of point grids in both files, which are neither same nor different.
    not_compared: Vec<String>,
    /// Names of grids that hold points in one file and values in the other: a difference.
    of_other_kind: Vec<String>,
    /// Up axes, if they differ: a difference if both files state theirs. What states no axis is taken for Z-up.
    #[serde(skip_serializing_if = "Option::is_none")]
    up: Option<Sides<ChosenUp>>,
    /// Creators that the metadata state, if they differ; no difference of the grids.
    #[serde(skip_serializing_if = "Option::is_none")]
    creator: Option<Sides<Option<String>>>,
    /// Differences between the files, in words.
    differences: Vec<String>,
}

/// Something that differs between the two files.
#[derive(Debug, Serialize, JsonSchema)]
struct Sides<T> {
    a: T,
    b: T,
}

impl<T: PartialEq> Sides<T> {
    /// Returns both, if `key` of them differs.
    fn differing<K: PartialEq>(a: T, b: T, key: impl Fn(&T) -> K) -> Option<Self> {
        (key(&a) != key(&b)).then_some(Self { a, b })
    }
}

#[derive(Debug, Serialize, JsonSchema)]
struct Compared {
    name: String,
    /// Name of the grid in the second file, if it differs from the name in the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    name_in_b: Option<String>,
    #[serde(flatten)]
    difference: Difference,
    /// Turn of the second grid after which it agrees with the first; none if it agrees as it lies, or after no turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    agrees_after_turn: Option<Turned>,
    /// True if the values are equal as 32-bit floats, in which differences are measured, but not in the grids' wider
    /// type.
    differs_beyond_f32: bool,
}

impl Diff {
    /// Reads, compares and reports.
    ///
    /// # Errors
    /// If a file cannot be read, a grid is not there, or two grids cannot be compared.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(Error::invalid(format!("--tolerance {}: zero or more is needed", self.tolerance))
                .hint("give the largest absolute difference of a value that still counts as equal"));
        }
        if let Some(sequences) = self.frames.pair([&self.a, &self.b], &["vdb"])? {
            return self.frames(&sequences, output);
        }
        let report = self.compared([&self.a, &self.b], self.memory.limits(), output)?;
        output.report(&report)?;
        Ok(if report.same { ExitCode::SUCCESS } else { ExitCode::from(1) })
    }

    /// Compares two files.
    ///
    /// # Errors
    /// If a file cannot be read, a grid is not there, or two grids cannot be compared.
    fn compared(&self, paths: [&Path; 2], limits: Limits, context: &Context) -> Result<Report> {
        let reading = context.stage("reading");
        let [a, b] = [crate::app::volume::open(paths[0], limits)?, crate::app::volume::open(paths[1], limits)?];
        let pairs = self.pairs(&a, &b)?;
        let alone = |from: &File, pick: fn(&(String, String)) -> &String| {
            let names = from.entries().iter().map(|e| e.name.clone());
            if self.grid.is_some() { vec![] } else { names.filter(|n| !pairs.iter().any(|p| pick(p) == n)).collect() }
        };
        let (only_in_a, only_in_b): (Vec<_>, Vec<_>) = (alone(&a, |p| &p.0), alone(&b, |p| &p.1));
        drop(reading);
        let (mut grids, mut not_compared, mut of_other_kind) = (Vec::new(), Vec::new(), Vec::new());
        for (in_a, in_b) in &pairs {
            if self.grid.is_none() {
                match Pairing::of([is_points(&a, in_a), is_points(&b, in_b)]) {
                    Pairing::Values => {}
                    Pairing::Points => {
                        not_compared.push(in_a.clone());
                        continue;
                    }
                    Pairing::Mixed => {
                        of_other_kind.push(in_a.clone());
                        continue;
                    }
                }
            }
            grids.push(self.grids([(&a, in_a), (&b, in_b)], limits, context)?);
        }
        let mut differences: Vec<String> = grids.iter().flat_map(|grid| self.differences(grid)).collect();
        let listed = |names: &[String]| names.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
        for (names, what) in [
            (&only_in_a, "that only the first file has"),
            (&only_in_b, "that only the second file has"),
            (&of_other_kind, "of points in one file and of values in the other"),
        ] {
            differences.extend((!names.is_empty()).then(|| format!("grids {what}: {}", listed(names))));
        }
        let up = Sides::differing(up::of_file(&a), up::of_file(&b), |up| up.axis);
        let creator = Sides::differing(creator(&a)?, creator(&b)?, Clone::clone);
        let contradicts = matches!((a.up(), b.up()), (Some(a), Some(b)) if a.up != b.up);
        differences.extend(contradicts.then(|| "the up axes that the files state".to_owned()));
        let same = differences.is_empty();
        Ok(Report { same, grids, only_in_a, only_in_b, not_compared, of_other_kind, up, creator, differences })
    }

    /// Returns what two grids differ in.
    fn differences(&self, grid: &Compared) -> Vec<String> {
        let (d, exact) = (&grid.difference, self.tolerance == 0.0);
        let other_name = grid.name_in_b.as_ref().filter(|_| self.grid.is_none());
        let all = [
            (d.max_abs > self.tolerance, format!("values by up to {:.3e}", d.max_abs)),
            (d.incomparable > 0, format!("{} values that are finite on one side only", d.incomparable)),
            (d.transform_difference != 0.0, format!("transforms, {:.3e} apart", d.transform_difference)),
            (exact && d.topology_iou != 1.0, format!("active voxels, topology IoU {:.4}", d.topology_iou)),
            (exact && grid.differs_beyond_f32, "digits that 32-bit floats do not hold".to_owned()),
            (
                other_name.is_some(),
                format!("the name, '{}' in the second file", grid.name_in_b.as_deref().unwrap_or("")),
            ),
        ];
        all.into_iter().filter(|(is, _)| *is).map(|(_, what)| format!("grid '{}': {what}", grid.name)).collect()
    }

    /// Compares two grids, each given by its file and name.
    fn grids(
        &self,
        [(a, in_a), (b, in_b)]: [(&File, &String); 2],
        limits: Limits,
        context: &Context,
    ) -> Result<Compared> {
        let mut budget = Budget { held: 0, limit: limits.max_memory };
        let [left, right] = {
            let _stage = context.stage("reading");
            [load(a, in_a, &mut budget)?, load(b, in_b, &mut budget)?]
        };
        let bar = context.steps(0, "comparing");
        let show = |done: u64, of: u64| {
            bar.set(done, of, "");
        };
        let effort = self.voxels.unwrap_or_default();
        let difference = compare_within(&left.field()?, &right.field()?, effort, &show)
            .map_err(|e| e.at(b.path()).part(format!("grid '{in_b}'")))?;
        // `same_values` is stricter than wanted where nodes differ and voxels do not.
        let differs_beyond_f32 = match (&left.wide, &right.wide) {
            (Some(a), Some(b)) if left.info.value_type == right.info.value_type => {
                difference.within(0.0) && difference.topology_iou == 1.0 && !a.same_values(b)?
            }
            _ => false,
        };
        let name_in_b = (in_a != in_b).then(|| in_b.clone());
        let agrees_after_turn = match difference.within(self.tolerance) {
            true => None,
            false => turn::turned(&left, &right, &difference, effort)?,
        };
        Ok(Compared { name: in_a.clone(), name_in_b, difference, agrees_after_turn, differs_beyond_f32 })
    }

    /// Pairs the names to compare, in the first and in the second file: equal ones, or the only one on each side.
    fn pairs(&self, a: &File, b: &File) -> Result<Vec<(String, String)>> {
        let only = |file: &File| match file.entries() {
            [one] => Some(one.name.clone()),
            _ => None,
        };
        if let Some(name) = &self.grid {
            let in_a = a.find(name)?.name.clone();
            let in_b = match (b.find(name), only(b)) {
                (Ok(entry), _) => entry.name.clone(),
                (Err(_), Some(one)) => one,
                (Err(error), None) => return Err(error),
            };
            return Ok(vec![(in_a, in_b)]);
        }
        if let (Some(one), Some(other)) = (only(a), only(b)) {
            return Ok(vec![(one, other)]);
        }
        let shared = a.entries().iter().filter(|e| b.entries().iter().any(|o| o.name == e.name));
        Ok(shared.map(|e| (e.name.clone(), e.name.clone())).collect())
    }
}

/// Program that made a file, as its metadata say.
fn creator(file: &File) -> Result<Option<String>> {
    Ok(match file.metadata()?.remove("creator") {
        Some(MetaValue::Text(creator)) => Some(creator),
        _ => None,
    })
}

/// Kinds of content of two grids of one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pairing {
    /// Both hold values, which are compared.
    Values,
    /// Both hold points, which cannot be compared.
    Points,
    /// One holds points and the other values: they differ.
    Mixed,
}

impl Pairing {
    /// Returns the pairing of two grids by whether each holds points.
    fn of(points: [bool; 2]) -> Self {
        match points {
            [false, false] => Self::Values,
            [true, true] => Self::Points,
            [true, false] | [false, true] => Self::Mixed,
        }
    }
}

fn is_points(file: &File, name: &str) -> bool {
    file.find(name).is_ok_and(|entry| entry.grid_type.starts_with("Tree_pt"))
}

/// Memory of the grids of a comparison together, in bytes.
struct Budget {
    held: u64,
    limit: u64,
}

impl Budget {
    /// Reserves `bytes`, and refuses them if they exceed the limit.
    fn take(&mut self, bytes: u64) -> Result<()> {
        self.held = self.held.saturating_add(bytes);
        if self.held <= self.limit {
            return Ok(());
        }
        let (needed, allowed) = (human(self.held), human(self.limit));
        Err(Error::unsupported(format!("comparing the grids needs {needed}, {allowed} are allowed"))
            .hint("raise --max-memory, or compare parts of them: cumulo convert --crop"))
    }
}

struct Loaded {
    /// The grid itself, kept if its values are wider than `f32`.
    wide: Option<NativeGrid>,
    info: GridInfo,
    raw: RawGrid,
}

fn load(file: &File, name: &str, budget: &mut Budget) -> Result<Loaded> {
    let place = |e: Error| e.at(file.path()).part(format!("grid '{name}'"));
    let in_file = file.find(name)?.topology.map_or(0, |t| t.memory);
    budget.take(in_file).map_err(place)?;
    let native = file.read(name)?;
    let info = native.info().map_err(place)?;
    info.affine().map_err(place)?;
    // A leaf's values, its mask, and its places in the lists and tables of the comparison.
    let leaf = 2048 * info.components as u64 + 256;
    budget.take(info.memory.saturating_sub(in_file) + info.leaf_count * leaf).map_err(place)?;
    let raw = native.to_raw().map_err(|e| place(e).hint("compare a grid with values: name it with --grid"))?;
    let wide = ["double", "vec3d", "int32", "int64", "vec3i"].contains(&info.value_type.as_str());
    if !wide {
        budget.held = budget.held.saturating_sub(info.memory.max(in_file));
    }
    Ok(Loaded { wide: wide.then_some(native), info, raw })
}

impl Loaded {
    fn field(&self) -> Result<Field<'_>> {
        Ok(self.field_at(self.info.affine()?))
    }

    /// The volume as it lies by another transform.
    fn field_at(&self, transform: Affine) -> Field<'_> {
        let mut background = [0.0; 3];
        background.iter_mut().zip(&self.info.background).for_each(|(to, from)| *to = *from as f32);
        let mut field = Field::new(self.raw.components, background, transform, self.info.index_box);
        self.raw.leaves.iter().for_each(|l| field.add_leaf(l.origin, &l.values, &l.active));
        self.raw.tiles.iter().for_each(|t| field.add_tile(t.origin, t.dim, t.value, t.active));
        field
    }
}

impl Report {
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
                "  second file {} ({}); cumulo convert --up turns a file, or states its axis",
                b.axis.name(),
                printable(&b.reason)
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
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
            if let Some(Turned { second_up, degrees, rms, .. }) = &grid.agrees_after_turn {
                let (second, first) = (second_up.name(), second_up.other().name());
                writeln!(
                    f,
                    "  equal but for a turn of the second by {degrees} degrees about x (rms {rms:.4e} then): \
                     {first}-up against {second}-up; cumulo convert --up {} turns it",
                    first.to_ascii_lowercase()
                )?;
            }
            if let Some(Multiple { factor, psnr_db }) = d.explained() {
                let left = psnr_db.map_or_else(|| "nothing is left".to_owned(), |db| format!("psnr is {db:.2} dB"));
                writeln!(
                    f,
                    "  B is {factor:.4} times A, and {left} after a division by that: a density scale or a unit of \
                     length that one of them holds and the other does not; cumulo convert --scale {:.4} takes it out \
                     of B",
                    1.0 / factor
                )?;
            }
            if d.sampled {
                writeln!(
                    f,
                    "  figures are of {} voxels, evenly spread: the transforms differ; --voxels all compares all of \
                     them",
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Points against values were no difference.
    #[test]
    fn points_and_values_are_of_different_kinds() {
        let pairings = [[false, false], [true, true], [true, false], [false, true]].map(Pairing::of);
        assert_eq!(pairings, [Pairing::Values, Pairing::Points, Pairing::Mixed, Pairing::Mixed]);
        let report = Report {
            same: false,
            grids: vec![],
            only_in_a: vec![],
            only_in_b: vec![],
            not_compared: vec![],
            of_other_kind: vec!["smoke".into()],
            up: None,
            creator: None,
            differences: vec!["grids of points in one file and of values in the other: 'smoke'".into()],
        };
        let text = report.to_string();
        assert!(
            text.ends_with("different: grids of points in one file and of values in the other: 'smoke'\n"),
            "{text}"
        );
    }
}
