//! The view that a picture shows: its camera, and what moves from frame to frame.

use super::pixel::Motion;
use crate::math::Ray;
use crate::render::integrator::{First, Interaction};
use crate::scene::camera::Camera;
use crate::scene::holdout::Holdout;
use crate::scene::velocity::Velocity;
use glam::{DVec2, DVec3};

/// A camera, and where it stands in the frames before and after.
#[derive(Debug, Clone, Copy)]
pub struct View<'c> {
    /// Camera.
    pub camera: &'c Camera,
    /// Camera of the frame before, if there is one.
    pub before: Option<&'c Camera>,
    /// Camera of the frame after, if there is one.
    pub after: Option<&'c Camera>,
    /// Depths beyond which the camera sees nothing, if something stands in its way.
    pub holdout: Option<&'c Holdout>,
    /// Velocities of volumes, by the volume's number; others are at rest.
    pub velocities: &'c [(usize, Velocity)],
}

impl<'c> From<&'c Camera> for View<'c> {
    /// Creates the view of a picture that stands alone.
    fn from(camera: &'c Camera) -> Self {
        Self { camera, before: None, after: None, holdout: None, velocities: &[] }
    }
}

impl View<'_> {
    /// Returns a camera's ray, which was drawn at a place of the picture in pixels, up to what stands in its way.
    #[inline(always)]
    pub(super) fn held_out(&self, ray: Ray, place: DVec2) -> Ray {
        let far = self.holdout.map_or(f64::INFINITY, |holdout| holdout.far(self.camera, place, &ray));
        Ray { far, ..ray }
    }

    /// Returns how a collision that is seen at `now` moves in the picture with its volume. In a picture that is blurred
    /// it is the motion in a sharp one.
    pub(super) fn motion(&self, first: &First, now: DVec2) -> Motion {
        let seen = self.camera.project(first.position).filter(|_| !self.camera.blur.is_none());
        let now = seen.map_or(now, |(place, _)| place);
        let velocity = self.velocities.iter().find(|(volume, _)| first.interaction == Interaction::Volume(*volume));
        let goes = velocity.map_or(DVec3::ZERO, |(_, velocity)| velocity.per_frame(first.position));
        let from_now = |camera: Option<&Camera>, world: DVec3| {
            let place = camera.unwrap_or(self.camera).project(world).map_or(now, |(place, _)| place);
            DVec2::new(place.x - now.x, now.y - place.y)
        };
        let depth = |camera: &Camera, world: DVec3| (world - camera.position()).dot(camera.forward());
        let before = first.position - goes;
        Motion {
            before: from_now(self.before, before),
            after: -from_now(self.after, first.position + goes),
            depth_before: depth(self.before.unwrap_or(self.camera), before) - depth(self.camera, first.position),
        }
    }
}
