//! Which random numbers a picture is made of.

use crate::error::{Error, Result};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

/// Numbers of a picture's replicates by the seed of their random numbers: `seed 0: 0-15, 32-47; seed 7: 3`.
///
/// Replicates of other numbers or seeds are independent.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::app::render) struct Streams {
    /// First and last numbers of ranges that do not touch, in ascending order.
    ranges: BTreeMap<u64, Vec<[u32; 2]>>,
}

impl Streams {
    /// Creates those of a seed from a first to a last number.
    fn range(seed: u64, first: u32, last: u32) -> Self {
        Self { ranges: BTreeMap::from([(seed, vec![[first, last]])]) }
    }

    /// Creates that of a picture that is one replicate.
    pub(in crate::app::render) fn one(seed: u64) -> Self {
        Self::range(seed, 0, 0)
    }

    /// Adds a replicate that follows the others of its seed.
    pub(in crate::app::render) fn push(&mut self, seed: u64, number: u32) {
        let ranges = self.ranges.entry(seed).or_default();
        match ranges.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => ranges.push([number, number]),
        }
    }

    /// Returns the number of replicates.
    pub(in crate::app::render) fn count(&self) -> u32 {
        self.ranges.values().flatten().fold(0, |sum, [first, last]| sum.saturating_add(last - first + 1))
    }

    /// Returns so many replicates that follow those of the seed that has most.
    pub(in crate::app::render) fn following(&self, count: u32) -> Self {
        let of =
            |ranges: &[[u32; 2]]| ranges.iter().fold(0_u64, |sum, [first, last]| sum + u64::from(last - first) + 1);
        let most = self.ranges.iter().max_by_key(|(seed, ranges)| (of(ranges), Reverse(**seed)));
        let (seed, next) = most.map_or((0, 0), |(seed, ranges)| (*seed, ranges.last().map_or(0, |[_, last]| last + 1)));
        Self::range(seed, next, next.saturating_add(count - 1))
    }

    /// Adds other replicates.
    ///
    /// # Errors
    /// If one of them is there already.
    pub(in crate::app::render) fn add(&mut self, other: &Self) -> Result<()> {
        for (seed, ranges) in &other.ranges {
            let all = self.ranges.entry(*seed).or_default();
            all.extend(ranges);
            all.sort_unstable();
            if let Some([a, b]) = all.windows(2).map(|pair| [pair[0], pair[1]]).find(|[a, b]| b[0] <= a[1]) {
                let both = Self::range(*seed, b[0], a[1].min(b[1]));
                return Err(Error::invalid(format!(
                    "replicates of {both} are in two of the pictures, which are not independent"
                ))
                .hint("join each replicate once; parts of a picture have other ⟨replicates⟩, or another ⟨seed⟩"));
            }
            let touching = |a: &mut [u32; 2], b: &mut [u32; 2]| b[1].checked_add(1) == Some(a[0]);
            all.dedup_by(|a, b| {
                let same = touching(a, b);
                if same {
                    b[1] = a[1];
                }
                same
            });
        }
        Ok(())
    }
}

impl fmt::Display for Streams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (seed, ranges)) in self.ranges.iter().enumerate() {
            write!(f, "{}seed {seed}: ", if i > 0 { "; " } else { "" })?;
            for (i, [first, last]) in ranges.iter().enumerate() {
                write!(f, "{}{first}", if i > 0 { ", " } else { "" })?;
                if last > first {
                    write!(f, "-{last}")?;
                }
            }
        }
        Ok(())
    }
}

impl FromStr for Streams {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let range = |text: &str| {
            let (first, last) = text.split_once('-').unwrap_or((text, text));
            let [first, last] = [first.parse().ok()?, last.parse().ok()?];
            (first <= last && last < u32::MAX).then_some([first, last])
        };
        let seed = |text: &str| {
            let (seed, ranges) = text.strip_prefix("seed ")?.split_once(": ")?;
            Some(Self {
                ranges: BTreeMap::from([(seed.parse().ok()?, ranges.split(", ").map(range).collect::<Option<_>>()?)]),
            })
        };
        let no = || format!("'{text}' names no replicates");
        let mut all = Self::default();
        for part in text.split("; ") {
            all.add(&seed(part).ok_or_else(no)?).map_err(|_| no())?;
        }
        Ok(all)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_joined() {
        let mut all = Streams::range(0, 0, 7);
        for (seed, first, last) in [(7, 3, 3), (0, 8, 15), (0, 32, 47)] {
            all.add(&Streams::range(seed, first, last)).unwrap();
        }
        assert_eq!((all.to_string().as_str(), all.count()), ("seed 0: 0-15, 32-47; seed 7: 3", 33));
        assert_eq!(all.to_string().parse::<Streams>().unwrap(), all);
        assert_eq!(all.following(5).to_string(), "seed 0: 48-52");
        assert_eq!(Streams::default().following(1).to_string(), "seed 0: 0");
        for (first, last) in [(0, 0), (15, 20), (16, 32), (0, 100), (40, 41)] {
            assert!(all.clone().add(&Streams::range(0, first, last)).is_err(), "{first} {last}");
        }
        let mut pushed = Streams::one(3);
        [1, 2, 5].into_iter().for_each(|number| pushed.push(3, number));
        assert_eq!(pushed.to_string(), "seed 3: 0-2, 5");
        for bad in ["", "0-15", "seed x: 1", "seed 1: 5-2", "seed 1: 1, 1", "seed 1: 1-4294967295"] {
            assert!(bad.parse::<Streams>().is_err(), "{bad}");
        }
    }
}
