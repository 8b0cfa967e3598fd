//! Volumes of stages: which file and grid each field is, and what it stands for.

use super::prim::Prim;
use super::stage::Stage;
use super::value::Asset;

/// Part that a field plays in its volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Density.
    Density,
    /// Temperature, by which black bodies emit.
    Temperature,
    /// Emission whatever the temperature.
    Flame,
    /// Velocity.
    Velocity,
    /// None that has an effect here.
    Other,
}

impl Role {
    /// Returns the name of the relationship that says the part without doubt.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Density => "density",
            Self::Temperature => "temperature",
            Self::Flame => "flame",
            Self::Velocity => "velocity",
            Self::Other => "other",
        }
    }
}

/// A field of a volume at a time code.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name of the relationship, without `field:`.
    pub name: String,
    /// Path of the field's prim.
    pub prim: String,
    /// Type of the prim; `OpenVDBAsset` for fields that can be read.
    pub type_name: String,
    /// File; `None` if the prim states none at this time.
    pub file: Option<Asset>,
    /// Name of the grid; empty for any.
    pub grid: String,
    /// Number among the grids of that name.
    pub index: Option<i64>,
    /// Role.
    pub role: Role,
}

impl Field {
    /// Returns the name of the grid in its file: with its number where one is stated, as files list grids of one name.
    pub(crate) fn grid_names(&self) -> [String; 2] {
        [format!("{}[{}]", self.grid, self.index.unwrap_or(0)), self.grid.clone()]
    }
}

/// True of the names of relationships of velocities.
pub(super) fn is_velocity(relationship: &str) -> bool {
    relationship.strip_prefix("field:").is_some_and(|name| role(name, "") == Role::Velocity)
}

/// Returns the role of a field by the name of its relationship, which shaders read it by, else by the name of its grid.
fn role(name: &str, grid: &str) -> Role {
    let of = |name: &str| match name.to_ascii_lowercase().as_str() {
        "density" | "smoke" | "extinction" => Role::Density,
        "temperature" | "temp" => Role::Temperature,
        "flame" | "flames" | "fire" | "heat" | "burn" | "emission" => Role::Flame,
        "velocity" | "velocities" | "vel" | "v" => Role::Velocity,
        _ => Role::Other,
    };
    match of(name) {
        Role::Other => of(grid),
        role => role,
    }
}

impl Stage {
    /// Returns the volumes, in their order.
    pub(crate) fn volumes(&self) -> impl Iterator<Item = &Prim> {
        self.of_type("Volume")
    }

    /// Returns the fields of a volume at a time code, by the names of their relationships. A volume with one field
    /// alone has it for its density, whatever its name. A relationship with several targets is no field, as in UsdVol.
    pub fn fields(&self, volume: &Prim, time: f64) -> Vec<Field> {
        let targets = volume.relationships.iter().filter_map(|(name, targets)| match &targets[..] {
            [target] => Some((name.strip_prefix("field:")?, target.as_str())),
            _ => None,
        });
        let field = |(name, target): (&str, &str)| {
            let prim = self.prim(target);
            let value = |attribute: &str| prim?.attribute(attribute)?.held_at(time);
            let grid = value("fieldName").and_then(|v| v.text().map(str::to_owned)).unwrap_or_default();
            Field {
                name: name.to_owned(),
                prim: target.to_owned(),
                type_name: prim.map(|prim| prim.type_name.clone()).unwrap_or_default(),
                file: value("filePath").and_then(|v| v.asset().cloned()).filter(|file| !file.authored.is_empty()),
                index: value("fieldIndex").and_then(|v| v.int()),
                role: role(name, &grid),
                grid,
            }
        };
        let mut fields: Vec<Field> = targets.map(field).collect();
        if let [only] = &mut fields[..]
            && only.role == Role::Other
        {
            only.role = Role::Density;
        }
        fields
    }

    /// Returns what keeps relationships of a volume from being fields, in words: more than one target.
    pub(crate) fn unclear_fields<'s>(&self, volume: &'s Prim) -> impl Iterator<Item = String> + 's {
        let several =
            volume.relationships.iter().filter(|(name, targets)| name.starts_with("field:") && targets.len() > 1);
        several.map(|(name, targets)| format!("{name} has {} targets, so that it is no field", targets.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_follow_the_names_of_relationships_first() {
        assert_eq!(role("density", "temperature"), Role::Density);
        assert_eq!(role("grid0", "Density"), Role::Density);
        assert_eq!(role("density", "heat"), Role::Density);
        assert_eq!(role("vel", "x"), Role::Velocity);
        assert_eq!(role("a", "b"), Role::Other);
    }
}
