//! Normal equations of a camera from the colors of its picture.

use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::inverse::pose::normal::{Frame, Normal, Pose};
use crate::render::differentiable::Differentiable;
use crate::scene::medium::{Medium, Source};

/// Derivatives that a walk gives, and how the colors' follow from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Colors {
    /// Cotangents of the walks: derivatives with respect to red, green, blue and alpha.
    losses: Vec<[f32; 4]>,
    /// Weights of the losses in the derivative of each color, `mix[loss][color]`.
    mix: [[f64; 3]; 3],
}

impl Colors {
    /// Chooses the derivatives for a medium: with a source of one shape the colors are the same function of the ray but
    /// for factors.
    pub fn from_medium(medium: &Medium, background: [f32; 3]) -> Self {
        let background = background.map(f64::from);
        match &medium.source {
            // L = α color + (1 - α) background.
            Source::Grey(color) => Self {
                losses: vec![unit(3)],
                mix: std::array::from_fn(|c| [f64::from(color[c]) - background[c], 0.0, 0.0]),
            },
            // L = e color + (1 - α) background: e from the brightest.
            Source::Linear(color) => {
                let most = (0..3).fold(0, |most, c| if color[c] > color[most] { c } else { most });
                let share = |c: usize| if color[c] > 0.0 { f64::from(color[c]) / f64::from(color[most]) } else { 0.0 };
                Self {
                    losses: vec![unit(most), unit(3)],
                    mix: std::array::from_fn(|c| [share(c), share(c) * background[most] - background[c], 0.0]),
                }
            }
            Source::Transfer(_) => Self::apart(),
        }
    }

    /// Takes each color for a function of its own.
    pub fn apart() -> Self {
        Self {
            losses: [0, 1, 2].map(unit).to_vec(),
            mix: [0, 1, 2].map(|c| std::array::from_fn(|i| if i == c { 1.0 } else { 0.0 })),
        }
    }
}

/// One of red, green, blue and alpha.
fn unit(c: usize) -> [f32; 4] {
    std::array::from_fn(|i| if i == c { 1.0 } else { 0.0 })
}

/// Returns the normal equations of one camera: those of its render against the colors of its picture, given by the
/// row-major number of a pixel, of which one in `stride` is compared. Colors that are not finite ask for nothing.
pub fn linearised<I: Differentiable<Real = f32>>(
    rows: &Rows<'_, I>,
    frame: &Frame,
    picture: &(dyn Fn(usize) -> [f32; 4] + Sync),
    colors: &Colors,
    stride: usize,
) -> Normal {
    let compared = |i: usize| i.is_multiple_of(stride) && picture(i)[..3].iter().all(|v| v.is_finite());
    let Colors { losses, mix } = colors;
    let sums = rows.fold(compared, losses, |normal: &mut Normal, i, rendered, by| {
        let by: Vec<(Pose, f64)> = by.iter().map(|by| frame.derivative(by)).collect();
        let target = picture(i);
        for c in 0..3 {
            let row = by
                .iter()
                .zip(mix[c])
                .fold((Pose::zeros(), 0.0), |(pose, focal), (by, share)| (pose + share * by.0, focal + share * by.1));
            normal.add(&row, f64::from(target[c]) - rendered[c]);
        }
    });
    sums.into_iter().sum()
}
