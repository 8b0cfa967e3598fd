//! USD stages, written and checked.

pub mod author;
pub mod lint;
