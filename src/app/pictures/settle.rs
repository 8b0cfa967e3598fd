//! What must not change from frame to frame: cameras that are placed around a volume, the density scale of
//! `density_scale = auto`, and the effects that a plan keeps. They are taken once for a sequence, since each frame's
//! own would flicker.

use super::capture::Cameras;
use super::settings::DensityScale;
use super::settings::PictureSettings;
use super::subject::Subject;
use crate::app::Context;
use crate::app::provenance::Provenance;
use crate::app::volume::format_of;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::formats::format::FileKind;
use crate::formats::sequence::Pattern;
use crate::plan::Effect;
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use crate::scene::up::Up;
use glam::DVec3;
use std::path::PathBuf;

/// Number of frames that are looked at.
const FRAMES: usize = 5;

/// Values for all frames of a sequence; those that need not be settled are none.
#[derive(Debug, Default)]
pub(in crate::app) struct Settled {
    /// Cameras that are placed, cropped: one at rest, or those of a turn.
    pub cameras: Vec<Camera>,
    /// Extinction per unit of density.
    pub density_scale: Option<f64>,
    /// Effects that no frame leaves out.
    pub kept: Vec<Effect>,
    /// Frames that were looked at.
    pub frames: Vec<u32>,
}

impl PictureSettings {
    /// Settles what holds for all frames, from frames spread over the whole sequence, whichever of them are rendered
    /// now: parts that are rendered apart fit together. The scale is the smallest of theirs, so that the densest is not
    /// black; the camera sees all of them, and stands upright with respect to the axis `placed`; none for given
    /// cameras. A frame that cannot be read is not looked at, as it will fail by itself.
    ///
    /// # Errors
    /// If the part of a picture that is rendered does not lie in it.
    pub(in crate::app) fn settle(
        &self,
        pattern: Option<&Pattern>,
        numbers: &[u32],
        template: Option<&Capture>,
        placed: Option<Up>,
        cancel: &Cancel,
    ) -> Result<Settled> {
        let mut settled = Settled::default();
        let auto = self.density_scale == Some(DensityScale::Auto);
        let plans = self.planning.max_omitted > 0.0;
        let moves =
            pattern.is_some() || format_of(&self.input).is_ok_and(|format| matches!(format.kind, FileKind::Capture));
        if !moves || !(auto || placed.is_some() || plans) {
            return Ok(settled);
        }
        let all = pattern.and_then(|pattern| pattern.numbers().ok()).unwrap_or_else(|| numbers.to_vec());
        let mut outline = Vec::new();
        for number in evenly_spaced(&all) {
            let cameras = Cameras::Around(placed.unwrap_or_default());
            let _ = self.measure(pattern, number, (template, cameras, cancel), &mut settled, &mut outline);
        }
        if let Some(up) = placed.filter(|_| !outline.is_empty()) {
            let cameras = self.place(&outline, up).into_iter();
            settled.cameras = cameras.map(|camera| self.cropped(camera)).collect::<Result<_>>()?;
        }
        settled.density_scale = settled.density_scale.filter(|_| auto);
        Ok(settled)
    }

    /// Looks at a frame.
    fn measure(
        &self,
        pattern: Option<&Pattern>,
        number: u32,
        (template, cameras, cancel): (Option<&Capture>, Cameras<'_>, &Cancel),
        settled: &mut Settled,
        outline: &mut Vec<DVec3>,
    ) -> Result<()> {
        let mut pictures = self.clone();
        pictures.frame = Some(number);
        if let Some(pattern) = pattern {
            pictures.input = pattern.path(number);
        }
        let limits = pictures.limits;
        let (subject, transfer) = pictures.subject(template, limits, &mut Provenance::begin(&Context::default()))?;
        outline.extend(subject.outline(transfer.as_ref()));
        if subject.is_scene() {
            return Ok(());
        }
        let capture = pictures.capture(|name| PathBuf::from(name), &subject, transfer, template, cameras)?;
        let scale = capture.density_scale;
        settled.density_scale = Some(settled.density_scale.map_or(scale, |least| least.min(scale)));
        if self.planning.max_omitted > 0.0 && matches!(subject, Subject::Grids { .. }) {
            let plan = pictures.plan(&pictures.scene(&capture, subject)?, false, cancel)?;
            let kept = plan.effects.iter().map(|planned| planned.name).filter(|effect| plan.simulates(*effect));
            // Only what could be left out can be kept by force.
            settled.kept.extend(kept.filter(|effect| effect.to_string().parse::<Effect>().is_ok()));
        }
        settled.frames.push(number);
        Ok(())
    }
}

/// Returns numbers spread evenly over a sequence, the first and the last among them.
fn evenly_spaced(numbers: &[u32]) -> Vec<u32> {
    let count = numbers.len().min(FRAMES);
    let last = numbers.len().saturating_sub(1);
    (0..count).filter_map(|k| numbers.get(k * last / count.saturating_sub(1).max(1)).copied()).collect()
}

impl Settled {
    /// Returns the same with the camera and the scale of the capture that earlier runs wrote, which the rest of its
    /// frames must share. Effects are settled by the same frames in each run.
    pub(in crate::app) fn after(self, capture: &Capture) -> Self {
        let first = capture.frames.first().map(|frame| vec![frame.camera]);
        let cameras = first.unwrap_or(self.cameras);
        Self { cameras, density_scale: Some(capture.density_scale), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_over_the_sequence() {
        assert!(evenly_spaced(&[]).is_empty());
        assert_eq!(evenly_spaced(&[7]), [7]);
        assert_eq!(evenly_spaced(&[1, 2, 3]), [1, 2, 3]);
        assert_eq!(evenly_spaced(&(1..=101).collect::<Vec<_>>()), [1, 26, 51, 76, 101]);
    }
}
