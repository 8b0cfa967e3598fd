//! The memory that reading a file may take.

use crate::error::Error;
use crate::formats::limits::Limits;
use crate::process;
use crate::text;

/// `--max-memory` of the commands that read volumes.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Memory {
    /// Memory of the whole process, 112M at least, in bytes or with K, M, G, T (default: half of the machine's)
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_memory: Option<u64>,
}

impl Memory {
    /// Returns an option that gives these limits.
    pub(crate) fn of(limits: Limits) -> Self {
        Self { max_memory: Some(limits.max_memory) }
    }

    /// Refuses a limit that the process cannot keep to, whatever the work.
    ///
    /// # Errors
    /// If `--max-memory` is less.
    pub(crate) fn check(self) -> Result<(), Error> {
        let least = process::least_memory();
        match self.max_memory {
            Some(most) if most < least => {
                let (given, threads) = (text::bytes(most), rayon::current_num_threads());
                let needed = format!("at least {} MiB are needed for the program", least.div_ceil(1 << 20));
                Err(Error::invalid(format!("--max-memory {given}: {needed}, its libraries and its {threads} threads"))
                    .hint("give as much or more, or fewer --threads where there are many"))
            }
            _ => Ok(()),
        }
    }

    /// Returns the limits for readers: `--max-memory`, else the default.
    pub(crate) fn limits(self) -> Limits {
        self.max_memory.map_or_else(Limits::default, |max_memory| Limits { max_memory })
    }
}

fn bytes(text: &str) -> Result<u64, String> {
    let expected = || format!("'{text}' is no size; give bytes, or a number with K, M, G or T such as 4G");
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let shift = match text[digits.len()..].to_ascii_uppercase().as_str() {
        "" | "B" => 0,
        "K" | "KIB" | "KB" => 10,
        "M" | "MIB" | "MB" => 20,
        "G" | "GIB" | "GB" => 30,
        "T" | "TIB" | "TB" => 40,
        _ => return Err(expected()),
    };
    let number: f64 = digits.parse().map_err(|_| expected())?;
    let size = number * (1_u64 << shift) as f64;
    if size.is_finite() && size >= 1.0 { Ok(size as u64) } else { Err(expected()) }
}
