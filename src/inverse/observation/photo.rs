//! A picture that is reconstructed from.

use crate::scene::camera::Camera;
use crate::scene::film::Film;

/// A camera and its picture.
#[derive(Debug, Clone)]
pub struct Photo {
    /// Camera of the picture.
    pub camera: Camera,
    /// Pixels of the picture.
    pub film: Film,
    /// Named in messages: the file.
    pub name: String,
    /// True for a picture of a real medium: its black is measured, and its light need not be exactly that of the
    /// medium's model.
    pub photograph: bool,
}
