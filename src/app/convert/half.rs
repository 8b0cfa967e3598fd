//! Values that are stored as 16-bit floats, and what these cannot hold.

use crate::error::Result;
use crate::formats::vdb::NativeGrid;
use crate::text::printable;
use half::f16;

/// True if the values of a type can be stored as 16-bit floats.
pub(crate) fn can_store(value_type: &str) -> bool {
    matches!(value_type, "float" | "double" | "vec3s" | "vec3d")
}

/// Number of finite values that become infinite as 16-bit floats, and number of values other than 0 that become 0.
///
/// # Errors
/// If OpenVDB cannot read the grid.
pub(crate) fn losses(native: &NativeGrid) -> Result<(u64, u64)> {
    let (mut overflow, mut underflow) = (0, 0);
    let mut count = |values: &[f32]| {
        for v in values.iter().filter(|v| v.is_finite()) {
            let h = f16::from_f32(*v);
            overflow += u64::from(h.is_infinite());
            underflow += u64::from(*v != 0.0 && h.to_f32() == 0.0);
        }
    };
    native.for_each_leaf(|leaf| {
        count(&leaf.values);
        true
    })?;
    native.tiles()?.iter().for_each(|tile| count(&tile.value));
    Ok((overflow, underflow))
}

/// Has the values of a new grid stored as 16-bit floats, and returns what that loses, one sentence each.
///
/// # Errors
/// If OpenVDB cannot read the grid.
pub(crate) fn store(native: &mut NativeGrid) -> Result<Vec<String>> {
    let name = printable(native.name()).into_owned();
    if !can_store(&native.info()?.value_type) {
        return Ok(vec![format!("grid '{name}': ⟨half⟩ has no effect on integers; give ⟨as=float⟩")]);
    }
    let (overflow, underflow) = losses(native)?;
    native.set_half(true)?;
    let sentences = [
        (overflow, "are too large for 16-bit floats and become infinite"),
        (underflow, "are too small for 16-bit floats and become 0"),
    ];
    let told = sentences.into_iter().filter(|(count, _)| *count > 0);
    Ok(told
        .map(|(count, what)| format!("grid '{name}': {count} values {what}; leave ⟨half⟩ out to keep them"))
        .collect())
}
