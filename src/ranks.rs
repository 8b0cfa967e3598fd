//! Processes that share the passes over rays of one computation, as they run on the nodes of a cluster.
//!
//! All of them have all inputs and do the same, but for sums over partitions of rays: each computes partitions of its
//! own, and all are added in the order in which one process adds them. Results have the same bits for any number of
//! processes.

use bytemuck::Pod;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// Messages between the processes of a computation, which are numbered from 0 (MPI's ranks).
pub trait Messages: Send + Sync {
    /// Number of this process.
    fn rank(&self) -> usize;
    /// Number of processes.
    fn count(&self) -> usize;
    /// Sends bytes to a process, which receives as many.
    fn send(&self, to: usize, bytes: &[u8]);
    /// Receives the bytes that a process sends.
    fn receive(&self, from: usize, bytes: &mut [u8]);
    /// Gives the bytes of process `from` to all.
    fn broadcast(&self, from: usize, bytes: &mut [u8]);
}

static MESSAGES: OnceLock<Box<dyn Messages>> = OnceLock::new();

/// Connects this process with the others of its computation, before any work; a second connection is refused by
/// `false`.
pub fn connect(messages: Box<dyn Messages>) -> bool {
    MESSAGES.set(messages).is_ok()
}

/// Returns true unless the computation has another process whose outputs count.
pub fn is_first() -> bool {
    others().is_none_or(|all| all.rank() == 0)
}

/// Returns true if this process works alone.
pub fn is_alone() -> bool {
    others().is_none()
}

/// Returns true if these bytes, as many in each process, are those of the first one.
pub fn is_common(bytes: &[u8]) -> bool {
    let Some(all) = others() else { return true };
    let mut first = bytes.to_vec();
    all.broadcast(0, &mut first);
    first == bytes
}

/// Returns the messages to other processes, if there are some.
fn others() -> Option<&'static dyn Messages> {
    MESSAGES.get().map(|all| &**all).filter(|all| all.count() > 1)
}

/// Returns the partitions of process `rank` among `count`. The first process has the first one, to which the others are
/// added.
fn share(partitions: usize, rank: usize, count: usize) -> Range<usize> {
    (rank * partitions).div_ceil(count)..((rank + 1) * partitions).div_ceil(count)
}

/// Returns the partitions that this process computes.
pub(crate) fn own(partitions: usize) -> Range<usize> {
    others().map_or(0..partitions, |all| share(partitions, all.rank(), all.count()))
}

/// Returns what all processes computed of so many partitions, from this one's; a part of others has the numbers that
/// `numbers` names, and is a `zero` otherwise.
pub(crate) fn gathered<T>(
    own: Vec<T>,
    partitions: usize,
    zero: impl Fn() -> T,
    numbers: impl Fn(&mut T) -> Vec<&mut f64>,
) -> Vec<T> {
    let Some(all) = others() else { return own };
    let before = share(partitions, all.rank(), all.count()).start;
    let mut parts: Vec<T> = (0..before).map(|_| zero()).chain(own).collect();
    parts.resize_with(partitions, &zero);
    for rank in 0..all.count() {
        let theirs = &mut parts[share(partitions, rank, all.count())];
        let mut sent: Vec<f64> = theirs.iter_mut().flat_map(&numbers).map(|v| *v).collect();
        if sent.is_empty() {
            continue;
        }
        all.broadcast(rank, bytemuck::cast_slice_mut(&mut sent));
        theirs.iter_mut().flat_map(&numbers).zip(sent).for_each(|(to, sent)| *to = sent);
    }
    parts
}

/// Pieces of a total that travel together: long enough for the network, short enough that all processes are at work.
const TOGETHER: usize = 512;

/// Adds up numbers over all processes, in pieces of so many: `total` holds those of the first process's first
/// partition, and `add(number, piece)` adds to a piece what the other partitions of this process have.
pub(crate) fn added<V: Pod + Send>(total: &mut [V], piece: usize, add: impl Fn(usize, &mut [V]) + Sync) {
    let run = |first: usize, values: &mut [V]| {
        values.par_chunks_mut(piece).enumerate().for_each(|(i, piece)| add(first + i, piece));
    };
    let Some(all) = others() else { return run(0, total) };
    // From process to process, so that the order of the additions is that of one process.
    let (rank, last) = (all.rank(), all.count() - 1);
    for (n, values) in total.chunks_mut(piece * TOGETHER).enumerate() {
        if rank > 0 {
            all.receive(rank - 1, bytemuck::cast_slice_mut(values));
        }
        run(n * TOGETHER, values);
        if rank < last {
            all.send(rank + 1, bytemuck::cast_slice(values));
        }
    }
    for values in total.chunks_mut(piece * TOGETHER) {
        all.broadcast(last, bytemuck::cast_slice_mut(values));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_partition_has_one_process() {
        for partitions in [0, 1, 2, 7, 16] {
            for count in [1, 2, 3, 5, 16, 40] {
                let all: Vec<usize> = (0..count).flat_map(|rank| share(partitions, rank, count)).collect();
                assert_eq!(all, (0..partitions).collect::<Vec<_>>(), "{partitions} among {count}");
                assert!(partitions == 0 || share(partitions, 0, count).contains(&0), "{partitions} among {count}");
            }
        }
    }

    #[test]
    fn one_process_has_its_own_sums() {
        assert!(is_first() && is_alone() && is_common(&[1, 2]));
        assert_eq!(own(16), 0..16);
        assert_eq!(gathered(vec![1.5, 2.5], 2, || 0.0, |v| vec![v]), [1.5, 2.5]);
        let mut total = [1.0_f32, 2.0, 3.0];
        added(&mut total, 2, |number, piece| piece.iter_mut().for_each(|v| *v += 10.0 * number as f32));
        assert_eq!(total, [1.0, 2.0, 13.0]);
    }
}
