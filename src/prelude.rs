//! What programs on top of this crate use most: `use cumulo::prelude::*;`.
//!
//! The settings of the use cases, with what runs them, and the scene, its renderers and the files below them.
//!
//! ```
//! use cumulo::prelude::*;
//! use std::path::Path;
//!
//! # fn main() -> Result<()> {
//! let limits = Limits::default();
//! let grid = Vdb::open(Path::new("fixtures/plume.vdb"), limits)?.read_fog(None)?;
//! let field = Bricks::from_grid(&grid, limits.max_memory)?;
//! let camera = orbit::cameras(&field.outline(), 1, Layout::Sphere, 64, 64, 40.0, Up::Z)[0];
//! let light = Dvr::new(&field, Medium::absorbing(3.0))?.over([1.0; 3]);
//! let film = render(&light, &camera, Sampling::grid(1), &[], &Cancel::NEVER).ok_or_else(Error::cancelled)?.film;
//! assert!(film.rgba.iter().any(|pixel| pixel[3] > 0.5));
//! # Ok(())
//! # }
//! ```

pub use crate::app::capture::{CaptureSettings, NewCaptureSettings};
pub use crate::app::compare::CompareSettings;
pub use crate::app::convert::{ConvertSettings, ImageSettings, ValueSettings};
pub use crate::app::denoise::DenoiseSettings;
pub use crate::app::diff::DiffSettings;
pub use crate::app::figure::FigureSettings;
pub use crate::app::function::FunctionSettings;
pub use crate::app::gradient::GradientSettings;
pub use crate::app::info::InfoSettings;
pub use crate::app::motion::{MotionFormat, MotionSettings};
pub use crate::app::pictures::scattering::ScatteringSettings;
pub use crate::app::pictures::{DensityScale, PictureSettings, PlanningSettings};
pub use crate::app::plan::PlanSettings;
pub use crate::app::pose::PoseSettings;
pub use crate::app::progress::{Event, Progress};
pub use crate::app::reconstruct::{ColorSettings, DensitySettings, RegionSettings, TransferFunctionSettings};
pub use crate::app::render::{AccuracySettings, MergeSettings, RenderSettings};
pub use crate::app::report::PageSettings;
pub use crate::app::scan::ScanSettings;
pub use crate::app::selftest::SelftestSettings;
pub use crate::app::transfer::TransferSettings;
pub use crate::app::usd::author::AuthorSettings;
pub use crate::app::usd::lint::LintSettings;
pub use crate::app::validate::ValidateSettings;
pub use crate::app::view::ViewSettings;
pub use crate::app::viewpoint::ViewpointSettings;
pub use crate::app::{Context, Report, Status, UseCase};
pub use crate::cancel::Cancel;
pub use crate::error::{Code, Error, Result};
pub use crate::formats::limits::Limits;
pub use crate::formats::sequence::Frames;
pub use crate::formats::vdb::File as Vdb;
pub use crate::render::dvr::Dvr;
pub use crate::render::film::{Rendered, Sampling, render};
pub use crate::render::integrator::Integrator;
pub use crate::render::path::PathTracer;
pub use crate::render::quadrature::Quadrature;
pub use crate::scene::bricks::Bricks;
pub use crate::scene::camera::Camera;
pub use crate::scene::capture::{Capture, Frame, Model};
pub use crate::scene::film::Film;
pub use crate::scene::grid::Grid;
pub use crate::scene::medium::{Medium, Source};
pub use crate::scene::orbit::{self, Layout};
pub use crate::scene::scene::Scene;
pub use crate::scene::transfer::Transfer;
pub use crate::scene::up::Up;
pub use crate::scene::volume::Volume;
