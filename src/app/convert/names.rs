//! Names by which programs know the grids of a volume.

/// Program whose names grids are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Convention {
    /// Blender: density, temperature, flame, color, velocity.
    Blender,
    /// Houdini: density, temperature, flame, Cd, vel.
    Houdini,
    /// Arnold: density, temperature; it has no names of its own for the others.
    Arnold,
    /// Karma: density, temperature, flame, Cd, vel.
    Karma,
}

/// Names that mean the same, in lower case, and how Blender, Houdini, Arnold and Karma spell them. Arnold's
/// `standard_volume` has default channels for density and temperature alone. Sources:
/// - Blender, Principled Volume:
///   <https://docs.blender.org/manual/en/latest/render/shader_nodes/shader/volume_principled.html>
/// - Houdini, Pyro Solver: <https://www.sidefx.com/docs/houdini/nodes/dop/pyrosolver-.html>
/// - Karma, Pyro Shader: <https://www.sidefx.com/docs/houdini/nodes/vop/kma_pyroshader.html>
const ROLES: [(&[&str], [Option<&str>; 4]); 5] = [
    (&["density"], [Some("density"); 4]),
    (&["temperature"], [Some("temperature"); 4]),
    (&["flame", "flames", "heat"], [Some("flame"), Some("flame"), None, Some("flame")]),
    (&["color", "cd"], [Some("color"), Some("Cd"), None, Some("Cd")]),
    (&["velocity", "vel", "v"], [Some("velocity"), Some("vel"), None, Some("vel")]),
];

impl Convention {
    /// Returns the program's name for a grid; `None` where it has none.
    fn of(self, name: &str) -> Option<&'static str> {
        let lower = name.to_ascii_lowercase();
        let (_, spellings) = ROLES.iter().find(|(names, _)| names.contains(&lower.as_str()))?;
        spellings[self as usize]
    }

    /// Returns a name for each of `names`, with the remarks on those that keep theirs because another grid has or takes
    /// the name that they would get. Of several grids for one name, one that bears it already keeps it, else the first
    /// one takes it.
    pub(crate) fn apply(self, names: &[String]) -> (Vec<String>, Vec<String>) {
        let (mut given, mut remarks) = (Vec::new(), Vec::new());
        let mut taken: Vec<&str> = Vec::new();
        for name in names {
            match self.of(name) {
                Some(new) if new != name && (names.iter().any(|other| other == new) || taken.contains(&new)) => {
                    remarks.push(format!("grid '{name}' keeps its name: another grid is named '{new}'"));
                    given.push(name.clone());
                }
                Some(new) => {
                    taken.extend((new != name).then_some(new));
                    given.push(new.to_owned());
                }
                None => given.push(name.clone()),
            }
        }
        (given, remarks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(convention: Convention, names: &[&str]) -> (Vec<String>, usize) {
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        let (given, remarks) = convention.apply(&names);
        (given, remarks.len())
    }

    #[test]
    fn each_program_gets_its_names() {
        let all = ["density", "temperature", "heat", "Cd", "vel", "fuel"];
        let blender = ["density", "temperature", "flame", "color", "velocity", "fuel"];
        let houdini = ["density", "temperature", "flame", "Cd", "vel", "fuel"];
        assert_eq!(apply(Convention::Blender, &all).0, blender);
        assert_eq!(apply(Convention::Houdini, &blender).0, houdini);
        assert_eq!(apply(Convention::Karma, &all).0, houdini);
        assert_eq!(apply(Convention::Arnold, &all).0, all);
    }

    #[test]
    fn no_two_grids_get_one_name() {
        assert_eq!(
            apply(Convention::Blender, &["heat", "flames", "v", "velocity"]),
            (vec!["flame".into(), "flames".into(), "v".into(), "velocity".into()], 2)
        );
    }
}
