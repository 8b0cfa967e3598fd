//! `cumulo reconstruct`: volumes and transfer functions from pictures.

mod color;
mod density;
mod tf;
