//! Difference quotients of a loss, parameter by parameter, in double precision: what derivatives are checked
//! against.

use crate::differentiate::study::Study;
use crate::differentiate::study::parameter::{Parameter, camera_step};
use crate::differentiate::study::subject::{Subject, depth_channel, largest};
use crate::error::Result;
use crate::scene::transfer::Transfer;

/// On which sides of a value the loss is smooth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Both,
    Above,
    Below,
}

/// Parameters of a point of a piecewise linear function: its density and its values.
const POINT: usize = 5;

/// A difference quotient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quotient {
    /// Estimate of the derivative.
    pub value: f64,
    /// Bound of the error that rounding of the loss alone makes in the estimate.
    pub rounding: f64,
}

/// The least share of a quotient that rounding leaves it good to, if it is to be compared by its own size.
const DIGITS: f64 = 1e-4;

impl Quotient {
    /// How far a derivative is off, relative to the larger of both, or to a floor: that given, or, where rounding
    /// leaves the quotient fewer than four digits, what would have them.
    pub fn error(&self, derivative: f64, floor: f64) -> f64 {
        let off = (derivative - self.value).abs();
        let scale = derivative.abs().max(self.value.abs()).max(floor).max(self.rounding / DIGITS);
        // What is not a number is no agreement.
        if off == 0.0 { 0.0 } else { off / scale }
    }
}

/// Rounding of a loss, relative to it: sums of pixels, each of sums along a ray.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl<V: Subject<Double = V>> Study<V> {
    /// Difference quotient of the loss, of second order: central, or from one side where the other is out of
    /// bounds or beyond a knot of the transfer function. Steps shrink until two quotients agree: some losses
    /// bend sharply (the entropy, where a pixel is all but clear).
    ///
    /// # Errors
    /// As [`Subject::renderer`].
    pub fn difference(&mut self, parameter: Parameter) -> Result<Quotient> {
        let (mut h, side) = self.reach(parameter)?;
        // Quotients are good to this over their step: where they are little more, two agree by chance.
        let rounding = ROUNDING * self.value_at(parameter, 0.0)?.0.abs();
        let quotient = |value: f64, h: f64| Quotient { value, rounding: rounding / h };
        let mut last = self.quotient(parameter, h, side)?;
        let (mut best, mut least) = (quotient(last, h), f64::INFINITY);
        for _ in 0..3 {
            h *= 0.1;
            let next = self.quotient(parameter, h, side)?;
            if rounding / h > 1e-3 * next.abs() {
                break;
            }
            let off = Quotient { value: last, rounding: 0.0 }.error(next, 0.0);
            if off < least {
                (best, least) = (quotient(next, h), off);
            }
            if off < 1e-6 {
                break;
            }
            last = next;
        }
        Ok(best)
    }

    fn quotient(&mut self, parameter: Parameter, h: f64, side: Side) -> Result<f64> {
        let mut at = |h: f64| self.value_at(parameter, h);
        if side == Side::Both {
            let ((up, above), (down, below)) = (at(h)?, at(-h)?);
            return Ok((up - down) / (above - below));
        }
        let h = if side == Side::Above { h } else { -h };
        let (near, far, here) = (at(h)?.0, at(2.0 * h)?.0, at(0.0)?.0);
        Ok((4.0 * near - far - 3.0 * here) / (2.0 * h))
    }

    /// The loss with a parameter changed, and by how much it was: some are held in `f32`.
    fn value_at(&mut self, parameter: Parameter, by: f64) -> Result<(f64, f64)> {
        let (keep, mut taken) = (self.setting.clone(), by);
        let setting = &mut self.setting;
        let mut voxels = Vec::new();
        match parameter {
            Parameter::Step => {
                setting.quadrature = setting.quadrature.map_step(|step| step + by);
            }
            Parameter::Camera { view, part } => {
                setting.cameras[view] = setting.cameras[view].moved(&camera_step(part, by));
            }
            Parameter::Transfer(i) => {
                if let Some(transfer) = &mut setting.transfer {
                    let mut all: Vec<f64> = transfer.parameters().iter().map(|p| p.1).collect();
                    all[i] += by;
                    *transfer = transfer.with_parameters(&all);
                }
            }
            Parameter::Voxel { voxel, channel } => {
                for slot in self.field.topology.slots(voxel).into_iter().flatten() {
                    let value = self.field.values[slot];
                    voxels.push((slot, value));
                    self.field.values[slot] = value.with(channel, value.channel(channel) + by);
                }
            }
            Parameter::Background(c) => {
                let new = (f64::from(setting.background[c]) + by) as f32;
                taken = f64::from(new) - f64::from(setting.background[c]);
                setting.background[c] = new;
            }
            Parameter::Extinction => setting.extinction += by,
        }
        let value = self.value();
        voxels.into_iter().for_each(|(slot, v)| self.field.values[slot] = v);
        self.setting = keep;
        Ok((value?, taken))
    }

    /// The step of a difference, and on which sides it may be taken. Values are good to 1e-16 of themselves, so
    /// that a step of a millionth of what matters leaves 1e-10 of rounding and 1e-12 of curvature.
    fn reach(&self, parameter: Parameter) -> Result<(f64, Side)> {
        let setting = &self.setting;
        let voxel = self.field.transform.voxel_size().min_element();
        let (_, group, value) = self.described(&[parameter]).swap_remove(0);
        // Densities are not negative; other values may be.
        let bounded = |h: f64| (h, if (0.0..h).contains(&value) { Side::Above } else { Side::Both });
        Ok(match parameter {
            Parameter::Step => (1e-6 * value, Side::Both),
            Parameter::Camera { view, part } => {
                let camera = &setting.cameras[view];
                let distance = (camera.position() - self.field.world_bounds().centre()).length();
                let h = match part {
                    0..3 => 1e-5 * voxel,
                    3..6 => 1e-5 * voxel / distance.max(voxel),
                    6..8 => 1e-6 * value,
                    _ => 1e-5,
                };
                (h, Side::Both)
            }
            Parameter::Transfer(i) => self.transfer_reach(i, group, value)?,
            Parameter::Voxel { channel, .. } => {
                let h = 1e-5 * largest(&self.field, channel);
                let Some(transfer) = &setting.transfer else { return Ok(bounded(h)) };
                match transfer.table()?.knots().iter().find(|k| (value - **k).abs() < 2.0 * h) {
                    Some(knot) if value < *knot && !(0.0..2.0 * h).contains(&value) => (h, Side::Below),
                    Some(_) => (h, Side::Above),
                    None => bounded(h),
                }
            }
            // A power of two: exact up to 2^-24 of the color, and that much is known.
            Parameter::Background(_) => (1.0 / 4096.0, Side::Both),
            Parameter::Extinction => (1e-6 * value, Side::Both),
        })
    }

    fn transfer_reach(&self, parameter: usize, group: &str, value: f64) -> Result<(f64, Side)> {
        let Some(transfer) = &self.setting.transfer else { return Ok((1.0, Side::Both)) };
        let table = transfer.table()?;
        let knots = table.knots();
        let width = (knots[knots.len() - 1] - knots[0]).max(f64::MIN_POSITIVE);
        Ok(match (group, transfer) {
            ("tf.density", Transfer::Piecewise { .. }) => {
                let gap = knots.iter().map(|k| (k - value).abs()).filter(|g| *g > 0.0).fold(width, f64::min);
                let h = (1e-6 * width).min(0.25 * gap);
                // The two knots of a step can only part.
                let knot = parameter / POINT;
                if knots.get(knot + 1) == Some(&value) {
                    return Ok((h, Side::Below));
                }
                if knot > 0 && knots[knot - 1] == value {
                    return Ok((h, Side::Above));
                }
                // Where the field is level at the knot, its densities belong to the piece above it.
                let density = |v: &V| self.field.reference + v.channel(depth_channel::<V>());
                let level = self.field.values.iter().any(|v| (density(v) - value).abs() < 2.0 * h);
                (h, if level { Side::Below } else { Side::Both })
            }
            ("tf.density", _) => (1e-6 * width, Side::Both),
            ("tf.width", _) => (1e-6, Side::Both),
            _ => {
                let h = 1e-6 * table.peak().iter().fold(1e-3, |m: f64, v| m.max(*v));
                (h, if value < h { Side::Above } else { Side::Both })
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_what_is_known() {
        let quotient = Quotient { value: 2.0, rounding: 1e-9 };
        assert_eq!([2.0, 4.0, 1.5].map(|d| quotient.error(d, 0.0)), [0.0, 0.5, 0.25]);
        assert_eq!(quotient.error(4.0, 40.0), 0.05);
        // One digit is known: off by as much as rounding is four digits of nothing.
        let coarse = Quotient { value: 1e-8, rounding: 1e-9 };
        assert!((coarse.error(1.1e-8, 0.0) - 1e-4).abs() < 1e-12);
        let nothing = Quotient { value: 0.0, rounding: 0.0 };
        assert!(nothing.error(0.0, 0.0) == 0.0 && nothing.error(f64::NAN, 0.0).is_nan());
        assert!(quotient.error(f64::NAN, 1.0).is_nan());
    }
}
