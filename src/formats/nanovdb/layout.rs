//! Types of values, and where the parts of each node lie (NanoVDB's ABI 32).

/// Type of a grid's values, by NanoVDB's number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Kind {
    /// 32-bit floats.
    Float = 1,
    /// 64-bit floats.
    Double = 2,
    /// Signed 16-bit integers.
    Int16 = 3,
    /// Signed 32-bit integers.
    Int32 = 4,
    /// Signed 64-bit integers.
    Int64 = 5,
    /// Three 32-bit floats.
    Vec3f = 6,
    /// Three 64-bit floats.
    Vec3d = 7,
    /// Active states without values.
    Mask = 8,
    /// 16-bit floats.
    Half = 9,
    /// Unsigned 32-bit integers.
    UInt32 = 10,
    /// Bits.
    Boolean = 11,
    /// Floats quantized to 4 bits within a leaf.
    Fp4 = 13,
    /// Floats quantized to 8 bits within a leaf.
    Fp8 = 14,
    /// Floats quantized to 16 bits within a leaf.
    Fp16 = 15,
    /// Floats quantized to 1, 2, 4, 8 or 16 bits, each leaf with a width of its own.
    FpN = 16,
}

/// Names of NanoVDB's types by number, those that are not read included.
const NAMES: [&str; 28] = [
    "unknown",
    "float",
    "double",
    "int16",
    "int32",
    "int64",
    "vec3f",
    "vec3d",
    "mask",
    "half",
    "uint32",
    "bool",
    "rgba8",
    "fp4",
    "fp8",
    "fp16",
    "fpN",
    "vec4f",
    "vec4d",
    "index",
    "onIndex",
    "indexMask",
    "onIndexMask",
    "pointIndex",
    "vec3u8",
    "vec3u16",
    "uint8",
    "end",
];

/// Name of a type by its number, as NanoVDB's tools print it.
pub(super) fn name(number: u32) -> &'static str {
    NAMES.get(number as usize).copied().unwrap_or(NAMES[0])
}

impl Kind {
    /// The type of a number; `None` if grids of it are not read.
    pub(super) fn of(number: u32) -> Option<Self> {
        use Kind::{
            Boolean, Double, Float, Fp4, Fp8, Fp16, FpN, Half, Int16, Int32, Int64, Mask, UInt32, Vec3d, Vec3f,
        };
        let all = [Float, Double, Int16, Int32, Int64, Vec3f, Vec3d, Mask, Half, UInt32, Boolean, Fp4, Fp8, Fp16, FpN];
        all.into_iter().find(|kind| *kind as u32 == number)
    }

    /// Name of the type, as NanoVDB's tools print it.
    pub(crate) fn name(self) -> &'static str {
        name(self as u32)
    }

    /// Number of components of a value.
    pub(super) fn components(self) -> usize {
        if matches!(self, Self::Vec3f | Self::Vec3d) { 3 } else { 1 }
    }

    /// Bytes and alignment of a value where it is not quantized: of tiles, the background, minimum and maximum.
    pub(super) fn value(self) -> (usize, usize) {
        match self {
            Self::Double | Self::Int64 => (8, 8),
            Self::Int16 | Self::Half => (2, 2),
            Self::Vec3f => (12, 4),
            Self::Vec3d => (24, 8),
            Self::Mask | Self::Boolean => (1, 1),
            _ => (4, 4),
        }
    }

    /// Bytes of the average and of the standard deviation, which are their alignment too.
    fn statistic(self) -> usize {
        match self {
            Self::Double | Self::Int64 | Self::Vec3d => 8,
            Self::Mask | Self::Boolean => 1,
            _ => 4,
        }
    }

    /// Bytes from `at` to the end of minimum, maximum, average and standard deviation, which begin at or after `at`.
    fn after_statistics(self, at: usize) -> usize {
        let (size, align) = self.value();
        let statistic = self.statistic();
        (at.next_multiple_of(align) + 2 * size).next_multiple_of(statistic) + 2 * statistic
    }

    /// Offsets of minimum, maximum, average and standard deviation, which begin at or after `at`.
    pub(super) fn statistics(self, at: usize) -> [usize; 4] {
        let (size, align) = self.value();
        let minimum = at.next_multiple_of(align);
        let statistic = self.statistic();
        let average = (minimum + 2 * size).next_multiple_of(statistic);
        [minimum, minimum + size, average, average + statistic]
    }

    /// Offset of the background in the root.
    pub(super) fn root_background(self) -> usize {
        ROOT_TABLE_SIZE + 4_usize.next_multiple_of(self.value().1)
    }

    /// Bytes of the root before its tiles.
    pub(super) fn root(self) -> usize {
        self.after_statistics(self.root_background() + self.value().0).next_multiple_of(ALIGNMENT)
    }

    /// Offset of the value in a tile of the root.
    pub(super) fn root_tile_value(self) -> usize {
        20_usize.next_multiple_of(self.value().1)
    }

    /// Bytes of a tile of the root.
    pub(super) fn root_tile(self) -> usize {
        (self.root_tile_value() + self.value().0).next_multiple_of(ALIGNMENT)
    }

    /// Bytes of an entry of an internal node's table: a value or a 64-bit offset.
    pub(super) fn entry(self) -> usize {
        self.value().0.next_multiple_of(8)
    }

    /// Bytes of a leaf before its values.
    pub(super) fn leaf_values(self) -> usize {
        match self {
            Self::Mask | Self::Boolean => LEAF_STATISTICS,
            Self::Fp4 | Self::Fp8 | Self::Fp16 | Self::FpN => 96,
            _ => self.after_statistics(LEAF_STATISTICS).next_multiple_of(ALIGNMENT),
        }
    }

    /// Bytes of a leaf's values; for [`Kind::FpN`] those of a leaf whose values have `bits` bits.
    pub(super) fn leaf_value_bytes(self, bits: usize) -> usize {
        match self {
            Self::Mask => 0,
            Self::Boolean => 64,
            Self::Fp4 => 256,
            Self::Fp8 => 512,
            Self::Fp16 => 1024,
            Self::FpN => 64 * bits,
            _ => 512 * self.value().0,
        }
    }
}

/// Alignment of every node, in bytes.
pub(super) const ALIGNMENT: usize = 32;

/// Bytes of the header of a grid.
pub(super) const GRID: usize = 672;
/// Offset of the version in the header of a grid.
pub(super) const GRID_VERSION: u64 = 16;
/// Offset of the byte count in the header of a grid.
pub(super) const GRID_SIZE: u64 = 32;
/// Offset of the name in the header of a grid.
pub(super) const GRID_NAME: u64 = 40;
/// Bytes of that name, its NUL included.
pub(super) const GRID_NAME_BYTES: usize = 256;
/// Offset of the map from indices to the world.
pub(super) const GRID_MAP: u64 = 296;
/// Offset of the 3 x 3 matrix of doubles in the map, row by row, acting on columns.
pub(super) const MAP_MATRIX: u64 = 88;
/// Offset of the translation of doubles in the map.
pub(super) const MAP_TRANSLATION: u64 = 232;
/// Offset of the class in the header of a grid.
pub(super) const GRID_CLASS: u64 = 632;
/// Offset of the type in the header of a grid.
pub(super) const GRID_KIND: u64 = 636;
/// Offset of the place of the texts behind the tree in the header of a grid.
pub(super) const GRID_TEXTS: u64 = 640;
/// Offset of their number.
pub(super) const GRID_TEXT_COUNT: u64 = 648;
/// Bytes of the header of a tree, which follows that of the grid.
pub(super) const TREE: usize = 64;
/// Offset of the number of leaves in the header of a tree.
pub(super) const TREE_LEAVES: u64 = 32;
/// Offset of the number of active voxels in the header of a tree.
pub(super) const TREE_VOXELS: u64 = 56;
/// Offset of the number of tiles in the root.
pub(super) const ROOT_TABLE_SIZE: usize = 24;
/// Offset of the mask of active values in an internal node.
pub(super) const NODE_MASKS: usize = 32;
/// Offset of the mask of active values in a leaf.
pub(super) const LEAF_MASK: usize = 16;
/// Offset behind the mask of a leaf, where minimum and maximum follow.
pub(super) const LEAF_STATISTICS: usize = 80;

/// An internal level of the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level {
    /// Entries of the table along an axis, as a power of two.
    pub log2: u32,
    /// Edge in voxels of what an entry covers, as a power of two.
    pub child_log2: u32,
}

/// Nodes of 4096³ voxels.
pub(super) const UPPER: Level = Level { log2: 5, child_log2: 7 };
/// Nodes of 128³ voxels.
pub(super) const LOWER: Level = Level { log2: 4, child_log2: 3 };

impl Level {
    /// Entries of the table.
    pub(crate) fn entries(self) -> usize {
        1 << (3 * self.log2)
    }
    /// Bytes of each of the two masks.
    pub(crate) fn mask(self) -> usize {
        self.entries() / 8
    }
    /// Offset of the minimum, or before it by less than its alignment.
    pub(crate) fn statistics(self) -> usize {
        NODE_MASKS + 2 * self.mask()
    }
    /// Offset of the table.
    pub(crate) fn table(self, kind: Kind) -> usize {
        kind.after_statistics(self.statistics()).next_multiple_of(ALIGNMENT)
    }
    /// Bytes of a node.
    pub(crate) fn node(self, kind: Kind) -> usize {
        self.table(kind) + self.entries() * kind.entry()
    }
    /// Index coordinates of an entry relative to the node.
    pub(crate) fn offset(self, entry: usize) -> [i32; 3] {
        let mask = (1 << self.log2) - 1;
        let entry = entry as i32;
        [entry >> (2 * self.log2), entry >> self.log2 & mask, entry & mask].map(|i| i << self.child_log2)
    }
    /// Entry of the table at index coordinates.
    pub(crate) fn entry_at(self, [x, y, z]: [i32; 3]) -> usize {
        let mask = (1 << self.log2) - 1;
        let along = |c: i32| (c >> self.child_log2 & mask) as usize;
        along(x) << (2 * self.log2) | along(y) << self.log2 | along(z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sizes that NanoVDB's headers state or assert (`NanoVDB.h`, `PNanoVDB.h`).
    #[test]
    fn sizes_are_those_of_the_abi() {
        let nodes = |kind| (UPPER.node(kind), LOWER.node(kind), kind.leaf_values() + kind.leaf_value_bytes(0));
        assert_eq!(nodes(Kind::Float), (270_400, 33_856, 2_144));
        assert_eq!(nodes(Kind::Double), (270_400, 33_856, 4_224));
        assert_eq!(nodes(Kind::Vec3f), (532_544, 66_624, 6_272));
        assert_eq!(nodes(Kind::Vec3d), (794_720, 99_424, 12_448));
        assert_eq!(nodes(Kind::Int16).2, 1_120);
        assert_eq!(nodes(Kind::Int64).2, 4_224);
        assert_eq!((Kind::Float.root(), Kind::Float.root_tile()), (64, 32));
        assert_eq!((Kind::Vec3f.root_background(), Kind::Vec3f.root(), Kind::Vec3f.root_tile()), (28, 96, 32));
        assert_eq!((Kind::Double.root_background(), Kind::Double.root()), (32, 96));
        assert_eq!((Kind::Vec3d.root_tile_value(), Kind::Vec3d.root_tile()), (24, 64));
        assert_eq!(Kind::of(19), None);
        assert_eq!((name(20), name(99), Kind::Fp16.name()), ("onIndex", "unknown", "fp16"));
    }

    #[test]
    fn entries_and_coordinates_agree() {
        for level in [UPPER, LOWER] {
            for entry in [0, 1, 17, level.entries() - 1] {
                assert_eq!(level.entry_at(level.offset(entry)), entry);
            }
        }
        assert_eq!(UPPER.entry_at([-1, -1, -1]), 32_767);
    }
}
