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

    /// Returns the name of the instruction set.
    pub fn name(self) -> String {
        #[cfg(target_arch = "x86_64")]
        let set = if self.wide.is_some() { "AVX2 and FMA" } else { "baseline" };
        #[cfg(not(target_arch = "x86_64"))]
        let set = if matches!(self.any, pulp::Arch::Scalar) { "baseline" } else { "vectors" };
        format!("{}, {set}", std::env::consts::ARCH)
    }

    /// Runs `loops`; what is inlined into its `call` is compiled for the instruction set.
    #[inline(always)]
    pub(crate) fn dispatch<F: pulp::NullaryFnOnce>(self, loops: F) -> F::Output {
        #[cfg(target_arch = "x86_64")]
        return match self.wide {
            Some(wide) => wide.vectorize(loops),
            None => loops.call(),
        };
        #[cfg(not(target_arch = "x86_64"))]
        self.any.dispatch(loops)
    }

    /// Returns eight rows of eight numbers as columns.
    #[inline(always)]
    pub fn transposed(self, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = self.wide {
            return transposed(wide, rows);
        }
        let mut columns = [[0.0; 8]; 8];
        for (i, row) in rows.iter().enumerate() {
            for (column, value) in columns.iter_mut().zip(row) {
                column[i] = *value;
            }
        }
        columns
    }
}

/// Returns eight rows of eight numbers as columns: pairs of rows are interleaved three times.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn transposed(wide: pulp::x86::V3, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    let avx = wide.avx;
    let row = |i: usize| pulp::cast::<[f32; 8], std::arch::x86_64::__m256>(rows[i]);
    let (a, b, c, d) = (row(0), row(1), row(2), row(3));
    let (e, f, g, h) = (row(4), row(5), row(6), row(7));
    let (ab, cd) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpacklo_ps(c, d));
    let (ef, gh) = (avx._mm256_unpacklo_ps(e, f), avx._mm256_unpacklo_ps(g, h));
    let (ab_high, cd_high) = (avx._mm256_unpackhi_ps(a, b), avx._mm256_unpackhi_ps(c, d));
    let (ef_high, gh_high) = (avx._mm256_unpackhi_ps(e, f), avx._mm256_unpackhi_ps(g, h));
    let quads = [
        (avx._mm256_shuffle_ps::<0x44>(ab, cd), avx._mm256_shuffle_ps::<0x44>(ef, gh)),
        (avx._mm256_shuffle_ps::<0xEE>(ab, cd), avx._mm256_shuffle_ps::<0xEE>(ef, gh)),
        (avx._mm256_shuffle_ps::<0x44>(ab_high, cd_high), avx._mm256_shuffle_ps::<0x44>(ef_high, gh_high)),
        (avx._mm256_shuffle_ps::<0xEE>(ab_high, cd_high), avx._mm256_shuffle_ps::<0xEE>(ef_high, gh_high)),
    ];
    let mut columns = [[0.0; 8]; 8];
    for (i, (upper, lower)) in quads.into_iter().enumerate() {
        columns[i] = pulp::cast(avx._mm256_permute2f128_ps::<0x20>(upper, lower));
        columns[i + 4] = pulp::cast(avx._mm256_permute2f128_ps::<0x31>(upper, lower));
    }
    columns
}

/// Stand-in for [`Arch`] that compiles loops once, for the target's baseline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain;

impl Plain {
    /// Runs `loops`.
    #[inline(always)]
    pub(crate) fn dispatch<F: pulp::NullaryFnOnce>(self, loops: F) -> F::Output {
        loops.call()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns_on_any_machine() {
        let rows = std::array::from_fn(|row| std::array::from_fn(|column| (10 * row + column) as f32));
        let columns = std::array::from_fn(|column| std::array::from_fn(|row| (10 * row + column) as f32));
        assert_eq!(Arch::default().transposed(&rows), columns);
        assert_eq!(Arch::oldest().transposed(&rows), columns);
    }
}
