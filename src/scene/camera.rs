//! Pinhole and orthographic cameras with shift and non-square pixels.
//!
//! A camera looks down its own -Z with +Y up and +X right, as in Blender, USD and `transforms.json`.
//! Pixel (0, 0) is the top left one and its centre lies at (0.5, 0.5).

use crate::error::{Error, Result};
use crate::math::Ray;
use crate::scene::blur::Blur;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};

/// Mapping from pixels to rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Projection {
    /// Rays leave the camera's origin; focal lengths are in pixels.
    Perspective,
    /// Rays are parallel; focal lengths are in pixels per world unit.
    Orthographic,
}

/// A camera and its image raster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Rigid motion from camera to world: column vectors of unit length.
    pub camera_to_world: DMat4,
    /// Mapping from pixels to rays.
    pub projection: Projection,
    /// Focal length along x and y: pixels (perspective) or pixels per world unit (orthographic).
    pub focal: DVec2,
    /// Principal point in pixels, from the top left corner.
    pub centre: DVec2,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// World-space distance along the viewing axis to the near plane; nothing closer is rendered.
    pub near: f64,
    /// Aperture and shutter. [`Camera::ray`] and all that follows from it are those of a sharp picture.
    pub blur: Blur,
}

/// Derivatives of a loss with respect to a camera's parameters, or a step of these parameters ([`Camera::moved`]).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraGradient {
    /// Component for the position, in world units.
    pub position: DVec3,
    /// Component for a rotation about the position: a rotation vector along world axes, in radians.
    pub rotation: DVec3,
    /// Component for the focal lengths along x and y, in the units of [`Camera::focal`].
    pub focal: DVec2,
    /// Component for the principal point, in pixels.
    pub centre: DVec2,
}

impl CameraGradient {
    /// Componentwise sum.
    #[must_use]
    pub fn plus(&self, o: &Self) -> Self {
        Self {
            position: self.position + o.position,
            rotation: self.rotation + o.rotation,
            focal: self.focal + o.focal,
            centre: self.centre + o.centre,
        }
    }
}

/// A part of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Window {
    /// Column and row of its first pixel.
    pub origin: [u32; 2],
    /// Width and height in pixels.
    pub size: [u32; 2],
}

impl Camera {
    /// Returns the camera of a part of the picture.
    ///
    /// # Errors
    /// If the part is not within the picture.
    pub fn cropped(self, Window { origin, size }: Window) -> Result<Self> {
        let whole = [self.width, self.height];
        if (0..2).any(|a| origin[a].checked_add(size[a]).is_none_or(|end| end > whole[a])) {
            let [[x, y], [w, h]] = [origin, size];
            return Err(Error::invalid(format!(
                "the part {x},{y},{w}x{h} is not within a picture of {}x{} pixels",
                whole[0], whole[1]
            ))
            .hint("give a part that is: column and row of its first pixel count from 0"));
        }
        let [x, y] = origin.map(f64::from);
        Ok(Self { centre: self.centre - DVec2::new(x, y), width: size[0], height: size[1], ..self })
    }

    /// Returns the camera with another size of picture. Focal lengths scale along, so that the whole picture stays in
    /// view; where the proportions differ, it is in the middle of the new one, which shows more to both sides.
    #[must_use]
    pub fn resized(self, [width, height]: [u32; 2]) -> Self {
        let old = DVec2::new(f64::from(self.width), f64::from(self.height));
        let new = DVec2::new(f64::from(width), f64::from(height));
        let factor = (new / old).min_element();
        let centre = factor * self.centre + 0.5 * (new - factor * old);
        Self { focal: factor * self.focal, centre, width, height, ..self }
    }

    /// Checks every number and normalises the columns of the motion, since files often carry a scale.
    ///
    /// # Errors
    /// If the motion is not finite and affine or its axes are not orthogonal to 1e-3, if focal lengths, principal point
    /// or near distance cannot be used, or if an image side is outside 1 to 65536.
    pub fn checked(mut self) -> Result<Self> {
        let m = self.camera_to_world;
        // Products of matrices leave some rounding in the last row.
        if !(m.is_finite() && m.row(3).abs_diff_eq(glam::DVec4::W, 1e-9)) {
            return Err(Error::invalid("camera-to-world matrix is not a finite affine map")
                .hint("give a 4x4 matrix, row by row, whose last row is 0 0 0 1"));
        }
        let lengths = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
        if lengths.iter().any(|l| !(1e-12..1e12).contains(l)) {
            return Err(Error::invalid(format!("camera-to-world matrix has columns of length {lengths:?}")));
        }
        let axes = DMat3::from_cols(
            m.x_axis.truncate() / lengths[0],
            m.y_axis.truncate() / lengths[1],
            m.z_axis.truncate() / lengths[2],
        );
        let skew =
            (axes.transpose() * axes - DMat3::IDENTITY).to_cols_array().iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        // Six decimals, as many tools write them, leave a skew of 2e-6.
        if skew > 1e-3 {
            return Err(Error::invalid(format!(
                "camera axes are not orthogonal (off by {skew:.2e}, at most 1e-3 expected)"
            )));
        }
        self.camera_to_world = DMat4::from_mat3_translation(axes, m.w_axis.truncate());
        if !(self.focal.x > 0.0 && self.focal.y > 0.0 && self.focal.is_finite() && self.centre.is_finite()) {
            return Err(Error::invalid(format!(
                "focal length {} x {} px with principal point {} cannot be used; positive finite numbers are needed",
                self.focal.x, self.focal.y, self.centre
            )));
        }
        if self.width == 0 || self.height == 0 || self.width > 65_536 || self.height > 65_536 {
            return Err(Error::invalid(format!("image size {}x{} is outside 1..65536", self.width, self.height)));
        }
        if !(self.near >= 0.0 && self.near.is_finite()) {
            return Err(Error::invalid(format!("near distance {} must be finite and not negative", self.near)));
        }
        if let Some(shutter) = &mut self.blur.shutter {
            for moved in [&mut shutter.start, &mut shutter.end] {
                let camera = Self { camera_to_world: *moved, blur: Blur::default(), ..self };
                *moved = camera.checked().map_err(|e| e.part("motion while the shutter is open"))?.camera_to_world;
                if moved.determinant() * m.determinant() < 0.0 {
                    return Err(Error::invalid("the camera is mirrored while its shutter is open")
                        .hint("correct its axes, or give ⟨shutter=0⟩ for pictures without motion"));
                }
            }
        }
        self.blur = self.blur.checked()?;
        Ok(self)
    }

    /// World-space ray through image position `(x, y)` in pixels, with a direction of unit length. It starts at the
    /// near plane.
    #[inline(always)]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let px = (x - self.centre.x) / self.focal.x;
        let py = (self.centre.y - y) / self.focal.y;
        let (origin, direction) = match self.projection {
            Projection::Perspective => {
                let d = DVec3::new(px, py, -1.0);
                (self.near * d, d.normalize())
            }
            Projection::Orthographic => (DVec3::new(px, py, -self.near), DVec3::NEG_Z),
        };
        Ray::new(self.camera_to_world.transform_point3(origin), self.camera_to_world.transform_vector3(direction))
    }

    /// World-space ray of unit direction towards image position `(x, y)` in pixels, through the point of the aperture
    /// that two numbers in [0, 1) stand for, at a time from 0, as the shutter opens, to 1, as it closes. It starts at
    /// the near plane. All rays of a position meet at the distance of focus, if the camera stands still.
    pub(crate) fn blurred_ray(&self, [x, y]: [f64; 2], aperture: [f64; 2], time: f64) -> Ray {
        let shutter = self.blur.shutter.map(|shutter| shutter.at(self.camera_to_world, time));
        let camera_to_world = shutter.unwrap_or(self.camera_to_world);
        let Some((point, focus)) = self.blur.point(aperture) else {
            return Ray { time, ..Self { camera_to_world, ..*self }.ray(x, y) };
        };
        let plane = DVec2::new((x - self.centre.x) / self.focal.x, (self.centre.y - y) / self.focal.y);
        let (from, sharp) = match self.projection {
            Projection::Perspective => (point, focus * plane),
            Projection::Orthographic => (plane + point, plane),
        };
        let along = ((sharp - from) / focus).extend(-1.0);
        let origin = camera_to_world.transform_point3(from.extend(0.0) + self.near * along);
        Ray { time, ..Ray::new(origin, camera_to_world.transform_vector3(along.normalize())) }
    }

    /// Derivatives of a loss with respect to the camera, from those with respect to the origin and direction of the
    /// camera's ray through `(x, y)`.
    pub fn gradient(&self, x: f64, y: f64, by_origin: DVec3, by_direction: DVec3) -> CameraGradient {
        let ray = self.ray(x, y);
        let turned = (ray.origin - self.position()).cross(by_origin) + ray.direction.cross(by_direction);
        // Derivatives in the camera's axes, and those with respect to the coordinates on its image plane.
        let to_camera = |v: DVec3| self.camera_to_world.transpose().transform_vector3(v);
        let (origin, direction) = (to_camera(by_origin), to_camera(by_direction));
        let plane = DVec2::new((x - self.centre.x) / self.focal.x, (self.centre.y - y) / self.focal.y);
        let by_plane = match self.projection {
            Projection::Perspective => {
                let d = plane.extend(-1.0);
                let unit = d.normalize();
                (self.near * origin + (direction - unit * unit.dot(direction)) / d.length()).truncate()
            }
            Projection::Orthographic => origin.truncate(),
        };
        let by_centre = by_plane * DVec2::new(-1.0, 1.0) / self.focal;
        CameraGradient {
            position: by_origin,
            rotation: turned,
            focal: -by_plane * plane / self.focal,
            centre: by_centre,
        }
    }

    /// Change of the origin and direction of the ray through `(x, y)` under a small step `by` of the camera
    /// ([`Camera::moved`]): the transpose of [`Camera::gradient`].
    pub fn tangent(&self, x: f64, y: f64, by: &CameraGradient) -> Ray {
        let ray = self.ray(x, y);
        let plane = DVec2::new((x - self.centre.x) / self.focal.x, (self.centre.y - y) / self.focal.y);
        let plane_moved = ((by.centre * DVec2::new(-1.0, 1.0) - plane * by.focal) / self.focal).extend(0.0);
        let (origin, direction) = match self.projection {
            Projection::Perspective => {
                let d = plane.extend(-1.0);
                let unit = d.normalize();
                (self.near * plane_moved, (plane_moved - unit * unit.dot(plane_moved)) / d.length())
            }
            Projection::Orthographic => (plane_moved, DVec3::ZERO),
        };
        let to_world = |v: DVec3| self.camera_to_world.transform_vector3(v);
        Ray::new(
            by.position + by.rotation.cross(ray.origin - self.position()) + to_world(origin),
            by.rotation.cross(ray.direction) + to_world(direction),
        )
    }

    /// The camera after a step: translated, rotated about its position by a rotation vector (world axes, radians), with
    /// focal lengths and principal point changed.
    #[must_use]
    pub fn moved(mut self, by: &CameraGradient) -> Self {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(by.rotation));
        let axes = turn * DMat3::from_mat4(self.camera_to_world);
        self.camera_to_world = DMat4::from_mat3_translation(axes, self.position() + by.position);
        self.focal += by.focal;
        self.centre += by.centre;
        self
    }

    /// The rotation that turns this camera's axes into those of another one: a rotation vector along world axes.
    pub fn rotation_to(&self, to: &Self) -> DVec3 {
        let axes = |camera: &Self| DMat3::from_mat4(camera.camera_to_world);
        DQuat::from_mat3(&(axes(to) * axes(self).transpose())).to_scaled_axis()
    }

    /// How far points lie apart in the pictures of this camera and another one: the root mean square in pixels; `None`
    /// if both see none of them.
    pub fn displacement(&self, to: &Self, points: &[DVec3]) -> Option<f64> {
        let apart = |point: &DVec3| Some(self.project(*point)?.0.distance_squared(to.project(*point)?.0));
        let squares: Vec<f64> = points.iter().filter_map(apart).collect();
        (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }

    /// Image position of a world point in pixels, and the point's distance along the viewing axis. `None` for points at
    /// or behind a perspective camera.
    pub fn project(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let m = &self.camera_to_world;
        let rel = world - m.w_axis.truncate();
        let p = DVec3::new(rel.dot(m.x_axis.truncate()), rel.dot(m.y_axis.truncate()), -rel.dot(m.z_axis.truncate()));
        let plane = match self.projection {
            Projection::Perspective if p.z <= 0.0 => return None,
            Projection::Perspective => DVec2::new(p.x, p.y) / p.z,
            Projection::Orthographic => DVec2::new(p.x, p.y),
        };
        Some((DVec2::new(self.centre.x + self.focal.x * plane.x, self.centre.y - self.focal.y * plane.y), p.z))
    }

    /// World length of a pixel at a point, by the finer of the picture's two directions; `None` for points at or behind
    /// a perspective camera.
    pub fn pixel_size_at(&self, world: DVec3) -> Option<f64> {
        let (_, depth) = self.project(world)?;
        let pixels = self.focal.max_element();
        Some(match self.projection {
            Projection::Perspective => depth / pixels,
            Projection::Orthographic => 1.0 / pixels,
        })
    }

    /// Position of the camera in world space.
    pub fn position(&self) -> DVec3 {
        self.camera_to_world.w_axis.truncate()
    }

    /// Unit viewing direction in world space.
    pub fn forward(&self) -> DVec3 {
        -self.camera_to_world.z_axis.truncate()
    }

    /// Camera-to-world motion of a camera at `eye` that looks at `target`. Where the view is parallel to `up`, an
    /// arbitrary up vector is chosen.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> DMat4 {
        let back = (eye - target).normalize();
        let up = if up.cross(back).length() < 1e-6 * up.length() { back.any_orthogonal_vector() } else { up };
        let right = up.cross(back).normalize();
        DMat4::from_mat3_translation(DMat3::from_cols(right, back.cross(right), back), eye)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::blur::{Aperture, Shutter};

    fn camera(projection: Projection) -> Camera {
        Camera {
            camera_to_world: Camera::look_at(DVec3::new(3.0, -2.0, 1.5), DVec3::new(0.1, 0.2, 0.3), DVec3::Z),
            projection,
            focal: DVec2::new(90.0, 110.0),
            centre: DVec2::new(33.0, 20.5),
            width: 64,
            height: 48,
            near: 0.25,
            blur: Blur::default(),
        }
    }

    #[test]
    fn projection_inverts_the_ray() {
        for p in [Projection::Perspective, Projection::Orthographic] {
            let c = camera(p).checked().unwrap();
            for (x, y) in [(0.5, 0.5), (63.5, 0.5), (12.25, 47.5), (33.0, 20.5)] {
                let (pixel, depth) = c.project(c.ray(x, y).at(2.5)).unwrap();
                assert!((pixel - DVec2::new(x, y)).length() < 1e-10, "{p:?} {pixel}");
                assert!(depth > c.near);
            }
        }
    }

    /// Rays through all of the aperture meet where it is focussed, and start at the near plane; the picture of a point
    /// elsewhere is as large as similar triangles say.
    #[test]
    fn rays_through_an_aperture_meet_at_the_distance_of_focus() {
        for p in [Projection::Perspective, Projection::Orthographic] {
            let blur = Blur { aperture: Some(Aperture::disc(0.3, 2.0)), shutter: None };
            let c = Camera { blur, ..camera(p) }.checked().unwrap();
            let sharp = c.ray(12.25, 40.0);
            let depth = |v: DVec3| v.dot(c.forward());
            let at = |ray: &Ray, z: f64| ray.at((z - depth(ray.origin - c.position())) / depth(ray.direction));
            for aperture in [[0.1, 0.2], [0.9, 0.4], [0.5, 0.99]] {
                let ray = c.blurred_ray([12.25, 40.0], aperture, 0.5);
                assert!((depth(ray.origin - c.position()) - c.near).abs() < 1e-12);
                assert!((ray.direction.length() - 1.0).abs() < 1e-12);
                assert!(at(&ray, 2.0).abs_diff_eq(at(&sharp, 2.0), 1e-12), "{p:?}");
                // Twice as far as the focus the rays are as far apart as in the aperture.
                let (apart, point) = (at(&ray, 4.0) - at(&sharp, 4.0), at(&ray, 0.0) - at(&sharp, 0.0));
                assert!(apart.abs_diff_eq(-point, 1e-12) && point.length() > 0.05 && point.length() <= 0.3);
            }
        }
    }

    #[test]
    fn a_camera_moves_while_its_shutter_is_open() {
        let still = camera(Projection::Perspective).checked().unwrap();
        let moved = |x: f64| DMat4::from_translation(DVec3::new(x, 0.0, 0.0)) * still.camera_to_world;
        let shutter = Some(Shutter { start: moved(-1.0), end: moved(1.0), open: None });
        let c = Camera { blur: Blur { aperture: None, shutter }, ..still }.checked().unwrap();
        for (time, x) in [(0.0, -1.0), (0.25, -0.5), (0.5, 0.0), (0.75, 0.5)] {
            let (ray, expected) = (c.blurred_ray([5.5, 7.5], [0.0; 2], time), still.ray(5.5, 7.5));
            assert!(ray.origin.abs_diff_eq(expected.origin + DVec3::new(x, 0.0, 0.0), 1e-12), "{time}");
            assert!(ray.direction.abs_diff_eq(expected.direction, 1e-12), "{time}");
        }
        let sheared =
            Shutter { start: moved(0.0), end: DMat4::from_scale(DVec3::new(1.0, 1.0, 2.0)) * moved(0.0), open: None };
        let c = Camera { blur: Blur { aperture: None, shutter: Some(sheared) }, ..still };
        assert!(c.checked().unwrap_err().to_string().contains("shutter"));
    }

    #[test]
    fn resizing_keeps_the_whole_picture_in_the_middle() {
        let c = camera(Projection::Perspective);
        // Twice as large, and 32 columns more on each side.
        let wide = c.resized([192, 96]);
        for corner in [DVec2::ZERO, DVec2::new(64.0, 48.0), DVec2::new(10.0, 40.0)] {
            let (pixel, _) = wide.project(c.ray(corner.x, corner.y).at(3.0)).unwrap();
            assert!((pixel - (2.0 * corner + DVec2::new(32.0, 0.0))).length() < 1e-9, "{pixel}");
        }
        assert_eq!((wide.width, wide.height), (192, 96));
        assert_eq!(c.resized([64, 48]), c);
    }

    #[test]
    fn gradients_match_central_differences() {
        let (o, d) = (DVec3::new(0.3, -1.2, 0.7), DVec3::new(-0.4, 0.9, 1.1));
        for p in [Projection::Perspective, Projection::Orthographic] {
            let c = camera(p).checked().unwrap();
            let g = c.gradient(12.25, 30.5, o, d);
            let loss = |c: Camera| {
                let ray = c.ray(12.25, 30.5);
                ray.origin.dot(o) + ray.direction.dot(d)
            };
            let check = |expected: f64, set: &dyn Fn(&mut CameraGradient, f64)| {
                let at = |h: f64| {
                    let mut step = CameraGradient::default();
                    set(&mut step, h);
                    loss(c.moved(&step))
                };
                let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((difference - expected).abs() < 1e-8, "{p:?} {difference} {expected}");
            };
            for a in 0..3 {
                check(g.position[a], &|s, h| s.position[a] = h);
                check(g.rotation[a], &|s, h| s.rotation[a] = h);
            }
            for a in 0..2 {
                check(g.focal[a], &|s, h| s.focal[a] = h);
                check(g.centre[a], &|s, h| s.centre[a] = h);
            }
        }
    }

    /// The product with the tangent and the gradient agree: `⟨J v, w⟩ = ⟨v, Jᵀ w⟩`.
    #[test]
    fn the_gradient_is_the_tangents_transpose() {
        let v = CameraGradient {
            position: DVec3::new(0.3, -0.2, 0.7),
            rotation: DVec3::new(-0.5, 0.4, 0.1),
            focal: DVec2::new(3.0, -2.0),
            centre: DVec2::new(0.7, 1.9),
        };
        let (o, d) = (DVec3::new(0.3, -1.2, 0.7), DVec3::new(-0.4, 0.9, 1.1));
        for p in [Projection::Perspective, Projection::Orthographic] {
            let c = camera(p).checked().unwrap();
            for (x, y) in [(12.25, 30.5), (63.5, 0.5), (33.0, 20.5)] {
                let (moved, g) = (c.tangent(x, y, &v), c.gradient(x, y, o, d));
                let left = moved.origin.dot(o) + moved.direction.dot(d);
                let right = g.position.dot(v.position)
                    + g.rotation.dot(v.rotation)
                    + g.focal.dot(v.focal)
                    + g.centre.dot(v.centre);
                // Some twenty products of order 1 to 10 are summed.
                assert!((left - right).abs() < 1e-14, "{p:?} {left} {right}");
            }
        }
    }

    #[test]
    fn a_scaled_matrix_is_normalised_and_a_sheared_one_refused() {
        let mut c = camera(Projection::Perspective);
        c.camera_to_world *= DMat4::from_scale(DVec3::splat(7.0));
        let n = c.checked().unwrap();
        assert!((n.forward().length() - 1.0).abs() < 1e-12);
        c.camera_to_world.x_axis += 0.1 * c.camera_to_world.y_axis;
        assert!(c.checked().unwrap_err().to_string().contains("orthogonal"));
    }
}
