//! Cameras that the settings place.

use super::settings::PictureSettings;
use super::stage::SIZE;
use crate::app::pictured;
use crate::scene::camera::Camera;
use crate::scene::orbit;
use crate::scene::scene::Scene;
use crate::scene::up::Up;
use glam::DVec3;

impl PictureSettings {
    /// Returns the number of cameras that are to be placed; none where none are stated.
    pub(in crate::app) fn placed(&self) -> Option<u32> {
        self.aim.count().or(self.views)
    }

    /// Returns the position that cameras look at: the target that is stated, else the middle of the volumes.
    pub(in crate::app) fn focus(&self, scene: &Scene) -> Option<DVec3> {
        self.aim.target.map(DVec3::from).or_else(|| pictured::middle(scene))
    }

    /// Places cameras around the points: those that `aim` states, else `views` of them.
    pub(in crate::app) fn place(&self, points: &[DVec3], up: Up) -> Vec<Camera> {
        let [width, height] = self.size.unwrap_or(SIZE);
        if self.aim.count().is_some() {
            return self.aim.cameras(points, [width, height], self.fov, up);
        }
        orbit::cameras(points, self.views.unwrap_or(1) as usize, self.layout, width, height, self.fov, up)
    }
}
