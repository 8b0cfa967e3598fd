//! How long a reconstruction takes on several machines that share its passes over rays by [`ranks`](crate::ranks).
//!
//! The model is a simulation of events, each at the time at which all that it waits for is there: the threads of a
//! machine take up the partitions of rays that are its share; all machines exchange the sums of the pass; the totals of
//! the voxels go from machine to machine in pieces, each of which waits for the one before it and for the machine that
//! adds to it; the last machine gives them to all along a binary tree. What every machine does for itself (reading
//! pictures, the region, the vectors of the solver) takes as long on many machines as on one. Random delays make the
//! others wait for the slowest machine.

use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Machines of one kind and the network between them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cluster {
    /// Threads of each machine.
    pub threads: usize,
    /// Bandwidth of a machine's connection in each direction, in bytes per second.
    pub bandwidth: f64,
    /// Time in seconds that a message takes beside that of its bytes.
    pub latency: f64,
    /// Part of the time of a partition, and of what a machine does for itself between two meetings of all, that varies:
    /// it is exponentially distributed, and its mean is this part of the whole.
    pub delay: f64,
}

/// A pass over the rays of a level or of a probe, and what each machine does for itself before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    /// Number of such passes.
    pub count: f64,
    /// Seconds of one thread for the rays of all partitions.
    pub rays: f64,
    /// Seconds of one machine to clear the sums of all partitions and to add them.
    pub sums: f64,
    /// Seconds of one machine for what all machines do alike between two passes.
    pub alone: f64,
    /// Partitions of the rays.
    pub partitions: usize,
    /// Bytes of the totals that all machines are given; 0 where a pass has only a few sums.
    pub bytes: f64,
}

/// Time of a reconstruction on a number of machines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Scaled {
    /// Number of machines, each with one process.
    pub machines: u32,
    /// Expected wall time in seconds.
    pub seconds: f64,
    /// Time on one machine over the machines' times together, 0 to 1.
    pub efficiency: f64,
}

/// Bytes of a piece of the totals: 512 blocks of 9³ numbers, as [`ranks`](crate::ranks) sends them.
const PIECE: f64 = 512.0 * 729.0 * 4.0;
/// Passes of a kind that are simulated, each with delays of its own.
const SIMULATED: u64 = 12;
/// Children of a machine in the tree along which totals are given to all.
const CHILDREN: usize = 2;

impl Cluster {
    /// Returns the time on each number of machines of a reconstruction with `alone` seconds outside of its passes.
    pub fn scaled(&self, machines: &[u32], alone: f64, passes: &[Pass]) -> Vec<Scaled> {
        let one = self.seconds(1, alone, passes);
        let on = |machines: &u32| {
            let seconds = if *machines == 1 { one } else { self.seconds(*machines as usize, alone, passes) };
            Scaled { machines: *machines, seconds, efficiency: one / (f64::from(*machines) * seconds) }
        };
        machines.iter().map(on).collect()
    }

    /// Returns the number of machines beyond which no pass has threads to do: its partitions over the threads of one.
    pub fn useful_machines(&self, passes: &[Pass]) -> u32 {
        let most = passes.iter().map(|pass| pass.partitions.div_ceil(self.threads.max(1))).max();
        most.unwrap_or(1).max(1) as u32
    }

    /// Returns the expected wall time on so many machines.
    fn seconds(&self, machines: usize, alone: f64, passes: &[Pass]) -> f64 {
        let mut delays = Delays { state: machines as u64, mean: self.delay };
        // All machines meet in the first pass, and the first one writes.
        let before = alone * slowest((0..machines).map(|_| delays.next()));
        passes.iter().filter(|pass| pass.count > 0.0).fold(before, |sum, pass| {
            let all: f64 = (0..SIMULATED).map(|_| self.pass(machines, pass, &mut delays)).sum();
            sum + pass.count * all / SIMULATED as f64
        })
    }

    /// Simulates one pass and returns the time at which the last machine has its totals.
    fn pass(&self, machines: usize, pass: &Pass, delays: &mut Delays) -> f64 {
        let share = |rank: usize| {
            let first = |rank: usize| (rank * pass.partitions).div_ceil(machines);
            first(rank + 1) - first(rank)
        };
        let of_partition = |seconds: f64| seconds / pass.partitions.max(1) as f64;
        let mut ready = Vec::with_capacity(machines);
        for rank in 0..machines {
            let alone = pass.alone * delays.next();
            let rays = (0..share(rank)).map(|_| of_partition(pass.rays) * delays.next());
            ready.push(alone + self.listed(rays));
        }
        if machines == 1 {
            return ready[0] + pass.sums;
        }
        // Each machine that has partitions gives their sums to all, in turn.
        let met =
            slowest(ready.into_iter()) + self.latency * (machines.min(pass.partitions) * depth(machines, 2)) as f64;
        let pieces = (pass.bytes / PIECE).ceil() as usize;
        let added = |rank: usize| of_partition(pass.sums) * share(rank) as f64 / pieces.max(1) as f64;
        if pieces == 0 {
            return met + (0..machines).map(added).fold(0.0, f64::max);
        }
        self.given_to_all(self.chained(met, pieces, (0..machines).map(added).collect()), pieces)
    }

    /// Returns the time after which threads have done pieces of work of so many seconds each, taken up in turn by
    /// the first thread that is free.
    fn listed(&self, work: impl Iterator<Item = f64>) -> f64 {
        // Times are not negative, so that their bits are in their order.
        let mut free: BinaryHeap<Reverse<u64>> = (0..self.threads.max(1)).map(|_| Reverse(0)).collect();
        let mut last = 0.0_f64;
        for seconds in work {
            let Some(Reverse(begun)) = free.pop() else { break };
            let done = f64::from_bits(begun) + seconds;
            free.push(Reverse(done.to_bits()));
            last = last.max(done);
        }
        last
    }

    /// Returns the times at which each machine has sent its last piece, the last machine has it: from `begun` on, piece
    /// after piece goes from machine to machine, and each takes `added` seconds to add to it. A message is sent once
    /// its receiver waits for it, and neither does anything else meanwhile.
    fn chained(&self, begun: f64, pieces: usize, added: Vec<f64>) -> Vec<f64> {
        let message = self.latency + PIECE / self.bandwidth;
        let mut free = vec![begun; added.len()];
        for _ in 0..pieces {
            let mut there = free[0] + added[0];
            for rank in 1..added.len() {
                let arrived = there.max(free[rank]) + message;
                free[rank - 1] = arrived;
                there = arrived + added[rank];
            }
            if let Some(last) = free.last_mut() {
                *last = there;
            }
        }
        free
    }

    /// Returns the time at which all machines have all pieces, which the last one gives to the others: each machine
    /// hands a piece on to its children in the tree, one after the other, while it receives the next one.
    fn given_to_all(&self, mut free: Vec<f64>, pieces: usize) -> f64 {
        let wire = PIECE / self.bandwidth;
        // From the last machine on, which is the root.
        free.reverse();
        // When a machine's connection has sent all that it was given so far.
        let mut sent = free.clone();
        let mut last = free[0];
        for _ in 0..pieces {
            let mut there = vec![free[0]; free.len()];
            for rank in 1..free.len() {
                let parent = (rank - 1) / CHILDREN;
                sent[parent] = sent[parent].max(there[parent]) + wire;
                there[rank] = (sent[parent] + self.latency).max(free[rank]);
                last = last.max(there[rank]);
            }
        }
        last
    }
}

/// Delays of machines by random numbers that are the same in each run.
struct Delays {
    state: u64,
    mean: f64,
}

impl Delays {
    /// Returns the factor by which work takes longer or shorter this time; its mean is 1.
    fn next(&mut self) -> f64 {
        // SplitMix64 (Steele, Lea & Flood 2014).
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let v = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let v = (v ^ (v >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let uniform = ((v ^ (v >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        1.0 - self.mean * (1.0 + (1.0 - uniform).ln())
    }
}

fn slowest(times: impl Iterator<Item = f64>) -> f64 {
    times.fold(0.0, f64::max)
}

/// Returns the levels below the root of a tree of so many machines with so many children each.
fn depth(machines: usize, children: usize) -> usize {
    let (mut reached, mut width, mut depth) = (1, 1, 0);
    while reached < machines {
        width *= children;
        reached += width;
        depth += 1;
    }
    depth
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDEAL: Cluster = Cluster { threads: 1, bandwidth: f64::INFINITY, latency: 0.0, delay: 0.0 };
    const RAYS: Pass = Pass { count: 3.0, rays: 16.0, sums: 0.0, alone: 0.0, partitions: 16, bytes: 4e7 };

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-9 * b.abs().max(1e-9)
    }

    /// Without a network and delays the fullest machine decides, and within it the rounds of its threads.
    #[test]
    fn partitions_are_what_machines_share() {
        for threads in [1_usize, 2, 5] {
            for machines in [1_u32, 2, 3, 5, 8, 16, 40] {
                let rounds = 16_usize.div_ceil(machines as usize).div_ceil(threads) as f64;
                let scaled = Cluster { threads, ..IDEAL }.scaled(&[1, machines], 0.0, &[RAYS]);
                let one = 3.0 * 16_usize.div_ceil(threads) as f64;
                assert!(near(scaled[0].seconds, one), "{scaled:?}");
                assert!(near(scaled[1].seconds, 3.0 * rounds), "{threads} {scaled:?}");
                assert!(near(scaled[1].efficiency, one / (3.0 * rounds * f64::from(machines))), "{scaled:?}");
            }
            assert_eq!(Cluster { threads, ..IDEAL }.useful_machines(&[RAYS]), 16_u32.div_ceil(threads as u32));
        }
    }

    /// Amdahl's law: what is not shared stays.
    #[test]
    fn what_every_machine_does_is_no_faster_on_many() {
        let pass = Pass { alone: 1.0, ..RAYS };
        let scaled = IDEAL.scaled(&[1, 4, 16], 7.0, &[pass]);
        let seconds: Vec<f64> = scaled.iter().map(|s| s.seconds).collect();
        assert!(near(seconds[0], 7.0 + 3.0 * 17.0) && near(seconds[1], 7.0 + 3.0 * 5.0), "{seconds:?}");
        assert!(near(seconds[2], 7.0 + 3.0 * 2.0), "{seconds:?}");
    }

    /// Of two machines every piece crosses the network to the second one, then back, where latencies overlap; of more,
    /// a machine sends a piece only after it has received it, so that each takes two messages.
    #[test]
    fn pieces_follow_one_another() {
        let network = Cluster { bandwidth: PIECE, latency: 0.5, ..IDEAL };
        let bytes = 6.0 * PIECE;
        let pass = Pass { count: 1.0, rays: 0.0, bytes, ..RAYS };
        let met = |machines: f64, depth: f64| 0.5 * machines * depth;
        let seconds = |machines| network.seconds(machines, 0.0, &[pass]);
        assert!(near(seconds(2), met(2.0, 1.0) + 6.0 * 1.5 + 6.0 + 0.5), "{}", seconds(2));
        let chain = 1.5 * (2.0 + 2.0 * 5.0);
        assert!(near(seconds(3), met(3.0, 1.0) + chain + 6.0 * 2.0 + 0.5), "{}", seconds(3));
        // Adding takes its time once a piece, however the partitions are shared, and clearing goes with it.
        let adding = Pass { sums: 16.0 * 6.0, ..pass };
        let both = Cluster { bandwidth: f64::INFINITY, latency: 0.0, ..network }.seconds(2, 0.0, &[adding]);
        assert!(near(both, 8.0 + 6.0 * 8.0), "{both}");
    }

    /// The largest of n numbers that are exponentially distributed is their mean times the nth harmonic number.
    #[test]
    fn all_wait_for_the_slowest() {
        let pass = Pass { count: 1.0, rays: 0.0, alone: 1.0, bytes: 0.0, ..RAYS };
        let slow = Cluster { delay: 0.1, ..IDEAL };
        let mean = |machines: usize| {
            let mut delays = Delays { state: 5, mean: 0.1 };
            (0..2000).map(|_| slow.pass(machines, &pass, &mut delays)).sum::<f64>() / 2000.0
        };
        let harmonic = |n: usize| (1..=n).map(|k| 1.0 / k as f64).sum::<f64>();
        for machines in [1, 4, 16] {
            let expected = 0.9 + 0.1 * harmonic(machines);
            // Five standard deviations of the mean of 2000, of 0.1 π / √6 at most.
            assert!((mean(machines) - expected).abs() < 5.0 * 0.13 / 2000_f64.sqrt(), "{machines} {}", mean(machines));
        }
        assert_eq!(slow.scaled(&[8], 1.0, &[pass]), slow.scaled(&[8], 1.0, &[pass]));
    }
}
