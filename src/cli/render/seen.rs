//! What pictures show at all: a picture in which nothing is to be seen says why.

use crate::scene::film::Film;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether some pixel of the pictures so far shows the volume, by its alpha or by a color that others do not have, and
/// whether some pixel is not black.
#[derive(Debug, Default)]
pub(super) struct Seen {
    covered: AtomicBool,
    lit: AtomicBool,
}

impl Seen {
    /// Looks at a picture.
    pub(super) fn add(&self, film: &Film) {
        if !self.covered.load(Ordering::Relaxed) && film.rgba.iter().any(|p| p[3] > 0.0 || *p != film.rgba[0]) {
            self.covered.store(true, Ordering::Relaxed);
        }
        if !self.lit.load(Ordering::Relaxed) && film.rgba.iter().any(|p| p[..3].iter().any(|c| *c > 0.0)) {
            self.lit.store(true, Ordering::Relaxed);
        }
    }

    /// Says why nothing is to be seen; `transfer` is true if a transfer function makes extinctions of densities.
    pub(super) fn remark(&self, transfer: bool) -> Option<String> {
        let [covered, lit] = [&self.covered, &self.lit].map(|seen| seen.load(Ordering::Relaxed));
        match (covered, lit, transfer) {
            (false, _, true) => Some(
                "the pictures do not show the volume: the transfer function absorbs nothing at its densities, or no camera \
                 looks at it; --tf-range LOW,HIGH moves the function to the densities that `cumulo info` lists"
                    .into(),
            ),
            (false, _, false) => Some(
                "the pictures do not show the volume: it absorbs next to nothing, or no camera looks at it; \
                 --density-scale auto makes it visible"
                    .into(),
            ),
            (true, false, _) => Some(
                "all pixels are black: nothing shines, neither the volume nor a light nor the background; \
                 --background 1,1,1 shows what absorbs"
                    .into(),
            ),
            (true, true, _) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_without_light_or_volume_are_told() {
        let of = |pixels: &[[f32; 4]]| {
            let seen = Seen::default();
            pixels.iter().for_each(|pixel| seen.add(&Film::of(1, 1, vec![*pixel])));
            (seen.remark(false), seen.remark(true))
        };
        let has = |text: &Option<String>, word: &str| text.as_ref().is_some_and(|text| text.contains(word));
        assert_eq!(of(&[[0.0; 4], [0.0, 0.1, 0.0, 0.5]]), (None, None));
        // A flame that absorbs nothing.
        let flame = Seen::default();
        flame.add(&Film::of(2, 1, vec![[0.0; 4], [1.0, 0.5, 0.0, 0.0]]));
        assert_eq!(flame.remark(false), None);
        let (plain, function) = of(&[[0.0, 0.0, 0.0, 1.0]]);
        assert!(has(&plain, "black") && has(&function, "black"));
        let (plain, function) = of(&[[1.0, 1.0, 1.0, 0.0]]);
        assert!(has(&plain, "--density-scale") && has(&function, "--tf-range"));
    }
}
