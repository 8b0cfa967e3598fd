//! Summary of a transfer function, for `transfer` and `info`.

use super::Function;
use super::rescale::range;
use crate::error::Result;
use crate::scene::transfer::Transfer;
use serde::Serialize;
use std::fmt;

/// Kind, size, range and peak values of a transfer function.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct TransferSummary {
    /// Kind of function: `texture`, `piecewise`, `gaussians`, `identity` or `labels`.
    pub kind: &'static str,
    /// Number of texels, points, lobes or classes; 1 for an identity.
    pub entries: usize,
    /// Number of parameters that can be optimised.
    pub parameters: usize,
    /// First and last density of the function's range.
    pub range: [f64; 2],
    /// Greatest extinction, per world unit.
    pub peak_extinction: f64,
    /// Greatest radiance of the source, by color channel.
    pub peak_color: [f64; 3],
    /// True if density 0 absorbs nothing, so that empty space can be skipped.
    pub empty_at_zero: bool,
    /// Albedo that the function states beside its colors.
    pub albedo: Option<AlbedoSummary>,
}

/// Summary of the albedo of a function.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct AlbedoSummary {
    /// Number of points.
    pub points: usize,
    /// Least albedo over all densities, by color channel.
    pub least: [f64; 3],
    /// Greatest albedo over all densities, by color channel.
    pub most: [f64; 3],
}

impl TransferSummary {
    /// Summary of a function.
    ///
    /// # Errors
    /// The conditions are those of [`Transfer::table`].
    pub(crate) fn of(Function { transfer, albedo }: &Function) -> Result<Self> {
        let (kind, entries, parameters) = match transfer {
            Transfer::Texture { texels, .. } => ("texture", texels.len(), 4 * texels.len()),
            Transfer::Piecewise { points } => ("piecewise", points.len(), 5 * points.len()),
            Transfer::Gaussians { lobes, .. } => ("gaussians", lobes.len(), 6 * lobes.len()),
            Transfer::Identity { .. } => ("identity", 1, 3),
            Transfer::Labels { classes } => ("labels", classes.len(), 4 * classes.len()),
        };
        let table = transfer.table()?;
        let [r, g, b, peak_extinction] = table.peak();
        Ok(Self {
            kind,
            entries,
            parameters,
            range: range(transfer),
            peak_extinction,
            peak_color: [r, g, b],
            empty_at_zero: table.at(0.0)[3] == 0.0,
            albedo: albedo.as_ref().map(|albedo| {
                let [least, most] = albedo.bounds();
                AlbedoSummary { points: albedo.points().len(), least, most }
            }),
        })
    }
}

impl fmt::Display for TransferSummary {
    /// Writes the summary on one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (one, many) = match self.kind {
            "texture" => ("texel", "texels"),
            "piecewise" => ("point", "points"),
            "gaussians" => ("lobe", "lobes"),
            _ => ("color", "colors"),
        };
        let [low, high] = self.range;
        let empty = if self.empty_at_zero { "nothing" } else { "something" };
        write!(
            f,
            "{} of {} {}, {} parameters, densities {low} to {high}, peak extinction {}, {empty} at density 0",
            self.kind,
            self.entries,
            if self.entries == 1 { one } else { many },
            self.parameters,
            self.peak_extinction
        )?;
        if let Some(AlbedoSummary { points, least, most }) = &self.albedo {
            let s = if *points == 1 { "" } else { "s" };
            let [low, high] = [least, most].map(|[r, g, b]| format!("{r} {g} {b}"));
            write!(f, ", albedo of {points} point{s}, {low} to {high}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::transfer::Lobe;

    #[test]
    fn parameters_are_counted_as_the_function_does() {
        for t in [
            Transfer::Texture { domain: [0.0, 1.0], texels: vec![[0.5; 4]; 3] },
            Transfer::Piecewise { points: vec![[0.0; 5], [1.0; 5]] },
            Transfer::Gaussians { domain: [0.0, 1.0], lobes: vec![Lobe { mean: 0.5, ln_width: -2.0, rgbs: [1.0; 4] }] },
            Transfer::Identity { domain: [0.0, 1.0], color: [1.0; 3] },
        ] {
            let s = TransferSummary::of(&t.clone().into()).unwrap();
            assert_eq!(s.parameters, t.parameters().len(), "{s}");
            assert_eq!(s.range, [0.0, 1.0]);
        }
    }
}
