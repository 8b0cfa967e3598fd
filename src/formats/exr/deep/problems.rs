//! Faults of deep pictures, for `validate`.

use super::header::open;
use super::{DeepLine, DeepSample};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use crate::formats::reading::Reading;
use std::path::Path;

/// Order of a pixel's samples, from the least to the most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Order {
    Messy,
    /// Samples are sorted by Z, then by ZBack.
    Sorted,
    /// Samples are sorted and none overlaps another.
    Tidy,
}

impl Order {
    pub(super) fn of(pixel: &[DeepSample]) -> Self {
        let mut order = Self::Tidy;
        for (a, b) in pixel.iter().zip(pixel.iter().skip(1)) {
            let (a_back, b_back) = (a.z_back.max(a.z), b.z_back.max(b.z));
            if (b.z, b_back) < (a.z, a_back) {
                return Self::Messy;
            }
            let points = a_back == a.z && b_back == b.z;
            // A point may stand where a volume begins or ends.
            if b.z < a_back || points && b.z == a.z {
                order = Self::Sorted;
            }
        }
        order
    }
}

/// A fault of a deep picture, or what is worth knowing of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Finding {
    /// True if it is a fault.
    pub certain: bool,
    pub problem: Problem,
}

/// Counts of what may be wrong.
#[derive(Default)]
struct Counts {
    depths: u64,
    colors: u64,
    alphas: u64,
    inverted: u64,
    /// Pixels whose samples are not sorted, and those that are but overlap.
    unsorted: u64,
    overlapping: u64,
}

impl Counts {
    fn add(&mut self, line: &DeepLine) {
        for sample in &line.samples {
            let [r, g, b, alpha] = sample.rgba;
            self.depths += u64::from(!(sample.z.is_finite() && sample.z_back.is_finite()));
            self.colors += u64::from(![r, g, b, alpha].iter().all(|v| v.is_finite()));
            self.alphas += u64::from(alpha.is_finite() && !(0.0..=1.0).contains(&alpha));
            self.inverted += u64::from(sample.z_back < sample.z);
        }
        for pixel in line.pixels() {
            let order = Order::of(pixel);
            self.unsorted += u64::from(order == Order::Messy);
            self.overlapping += u64::from(order == Order::Sorted);
        }
    }
}

/// Faults of a deep picture; empty if there are none. A file that cannot be decoded is one fault. Samples that are not
/// sorted or that overlap are no fault, since OpenEXR allows for them.
///
/// # Errors
/// If the operating system does not let the file be read.
pub(crate) fn findings_within(path: &Path, limits: Limits) -> Result<Vec<Finding>> {
    let _reading = Reading::begin(path);
    let mut counts = Counts::default();
    let counted = open(path, limits).and_then(|mut source| {
        source.lines((0, limits), |_, line| {
            counts.add(&line);
            Ok(())
        })
    });
    if let Err(error) = counted {
        return Ok(vec![Finding { certain: true, problem: Problem::of(error)? }]);
    }
    let alike = "write the file again where it was rendered; compositors take such samples in different ways";
    let tidied = "flattening sorts and splits them; programs that do not may show another picture";
    let all = [
        (true, counts.depths, "samples whose depth is NaN or infinite", "render it again; such samples have no order"),
        (true, counts.colors, "samples whose color or opacity is NaN or infinite", "render it again"),
        (true, counts.alphas, "samples whose opacity is not within 0 to 1", alike),
        (true, counts.inverted, "samples whose back lies before their front (ZBack below Z)", alike),
        (false, counts.unsorted, "pixels whose samples are not sorted by depth", tidied),
        (false, counts.overlapping, "pixels whose samples overlap", tidied),
    ];
    let found = all.into_iter().filter(|(_, count, ..)| *count > 0).map(|(certain, count, what, remedy)| Finding {
        certain,
        problem: Problem::new(format!("{what}: {count}"), remedy),
    });
    Ok(found.collect())
}
