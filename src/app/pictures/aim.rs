//! Cameras by the names of sides, by angles, or by positions.

use crate::app::ranges;
use crate::error::{Code, Error, Result};
use crate::scene::aim::{self, Bearing, Side, Stand, View};
use crate::scene::camera::{Camera, Projection};
use crate::scene::up::Up;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Settings of cameras by the names of sides, by angles or by positions; all open where cameras are placed otherwise.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AimSettings {
    /// Sides that cameras face, one view each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub from: Vec<Side>,
    /// Angle of the camera about the up axis in degrees: 0 is the front, 90 the right; none for 0 where `elevation` is
    /// stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub azimuth: Option<f64>,
    /// Angle of the camera above the horizontal plane in degrees, from -90 to 90; none for 0 where `azimuth` is stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elevation: Option<f64>,
    /// Distance in world units from the middle of the volume to a camera by `from`, `azimuth` or `elevation`; none for
    /// the one at which the volume's bounding sphere subtends `fov`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
    /// Position of the camera in the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye: Option<[f64; 3]>,
    /// Position in the world that a camera at `eye` looks at; none for the middle of the volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<[f64; 3]>,
    /// True for parallel rays in place of perspective.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub orthographic: bool,
}

impl AimSettings {
    /// Returns the number of views that are stated; none where there are none.
    pub(crate) fn count(&self) -> Option<u32> {
        let angles = self.azimuth.is_some() || self.elevation.is_some();
        let single = angles || self.eye.is_some();
        if self.from.is_empty() { single.then_some(1) } else { Some(self.from.len() as u32) }
    }

    /// Refuses values out of their ranges, and settings that contradict each other.
    ///
    /// # Errors
    /// If there is one.
    pub(crate) fn check(&self) -> Result<()> {
        let degrees = |setting: &str, value: Option<f64>, most: f64, expected: &str| {
            value.map_or(Ok(()), |v| ranges::require(setting, v, v.abs() <= most, expected))
        };
        degrees("azimuth", self.azimuth, 360.0, "an angle from -360 to 360 degrees")?;
        degrees("elevation", self.elevation, 90.0, "an angle from -90 to 90 degrees")?;
        ranges::positive("distance", self.distance)?;
        for (setting, position) in [("eye", self.eye), ("target", self.target)] {
            let holds = position.is_none_or(|p| p.iter().all(|v| v.abs() <= 1e15));
            ranges::require(setting, position, holds, "three numbers up to 1e15")?;
        }
        let angles = self.azimuth.is_some() || self.elevation.is_some();
        let aims = [!self.from.is_empty(), angles, self.eye.is_some()];
        let refused = |what: &str, remedy: &str| Err(Error::invalid(what).coded(Code::Usage).hint(remedy));
        if aims.iter().filter(|given| **given).count() > 1 {
            return refused(
                "a camera is stated in two ways",
                "give one of ⟨from⟩, ⟨azimuth⟩ with ⟨elevation⟩, and ⟨eye⟩",
            );
        }
        if self.target.is_some() && self.eye.is_none() {
            return refused("⟨target⟩ without ⟨eye⟩", "give ⟨eye⟩, the position of the camera, or leave ⟨target⟩ out");
        }
        if self.distance.is_some() && (self.eye.is_some() || self.count().is_none()) {
            return refused("⟨distance⟩ without a direction", "give ⟨from⟩, or ⟨azimuth⟩ and ⟨elevation⟩");
        }
        if self.orthographic && self.count().is_none() {
            return refused("⟨orthographic⟩ without a direction", "give ⟨from⟩, ⟨azimuth⟩ and ⟨elevation⟩, or ⟨eye⟩");
        }
        match (self.eye, self.target) {
            (Some(eye), Some(target)) if eye == target => {
                refused("⟨eye⟩ and ⟨target⟩ are the same position", "move one of them")
            }
            _ => Ok(()),
        }
    }

    /// Returns where the cameras stand.
    fn stands(&self, up: Up) -> Vec<Stand> {
        if let Some(eye) = self.eye {
            return vec![Stand::At { eye: eye.into(), target: self.target.map(DVec3::from), up }];
        }
        if self.from.is_empty() {
            let bearing = Bearing {
                azimuth: self.azimuth.unwrap_or_default(),
                elevation: self.elevation.unwrap_or_default(),
                up,
            };
            return vec![Stand::Around(bearing, self.distance)];
        }
        self.from.iter().map(|side| Stand::Around(side.bearing(up), self.distance)).collect()
    }

    /// Places the cameras that are stated around `points`.
    pub(crate) fn cameras(&self, points: &[DVec3], size: [u32; 2], field_of_view: f64, up: Up) -> Vec<Camera> {
        let projection = if self.orthographic { Projection::Orthographic } else { Projection::Perspective };
        aim::cameras(points, &self.stands(up), View { size, field_of_view, projection })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_are_refused() {
        type Change = fn(&mut AimSettings);
        let refused = |change: Change| {
            let mut aim = AimSettings::default();
            change(&mut aim);
            aim.check().err().map(|error| error.to_string()).unwrap_or_default()
        };
        let fine: [Change; 4] = [
            |_| {},
            |a| (a.from, a.distance, a.orthographic) = (vec![Side::Left, Side::Iso], Some(2.0), true),
            |a| (a.azimuth, a.elevation) = (Some(-200.0), Some(90.0)),
            |a| (a.eye, a.target) = (Some([1.0; 3]), Some([0.0; 3])),
        ];
        assert_eq!(fine.map(refused), [""; 4]);
        let wrong: [(Change, &str); 8] = [
            (|a| a.elevation = Some(91.0), "elevation"),
            (|a| a.azimuth = Some(f64::NAN), "azimuth"),
            (|a| (a.azimuth, a.distance) = (Some(1.0), Some(0.0)), "distance"),
            (|a| (a.from, a.azimuth) = (vec![Side::Left], Some(1.0)), "two ways"),
            (|a| a.target = Some([0.0; 3]), "eye"),
            (|a| a.distance = Some(1.0), "direction"),
            (|a| a.orthographic = true, "direction"),
            (|a| (a.eye, a.target) = (Some([1.0; 3]), Some([1.0; 3])), "same position"),
        ];
        for (change, part) in wrong {
            let error = refused(change);
            assert!(error.contains(part), "{part}: {error}");
        }
    }
}
