//! The feature that models predict colors from: an exponentially weighted history of colors that follows the motion
//! (the paper's equation 12), and distances between colors.

use glam::Vec3;

/// Returns the least and the greatest values, channel by channel, of the pixels within one of a pixel; pixels that are
/// not finite are left out. `None` if none is left.
pub(crate) fn neighbourhood(color: &[Vec3], [width, height]: [usize; 2], [x, y]: [usize; 2]) -> Option<[Vec3; 2]> {
    let (columns, rows) = (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
    let all = rows.flat_map(|row| columns.clone().map(move |column| color[row * width + column]));
    let finite = all.filter(|color| color.is_finite());
    finite.fold(None, |range, color| {
        Some(range.map_or([color; 2], |[low, high]: [Vec3; 2]| [low.min(color), high.max(color)]))
    })
}

/// Returns the feature of a pixel from the history that was reprojected to it: `α Ψ[history] + (1 - α) color`, where Ψ
/// clamps the history to the range of the colors around the pixel.
#[inline(always)]
pub(crate) fn follow(history: Vec3, color: Vec3, [low, high]: [Vec3; 2], alpha: f32) -> Vec3 {
    alpha * history.clamp(low, high) + (1.0 - alpha) * color
}

/// Returns the distance of two colors as a share of the darker one, the paper's equation 13; 0 of two black ones.
#[inline(always)]
pub(crate) fn distance(a: Vec3, b: Vec3) -> f32 {
    let most = a.abs().max(b.abs()).max_element();
    if most == 0.0 {
        return 0.0;
    }
    // Squares of very bright or faint colors overflow or vanish.
    let (a, b) = (a / most, b / most);
    (a - b).length() / a.length().min(b.length()).max(f32::MIN_POSITIVE)
}

/// Returns the weight of a distance, `exp(-d² / h²)`; 1 for an infinite bandwidth.
#[inline(always)]
pub(crate) fn weight(distance: f32, bandwidth: f32) -> f32 {
    if bandwidth.is_infinite() {
        return 1.0;
    }
    let ratio = distance / bandwidth;
    (-ratio * ratio).exp()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn histories_are_clamped_to_what_is_around() {
        let color: Vec<Vec3> = (0..12).map(|i| Vec3::splat(i as f32)).collect();
        let range = neighbourhood(&color, [4, 3], [0, 0]).unwrap();
        assert_eq!(range, [Vec3::splat(0.0), Vec3::splat(5.0)]);
        assert_eq!(neighbourhood(&color, [4, 3], [2, 1]).unwrap(), [Vec3::splat(1.0), Vec3::splat(11.0)]);
        assert_eq!(follow(Vec3::splat(9.0), Vec3::ONE, range, 0.75), Vec3::splat(4.0));
        assert_eq!(neighbourhood(&[Vec3::NAN; 4], [2, 2], [0, 0]), None);
    }

    #[test]
    fn distances_are_relative() {
        assert_eq!(distance(Vec3::ZERO, Vec3::ZERO), 0.0);
        for light in [1e-30_f32, 1.0, 1e30] {
            let d = distance(light * Vec3::ONE, light * Vec3::splat(1.5));
            assert!((d - 0.5).abs() < 1e-5, "{light}: {d}");
        }
        assert_eq!(weight(distance(Vec3::ZERO, Vec3::ONE), 0.75), 0.0);
        assert_eq!(weight(0.0, 0.75), 1.0);
    }
}
