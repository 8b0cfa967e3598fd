//! Damaged inputs: sound files to begin with, damage to them, and the program run on what comes out.

pub mod corpus;
pub mod mutate;
pub mod references;
pub mod trial;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The random numbers of one case. They depend on the seed and the case's number alone, so that a case can be
/// repeated by itself and any number of workers sees the same cases.
pub struct Dice(ChaCha8Rng);

impl Dice {
    pub fn new(seed: u64, case: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(case);
        Self(random)
    }

    /// A number from 0 up to and without `n`.
    pub fn below(&mut self, n: usize) -> usize {
        // The bias of the remainder is below n / 2⁶⁴.
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    pub fn choose<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }

    pub fn bytes(&mut self, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.0.next_u64() as u8).collect()
    }
}
