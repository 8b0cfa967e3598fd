//! Noise of pictures, as their layers tell it.

use crate::scene::film::Film;

/// Returns the mean variance of the colors of a picture, as its layers tell it.
pub(super) fn variance(film: &Film) -> Option<f64> {
    let mean = |of: &dyn Fn(&str) -> Option<f64>| Some(["R", "G", "B"].map(of).into_iter().sum::<Option<f64>>()? / 3.0);
    let finite = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.filter(|v| v.is_finite()).fold((0.0, 0_u32), |(sum, n), v| (sum + v, n + 1));
        sum / f64::from(count.max(1))
    };
    let stated = |channel: &str| {
        let plane = film.plane(&format!("variance.{channel}"))?;
        Some(finite(&mut plane.iter().map(|v| f64::from(*v))))
    };
    let halves = |channel: &str| {
        let [a, b] = ["half_a", "half_b"].map(|half| film.plane(&format!("{half}.{channel}")));
        // The mean of two halves has a fourth of the variance of their difference.
        Some(finite(&mut a?.iter().zip(b?).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2) / 4.0)))
    };
    mean(&stated).or_else(|| mean(&halves))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::film::Plane;

    #[test]
    fn noise_is_told_by_layers() {
        let plane = |name: &str, v: f32| Plane { name: name.into(), samples: vec![v; 4] };
        let mut film = Film::new(2, 2);
        assert_eq!(variance(&film), None);
        for channel in ["R", "G", "B"] {
            film.planes.push(plane(&format!("half_a.{channel}"), 1.0));
            film.planes.push(plane(&format!("half_b.{channel}"), 2.0));
        }
        assert_eq!(variance(&film), Some(0.25));
        film.planes.extend(["variance.R", "variance.G", "variance.B"].map(|name| plane(name, 0.5)));
        assert_eq!(variance(&film), Some(0.5));
    }
}
