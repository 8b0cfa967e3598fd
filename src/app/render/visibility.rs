//! Whether pictures show the volume at all: one that does not says why.

use crate::plan::Plan;
use crate::scene::film::Film;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Share of the brightest pixel's radiance that may be left out of pictures without a remark.
const UNREMARKED: f64 = 0.1;

/// Alpha from which a pixel is opaque, and below which it does not show the volume.
const OPAQUE: f32 = 0.999;
const SHOWN: f32 = 0.004;
/// Share of the pixels that show the volume of which opaque ones say that nothing of its inside is seen.
const SOLID: f64 = 0.98;
/// Fewest pixels that say so.
const FEWEST: u64 = 64;

/// Whether some pixel of the pictures so far shows the volume, by its alpha or by a color that others do not have, and
/// the radiance of the brightest.
#[derive(Debug, Default)]
pub(super) struct Visibility {
    covered: AtomicBool,
    /// Bits of the radiance, which for numbers from 0 on are in the order of these.
    brightest: AtomicU32,
    /// Pixels that show the volume, and those of them that are opaque.
    shown: AtomicU64,
    opaque: AtomicU64,
}

impl Visibility {
    /// Looks at a picture.
    pub(super) fn add(&self, film: &Film) {
        if !self.covered.load(Ordering::Relaxed) && film.rgba.iter().any(|p| p[3] > 0.0 || *p != film.rgba[0]) {
            self.covered.store(true, Ordering::Relaxed);
        }
        let brightest = film.rgba.iter().flat_map(|p| &p[..3]).fold(0.0_f32, |most, c| most.max(*c));
        self.brightest.fetch_max(brightest.to_bits(), Ordering::Relaxed);
        let above = |alpha: f32| film.rgba.iter().filter(|p| p[3] >= alpha).count() as u64;
        self.shown.fetch_add(above(SHOWN), Ordering::Relaxed);
        self.opaque.fetch_add(above(OPAQUE), Ordering::Relaxed);
    }

    /// Looks at a deep picture, of which opacity alone is of use as well.
    pub(super) fn add_deep(&self, film: &Film) {
        self.add(film);
        self.brightest.fetch_max(f32::MIN_POSITIVE.to_bits(), Ordering::Relaxed);
    }

    fn brightest(&self) -> f64 {
        f32::from_bits(self.brightest.load(Ordering::Relaxed)).into()
    }

    /// Says why nothing is to be seen, and whether the plan leaves out much of what would be; `transfer` is true if a
    /// transfer function makes extinctions of densities.
    pub(super) fn remarks(&self, transfer: bool, plan: Option<&Plan>) -> Vec<String> {
        let omitted = plan.and_then(|plan| plan.omitted).filter(|omitted| *omitted > UNREMARKED * self.brightest());
        let of = if plan.is_some_and(|plan| plan.confidence < 1.0) { "block of pixels" } else { "pixel" };
        let omitted = omitted.filter(|omitted| *omitted > 0.0).map(|omitted| {
            format!(
                "up to {omitted:.2e} of radiance may be missing in a channel of a {of}, and the brightest pixel has \
                 {:.2e}: ⟨max_omitted⟩ is a radiance, not a share of the picture's; a smaller one keeps more",
                self.brightest()
            )
        });
        let solid = self.solid().filter(|_| transfer);
        self.nothing(transfer).into_iter().chain(solid).chain(omitted).collect()
    }

    /// Says so if the volume is one solid block.
    fn solid(&self) -> Option<String> {
        let [shown, opaque] = [&self.shown, &self.opaque].map(|count| count.load(Ordering::Relaxed));
        let share = opaque as f64 / shown.max(1) as f64;
        (shown >= FEWEST && share >= SOLID).then(|| {
            format!(
                "the volume is opaque in {:.0} % of the pixels that show it, so that nothing of its inside is seen: \
                 ⟨tf_range=LOW,HIGH⟩ moves the transfer function to the values that `cumulo info` lists, \
                 ⟨density_scale=auto⟩ thins it",
                100.0 * share
            )
        })
    }

    fn nothing(&self, transfer: bool) -> Option<String> {
        let (covered, lit) = (self.covered.load(Ordering::Relaxed), self.brightest() > 0.0);
        match (covered, lit, transfer) {
            (false, _, true) => Some(
                "the pictures do not show the volume: the transfer function absorbs nothing at its densities, or no \
                 camera looks at it; ⟨tf_range=LOW,HIGH⟩ moves the function to the densities that `cumulo info` lists"
                    .into(),
            ),
            (false, _, false) => Some(
                "the pictures do not show the volume: it absorbs next to nothing, or no camera looks at it; \
                 ⟨density_scale=auto⟩ makes it visible"
                    .into(),
            ),
            (true, false, _) => Some(
                "all pixels are black: nothing shines, neither the volume nor a light nor the background; \
                 ⟨background=1,1,1⟩ shows what absorbs"
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
    fn solid_blocks_are_told() {
        let of = |alphas: &[f32]| {
            let visibility = Visibility::default();
            visibility.add(&Film::of(alphas.len(), 1, alphas.iter().map(|a| [0.5, 0.5, 0.5, *a]).collect()));
            visibility.solid()
        };
        let block: Vec<f32> = (0..400).map(|i| if i < 200 { 1.0 } else { 0.0 }).collect();
        assert!(of(&block).is_some_and(|text| text.contains("100 %")));
        assert_eq!(of(&block[150..250]), None, "too few pixels to say so");
        let soft: Vec<f32> = (0..400).map(|i| (i as f32 / 200.0).min(1.0)).collect();
        assert_eq!(of(&soft), None);
    }

    #[test]
    fn pictures_without_light_or_volume_are_told() {
        let of = |pixels: &[[f32; 4]]| {
            let visibility = Visibility::default();
            pixels.iter().for_each(|pixel| visibility.add(&Film::of(1, 1, vec![*pixel])));
            (visibility.nothing(false), visibility.nothing(true))
        };
        let has = |text: &Option<String>, word: &str| text.as_ref().is_some_and(|text| text.contains(word));
        assert_eq!(of(&[[0.0; 4], [0.0, 0.1, 0.0, 0.5]]), (None, None));
        // A flame that absorbs nothing.
        let flame = Visibility::default();
        flame.add(&Film::of(2, 1, vec![[0.0; 4], [1.0, 0.5, 0.0, 0.0]]));
        assert_eq!(flame.nothing(false), None);
        let (plain, function) = of(&[[0.0, 0.0, 0.0, 1.0]]);
        assert!(has(&plain, "black") && has(&function, "black"));
        let matte = Visibility::default();
        matte.add_deep(&Film::of(1, 1, vec![[0.0, 0.0, 0.0, 0.5]]));
        assert_eq!(matte.nothing(false), None);
        let (plain, function) = of(&[[1.0, 1.0, 1.0, 0.0]]);
        assert!(has(&plain, "⟨density_scale=auto⟩") && has(&function, "⟨tf_range"));
    }
}
