//! Rescaling of a transfer function to another range of densities.

use crate::error::{Error, Result};
use crate::scene::albedo::AlbedoFunction;
use crate::scene::transfer::{Lobe, Transfer};

/// Range of densities of a function: its domain, or the densities of its first and last point.
pub(crate) fn range(transfer: &Transfer) -> [f64; 2] {
    match transfer {
        Transfer::Texture { domain, .. } | Transfer::Gaussians { domain, .. } | Transfer::Identity { domain, .. } => {
            *domain
        }
        Transfer::Labels { classes } => {
            [classes.first(), classes.last()].map(|class| class.map_or(f64::NAN, |class| class.label.into()))
        }
        Transfer::Piecewise { points } => [points.first(), points.last()].map(|point| point.map_or(f64::NAN, |p| p[0])),
    }
}

/// Maps the densities of an albedo as [`to_range`] does those of the function that it goes with.
///
/// # Errors
/// As of [`to_range`].
pub(super) fn albedo_to_range(albedo: &AlbedoFunction, transfer: &Transfer, to: [f64; 2]) -> Result<AlbedoFunction> {
    let map = map(range(transfer), to)?;
    let mut last = f64::NEG_INFINITY;
    let moved = |[density, r, g, b]: [f64; 4]| {
        // Rounding must not swap neighbours.
        last = map(density).max(last);
        [last, r, g, b]
    };
    AlbedoFunction::new(&albedo.points().into_iter().map(moved).collect::<Vec<_>>())
        .map_err(|e| e.hint("give a range that can tell the densities of the albedo apart"))
}

/// Returns the linear map of one range of densities to another.
fn map(from: [f64; 2], [low, high]: [f64; 2]) -> Result<impl Fn(f64) -> f64> {
    let width = from[1] - from[0];
    if !(low < high && (high - low).is_finite()) {
        return Err(Error::invalid(format!("range {low}..{high} must ascend"))
            .hint("give the smaller of two finite densities first"));
    }
    if !(width > 0.0 && width.is_finite()) {
        return Err(Error::invalid(format!(
            "densities from {} to {} cannot be mapped to {low}..{high}: they are no range",
            from[0], from[1]
        ))
        .hint("leave the range out, or give the function a second density"));
    }
    // Both ends are met exactly.
    Ok(move |d: f64| {
        let f = (d - from[0]) / width;
        (1.0 - f) * low + f * high
    })
}

/// Maps the densities of a function linearly so that its ends become `low` and `high`. Extinctions are unchanged; an
/// identity, whose extinctions are the densities, therefore becomes points.
///
/// # Errors
/// If one of the ranges does not ascend, or is too narrow to tell the function's densities apart.
pub(super) fn to_range(transfer: &Transfer, to: [f64; 2]) -> Result<Transfer> {
    let [from, [low, high]] = [range(transfer), to];
    let width = from[1] - from[0];
    let map = map(from, to)?;
    let scaled = match transfer {
        Transfer::Texture { texels, .. } => Transfer::Texture { domain: to, texels: texels.clone() },
        Transfer::Piecewise { points } => {
            let mut last = low;
            let moved = |[d, r, g, b, s]: &[f64; 5]| {
                // Rounding must not swap neighbours.
                last = map(*d).max(last);
                [last, *r, *g, *b, *s]
            };
            Transfer::Piecewise { points: points.iter().map(moved).collect() }
        }
        Transfer::Gaussians { lobes, .. } => {
            let wider = ((high - low) / width).ln();
            let moved = |l: &Lobe| Lobe { mean: map(l.mean), ln_width: l.ln_width + wider, rgbs: l.rgbs };
            Transfer::Gaussians { domain: to, lobes: lobes.iter().map(moved).collect() }
        }
        Transfer::Labels { .. } => {
            return Err(Error::invalid("labels cannot be mapped to another range").hint("leave the range out"));
        }
        Transfer::Identity { domain, color: [r, g, b] } => {
            Transfer::Piecewise { points: vec![[low, *r, *g, *b, domain[0]], [high, *r, *g, *b, domain[1]]] }
        }
    };
    scaled.checked().map_err(|e| e.hint("give a range that can tell the function's densities apart"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn every_kind_keeps_its_values() {
        let rgbs = |v: f64| [v, 1.0 - v, 0.5, 3.0 * v];
        for t in [
            Transfer::Texture { domain: [1.0, 3.0], texels: [0.1, 0.9, 0.4].map(rgbs).to_vec() },
            Transfer::Piecewise {
                points: vec![[1.0, 0.1, 0.2, 0.3, 0.0], [1.7, 0.3, 0.3, 0.3, 2.0], [3.0, 0.0, 0.0, 0.0, 1.0]],
            },
            Transfer::Gaussians {
                domain: [1.0, 3.0],
                lobes: vec![Lobe { mean: 1.6, ln_width: -1.5, rgbs: rgbs(0.3) }],
            },
            Transfer::Identity { domain: [1.0, 3.0], color: [0.3, 0.6, 0.9] },
        ] {
            let scaled = to_range(&t, [-2.0, 8.0]).unwrap();
            assert_eq!(range(&scaled), [-2.0, 8.0]);
            let (a, b) = (t.table().unwrap(), scaled.table().unwrap());
            for i in 0..=40 {
                let f = f64::from(i) / 40.0;
                let (x, y) = (a.at(1.0 + 2.0 * f), b.at(-2.0 + 10.0 * f));
                // Densities are rounded on the way: a few ulps times slopes below 100.
                assert!((0..4).all(|c| (x[c] - y[c]).abs() < 1e-12), "{t:?} {f}: {x:?} {y:?}");
            }
        }
    }

    #[test]
    fn albedos_move_with_their_function() {
        let t = Transfer::Piecewise { points: vec![[1.0; 5], [3.0; 5]] };
        let albedo = AlbedoFunction::new(&[[0.0, 0.5, 0.5, 0.5], [2.0, 1.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0]]);
        let moved = albedo_to_range(&albedo.unwrap(), &t, [0.0, 1.0]).unwrap();
        assert_eq!(moved.points().iter().map(|p| p[0]).collect::<Vec<_>>(), [-0.5, 0.5, 1.0]);
    }

    #[test]
    fn what_is_no_range_is_refused() {
        let one = Transfer::Piecewise { points: vec![[0.5; 5]] };
        assert!(to_range(&one, [0.0, 1.0]).unwrap_err().to_string().contains("no range"));
        let t = Transfer::Identity { domain: [0.0, 1.0], color: [1.0; 3] };
        assert!(to_range(&t, [1.0, 1.0]).unwrap_err().to_string().contains("ascend"));
        assert!(to_range(&t, [f64::NAN, 1.0]).is_err());
    }
}
