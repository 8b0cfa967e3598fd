//! What photographs of a medium tell of its setting: whether it is lighter than the background, or darker.

use crate::error::{Error, Result};
use crate::scene::capture::{Capture, EmissionModel, Model};
use crate::scene::film::Film;

/// Shorter side of a picture over the width of the border that shows the background.
const BORDER: usize = 32;
/// Difference from the background that its noise and uneven light leave.
const SAME: f32 = 0.03;
/// Radiance up to which a background counts as what a camera makes of black: 8 of 255 levels of sRGB.
const BLACK: f32 = 0.0025;

/// Background and light of the pictures that were added.
#[derive(Debug, Default)]
pub(super) struct Setting {
    /// Colors of all borders.
    border: Vec<[f32; 3]>,
    /// Light that the medium adds to the background, by color, and takes from it.
    added: [f64; 3],
    taken: f64,
    brightest: f32,
}

impl Setting {
    /// Adds a picture.
    pub(crate) fn add(&mut self, film: &Film) {
        let border = border(film);
        let background = median(&border);
        for pixel in film.rgba.iter().filter(|pixel| pixel.iter().all(|v| v.is_finite())) {
            for c in 0..3 {
                let difference = pixel[c] - background[c];
                if difference.abs() > SAME {
                    let side = if difference > 0.0 { &mut self.added[c] } else { &mut self.taken };
                    *side += f64::from(difference.abs());
                }
                self.brightest = self.brightest.max(pixel[c]);
            }
        }
        self.border.extend(border);
    }

    /// States the setting in a capture, and returns it in words. The background is that of the borders unless it is
    /// given. What is lighter than it scatters or emits: a real medium follows the model of a grey source about, whose
    /// radiance no pixel exceeds.
    ///
    /// # Errors
    /// If most of the borders have another color than the median, or there is nothing but background.
    pub(crate) fn state(&self, capture: &mut Capture, given: Option<[f32; 3]>) -> Result<String> {
        let median = median(&self.border);
        let like = |pixel: &&[f32; 3]| (0..3).map(|c| pixel[c] - median[c]).sum::<f32>().abs() <= 3.0 * SAME;
        if given.is_none() && 2 * self.border.iter().filter(like).count() < self.border.len() {
            return Err(Error::invalid("the borders of the pictures do not show one even background").hint(
                "take pictures that show the medium before a black or an evenly lit background with some room around \
                 it, or state the background with ⟨background⟩",
            ));
        }
        let most = self.added.iter().copied().fold(0.0, f64::max);
        if most.max(self.taken) == 0.0 {
            return Err(Error::invalid("the pictures show nothing that differs from their background")
                .hint("give other pictures, or for videos another ⟨frame⟩"));
        }
        let light = self.added.iter().sum::<f64>() > self.taken;
        let black = median.iter().all(|v| *v <= BLACK);
        capture.model = if light { Model::EmissionAbsorption } else { Model::Absorption };
        capture.background = given.unwrap_or(if black { [0.0; 3] } else { median });
        // The medium is of one color: that of all its light.
        let color = self.added.map(|added| if light { (added / most) as f32 } else { 1.0 });
        capture.emission = color.map(|c| c * self.brightest.max(1.0));
        capture.emission_model = EmissionModel::Grey;
        capture.transfer = None;
        let [r, g, b] = capture.background;
        let (what, model) =
            if light { ("a light medium", "emission-absorption") } else { ("a dark medium", "absorption") };
        Ok(format!("the pictures show {what} before the background {r:.3},{g:.3},{b:.3}: the model is {model}"))
    }
}

/// Colors of the border of a picture, but for what is not finite.
fn border(film: &Film) -> Vec<[f32; 3]> {
    let (width, height) = (film.width, film.height);
    let edge = (width.min(height) / BORDER).max(1);
    let outer = |at: usize, end: usize| at < edge || at + edge >= end;
    let pixels = film.rgba.iter().enumerate().filter(|(i, _)| outer(i % width, width) || outer(i / width, height));
    pixels.map(|(_, [r, g, b, _])| [*r, *g, *b]).filter(|color| color.iter().all(|v| v.is_finite())).collect()
}

/// Median of each color; black of none.
fn median(colors: &[[f32; 3]]) -> [f32; 3] {
    let median = |mut values: Vec<f32>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
    };
    std::array::from_fn(|c| median(colors.iter().map(|color| color[c]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk of one color before another one, with an uneven last level of black.
    fn disk(color: f32, behind: f32) -> Film {
        let pixel = |i: usize| {
            let (x, y) = (i as i32 % 40 - 20, i as i32 / 40 - 20);
            let value = if x * x + y * y < 100 { color } else { behind + 0.0003 * (i % 2) as f32 };
            [value, value, value, 1.0]
        };
        Film::of(40, 40, (0..1600).map(pixel).collect())
    }

    fn stated(films: &[Film], given: Option<[f32; 3]>) -> Result<Capture> {
        let mut setting = Setting::default();
        films.iter().for_each(|film| setting.add(film));
        let mut capture = Capture::of_frames(Vec::new());
        setting.state(&mut capture, given)?;
        Ok(capture)
    }

    #[test]
    fn a_light_medium_emits_and_a_dark_one_absorbs() -> Result<()> {
        let light = stated(&[disk(0.8, 0.002)], None)?;
        assert_eq!((light.model, light.background), (Model::EmissionAbsorption, [0.0; 3]));
        let dark = stated(&[disk(0.2, 0.7)], None)?;
        assert!(dark.model == Model::Absorption && (dark.background[0] - 0.7).abs() < 1e-3, "{dark:?}");
        Ok(())
    }

    #[test]
    fn borders_of_many_colors_are_no_background() {
        let film = [Film::of(40, 40, (0..1600).map(|i| [(i % 40) as f32 / 40.0; 4]).collect())];
        assert!(stated(&film, None).is_err());
        assert!(stated(&film, Some([0.0; 3])).is_ok());
        assert!(stated(&[disk(0.1, 0.1)], None).is_err(), "nothing to see");
    }
}
