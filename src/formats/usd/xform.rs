//! Transforms of prims: the operations of `xformOpOrder`.
//!
//! Maps are of column vectors: the first operation of the order is the outermost, so that the product of the order from
//! left to right maps from the prim's space to its parent's.

use super::prim::Prim;
use super::value::Value;
use crate::error::{Error, Result};
use glam::{DMat3, DMat4, DQuat, DVec3};

/// Map from a prim's space to that of its parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Local {
    /// Map of column vectors.
    pub matrix: DMat4,
    /// True if the space is the stage's, not the parent's.
    pub resets: bool,
}

const RESET: &str = "!resetXformStack!";
const INVERSE: &str = "!invert!";

/// True if transform operations of a prim count: prims without a type and scopes have none.
pub(super) fn is_transformable(prim: &Prim) -> bool {
    prim.is_typed() && prim.type_name != "Scope"
}

/// Returns the map from a prim's space to that of its parent at a time code.
///
/// # Errors
/// If an operation is missing, unknown, has a value of another kind, or must be inverted and cannot.
pub(super) fn local(prim: &Prim, time: f64) -> Result<Local> {
    let mut local = Local { matrix: DMat4::IDENTITY, resets: false };
    let Some(order) = prim.value("xformOpOrder", time).filter(|_| is_transformable(prim)) else { return Ok(local) };
    for name in order.texts() {
        if name == RESET {
            // What stands before it has no effect.
            local = Local { matrix: DMat4::IDENTITY, resets: true };
            continue;
        }
        let (operation, inverse) = name.strip_prefix(INVERSE).map_or((name, false), |name| (name, true));
        let matrix = matrix(prim, operation, time)?;
        local.matrix *= match inverse {
            false => matrix,
            true if matrix.determinant().abs() > 0.0 => matrix.inverse(),
            true => {
                return Err(Error::invalid(format!("the operation '{operation}' is singular and cannot be inverted"))
                    .hint("correct the operation, or leave its inverse out of 'xformOpOrder'"));
            }
        };
    }
    if !local.matrix.is_finite() {
        return Err(
            Error::invalid("its transform is not finite").hint("correct the values of its 'xformOp' attributes")
        );
    }
    Ok(local)
}

/// Returns the matrix of an operation.
fn matrix(prim: &Prim, operation: &str, time: f64) -> Result<DMat4> {
    let kind = operation.strip_prefix("xformOp:").unwrap_or_default().split(':').next().unwrap_or_default();
    let Some(value) = prim.value(operation, time) else {
        return Err(Error::invalid(format!("'xformOpOrder' names '{operation}', which has no value"))
            .hint("give the attribute a value, or remove it from the order"));
    };
    of_kind(kind, &value).ok_or_else(|| {
        Error::unsupported(format!("the operation '{operation}' is unknown, or its value is of another kind"))
            .hint("write the transform with translate, scale, rotate…, orient or transform operations")
    })
}

/// Returns the matrix of a kind of operation; `None` if the kind is unknown or the value does not fit.
fn of_kind(kind: &str, value: &Value) -> Option<DMat4> {
    let vector = || value.tuple::<3>().map(DVec3::from_array);
    let along = |axis: DVec3| value.number().map(|v| axis * v);
    let about = |axis: DVec3| value.number().map(|degrees| DMat4::from_axis_angle(axis, degrees.to_radians()));
    match kind {
        "translate" => vector().map(DMat4::from_translation),
        "translateX" => along(DVec3::X).map(DMat4::from_translation),
        "translateY" => along(DVec3::Y).map(DMat4::from_translation),
        "translateZ" => along(DVec3::Z).map(DMat4::from_translation),
        "scale" => vector().map(scaling),
        "scaleX" => value.number().map(|v| scaling(DVec3::new(v, 1.0, 1.0))),
        "scaleY" => value.number().map(|v| scaling(DVec3::new(1.0, v, 1.0))),
        "scaleZ" => value.number().map(|v| scaling(DVec3::new(1.0, 1.0, v))),
        "rotateX" => about(DVec3::X),
        "rotateY" => about(DVec3::Y),
        "rotateZ" => about(DVec3::Z),
        "rotateXYZ" | "rotateXZY" | "rotateYXZ" | "rotateYZX" | "rotateZXY" | "rotateZYX" => {
            let angles = vector()?;
            // The axis that is named first turns first.
            let turn = kind["rotate".len()..].bytes().fold(DMat3::IDENTITY, |turn, axis| {
                let of = |axis: DVec3, degrees: f64| DMat3::from_axis_angle(axis, degrees.to_radians());
                let next = match axis {
                    b'X' => of(DVec3::X, angles.x),
                    b'Y' => of(DVec3::Y, angles.y),
                    _ => of(DVec3::Z, angles.z),
                };
                next * turn
            });
            Some(DMat4::from_mat3(turn))
        }
        "orient" => {
            let [w, x, y, z] = value.tuple::<4>()?;
            let q = DQuat::from_xyzw(x, y, z, w);
            (q.length() > 0.0).then(|| DMat4::from_quat(q.normalize()))
        }
        "transform" => value.matrix(),
        _ => None,
    }
}

/// Returns a scaling, which unlike glam's may be by 0.
fn scaling(by: DVec3) -> DMat4 {
    DMat4::from_mat3(DMat3::from_diagonal(by))
}
