//! The program for clusters: `mpirun -n 4 cumulo-mpi reconstruct density shots -o found.vdb` does what `cumulo` does
//! with the same words, and its passes over rays on all processes. Outputs and reports are those of the first.

use cumulo::formats::vdb::helper;
use cumulo::ranks::{self, Messages};
use mpi::Threading;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Root, Source};
use std::ffi::OsString;
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::process::ExitCode;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: cumulo::process::Allocator = cumulo::process::Allocator;

/// All processes that `mpirun` has started.
struct World {
    rank: usize,
    count: usize,
}

impl World {
    /// Largest message in bytes: MPI counts them in 32 bits.
    const MOST: usize = 1 << 30;

    fn new() -> Self {
        let world = SimpleCommunicator::world();
        Self { rank: world.rank() as usize, count: world.size() as usize }
    }
}

impl Messages for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn count(&self) -> usize {
        self.count
    }

    fn send(&self, to: usize, bytes: &[u8]) {
        let world = SimpleCommunicator::world();
        bytes.chunks(Self::MOST).for_each(|bytes| world.process_at_rank(to as i32).send(bytes));
    }

    fn receive(&self, from: usize, bytes: &mut [u8]) {
        let world = SimpleCommunicator::world();
        for bytes in bytes.chunks_mut(Self::MOST) {
            world.process_at_rank(from as i32).receive_into(bytes);
        }
    }

    fn broadcast(&self, from: usize, bytes: &mut [u8]) {
        let world = SimpleCommunicator::world();
        for bytes in bytes.chunks_mut(Self::MOST) {
            world.process_at_rank(from as i32).broadcast_into(bytes);
        }
    }
}

/// Time in which the first process says what is wrong with the words or inputs of all of them.
const FIRST: Duration = Duration::from_secs(3);

fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    let run = |words| cumulo::cli::main(words, option_env!("CUMULO_COMMIT"));
    // A process that tries a grid is none of the computation's.
    if words.get(1).is_some_and(|word| word == helper::SUBCOMMAND) {
        return ExitCode::from(run(words));
    }
    let Some((universe, _)) = mpi::initialize_with_threading(Threading::Serialized) else {
        let _ = writeln!(std::io::stderr(), "cumulo-mpi: MPI cannot be initialized");
        return ExitCode::from(2);
    };
    let world = World::new();
    let (rank, aside) = (world.rank, if world.rank > 0 { set_aside() } else { None });
    ranks::connect(Box::new(world));
    let code = run(words);
    if code > 1 {
        // The others may wait for this process, and would do so for ever.
        if rank > 0 {
            std::thread::sleep(FIRST);
            tell(aside, rank);
        }
        SimpleCommunicator::world().abort(code.into());
    }
    drop(universe);
    ExitCode::from(code)
}

/// Lets standard output lead nowhere, and standard error to a file, which is returned.
fn set_aside() -> Option<(File, File)> {
    let errors = tempfile::tempfile().ok()?;
    let own = File::from(rustix::io::dup(rustix::stdio::stderr()).ok()?);
    rustix::stdio::dup2_stdout(File::options().write(true).open("/dev/null").ok()?).ok()?;
    rustix::stdio::dup2_stderr(&errors).ok()?;
    Some((errors, own))
}

/// Says on the own standard error what was set aside.
fn tell(aside: Option<(File, File)>, rank: usize) {
    let Some((mut errors, mut own)) = aside else { return };
    let mut text = String::new();
    if errors.rewind().and_then(|()| errors.read_to_string(&mut text)).is_ok() {
        let _ = writeln!(own, "process {rank}: {}", text.trim_end());
    }
}
