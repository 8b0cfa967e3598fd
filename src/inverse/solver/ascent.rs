//! Gradient ascent on the sphere of viewpoints, with curvature learnt on the way.
//!
//! BFGS (Nocedal & Wright 2006, eq. 6.17) in the two coordinates of the tangent plane. They belong to the
//! camera's own axes, which steps carry along (parallel transport): gradients and steps of different points can be
//! subtracted from one another as they are.

use crate::scene::sphere::stepped;
use glam::{DMat2, DMat3, DVec2};

/// Length of the first step in radians: a sixth of what lies between the paper's starts.
const FIRST: f64 = 0.2;
/// The longest step.
const LONGEST: f64 = 0.5;
/// Share of the rise that the gradient predicts below which a step is taken back (Armijo).
const RISE: f64 = 1e-4;

/// A value and its derivative by a step along the axes right and up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Evaluation {
    /// Value of the function that is maximised.
    pub value: f64,
    /// Derivative by a rotation vector's two coordinates, per radian.
    pub gradient: DVec2,
}

/// A local search: its viewpoint and its estimate of the curvature.
#[derive(Debug, Clone)]
pub(crate) struct Ascent {
    /// Axes of the viewpoint.
    pub axes: DMat3,
    /// Axes of all viewpoints it was at, the first one included.
    pub path: Vec<DMat3>,
    /// Value where it is, as the last climb evaluated it; none before.
    pub value: Option<f64>,
    /// Number of evaluations.
    pub evaluations: u32,
    /// Minus the inverse of the second derivatives, known once two points are evaluated.
    curvature: Option<DMat2>,
}

impl Ascent {
    /// A search from a viewpoint.
    pub(crate) fn new(axes: DMat3) -> Self {
        Self { axes, path: vec![axes], value: None, evaluations: 0, curvature: None }
    }

    /// Sets out anew with a frame of the same viewpoint, turned about the line of sight: what was learnt of the
    /// curvature turns with it, path and count begin again.
    pub(crate) fn restart(&mut self, axes: DMat3) {
        let old = DMat2::from_cols(
            DVec2::new(self.axes.x_axis.dot(axes.x_axis), self.axes.x_axis.dot(axes.y_axis)),
            DVec2::new(self.axes.y_axis.dot(axes.x_axis), self.axes.y_axis.dot(axes.y_axis)),
        );
        let curvature = self.curvature.map(|inverse| old * inverse * old.transpose());
        *self = Self { value: self.value, curvature, ..Self::new(axes) };
    }

    /// Climbs until steps are shorter than `shortest` (radians) or predict a smaller rise than `worth`, for at most
    /// `most` evaluations. `evaluate` gives nothing once the search is to stop. What was learnt of the curvature is
    /// kept for the next climb.
    pub(crate) fn climb(
        &mut self,
        [shortest, worth]: [f64; 2],
        most: u32,
        evaluate: impl Fn(&DMat3) -> Option<Evaluation>,
    ) {
        let end = self.evaluations.saturating_add(most);
        let probe = |axes: &DMat3, count: &mut u32| {
            (*count < end).then(|| *count += 1)?;
            evaluate(axes).filter(|s| s.value.is_finite() && s.gradient.is_finite())
        };
        let Some(mut current) = probe(&self.axes, &mut self.evaluations) else { return };
        loop {
            self.value = Some(current.value);
            let mut step = self.step(current.gradient);
            let (candidate, axes) = loop {
                let predicted = current.gradient.dot(step);
                // A step of nothing ends here, too.
                if !(step.length() > shortest && predicted > worth) {
                    return;
                }
                let axes = stepped(&self.axes, step);
                let Some(candidate) = probe(&axes, &mut self.evaluations) else { return };
                if candidate.value >= current.value + RISE * predicted {
                    break (candidate, axes);
                }
                step *= shrunk(current.value, predicted, candidate.value);
            };
            self.update_curvature(step, current.gradient - candidate.gradient);
            (self.axes, current) = (axes, candidate);
            self.path.push(axes);
        }
    }

    fn step(&self, gradient: DVec2) -> DVec2 {
        let step = match self.curvature {
            Some(inverse) => inverse * gradient,
            None => gradient.normalize_or_zero() * FIRST,
        };
        step.clamp_length_max(LONGEST)
    }

    /// Takes up what a step and the gradient's decrease along it say.
    fn update_curvature(&mut self, step: DVec2, decrease: DVec2) {
        let along = step.dot(decrease);
        if along <= 1e-9 * step.length() * decrease.length() {
            // The land curves upwards here: no summit near, go on in longer steps.
            self.curvature = self.curvature.map(|inverse| 2.0 * inverse);
            return;
        }
        let inverse = self.curvature.unwrap_or(DMat2::from_diagonal(DVec2::splat(along / decrease.length_squared())));
        let outer = |a: DVec2, b: DVec2| DMat2::from_cols(a * b.x, a * b.y);
        let keep = DMat2::IDENTITY - outer(step, decrease) * (1.0 / along);
        self.curvature = Some(keep * inverse * keep.transpose() + outer(step, step) * (1.0 / along));
    }
}

/// Where the parabola through two values and the derivative at the first has its top, as a share of the step.
fn shrunk(current: f64, predicted: f64, candidate: f64) -> f64 {
    let top = 0.5 * predicted / (predicted + current - candidate);
    if top.is_finite() { top.clamp(0.1, 0.5) } else { 0.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::sphere::upright;
    use crate::scene::up::Up;
    use glam::DVec3;

    /// A hill on the sphere: its top at the direction to which a quadratic form is largest.
    fn hill(axes: &DMat3) -> Evaluation {
        let form = DMat3::from_diagonal(DVec3::new(1.0, 0.4, 3.0));
        let d = axes.z_axis;
        // d changes by ω × d: the derivative by ω is d × ∇.
        let by_turn = d.cross(2.0 * (form * d));
        Evaluation { value: d.dot(form * d), gradient: DVec2::new(by_turn.dot(axes.x_axis), by_turn.dot(axes.y_axis)) }
    }

    #[test]
    fn the_top_is_found_in_few_steps_even_at_a_pole() {
        for from in [DVec3::new(1.0, 0.3, 0.2), DVec3::new(-0.2, 1.0, -0.1), DVec3::new(0.5, 0.5, 0.7)] {
            let mut ascent = Ascent::new(upright(from.normalize(), Up::Z));
            ascent.climb([1e-7, 0.0], 60, |axes| Some(hill(axes)));
            assert!(ascent.axes.z_axis.cross(DVec3::Z).length() < 1e-6, "{:?}", ascent.axes.z_axis);
            assert!(ascent.evaluations < 25, "{}", ascent.evaluations);
        }
    }

    #[test]
    fn flat_land_and_refusals_end_it() {
        let mut ascent = Ascent::new(DMat3::IDENTITY);
        ascent.climb([1e-3, 0.0], 9, |_| Some(Evaluation { value: 1.0, gradient: DVec2::ZERO }));
        assert_eq!((ascent.evaluations, ascent.path.len()), (1, 1));
        ascent.climb([1e-3, 0.0], 9, |_| None);
        ascent.climb([1e-3, 0.0], 9, |_| Some(Evaluation { value: f64::NAN, gradient: DVec2::ONE }));
        assert_eq!((ascent.evaluations, ascent.path.len()), (3, 1));
        let mut limited = Ascent::new(upright(DVec3::new(1.0, 0.3, 0.2).normalize(), Up::Z));
        limited.climb([0.0; 2], 4, |axes| Some(hill(axes)));
        assert_eq!(limited.evaluations, 4);
    }
}
