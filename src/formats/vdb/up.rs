//! The up axis of a file, from the metadata that programs leave in it. OpenVDB itself has no word for it.

use crate::scene::up::Up;

/// Key of the file's metadata under which a conversion states the up axis, "Y" or "Z".
pub(crate) const UP_KEY: &str = "cumulo_up";

/// Longest value that is looked at, in bytes.
const LONGEST: usize = 4096;

/// An up axis with what it was concluded from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatedUp {
    /// Axis that points upwards.
    pub up: Up,
    /// Metadata that says so, in words: `its creator is 'Houdini 20.5.654/GEO_VDBTranslator'`.
    pub reason: String,
}

/// Marks of the up axis in the metadata of a file and its grids, as far as they were looked at.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct UpMarks {
    /// Statement of a conversion.
    stated: Option<StatedUp>,
    /// Mark of a program that works with one axis.
    producer: Option<StatedUp>,
}

impl UpMarks {
    /// Looks at one entry of metadata. The first entry that says something counts.
    pub(crate) fn note(&mut self, name: &str, type_name: &str, value: &[u8]) {
        let text = (type_name == "string" && value.len() <= LONGEST).then(|| String::from_utf8_lossy(value));
        let found = |up, reason: String| Some(StatedUp { up, reason });
        match (name, text.as_deref()) {
            (UP_KEY, Some(axis @ ("Y" | "Z"))) if self.stated.is_none() => {
                let up = if axis == "Y" { Up::Y } else { Up::Z };
                self.stated = found(up, format!("its {UP_KEY} is '{axis}'"));
            }
            ("creator", Some(creator)) if self.producer.is_none() => {
                self.producer = of_creator(creator).and_then(|up| found(up, format!("its creator is '{creator}'")));
            }
            // Bifrost numbers its grids; it runs in Maya, which is Y-up.
            ("_bifrost_volume_index", _) if self.producer.is_none() => {
                self.producer = found(Up::Y, "a grid has the metadata of Maya's Bifrost".into());
            }
            _ => {}
        }
    }

    /// Returns the axis: that of a statement, else that of the program.
    pub(crate) fn conclusion(&self) -> Option<&StatedUp> {
        self.stated.as_ref().or(self.producer.as_ref())
    }
}

/// Up axis of the programs that write these creators: Houdini's exporters name themselves `Houdini
/// 20.5/GEO_VDBTranslator` or `Houdini/SOP_OpenVDB_Write`, Maya's `Maya/OpenVDB_Write_Node`, Blender's
/// `Blender/OpenVDBWriter`.
fn of_creator(creator: &str) -> Option<Up> {
    let creator = creator.to_ascii_lowercase();
    match creator.as_str() {
        c if c.starts_with("houdini") || c.starts_with("maya") || c.contains("bifrost") => Some(Up::Y),
        c if c.starts_with("blender") || c.contains("mantaflow") => Some(Up::Z),
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn programs_are_known_by_their_marks_and_a_statement_outdoes_them() {
        let of = |entries: &[(&str, &str, &str)]| {
            let mut marks = UpMarks::default();
            entries.iter().for_each(|(name, kind, value)| marks.note(name, kind, value.as_bytes()));
            marks.conclusion().cloned()
        };
        let creator = |text| of(&[("creator", "string", text)]).map(|stated| stated.up);
        assert_eq!(creator("Houdini 20.5.654/GEO_VDBTranslator"), Some(Up::Y));
        assert_eq!(creator("Houdini/SOP_OpenVDB_Write"), Some(Up::Y));
        assert_eq!(creator("Maya/OpenVDB_Write_Node"), Some(Up::Y));
        assert_eq!(creator("Blender/OpenVDBWriter"), Some(Up::Z));
        assert_eq!(creator("a program of our own"), None);
        assert_eq!(of(&[("_bifrost_volume_index", "int32", "\0\0\0\0")]).unwrap().up, Up::Y);
        let both = of(&[("creator", "string", "Houdini 19"), (UP_KEY, "string", "Z")]).unwrap();
        assert_eq!((both.up, both.reason.as_str()), (Up::Z, "its cumulo_up is 'Z'"));
        // Neither another type nor another value counts.
        assert_eq!(of(&[(UP_KEY, "int32", "Z"), (UP_KEY, "string", "X"), ("creator", "int32", "Houdini")]), None);
    }
}
