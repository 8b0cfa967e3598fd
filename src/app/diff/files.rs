//! Comparison of two files.

use super::DiffSettings;
use super::grids::Compared;
use super::report::{FilesReport, Sides};
use crate::app::{Context, up, volume};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::File;
use crate::scene::grid::MetaValue;
use std::path::Path;

impl DiffSettings {
    /// Compares two files.
    ///
    /// # Errors
    /// If a file cannot be read, a grid is not there, or two grids cannot be compared.
    pub(super) fn files(&self, paths: [&Path; 2], limits: Limits, context: &Context) -> Result<FilesReport> {
        let reading = context.stage("reading");
        let formats = [volume::format_of(paths[0])?, volume::format_of(paths[1])?];
        self.scan.check_any(&formats, paths[0])?;
        let open = |i: usize| volume::open(paths[i], &self.scan.of(formats[i]), limits);
        let [a, b] = [open(0)?, open(1)?];
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
        Ok(FilesReport { same, grids, only_in_a, only_in_b, not_compared, of_other_kind, up, creator, differences })
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Points against values were no difference.
    #[test]
    fn points_and_values_are_of_different_kinds() {
        let pairings = [[false, false], [true, true], [true, false], [false, true]].map(Pairing::of);
        assert_eq!(pairings, [Pairing::Values, Pairing::Points, Pairing::Mixed, Pairing::Mixed]);
        let report = FilesReport {
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
