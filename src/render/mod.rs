//! Light transport: integrators and their derivatives.
//!
//! To read from above: [`renderer`] is what a scene calls for, and [`film`] asks its [`integrator`] for every ray of a
//! picture. There are two: [`path`] traces paths of scattered light, and [`composited`] puts emission and absorption
//! along straight rays ([`emission_absorption`]) over a background. These are integrated by [`dvr`] (a density in a
//! medium), [`shaded`] (surfaces of a density) and [`preshaded`] (emission and extinction by voxel), which walk a ray's
//! bricks (`march`), cut it into segments ([`quadrature`], `segment`) and composite these by one driver
//! (`compositing`). [`deep`] keeps at which depths a pixel's light comes from. [`differentiable`] is what they offer
//! beyond a value.

pub mod accuracy;
pub(crate) mod cell;
pub mod composited;
mod compositing;
pub(crate) mod cubic;
pub(crate) mod curve;
pub mod deep;
pub mod differentiable;
pub mod direct;
pub mod dvr;
pub mod emission_absorption;
pub mod film;
pub(crate) mod gauss;
pub(crate) mod gradient;
pub(crate) mod index_ray_gradient;
pub mod integrator;
pub mod labels;
pub(crate) mod majorant;
pub(crate) mod march;
pub mod order;
pub mod path;
pub mod preshaded;
pub mod quadrature;
pub mod renderer;
pub mod sampler;
pub mod scale;
pub(crate) mod segment;
pub mod shaded;
pub mod tiles;
