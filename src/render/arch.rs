//! Choice of the instruction set that inner loops run with.

/// Instruction set of inner loops, detected at run time: on x86-64 AVX2 with FMA or else the baseline; on other targets
/// what `pulp` detects. (Vectors have four lanes here, so AVX-512 would add code without adding speed.)
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
    /// Returns the baseline instruction set, whatever the machine supports.
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

/// Stand-in for [`Arch`] that compiles loops once, for the target's baseline.
#[derive(Debug, Clone, Copy)]
pub struct Plain;

impl Plain {
    /// Runs `loops`.
    #[inline(always)]
    pub fn dispatch<F: pulp::NullaryFnOnce>(self, loops: F) -> F::Output {
        loops.call()
    }
}
