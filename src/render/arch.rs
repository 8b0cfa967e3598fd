//! Which instruction set loops are run with.

/// The machine's choice among those that loops are compiled for: AVX2 with FMA, or the oldest, on x86; one
/// elsewhere. (Vectors here have four lanes: AVX-512 would bring more code, not more speed.)
#[derive(Debug, Clone, Copy)]
pub struct Arch {
    #[cfg(target_arch = "x86_64")]
    wide: Option<pulp::x86::V3>,
    #[cfg(not(target_arch = "x86_64"))]
    any: pulp::Arch,
}

impl Default for Arch {
    fn default() -> Self {
        #[cfg(target_arch = "x86_64")]
        return Self { wide: pulp::x86::V3::try_new() };
        #[cfg(not(target_arch = "x86_64"))]
        Self { any: pulp::Arch::new() }
    }
}

impl Arch {
    /// Runs `loops`; what is inlined into its `call` is compiled for the instruction set.
    #[inline(always)]
    pub fn dispatch<F: pulp::NullaryFnOnce>(self, loops: F) -> F::Output {
        #[cfg(target_arch = "x86_64")]
        return match self.wide {
            Some(wide) => wide.vectorize(loops),
            None => loops.call(),
        };
        #[cfg(not(target_arch = "x86_64"))]
        self.any.dispatch(loops)
    }
}
