//! Maps from indices to the world, as files state them.

use super::image::Values;
use crate::error::{Error, Result};
use crate::math::Affine;
use glam::{DMat4, DVec3};

/// Map of images whose axes are left, posterior, superior (LPS: DICOM, ITK) to those of this crate, right, anterior,
/// superior (RAS); and the other way round.
pub(crate) fn swap_lps_ras(map: DMat4) -> DMat4 {
    let mut rows = map.transpose();
    // Subtracted from 0, so that no zero becomes negative.
    for row in [&mut rows.x_axis, &mut rows.y_axis] {
        *row = -*row + 0.0;
    }
    rows.transpose()
}

/// Note that vectors of an image whose axes were brought to right, anterior, superior were not; none for scalars, and
/// for integers, which are colors.
pub(crate) fn unturned(values: Values, components: usize) -> Option<String> {
    let vectors = components == 3 && values == Values::Real;
    vectors.then(|| "the components of vectors stay as they are, along the axes of the file's space".into())
}

/// Map with these columns, one for each index axis, and this position of the first voxel's centre.
///
/// # Errors
/// If an entry is not finite, or the columns do not span space.
pub(crate) fn affine(columns: [DVec3; 3], origin: DVec3) -> Result<Affine> {
    let [x, y, z] = columns.map(|c| c.extend(0.0));
    checked(DMat4::from_cols(x, y, z, origin.extend(1.0)))
}

/// Checked map of a file.
///
/// # Errors
/// If an entry is not finite, or the columns do not span space.
pub(crate) fn checked(map: DMat4) -> Result<Affine> {
    Affine::new(map).map_err(|e| {
        Error::invalid(format!("the placement of the voxels cannot be used: {}", e.what()))
            .instead("correct the spacing and the directions in the file's header, or write it again where it was made")
    })
}

/// Checks the edge of a voxel, or another distance that a format has as a number above 0. `name` is that of the field.
///
/// # Errors
/// If it is 0, negative, infinite or no number.
pub(crate) fn edge(name: &str, value: f64) -> Result<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(Error::invalid(format!("{name} is {value}; a finite number above 0 is expected"))
        .hint("correct the file's header, or write the file again where it was made"))
}

/// Checks the edges of a voxel, which the field `name` has.
///
/// # Errors
/// If one of them is 0, negative, infinite or no number.
pub(crate) fn edges(name: &str, values: DVec3) -> Result<DVec3> {
    values.to_array().iter().try_for_each(|value| edge(&format!("a number of {name}"), *value).map(drop))?;
    Ok(values)
}

/// Moves a map so that its first voxel is another: index `shift` of `map` becomes index 0.
///
/// # Errors
/// If the position overflows.
pub(crate) fn shifted(map: &Affine, shift: DVec3) -> Result<Affine> {
    checked(map.matrix() * DMat4::from_translation(shift))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn edges_are_finite_and_above_zero() {
        assert_eq!(edge("e", 0.5).unwrap(), 0.5);
        for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = edge("the edge", value).unwrap_err();
            assert!(error.to_string().starts_with("the edge is ") && error.remedy().is_some(), "{error}");
        }
    }

    #[test]
    fn axes_swap_there_and_back_and_zeros_stay_positive() {
        let map =
            DMat4::from_cols_array(&[2.0, 0.0, 1.0, 0.0, 0.5, 3.0, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 7.0, -8.0, 9.0, 1.0]);
        let swapped = swap_lps_ras(map);
        assert_eq!(swapped.transform_point3(DVec3::ZERO), DVec3::new(-7.0, 8.0, 9.0));
        assert_eq!(swap_lps_ras(swapped), map);
        assert!(swapped.to_cols_array().iter().all(|v| *v != 0.0 || v.is_sign_positive()));
        assert!(affine([DVec3::X, DVec3::X, DVec3::Z], DVec3::ZERO).unwrap_err().to_string().contains("header"));
    }
}
