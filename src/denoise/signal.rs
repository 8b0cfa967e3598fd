//! Share of the residual that is signal.
//!
//! Several estimates of the [`noise`](super::noise) hold under different assumptions. Each alone can show that a
//! residual is more than noise: the frame's own, that of all frames so far, and that of smooth surroundings. That of
//! the nearest pixel takes the place of the frame's own where the frames around show another signal, and the
//! [least of the frames before](super::minimum) that of the nearest pixel where texture hides the noise from it. The
//! residual's [spectrum](super::spectrum) bounds them all.

use super::blocks::{Planes, Pool};
use super::lanes::{LANES, Lanes, between, each};
use super::minimum;
use super::noise::{
    ADDED, CHANCE, DIRECT, EXCESS, EXCESS_CHANCE, LIGHT, LIGHT_NEAREST, LIGHT_NOISE, NOISE, NOISE_POWER, PIXELS,
    RESIDUAL, RESIDUAL_POWER, SINCE,
};
use super::reprojection::noise_gain;
use super::spectrum::{Floor, NoiseSpectra, Powers, Spectrum};
use glam::Vec2;

/// Numbers that a block is solved for: the share of its residuals that is signal, and the mean square of its noise.
pub(crate) const SOLVED: usize = 2;
/// Blocks to each side over which sums are pooled.
pub(crate) const POOL: usize = 2;
/// Standard deviations of the noise's square that are added to it, so that chance seldom takes noise for signal: of a
/// frame alone, which tells sudden errors, and of all.
const DEVIATIONS: [f32; 2] = [1.25, 0.75];
/// Shares of noise in the residual, by a difference's own square, between which the other estimate takes over where one
/// side of time is known.
const ONE_SIDED: [f32; 2] = [0.25, 0.45];
/// Noise that second differences show, as a multiple: texture is more often taken for noise than noise for texture.
const AROUND: f32 = 1.25;
/// Noise as a multiple of what nearest pixels show at most. No filter of pixels makes neighbours as alike as texture is
/// that moves without a motion, and looks like noise from frame to frame.
const FARTHEST: f32 = 8.0;
/// Noise that the frames before show, on average and at least, as a multiple.
const EARLIER: f32 = 1.25;
/// Noise that nearest pixels show, as a multiple of that by the frames before and after, between which texture comes to
/// explain it, so that it tells no more.
const VAGUE: [f32; 2] = [1.25, 2.0];
/// Standard deviations of the noise's square by chance that are added to that of a frame before it counts as a minimum.
const CERTAIN: f32 = 2.0;
/// Noise that nearest pixels show, as a multiple at least.
const NEAREST: f32 = 1.1;
/// Standard deviations of the excess by chance from which on it shows another signal: where that is rare in a picture,
/// and where it is common.
const BEYOND: [f32; 2] = [2.0, 0.25];
/// Root mean squares of the excess over its deviation between which another signal comes to be common.
const COMMON: [f64; 2] = [1.0, 2.0];
/// Largest excess over its deviation that counts.
const MOST: f32 = 4.0;
/// Excess beyond its deviations by chance, as a share of the noise's square, from which on nothing but another signal
/// explains it.
const OTHER: f32 = 0.1;
/// Shares of the noise that lie where the frames show the same signal, between which calibration comes to count.
const FITTING: [f64; 2] = [0.05, 0.25];
/// Shares of the noise that lie where the frames seem to show the same signal, between which that ceases to be chance
/// in a picture where another signal is common.
const BY_CHANCE: [f64; 2] = [0.1, 0.3];
/// Shares of noise in the residual between which the frames before and after come to explain it.
const EXPLAINED: [f32; 2] = [0.8, 0.95];
/// Shares of the residual of a picture that is explained so, between which the spectrum of its noise comes to be known.
const KNOWN: [f64; 2] = [0.02, 0.2];
/// Shares of signal in the residual by the frames around, between which all of it comes to be given back: the little
/// noise in it costs less than texture that an estimate has missed.
const NEARLY_ALL: [f32; 2] = [0.5, 0.8];
/// Shares of signal in the residual by its spectrum, which bounds the noise from above, between which all of it comes
/// to be given back.
const BY_SPECTRUM: [f32; 2] = [0.15, 0.6];
/// Share of what resampling averages away of noise that counts as noise that neighbours share.
const SPREAD: f32 = 0.5;
/// Noise that is not known: as much as can be interpolated.
const UNKNOWN: f32 = 1e30;
/// Least residual, where there is none.
const LEAST: f32 = 1e-30;

/// Sums of eight neighbourhoods of blocks.
#[derive(Debug, Clone, Copy, Default)]
struct Pooled {
    /// Share of the variance of independent noise that resampling averages away.
    averaged: Lanes,
    /// Sums of the frame.
    noise: Lanes,
    direct: Lanes,
    residual: Lanes,
    chance: Lanes,
    excess: Lanes,
    light_noise: Lanes,
    light_nearest: Lanes,
    light: Lanes,
    /// Sums of all frames.
    noises: Lanes,
    residuals: Lanes,
    chances: Lanes,
    excesses: Lanes,
    excess_chances: Lanes,
    /// Mean square of the noise of the frames before, as a share of that of the residual; infinite where unknown.
    earlier: Lanes,
    /// Mean square of the noise of all frames; [`UNKNOWN`] where it is.
    power: Lanes,
    /// Count of the pixels of the frame that are known on both sides of time.
    pixels: Lanes,
    /// Least sum of noise of the frames before; infinite where unknown.
    minimum: Lanes,
    /// Share of the residual that is noise at most, by its spectrum.
    by_spectrum: Lanes,
}

impl Pooled {
    /// Calls `with` for each vector of a row of neighbourhoods.
    #[inline(always)]
    fn of_row(sums: &Planes, motions: &[Vec2], row: usize, pool: &mut Pool, mut with: impl FnMut(usize, &Self)) {
        const NOW: [usize; 8] = [NOISE, DIRECT, RESIDUAL, CHANCE, EXCESS, LIGHT_NOISE, LIGHT_NEAREST, LIGHT];
        const OF_ALL: [usize; 5] = [NOISE, RESIDUAL, CHANCE, EXCESS, EXCESS_CHANCE];
        const POWERS: [usize; 5] =
            [SINCE + NOISE_POWER, SINCE + PIXELS, ADDED + NOISE_POWER, ADDED + RESIDUAL_POWER, ADDED + PIXELS];
        let places = NOW.into_iter().chain(OF_ALL.map(|place| SINCE + place)).chain(POWERS);
        let (vectors, found) = pool.sums(sums, row, places.map(|plane| (plane, POOL)));
        for vector in 0..vectors {
            let of = |plane: usize| found[plane * vectors + vector];
            let [noise, direct, residual, chance, excess, light_noise, light_nearest, light] = each(of);
            let [noises, residuals, chances, excesses, excess_chances] = each(|plane| of(NOW.len() + plane));
            let [noise_power, pixels, own, residual_power, own_pixels] =
                each(|plane| of(NOW.len() + OF_ALL.len() + plane));
            let least = Lanes([LEAST; LANES]);
            let before = pixels - own_pixels - Lanes([1.0; LANES]);
            let known = before.max(Lanes::ZERO) * own_pixels;
            let earlier = (noise_power - own).max(Lanes::ZERO) * own_pixels / (before * residual_power).max(least);
            let earlier = known.select(earlier, Lanes([f32::INFINITY; LANES]));
            let at = row * sums.grid().columns + vector * LANES;
            let averaged = |lane: usize| motions.get(at + lane).map_or(0.0, |motion| 1.0 - noise_gain(*motion));
            let pooled = Self {
                averaged: Lanes(each(averaged)),
                noise,
                direct,
                residual,
                chance,
                excess,
                light_noise,
                light_nearest,
                light,
                noises,
                residuals,
                chances,
                excesses,
                excess_chances,
                earlier,
                power: pixels.select(noise_power.max(Lanes::ZERO) / pixels.max(least), Lanes([UNKNOWN; LANES])),
                pixels: own_pixels,
                minimum: Lanes([f32::INFINITY; LANES]),
                by_spectrum: Lanes([f32::INFINITY; LANES]),
            };
            with(vector, &pooled);
        }
    }

    /// Returns the excess of the frame and that of all frames, and how much they vary by chance.
    #[inline(always)]
    fn excess(&self) -> [[Lanes; 2]; 2] {
        // Where a frame is resampled, less is averaged away of noise that neighbours share.
        let beyond = |excess: Lanes, noise: Lanes| {
            let spread = noise * self.averaged * SPREAD;
            (excess - spread).max(Lanes::ZERO) + excess.min(Lanes::ZERO)
        };
        let by_chance = self.excess_chances.sqrt();
        let now = [beyond(self.excess, self.noise), by_chance.max(self.chance.sqrt() * DEVIATIONS[0])];
        [now, [beyond(self.excesses, self.noises), by_chance]]
    }

    /// Returns 1 where the frames before and after show another signal, 0 where noise explains how they differ, up to
    /// so many of the deviations by chance.
    #[inline(always)]
    fn other(&self, deviations: f32) -> Lanes {
        let [now, all] = self.excess();
        let other = |[excess, chance]: [Lanes; 2], noise: Lanes| {
            let beyond = excess.max(Lanes::ZERO - excess) - chance * deviations;
            (beyond / (noise.max(Lanes([LEAST; LANES])) * OTHER)).max(Lanes::ZERO).min(Lanes([1.0; LANES]))
        };
        other(now, self.noise).max(other(all, self.noises))
    }

    /// Returns the mean square by pixel that the noise of the frame has at most, as far as chance goes; infinite where
    /// it is not known on both sides of time. What frames around have lost together is none.
    #[inline(always)]
    fn most_noise(&self) -> Lanes {
        let one = Lanes([1.0; LANES]);
        let of_both = self.excess.min(Lanes::ZERO) / (one - self.averaged);
        let most = (self.noise + of_both + self.chance.sqrt() * CERTAIN).max(Lanes::ZERO) / self.pixels.max(one);
        self.pixels.select(most, Lanes([f32::INFINITY; LANES]))
    }

    /// Returns the share of the residuals that is signal. Nearest pixels show the noise by a factor, and count where
    /// the excess is beyond so many deviations, and by a share everywhere.
    #[inline(always)]
    fn signal(&self, factor: f32, deviations: f32, everywhere: f32) -> Lanes {
        let (one, least) = (Lanes([1.0; LANES]), Lanes([LEAST; LANES]));
        let residual = self.residual.max(least);
        let chance = self.chance.sqrt() * DEVIATIONS[0];
        let product = (self.noise + chance) / residual;
        // A difference's own square holds half of the noise of a single bright pixel, but less of what resampling
        // misses.
        let square = ((self.direct + (chance * 0.25).min(self.direct)) / residual).min(product);
        let part = between(square, ONE_SIDED);
        let now = square + (product - square) * part;
        let nearest = self.light_nearest / self.light.max(least);
        let near = nearest * factor;
        // Where texture hides the noise from nearest pixels, frames before tell it that lost none of the texture.
        let vague = between(near / now.max(least), VAGUE);
        let near = near + (near.min(self.minimum * EARLIER / residual) - near) * vague;
        let most = vague.select(near, nearest * FARTHEST).min(nearest * FARTHEST);
        let other = self.other(deviations).max(Lanes([everywhere; LANES]));
        let now = now + (now.min(near) - now) * other;
        // A frame that differs from both around, which are alike, has more noise or shows something else. More noise
        // shows in the nearest pixel, too.
        let now = now.min(near.max(self.earlier * EARLIER));
        // Frames before and after that are more alike than their noise allows have lost the same texture, and the
        // difference between them is that of their noise; or this frame has more noise than they, which shows around.
        let deviation = self.chances.sqrt() * DEVIATIONS[1];
        let since = |noises: Lanes| self.residuals.select((noises + deviation) / self.residuals.max(least), one);
        let of_both = self.excesses.min(Lanes::ZERO) / (one - self.averaged);
        let alike = since((self.noises + of_both).max(Lanes::ZERO)).max(near);
        let since = since(self.noises).min(alike);
        let around = self.light_noise * AROUND / self.light.max(least);
        // Numbers that are none lose every comparison.
        let by_frames = (one - now.min(since).min(around).min(most)).max(Lanes::ZERO).min(one);
        let signal = by_frames.max(between(by_frames, NEARLY_ALL)).max(between(one - self.by_spectrum, BY_SPECTRUM));
        // Small shares are more often chance than signal.
        signal * signal * (Lanes([3.0; LANES]) - signal * 2.0)
    }
}

/// Sums over whole pictures that calibrate the noise by the nearest pixel against that by the frames before and after,
/// and tell how common it is that those frames show another signal.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Calibration {
    /// Sums of the noise's square by both estimates where the frames show the same signal. Neighbours that are alike,
    /// by a filter or because noise takes few values, show too little.
    by_time: f64,
    nearest: f64,
    /// Sum of the square that nearest pixels show everywhere.
    everywhere: f64,
    /// Sum of the squares of excesses over their deviations, and count of neighbourhoods.
    squares: f64,
    count: f64,
    /// Sums of the powers of residuals that the frames before and after explain as noise, of these residuals, and of
    /// all.
    powers: Powers<f64>,
    explained: f64,
    all: f64,
    /// Sums of the blocks that are the least of their neighbourhoods.
    floor: Floor,
}

impl Calibration {
    /// Returns a share of this one and another together.
    pub(crate) fn plus_share(self, share: f64, other: Self) -> Self {
        Self {
            by_time: share * self.by_time + other.by_time,
            nearest: share * self.nearest + other.nearest,
            everywhere: share * self.everywhere + other.everywhere,
            squares: share * self.squares + other.squares,
            count: share * self.count + other.count,
            powers: each(|i| share * self.powers[i] + other.powers[i]),
            explained: share * self.explained + other.explained,
            all: share * self.all + other.all,
            floor: self.floor.plus_share(share, &other.floor),
        }
    }

    /// Returns 1 where another signal is common in the picture, and 0 where it is rare.
    fn common(&self) -> f64 {
        let [rare, common] = COMMON;
        let share = (((self.squares / self.count).sqrt() - rare) / (common - rare)).clamp(0.0, 1.0);
        // Of nothing it is not a number.
        if share > 0.0 { share } else { 0.0 }
    }

    /// Returns the deviations from which on an excess shows another signal.
    fn deviations(&self) -> f32 {
        BEYOND[0] + (BEYOND[1] - BEYOND[0]) * self.common() as f32
    }

    /// Returns 1 where the frames show another signal nearly everywhere, so that where they seem to show the same it is
    /// chance.
    fn everywhere_other(&self) -> f32 {
        let [few, most] = BY_CHANCE;
        let share = ((most - self.nearest / self.everywhere) / (most - few)).clamp(0.0, 1.0) * self.common();
        // Of nothing it is not a number.
        if share > 0.0 { share as f32 } else { 0.0 }
    }

    /// Returns the spectra that the noise in residuals may have, of colors that an alpha `guided`, or none.
    pub(crate) fn noise_spectra(&self, guided: bool) -> NoiseSpectra {
        let [few, most] = KNOWN;
        // Of nothing the ratio is not a number, and nothing is known.
        let known = ((self.explained / self.all - few) / (most - few)).clamp(0.0, 1.0);
        let powers = self.powers.map(|power| power / self.explained);
        // Where an alpha guides, means are over so many pixels that what is left has the spectrum of the noise.
        let less = if guided { 0.0 } else { 1.0 };
        NoiseSpectra::new(powers, known, self.floor.shared(less), less)
    }

    /// Returns the noise as a multiple of what nearest pixels show.
    fn factor(&self) -> f32 {
        let [few, most] = FITTING;
        let weight = ((self.nearest / self.everywhere - few) / (most - few)).clamp(0.0, 1.0);
        // Of nothing the ratio is not a number, and loses.
        NEAREST.max((self.by_time / self.nearest).powf(weight) as f32)
    }
}

/// Calibrates by a row of neighbourhoods.
pub(crate) struct Calibrate<'a> {
    /// Sums of noise, and of spectra.
    pub sums: &'a Planes,
    pub spectra: &'a Planes,
    /// Mean motions of the blocks.
    pub motions: &'a [Vec2],
    pub row: usize,
    pub pool: &'a mut Pool,
}

impl Calibrate<'_> {
    /// Rows and columns of neighbourhoods of which one is taken, so that none are taken twice.
    pub(crate) const STEP: usize = 2 * POOL + 1;
}

impl pulp::NullaryFnOnce for Calibrate<'_> {
    type Output = Calibration;

    #[inline(always)]
    fn call(self) -> Calibration {
        let Self { sums, spectra, motions, row, pool } = self;
        let mut found = Calibration { floor: Floor::of_row(spectra, row, POOL), ..Calibration::default() };
        let spectra = Spectrum::of_row(spectra, row, POOL, pool);
        Pooled::of_row(sums, motions, row, pool, |vector, sums| {
            let least = Lanes([LEAST; LANES]);
            let share = (sums.noises / sums.residuals.max(least)).min(sums.noise / sums.residual.max(least));
            let explained = between(share, EXPLAINED) * sums.residual * (Lanes([1.0; LANES]) - spectra[vector].alone);
            let same = Lanes([1.0; LANES]) - sums.other(BEYOND[1]);
            let by_time = sums.light * sums.noises / sums.residuals.max(Lanes([LEAST; LANES])) * same;
            let all = sums.residuals.select(sums.light_nearest, Lanes::ZERO);
            let nearest = all * same;
            let [now, of_all] = sums.excess();
            let [excess, chance]: [Lanes; 2] = each(|i| of_all[1].select(of_all[i], now[i]));
            for lane in (0..LANES).filter(|lane| (vector * LANES + lane) % Self::STEP == POOL) {
                found.by_time += f64::from(by_time.0[lane]);
                found.nearest += f64::from(nearest.0[lane]);
                found.everywhere += f64::from(all.0[lane]);
                let explained = explained.0[lane];
                let powers: Powers<f64> = each(|i| f64::from(explained * spectra[vector].powers[i].0[lane]));
                if powers.iter().all(|power| power.is_finite()) {
                    found.powers = each(|i| found.powers[i] + powers[i]);
                    found.explained += f64::from(explained);
                    found.all += f64::from(sums.residual.0[lane]);
                }
                if chance.0[lane] > 0.0 {
                    found.squares += f64::from((excess.0[lane].abs() / chance.0[lane]).min(MOST)).powi(2);
                    found.count += 1.0;
                }
            }
        });
        found
    }
}

/// Solves for the shares of a row of blocks.
pub(crate) struct Solve<'a> {
    /// Sums of noise, and of spectra.
    pub sums: &'a Planes,
    pub spectra: &'a Planes,
    /// Mean motions of the blocks.
    pub motions: &'a [Vec2],
    pub row: usize,
    pub pool: &'a mut Pool,
    pub calibration: Calibration,
    /// Spectra that noise may have.
    pub noise: NoiseSpectra,
    /// Least noise of the frames before.
    pub before: &'a Planes,
    /// Where that with this frame goes.
    pub minima: &'a mut [f32],
    /// Where they go, plane after plane.
    pub to: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, spectra, motions, row, pool, calibration, noise, before, minima, to } = self;
        let spectra = Spectrum::of_row(spectra, row, POOL, pool);
        let (shares, powers) = to.split_at_mut(to.len() / SOLVED);
        let (factor, deviations, everywhere) =
            (calibration.factor(), calibration.deviations(), calibration.everywhere_other());
        Pooled::of_row(sums, motions, row, pool, |vector, sums| {
            let moved = minimum::moved(before, motions, row, vector);
            minimum::next(moved, sums.most_noise()).store(minima, vector * LANES);
            let minimum = moved * minimum::pixels(before.grid(), POOL, row, vector);
            let sums = Pooled { minimum, by_spectrum: spectra[vector].most_noise(&noise), ..*sums };
            sums.signal(factor, deviations, everywhere).store(shares, vector * LANES);
            sums.power.store(powers, vector * LANES);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(value: f32) -> Lanes {
        Lanes([value; LANES])
    }

    /// Neighbourhoods of noise of a variance that comes in, a residual that holds it and an error, and nearest pixels
    /// that show the noise.
    fn pooled(noise: f32, error: f32) -> Pooled {
        let light = 3.0 * (noise + error);
        Pooled {
            noise: all(noise),
            direct: all(noise),
            residual: all(noise + error),
            light_noise: all(light),
            light_nearest: all(3.0 * noise),
            light: all(light),
            noises: all(noise),
            residuals: all(noise + error),
            chances: all(1e-6),
            excess_chances: all(1e-6),
            earlier: all(f32::INFINITY),
            minimum: all(f32::INFINITY),
            by_spectrum: all(f32::INFINITY),
            power: all(noise),
            ..Pooled::default()
        }
    }

    /// Where frames show another signal, by more difference than noise explains or by less, what they show counts as
    /// noise no more, and the nearest pixel tells it. Where they show the same, the nearest pixel counts for nothing.
    #[test]
    fn nearest_pixels_tell_the_noise_of_other_signals() {
        let signal = |pooled: Pooled| pooled.signal(1.0, 1.0, 0.0).0[0];
        let right = pooled(4.0, 6.0);
        assert!((signal(right) - 0.648).abs() < 1e-3, "{}", signal(right));
        assert_eq!(signal(pooled(1.0, 9.0)), 1.0);
        // Products take the error for noise.
        let fooled = Pooled { noise: all(5.0), direct: all(5.0), noises: all(5.0), ..pooled(1.0, 4.0) };
        assert_eq!(signal(fooled), 0.0);
        for excess in [2.5, -2.5] {
            let now = Pooled { excess: all(excess), ..fooled };
            assert!(signal(now) > 0.85, "{excess}: {}", signal(now));
        }
        let since = Pooled { excesses: all(-4.5), ..fooled };
        assert!(signal(since) > 0.85, "{}", signal(since));
        // A frame of more noise than those around, which its pixels show.
        let noisy = Pooled { excesses: all(-9.0), excess: all(-9.0), ..pooled(10.0, 0.1) };
        assert!(signal(noisy) < 0.01, "{}", signal(noisy));
        // One that has no more noise than those before has another signal.
        let odd = Pooled { earlier: all(0.1), ..fooled };
        assert!(signal(odd) > 0.85, "{}", signal(odd));
        assert!(signal(Pooled { light_nearest: all(15.0), ..odd }) < 0.01);
        // Where the frames hardly ever show the same signal, it is chance that they seem to.
        assert!(fooled.signal(1.0, 1.0, 1.0).0[0] > 0.85);
        // Frames before that showed less noise tell of texture, which hides it from nearest pixels.
        let hidden = Pooled { light_nearest: all(90.0), ..fooled };
        assert_eq!(signal(hidden), 0.0);
        assert!(signal(Pooled { minimum: all(0.5), ..hidden }) > 0.85);
        assert_eq!(signal(Pooled { minimum: all(0.5), ..pooled(1.0, 0.1) }), signal(pooled(1.0, 0.1)));
        // What its spectrum shows to be no noise comes back, whatever else takes it for noise.
        let of_spectrum = |most: f32| signal(Pooled { by_spectrum: all(most), ..fooled });
        assert_eq!([of_spectrum(0.9), of_spectrum(f32::NAN), of_spectrum(0.4)], [0.0, 0.0, 1.0]);
        // Noise that neighbours share, as far as filters of pixels make them, and more than that.
        let shared = |nearest: f32| signal(Pooled { light_nearest: all(nearest), ..pooled(1.0, 0.01) });
        assert!(shared(0.6) < 0.01 && shared(0.0) == 1.0, "{} {}", shared(0.6), shared(0.0));
    }

    /// Excesses of resampled noise that neighbours share show no other signal.
    #[test]
    fn noise_that_neighbours_share_is_no_other_signal() {
        let of = |excess: f32, averaged: f32| {
            Pooled { excesses: all(excess), averaged: all(averaged), ..pooled(1.0, 0.0) }.other(1.0).0[0]
        };
        assert_eq!([of(0.2, 0.0), of(0.2, 0.5), of(-0.2, 0.5), of(0.0, 0.0)], [1.0, 0.0, 1.0, 0.0]);
    }

    /// Neighbours that show too little noise are calibrated where enough of the picture fits, and the test is less
    /// strict where much of it does not.
    #[test]
    fn pictures_calibrate() {
        let found = Calibration {
            by_time: 4.0,
            nearest: 1.0,
            everywhere: 2.0,
            squares: 0.5,
            count: 2.0,
            ..Calibration::default()
        };
        assert_eq!([found.factor(), found.deviations()], [4.0, BEYOND[0]]);
        let other = Calibration { everywhere: 100.0, squares: 8.0, ..found };
        assert_eq!([other.factor(), other.deviations()], [NEAREST, BEYOND[1]]);
        assert_eq!([found.everywhere_other(), other.everywhere_other()], [0.0, 1.0]);
        assert_eq!(Calibration::default().everywhere_other(), 0.0);
        assert_eq!([Calibration::default().factor(), Calibration::default().deviations()], [NEAREST, BEYOND[0]]);
        let [sum, half] = [1.0, 0.5].map(|share| found.plus_share(share, other));
        assert_eq!([sum.by_time, half.by_time, half.count], [8.0, 6.0, 3.0]);
    }

    /// The spectrum of noise is that of residuals which the frames around explain, where they explain enough of them.
    #[test]
    fn explained_residuals_have_the_spectrum_of_noise() {
        let of = |explained: f64| Calibration {
            powers: each(|i| explained * (0.5 + 0.1 * i as f64)),
            explained,
            all: 10.0,
            ..Calibration::default()
        };
        let unknown = NoiseSpectra::new(Powers::default(), 0.0, 1.0, 1.0);
        assert_eq!([Calibration::default(), of(0.2)].map(|found| found.noise_spectra(false)), [unknown; 2]);
        let powers = each(|i| 0.5 + 0.1 * i as f64);
        assert_eq!(of(4.0).noise_spectra(false), NoiseSpectra::new(powers, 1.0, 1.0, 1.0));
        // Where an alpha guides, pixels that no other frame shows have lost no mean over few pixels.
        let guided = of(4.0).noise_spectra(true);
        assert!(guided == NoiseSpectra::new(powers, 1.0, 1.0, 0.0) && guided != of(4.0).noise_spectra(false));
    }
}
