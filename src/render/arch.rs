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
    /// The oldest, whatever the machine has.
    pub fn oldest() -> Self {
        #[cfg(target_arch = "x86_64")]
        return Self { wide: None };
        #[cfg(not(target_arch = "x86_64"))]
        Self { any: pulp::Arch::Scalar }
    }

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

/// Stands where an [`Arch`] could, for loops that are compiled once.
#[derive(Debug, Clone, Copy)]
pub struct Plain;

impl Plain {
    /// Runs `loops`.
    #[inline(always)]
    pub fn dispatch<F: pulp::NullaryFnOnce>(self, loops: F) -> F::Output {
        loops.call()
    }
}
