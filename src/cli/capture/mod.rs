//! `cumulo capture`: captures of other programs, and cameras without pictures.

mod convert;
mod new;
