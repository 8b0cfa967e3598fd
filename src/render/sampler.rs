//! Random numbers of paths, keyed by seed, pixel and sample: any sample of any pixel can be drawn alone, so that
//! pictures do not depend on the order in which threads, tiles or a resumed run compute them.
//!
//! The numbers that matter most come in sets of four from an Owen-scrambled Sobol sequence (Burley 2020), scrambled by
//! pixel, which covers a pixel's samples evenly; the rest are independent.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// Numbers of one sample of one pixel.
#[derive(Debug, Clone)]
pub struct Sampler {
    independent: Pcg32,
    /// Index in the Sobol sequence, and the scramble of its pixel.
    index: u32,
    scramble: u32,
    /// Sets of four drawn so far.
    sets: u32,
}

/// Samples of a Sobol sequence before another one begins, and the number of its sets of four.
const SEQUENCE: u32 = 1 << 16;
const SETS: u32 = sobol_burley::NUM_DIMENSION_SETS_4D;

/// Mixes 64 bits (the finaliser of SplitMix64; Steele, Lea & Flood 2014).
fn mixed(v: u64) -> u64 {
    let v = (v ^ (v >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let v = (v ^ (v >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    v ^ (v >> 31)
}

impl Sampler {
    /// Creates the numbers of a sample of the pixel in column x and row y.
    pub fn new(seed: u64, [x, y]: [usize; 2], sample: u32) -> Self {
        let golden = 0x9E37_79B9_7F4A_7C15_u64;
        let pixel = mixed(mixed(seed.wrapping_add(golden)) ^ ((y as u64) << 32 | x as u64));
        let of_sample = mixed(pixel.wrapping_add(golden.wrapping_mul(u64::from(sample) + 1)));
        let sequence = mixed(pixel ^ u64::from(sample / SEQUENCE).wrapping_mul(golden));
        Self {
            independent: Pcg32::new(of_sample, mixed(of_sample ^ golden)),
            index: sample % SEQUENCE,
            scramble: (sequence >> 32) as u32,
            sets: 0,
        }
    }

    /// Returns the next four numbers in [0, 1) that are even over the samples of a pixel.
    #[inline]
    pub(crate) fn stratified(&mut self) -> [f64; 4] {
        if self.sets == SETS {
            return std::array::from_fn(|_| self.uniform());
        }
        self.sets += 1;
        sobol_burley::sample_4d(self.index, self.sets - 1, self.scramble).map(f64::from)
    }

    /// Leaves out the next four numbers that are even over the samples of a pixel, without computing them.
    #[inline(always)]
    pub(crate) fn skip_stratified(&mut self) {
        self.sets = SETS.min(self.sets + 1);
    }

    /// Returns the numbers of a second path of the same sample, independent of those of this one from here on.
    pub(crate) fn second(&self) -> Self {
        let golden = 0x9E37_79B9_7F4A_7C15_u64;
        let key = mixed(u64::from(self.scramble).wrapping_add(golden));
        let mut independent = self.independent.clone();
        let own = u64::from(independent.next_u32()) << 32 | u64::from(independent.next_u32());
        Self {
            independent: Pcg32::new(mixed(own), mixed(own ^ golden)),
            index: self.index,
            scramble: (key >> 32) as u32,
            sets: self.sets,
        }
    }

    /// Returns an independent number in (0, 1).
    #[inline(always)]
    pub fn uniform(&mut self) -> f64 {
        (f64::from(self.independent.next_u32()) + 0.5) * (1.0 / 4_294_967_296.0)
    }

    /// Returns an independent number with the density `e^{-x}`.
    #[inline(always)]
    pub fn exponential(&mut self) -> f32 {
        // Single precision keeps small numbers, of which the large results are made.
        -((self.independent.next_u32() as f32 + 0.5) * (1.0 / 4_294_967_296.0)).min(1.0).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(numbers: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = numbers.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        sum / count
    }

    #[test]
    fn numbers_depend_on_seed_pixel_and_sample_alone() {
        let first = |seed, pixel, sample| {
            let mut sampler = Sampler::new(seed, pixel, sample);
            (sampler.stratified(), sampler.uniform())
        };
        let one = first(1, [2, 3], 4);
        assert_eq!(one, first(1, [2, 3], 4));
        for other in [first(2, [2, 3], 4), first(1, [3, 2], 4), first(1, [2, 3], 5), first(1, [2, 3], 4 + SEQUENCE)] {
            assert!(one.0 != other.0 && one.1 != other.1, "{one:?} {other:?}");
        }
    }

    #[test]
    fn what_is_left_out_is_not_drawn_later() {
        for count in 1..=SETS {
            let (mut drawn, mut left_out) = (Sampler::new(5, [1, 2], 3), Sampler::new(5, [1, 2], 3));
            for _ in 0..count {
                drawn.stratified();
                left_out.skip_stratified();
            }
            assert_eq!(drawn.stratified(), left_out.stratified(), "{count}");
        }
    }

    /// Moments of the uniform and the exponential distribution, within five standard deviations.
    #[test]
    fn numbers_have_their_distributions() {
        let draws = 200_000;
        let all = |draw: fn(&mut Sampler) -> f64| {
            move |power: i32| mean((0..draws).map(|i| draw(&mut Sampler::new(7, [i % 100, i / 100], 3)).powi(power)))
        };
        let near = |value: f64, expected: f64, deviation: f64| {
            assert!((value - expected).abs() < 5.0 * deviation / f64::from(draws as u32).sqrt(), "{value} {expected}");
        };
        for draw in [Sampler::uniform, |s: &mut Sampler| s.stratified()[3]] {
            near(all(draw)(1), 0.5, 0.3);
            near(all(draw)(2), 1.0 / 3.0, 0.3);
        }
        let exponential = all(|s| s.exponential().into());
        near(exponential(1), 1.0, 1.0);
        near(exponential(2), 2.0, 20.0_f64.sqrt());
    }

    /// A pixel's even numbers leave no stratum of a power of two empty.
    #[test]
    fn even_numbers_are_even() {
        for set in 0..3 {
            for dimension in 0..4 {
                let mut seen = [false; 64];
                for sample in 0..64 {
                    let mut sampler = Sampler::new(5, [9, 9], sample);
                    let numbers = (0..=set).map(|_| sampler.stratified()).last().unwrap_or_default();
                    seen[(64.0 * numbers[dimension]) as usize] = true;
                }
                assert!(seen.iter().all(|s| *s), "{set} {dimension}");
            }
        }
    }
}
