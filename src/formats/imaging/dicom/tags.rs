//! Tags of the elements that are read.
#![allow(missing_docs, reason = "the names are the standard's, shortened")]

pub(crate) const MEDIA_CLASS: u32 = 0x0002_0002;
pub(crate) const TRANSFER_SYNTAX: u32 = 0x0002_0010;
pub(crate) const MODALITY: u32 = 0x0008_0060;
pub(crate) const SERIES_DESCRIPTION: u32 = 0x0008_103e;
pub(crate) const SLICE_THICKNESS: u32 = 0x0018_0050;
pub(crate) const SPACING_BETWEEN_SLICES: u32 = 0x0018_0088;
pub(crate) const SERIES: u32 = 0x0020_000e;
pub(crate) const INSTANCE_NUMBER: u32 = 0x0020_0013;
pub(crate) const POSITION: u32 = 0x0020_0032;
pub(crate) const ORIENTATION: u32 = 0x0020_0037;
pub(crate) const PLANE_POSITION: u32 = 0x0020_9113;
pub(crate) const PLANE_ORIENTATION: u32 = 0x0020_9116;
pub(crate) const SAMPLES: u32 = 0x0028_0002;
pub(crate) const PHOTOMETRIC: u32 = 0x0028_0004;
pub(crate) const FRAMES: u32 = 0x0028_0008;
pub(crate) const ROWS: u32 = 0x0028_0010;
pub(crate) const COLUMNS: u32 = 0x0028_0011;
pub(crate) const PIXEL_SPACING: u32 = 0x0028_0030;
pub(crate) const BITS_ALLOCATED: u32 = 0x0028_0100;
pub(crate) const BITS_STORED: u32 = 0x0028_0101;
pub(crate) const HIGH_BIT: u32 = 0x0028_0102;
pub(crate) const REPRESENTATION: u32 = 0x0028_0103;
pub(crate) const PADDING: u32 = 0x0028_0120;
pub(crate) const INTERCEPT: u32 = 0x0028_1052;
pub(crate) const SLOPE: u32 = 0x0028_1053;
pub(crate) const RESCALE_TYPE: u32 = 0x0028_1054;
pub(crate) const MODALITY_TABLE: u32 = 0x0028_3000;
pub(crate) const PIXEL_MEASURES: u32 = 0x0028_9110;
pub(crate) const VALUE_TRANSFORMATION: u32 = 0x0028_9145;
pub(crate) const FRAME_OFFSETS: u32 = 0x3004_000c;
pub(crate) const DOSE_SCALING: u32 = 0x3004_000e;
pub(crate) const SHARED_GROUPS: u32 = 0x5200_9229;
pub(crate) const FRAME_GROUPS: u32 = 0x5200_9230;
pub(crate) const FLOAT_PIXELS: u32 = 0x7fe0_0008;
pub(crate) const DOUBLE_PIXELS: u32 = 0x7fe0_0009;
pub(crate) const PIXELS: u32 = 0x7fe0_0010;

/// Sequences that are kept.
pub(crate) const SEQUENCES: [u32; 7] = [
    SHARED_GROUPS,
    FRAME_GROUPS,
    PLANE_POSITION,
    PLANE_ORIENTATION,
    PIXEL_MEASURES,
    VALUE_TRANSFORMATION,
    MODALITY_TABLE,
];

/// Elements that are kept.
pub(crate) const WANTED: [u32; 31] = [
    RESCALE_TYPE,
    MODALITY,
    SERIES_DESCRIPTION,
    SLICE_THICKNESS,
    SPACING_BETWEEN_SLICES,
    SERIES,
    INSTANCE_NUMBER,
    POSITION,
    ORIENTATION,
    PLANE_POSITION,
    PLANE_ORIENTATION,
    SAMPLES,
    PHOTOMETRIC,
    FRAMES,
    ROWS,
    COLUMNS,
    PIXEL_SPACING,
    BITS_ALLOCATED,
    BITS_STORED,
    HIGH_BIT,
    REPRESENTATION,
    PADDING,
    INTERCEPT,
    SLOPE,
    MODALITY_TABLE,
    PIXEL_MEASURES,
    VALUE_TRANSFORMATION,
    FRAME_OFFSETS,
    DOSE_SCALING,
    SHARED_GROUPS,
    FRAME_GROUPS,
];
