//! Lattice and bounds of the unknown voxels of a reconstruction.

use crate::cli::output::Output;
use crate::cli::parse;
use crate::error::{Error, Result};
use crate::formats::vdb;
use crate::math::{Aabb, Affine};
use crate::optimise::plausibility::{self, Warning};
use crate::optimise::projection::observation::Observation;
use crate::optimise::region::hull::{Hull, Survey};
use crate::optimise::region::lattice;
use crate::scene::capture::Capture;
use std::path::Path;

/// Options for the lattice and the bounds of the unknown voxels.
#[derive(Debug, clap::Args)]
pub(super) struct Region {
    /// Edge of the voxels in world units (default: the capture's lattice, else a pixel's size in the volume)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    voxel_size: Option<f64>,
    /// Voxels along the longest edge of the region instead
    #[arg(long, value_name = "N", conflicts_with = "voxel_size", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    resolution: Option<u32>,
    /// Region in world space, x0,y0,z0,x1,y1,z1; auto: where no picture shows that there is nothing
    #[arg(long, value_name = "auto|BOX", default_value = "auto", allow_hyphen_values = true, value_parser = bounds)]
    bounds: Bounds,
}

/// Number of unknowns per pixel above which a warning is due.
const DOUBTFUL: f64 = 50.0;
/// Number of unknowns per pixel above which the pictures cannot determine the voxels.
const HOPELESS: f64 = 400.0;

/// The unknown voxels of a reconstruction.
#[derive(Debug)]
pub(super) struct Unknowns {
    /// Voxel lattice, index to world.
    pub lattice: Affine,
    /// World box of the unknowns.
    pub bounds: Aabb,
    /// Estimated numbers of voxels and bricks.
    pub survey: Survey,
    /// Doubts about the region that do not keep the work from beginning.
    pub warnings: Vec<Warning>,
}

impl Unknowns {
    /// Refuses a lattice that no VDB can hold, before the work.
    ///
    /// # Errors
    /// Those of [`vdb::writable`].
    pub fn writable(&self, output: &Path) -> Result<()> {
        vdb::writable(&self.lattice).map_err(|e| {
            e.at(output).instead(
                "scale the scene up: multiply the positions in each 'transform_matrix', the lattice and --voxel-size by a \
                 common factor, and divide density_scale by it",
            )
        })
    }
}

/// `--bounds`.
#[derive(Debug, Clone, Copy)]
enum Bounds {
    Auto,
    Given(Aabb),
}

fn bounds(text: &str) -> Result<Bounds, String> {
    if text == "auto" { Ok(Bounds::Auto) } else { parse::corners(text).map(Bounds::Given) }
}

impl Region {
    /// Chooses the lattice and the world box of the unknowns, from the options or else from the capture and its visual
    /// hull.
    ///
    /// # Errors
    /// If the cameras contradict one another or the pictures leave nothing, or the lattice is not usable.
    pub fn choose(&self, capture: &Capture, observation: &Observation, output: &Output) -> Result<Unknowns> {
        let _stage = output.stage("visual hull");
        let mut warnings = match self.bounds {
            // With --bounds, views may well show only parts of the volume.
            Bounds::Given(_) => plausibility::warnings(plausibility::cameras(observation)),
            Bounds::Auto => plausibility::refuse(plausibility::cameras(observation))?,
        };
        let bounds = match self.bounds {
            Bounds::Given(bounds) => bounds,
            Bounds::Auto => Hull::new(observation).bounds()?,
        };
        let voxel_size = match (self.voxel_size, self.resolution) {
            (Some(size), _) => Some(size),
            (None, Some(count)) => Some(lattice::divided(&bounds, count)?),
            (None, None) if capture.lattice.is_some() => None,
            (None, None) => lattice::footprint(&observation.maps, &bounds),
        };
        let mut lattice = lattice::choose(capture.lattice, voxel_size)?;
        let mut survey = Hull::new(observation).survey(&lattice, &bounds)?;
        let pixels: usize = observation.maps.iter().map(|map| map.depth.len()).sum();
        let ratio = survey.unknowns / pixels.max(1) as f64;
        let chosen = self.voxel_size.is_some() || self.resolution.is_some();
        if let Some(size) = voxel_size.filter(|_| ratio > 1.0 && !chosen && observation.photographs()) {
            let larger = size * ratio.cbrt();
            output.note(format!(
                "voxels of {larger:.4} in place of a pixel's {size:.4}: photographs determine no more unknowns than they \
                 have pixels"
            ));
            lattice = lattice::choose(None, Some(larger))?;
            survey = Hull::new(observation).survey(&lattice, &bounds)?;
        }
        if voxel_size.is_none() && survey.longest < 2.0 {
            return Err(Error::invalid(format!(
                "the capture's lattice has voxels of {}, and the region that the pictures show is only {} across",
                lattice.voxel_size().max_element(),
                bounds.size().max_element()
            ))
            .hint("correct 'lattice' in transforms.json, or give --voxel-size or --resolution"));
        }
        warnings.extend(self.check_unknowns(&survey, observation, &bounds)?);
        Ok(Unknowns { lattice, bounds, survey, warnings })
    }

    /// Warns of many more unknowns than measurements, and refuses far too many: a damaged camera or a wrong background
    /// leaves them.
    fn check_unknowns(&self, survey: &Survey, observation: &Observation, bounds: &Aabb) -> Result<Option<Warning>> {
        let pixels: usize = observation.maps.iter().map(|m| m.depth.len()).sum();
        let ratio = survey.unknowns / pixels.max(1) as f64;
        let what = format!(
            "{pixels} pixels stand against about {:.0} unknown voxels in a region of {:.4} x {:.4} x {:.4}",
            survey.unknowns,
            bounds.size().x,
            bounds.size().y,
            bounds.size().z
        );
        let remedy = "check cameras and background in transforms.json; of photographs, `cumulo capture convert \
                      --photographs` measures the background; if they are right, give --voxel-size, --resolution or \
                      --bounds";
        let user_chosen =
            self.voxel_size.is_some() || self.resolution.is_some() || matches!(self.bounds, Bounds::Given(_));
        match ratio {
            _ if ratio <= DOUBTFUL => Ok(None),
            _ if ratio <= HOPELESS || user_chosen => Ok(Some(Warning::new(what, remedy))),
            _ => Err(Error::invalid(what).hint(remedy)),
        }
    }
}
