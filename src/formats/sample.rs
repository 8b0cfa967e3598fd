//! Types of the numbers in files, and their bytes.

use half::f16;

/// Order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// Type of a number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names say all: unsigned, signed and floating, with the number of bits")]
pub enum Sample {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
}

impl Sample {
    /// All types, as their [`Sample::name`]s are listed to the user.
    pub const ALL: [Self; 11] = [
        Self::U8,
        Self::I8,
        Self::U16,
        Self::I16,
        Self::U32,
        Self::I32,
        Self::U64,
        Self::I64,
        Self::F16,
        Self::F32,
        Self::F64,
    ];

    /// Name of the type: `u8`, `i16`, `f32` and the like.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F16 => "f16",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// Number of bytes.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// True for integers.
    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F16 | Self::F32 | Self::F64)
    }

    /// Appends the numbers of `bytes`, whose length is a multiple of the type's, to `out`. Integers beyond 2⁵³ are
    /// rounded.
    pub fn decode(self, endian: Endian, bytes: &[u8], out: &mut impl Extend<f64>) {
        macro_rules! numbers {
            ($type:ty, $n:literal, $to:expr) => {
                out.extend(bytes.as_chunks::<$n>().0.iter().map(|b| {
                    let number = match endian {
                        Endian::Little => <$type>::from_le_bytes(*b),
                        Endian::Big => <$type>::from_be_bytes(*b),
                    };
                    $to(number)
                }))
            };
        }
        match self {
            Self::U8 => numbers!(u8, 1, f64::from),
            Self::I8 => numbers!(i8, 1, f64::from),
            Self::U16 => numbers!(u16, 2, f64::from),
            Self::I16 => numbers!(i16, 2, f64::from),
            Self::U32 => numbers!(u32, 4, f64::from),
            Self::I32 => numbers!(i32, 4, f64::from),
            Self::U64 => numbers!(u64, 8, |n| n as f64),
            Self::I64 => numbers!(i64, 8, |n| n as f64),
            Self::F16 => numbers!(f16, 2, f64::from),
            Self::F32 => numbers!(f32, 4, f64::from),
            Self::F64 => numbers!(f64, 8, |n| n),
        }
    }

    /// Appends the bytes of numbers, least significant first. Integers saturate.
    pub fn encode(self, values: &[f64], out: &mut Vec<u8>) {
        macro_rules! numbers {
            ($to:expr) => {
                values.iter().for_each(|v| out.extend($to(*v).to_le_bytes()))
            };
        }
        match self {
            Self::U8 => numbers!(|v| v as u8),
            Self::I8 => numbers!(|v| v as i8),
            Self::U16 => numbers!(|v| v as u16),
            Self::I16 => numbers!(|v| v as i16),
            Self::U32 => numbers!(|v| v as u32),
            Self::I32 => numbers!(|v| v as i32),
            Self::U64 => numbers!(|v| v as u64),
            Self::I64 => numbers!(|v| v as i64),
            Self::F16 => numbers!(f16::from_f64),
            Self::F32 => numbers!(|v| v as f32),
            Self::F64 => numbers!(|v| v),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type_come_back_and_turn_over() {
        for sample in Sample::ALL {
            let values: &[f64] = match sample {
                Sample::U8 => &[0.0, 1.0, 255.0],
                Sample::I8 => &[-128.0, 0.0, 127.0],
                Sample::U16 => &[0.0, 258.0, 65_535.0],
                Sample::I16 => &[-32_768.0, 258.0],
                Sample::U32 => &[4_294_967_295.0, 16_909_060.0],
                Sample::I32 => &[-2_147_483_648.0, 16_909_060.0],
                Sample::U64 => &[9_007_199_254_740_991.0],
                Sample::I64 => &[-9_007_199_254_740_991.0],
                Sample::F16 => &[-1.5, 0.25],
                Sample::F32 => &[-1.5, f64::from(0.1_f32)],
                Sample::F64 => &[0.1, -1e300],
            };
            let (mut bytes, mut found) = (Vec::new(), Vec::new());
            sample.encode(values, &mut bytes);
            assert_eq!(bytes.len(), values.len() * sample.bytes());
            sample.decode(Endian::Little, &bytes, &mut found);
            assert_eq!(found, values, "{sample:?}");
            let turned: Vec<u8> = bytes.chunks(sample.bytes()).flat_map(|b| b.iter().rev().copied()).collect();
            found.clear();
            sample.decode(Endian::Big, &turned, &mut found);
            assert_eq!(found, values, "{sample:?}");
        }
    }
}
