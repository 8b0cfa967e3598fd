//! Frames that are there and are made again, because something that they were made from has changed.

use crate::text::ranges;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Frames that one changed input had made again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Renewed {
    /// Path of the input.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    /// Numbers of the frames.
    pub frames: Vec<u32>,
}

/// Groups frames by the input that has changed.
pub(crate) fn by_input(frames: impl IntoIterator<Item = (u32, PathBuf)>) -> Vec<Renewed> {
    let mut all: Vec<Renewed> = Vec::new();
    for (frame, input) in frames {
        match all.iter_mut().find(|renewed| renewed.input == input) {
            Some(renewed) => renewed.frames.push(frame),
            None => all.push(Renewed { input, frames: vec![frame] }),
        }
    }
    all
}

/// Frames that were made again, as the end of a report lists them.
pub struct List<'r>(pub &'r [Renewed]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Inputs that are told of each on a line of its own.
        const MOST: usize = 3;
        for Renewed { input, frames } in self.0.iter().take(MOST) {
            write!(f, "\n  made again, since {} has changed: {}", input.display(), ranges(frames.iter().copied()))?;
        }
        let rest: Vec<u32> = self.0.iter().skip(MOST).flat_map(|renewed| renewed.frames.iter().copied()).collect();
        if rest.is_empty() {
            return Ok(());
        }
        write!(f, "\n  made again, since {} more inputs have changed: {}", self.0.len() - MOST, ranges(rest))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn frames_are_told_of_by_what_has_changed() {
        let all = by_input([(1, "a".into()), (2, "b".into()), (3, "a".into()), (4, "a".into())]);
        assert_eq!(all.len(), 2);
        let text = List(&all).to_string();
        assert_eq!(text, "\n  made again, since a has changed: 1, 3-4\n  made again, since b has changed: 2");
        let many = by_input((0..5).map(|n| (n, PathBuf::from(format!("v.{n}.vdb")))));
        let text = List(&many).to_string();
        assert!(text.lines().count() == 5 && text.ends_with("2 more inputs have changed: 3-4"), "{text}");
    }
}
