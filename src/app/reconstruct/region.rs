//! Lattice and bounds of the unknown voxels of a reconstruction.

use crate::app::Context;
use crate::app::checks::{self, Warning};
use crate::app::ranges;
use crate::error::{Error, Result};
use crate::formats::vdb;
use crate::inverse::observation::Observation;
use crate::inverse::region::hull::{Hull, Survey};
use crate::inverse::region::lattice;
use crate::math::{Aabb, Affine};
use crate::scene::capture::Capture;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of the lattice and the bounds of the unknown voxels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RegionSettings {
    /// Edge of the voxels in world units; none for the capture's lattice, else a pixel's size in the volume.
    pub voxel_size: Option<f64>,
    /// Number of voxels along the longest edge of the region, 1 to 65536, in place of `voxel_size`.
    pub resolution: Option<u32>,
    /// Region in world space, its lowest and its highest corner; none for where no picture shows that there is nothing.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// Number of unknowns per pixel above which a warning is due.
const DOUBTFUL: f64 = 50.0;
/// Number of unknowns per pixel above which the pictures cannot determine the voxels.
const HOPELESS: f64 = 400.0;

/// The unknown voxels of a reconstruction.
#[derive(Debug)]
pub(super) struct Unknowns {
    /// Where they are, and how many.
    pub placed: Placed,
    /// Doubts about the region that do not keep the work from beginning.
    pub warnings: Vec<Warning>,
}

/// The place of unknown voxels.
#[derive(Debug)]
pub(super) struct Placed {
    /// Voxel lattice, index to world.
    pub lattice: Affine,
    /// World box of the unknowns.
    pub bounds: Aabb,
    /// Estimated numbers of voxels and bricks.
    pub survey: Survey,
    /// Remark on the size of the voxels.
    note: Option<String>,
}

impl Unknowns {
    /// Refuses a lattice that no VDB can hold, before the work.
    ///
    /// # Errors
    /// Those of [`vdb::writable`].
    pub(crate) fn writable(&self, output: &Path) -> Result<()> {
        vdb::writable(&self.placed.lattice).map_err(|e| {
            e.at(output).instead(
                "scale the scene up: multiply the positions in each 'transform_matrix', the lattice and ⟨voxel_size⟩ \
                 by a common factor, and divide density_scale by it",
            )
        })
    }
}

impl RegionSettings {
    /// Refuses values out of their ranges.
    ///
    /// # Errors
    /// If a value is none that its setting may have; the error names it.
    pub(super) fn check(&self) -> Result<()> {
        ranges::positive("voxel_size", self.voxel_size)?;
        ranges::within("resolution", self.resolution, [1, 65_536])?;
        let Some(bounds) = self.bounds else { return Ok(()) };
        let holds =
            (0..3).all(|a| bounds[0][a].is_finite() && bounds[1][a].is_finite() && bounds[0][a] <= bounds[1][a]);
        ranges::require("bounds", bounds, holds, "a lowest and a highest corner")
    }

    /// World box that is given for the region.
    fn stated_bounds(&self) -> Option<Aabb> {
        self.bounds.map(|[min, max]| Aabb { min: DVec3::from_array(min), max: DVec3::from_array(max) })
    }

    /// Chooses the lattice and the world box of the unknowns, from the settings or else from the capture and its visual
    /// hull.
    ///
    /// # Errors
    /// If the cameras contradict one another or the pictures leave nothing, or the lattice is not usable.
    pub(super) fn choose(&self, capture: &Capture, observation: &Observation, context: &Context) -> Result<Unknowns> {
        let _stage = context.stage("visual hull");
        // Within bounds that are given, views may well show only parts of the volume.
        let mut warnings = match self.bounds.is_some() {
            true => checks::warnings(checks::cameras::cameras(observation)),
            false => checks::refuse(checks::cameras::cameras(observation))?,
        };
        let placed = self.place(capture, observation)?;
        let Placed { lattice, bounds, survey, note } = &placed;
        if let Some(note) = note {
            context.note(note);
        }
        if self.voxel_size.is_none() && self.resolution.is_none() && capture.lattice.is_some() && survey.longest < 2.0 {
            return Err(Error::invalid(format!(
                "the capture's lattice has voxels of {}, and the region that the pictures show is only {} across",
                lattice.voxel_size().max_element(),
                bounds.size().max_element()
            ))
            .hint("correct 'lattice' in transforms.json, or give ⟨voxel_size⟩ or ⟨resolution⟩"));
        }
        warnings.extend(self.check_unknowns(survey, capture.pixels(), bounds)?);
        warnings.extend(checks::left_out::left_out(observation, bounds));
        Ok(Unknowns { placed, warnings })
    }

    /// Places the unknowns by what the observed pictures show, which may be some of the capture's, and estimates their
    /// numbers.
    ///
    /// # Errors
    /// If the pictures leave nothing, or the lattice is not usable.
    pub(super) fn place(&self, capture: &Capture, observation: &Observation) -> Result<Placed> {
        let hull = Hull::new(observation);
        let bounds = self.stated_bounds().map_or_else(|| hull.bounds(), Ok)?;
        let chosen = match (self.voxel_size, self.resolution) {
            (Some(size), _) => Some(size),
            (None, Some(count)) => Some(lattice::divided(&bounds, count)?),
            (None, None) => None,
        };
        let cameras = capture.frames.iter().map(|frame| &frame.camera);
        let footprint = || if capture.lattice.is_some() { None } else { lattice::footprint(cameras, &bounds) };
        let size = chosen.or_else(footprint);
        let lattice = lattice::choose(capture.lattice, size)?;
        let survey = hull.survey(&lattice, &bounds)?;
        let ratio = survey.unknowns / (capture.pixels().max(1)) as f64;
        let Some(size) = size.filter(|_| ratio > 1.0 && chosen.is_none() && observation.photographs()) else {
            return Ok(Placed { lattice, bounds, survey, note: None });
        };
        let larger = size * ratio.cbrt();
        let note = format!(
            "voxels of {larger:.4} in place of a pixel's {size:.4}: photographs determine no more unknowns than they \
             have pixels"
        );
        let lattice = lattice::choose(None, Some(larger))?;
        Ok(Placed { lattice, bounds, survey: hull.survey(&lattice, &bounds)?, note: Some(note) })
    }

    /// Warns of many more unknowns than measurements, and refuses far too many: a damaged camera or a wrong background
    /// leaves them.
    fn check_unknowns(&self, survey: &Survey, pixels: u64, bounds: &Aabb) -> Result<Option<Warning>> {
        let ratio = survey.unknowns / pixels.max(1) as f64;
        let what = format!(
            "{pixels} pixels stand against about {:.0} unknown voxels in a region of {:.4} x {:.4} x {:.4}",
            survey.unknowns,
            bounds.size().x,
            bounds.size().y,
            bounds.size().z
        );
        let remedy = "check cameras and background in transforms.json; of photographs, ⟨capture.convert.photographs⟩ \
                      measures the background; if they are right, give ⟨voxel_size⟩, ⟨resolution⟩ or ⟨bounds⟩";
        let user_chosen = self.voxel_size.is_some() || self.resolution.is_some() || self.bounds.is_some();
        match ratio {
            _ if ratio <= DOUBTFUL => Ok(None),
            _ if ratio <= HOPELESS || user_chosen => Ok(Some(Warning::new(what, remedy))),
            _ => Err(Error::invalid(what).hint(remedy)),
        }
    }
}
