//! What accuracy costs in time: the error of a path-traced picture, known without a reference, and the paths that a
//! wanted error takes.
//!
//! A picture is made of independent replicates ([`film::Replicates`](crate::render::film::Replicates)). By their spread
//! [`interval`] states, for each block of 8 x 8 pixels, an interval that holds the expected mean of the block with a
//! confidence. A [`pilot`], whose pixels are thrown away, tells how much the paths of each block vary and what they
//! cost ([`demand`]). The numbers of paths that follow are fixed before the picture begins, because samples that decide
//! when to stop bias what they are averaged into (Kirk & Arvo 1991).

pub mod demand;
pub mod interval;
pub mod pilot;
