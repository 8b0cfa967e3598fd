//! What a reconstruction costs, told by a few of its pictures before all are read.

use super::region::{Placed, RegionSettings};
use crate::app::checks::Warning;
use crate::app::{Context, photos};
use crate::differentiate::gradient::pictures::Target;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::inverse::cost::Cost;
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::observation::transmittances::{Channels, Transmittances};
use crate::inverse::pose::pyramid::halved;
use crate::ordered;
use crate::scene::capture::{Capture, Pictures};
use crate::scene::film::Film;
use crate::text::bytes as human;
use rayon::prelude::*;
use std::time::Instant;

/// Pixels of a capture from which on reading its pictures takes seconds.
const MANY: u64 = 1 << 24;
/// Number of pictures that are looked at (four may bound a region far too large), and how often they are halved: the
/// region need not be exact.
const FEW: usize = 8;
const HALVINGS: usize = 2;

/// The pictures of a capture, of which few are read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast<'c> {
    /// Cameras and paths of the pictures.
    pub capture: &'c Capture,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<&'c str>,
    /// Memory that the work may take.
    pub limits: Limits,
    /// Channels that tell the optical depths.
    pub channels: Channels,
}

impl Forecast<'_> {
    /// Tells what the reconstruction will cost, by `cost` of the unknowns and of a few observed pictures, and warns
    /// if that may not fit in memory. Captures that are read in a moment have no forecast, and neither have those of
    /// which a few pictures bound no region.
    ///
    /// # Errors
    /// If a picture cannot be read.
    pub(crate) fn tell(
        self,
        region: &RegionSettings,
        context: &Context,
        cost: impl FnOnce(&Observation, &Placed) -> Result<Cost>,
    ) -> Result<()> {
        let count = self.capture.frames.len();
        if self.capture.pixels() < MANY || count <= FEW {
            return Ok(());
        }
        let begun = Instant::now();
        let some: Vec<usize> = (0..FEW).map(|i| (2 * i + 1) * count / (2 * FEW)).collect();
        let read = ordered::try_map(some.par_iter(), |frame| self.transmittances(*frame))?;
        let reading = begun.elapsed().as_secs_f64() * count as f64 / FEW as f64;
        let observed = Observation::gather(read, self.channels);
        let placed = observed.and_then(|observed| Ok((region.place(self.capture, &observed)?, observed)));
        let Ok((placed, observed)) = placed else { return Ok(()) };
        let cost = cost(&observed, &placed)?;
        context.note(format!(
            "expected by {FEW} of the {count} pictures: {cost}, and {reading:.0} s to read the pictures"
        ));
        if let Err(error) = cost.fits(self.limits.max_memory) {
            let allowed = human(self.limits.max_memory);
            let what = format!("that may not fit in memory, of which {allowed} are allowed");
            context.warn(&[Warning::new(what, error.remedy().unwrap_or_default())]);
        }
        Ok(())
    }

    /// Reads the transmittances of a picture of a fraction of the size.
    fn transmittances(&self, frame: usize) -> Result<Transmittances> {
        let frame = &self.capture.frames[frame];
        let film = photos::picture(&frame.picture, self.layer, self.capture, self.limits)?;
        let mut camera = frame.camera;
        (camera.width, camera.height) = (film.width as u32, film.height as u32);
        let mut target = Target { camera, rgba: film.rgba, rays_per_edge: 1 };
        (0..HALVINGS).for_each(|_| target = halved(&target));
        let Target { camera, rgba, .. } = target;
        let photo = Photo {
            camera,
            film: Film::of(camera.width as usize, camera.height as usize, rgba),
            name: frame.picture.display().to_string(),
            photograph: self.capture.pictures == Some(Pictures::Photographs),
        };
        Ok(Transmittances::new(&photo, self.channels))
    }
}
