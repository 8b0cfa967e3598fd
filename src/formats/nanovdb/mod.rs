//! NanoVDB files: the memory of sparse grids as renderers and GPUs hold it, read to leaves and tiles, and written.
//!
//! A file is a row of segments, each with the metadata of its grids and their memory, plain, zipped or packed by Blosc;
//! or a row of bare grids. The memory of a grid is a header, a tree of root, upper nodes (4096³ voxels), lower nodes
//! (128³) and leaves (8³), linked by byte offsets. Every offset is checked before it is followed, and places follow
//! from the path through the tree, never from a node's own statement.
//!
//! Source: NanoVDB's headers of ABI 32 (`NanoVDB.h`, `PNanoVDB.h`, `util/IO.h` of OpenVDB 10 to 13).

mod bytes;
mod collect;
mod decode;
mod encode;
mod file;
mod layout;
mod memory;
mod native;
mod nodes;
mod statistics;
mod texts;
mod unpack;
mod volume;
mod write;

pub use file::{Entry, File};
pub use layout::Kind;
pub use unpack::Codec;
pub(crate) use volume::KEPT;
pub use volume::{IntegerLeaf, IntegerTile, Tree, Volume};
pub use write::{encode, write};
