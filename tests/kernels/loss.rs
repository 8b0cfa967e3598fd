//! A loss of a pixel, and how near derivatives have to be.

use cumulo::real::Real;
use cumulo::render::composited::Pixel;

/// A loss that weighs every channel and alpha differently: Σ k (v - t)² / 2.
const TARGET: [f64; 4] = [0.3, 0.1, 0.5, 0.2];
const WEIGHT: [f64; 4] = [1.0, 2.0, 0.5, -0.7];

pub fn loss<R: Real>(seen: &Pixel<R>) -> f64 {
    let v = seen.rgba().map(Real::f64);
    (0..4).map(|c| 0.5 * WEIGHT[c] * (v[c] - TARGET[c]).powi(2)).sum()
}

/// Its derivatives.
pub fn slope<R: Real>(seen: &Pixel<R>) -> [R; 4] {
    let v = seen.rgba().map(Real::f64);
    std::array::from_fn(|c| R::of(WEIGHT[c] * (v[c] - TARGET[c])))
}

/// Relative to the larger of the two, floored where both are rounding noise of the loss.
pub fn close(what: &str, got: f64, expected: f64, relative: f64, floor: f64) {
    let error = (got - expected).abs() / expected.abs().max(got.abs()).max(floor);
    assert!(error < relative, "{what}: {got} against {expected}, off by {error:.1e}");
}
