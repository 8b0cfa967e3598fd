//! Where the grids of a conversion come from: grids of the file as they are, taken apart, or put together.

use super::computed::Computed;
use crate::error::{Error, Result};
use crate::formats::vdb::{File, NativeGrid};
use crate::scene::grid::GridClass;
use crate::text::serde_as_text;
use std::fmt;
use std::str::FromStr;

/// Three grids of scalars that become one of vectors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Merge {
    /// Name of the grid of vectors.
    pub name: String,
    /// Names of the components, x, y and z.
    pub parts: [String; 3],
}

impl fmt::Display for Merge {
    /// Writes the text that [`FromStr`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.name, self.parts.join(","))
    }
}

serde_as_text!(Merge);

impl FromStr for Merge {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let fault = || format!("'{text}' is not NAME=X,Y,Z with the names of three grids");
        let (name, parts) = text.split_once('=').ok_or_else(fault)?;
        let parts: Vec<String> = parts.split(',').map(|part| part.trim().to_owned()).collect();
        let parts: [String; 3] = parts.try_into().map_err(|_| fault())?;
        if name.is_empty() || parts.iter().any(String::is_empty) {
            return Err(fault());
        }
        Ok(Self { name: name.into(), parts })
    }
}

/// Where one grid, or three of them, come from; names are the unique ones of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum GridSource {
    /// A grid as it is.
    Whole(String),
    /// The components of a grid of vectors.
    Split(String),
    /// A grid of vectors of three grids of scalars.
    Merged(String, [String; 3]),
    /// A grid that is computed of others.
    Computed(Computed),
}

/// Returns the sources of a conversion, in the order of the chosen grids. A merged grid stands where the first of its
/// parts stood, and a computed one where that of its name stood, or behind all others.
///
/// # Errors
/// If a grid to be split or merged is not in the file, not among the chosen, or asked for twice, or a computed one is
/// made of grids that are not in the file.
pub(super) fn sources(
    (split, merge, eval): (&[String], &[Merge], &[Computed]),
    file: &File,
    chosen: &[String],
) -> Result<Vec<GridSource>> {
    let find = |option: &str, name: &str| {
        let name = file.find(name)?.name.clone();
        if chosen.contains(&name) {
            return Ok(name);
        }
        Err(Error::invalid(format!("{option}: grid '{name}' is not among those of ⟨grid⟩"))
            .hint("name it with ⟨grid⟩ too, or leave the option out"))
    };
    let split = split.iter().map(|name| find("⟨split⟩", name)).collect::<Result<Vec<_>>>()?;
    let mut merges = Vec::new();
    for merge in merge {
        let [x, y, z] = merge.parts.each_ref().map(|part| find("⟨merge⟩", part));
        merges.push((merge.name.clone(), [x?, y?, z?]));
    }
    let used = |name: &String| {
        let merged = merges.iter().flat_map(|(_, parts)| parts).filter(|part| *part == name).count();
        merged + split.iter().filter(|other| *other == name).count()
    };
    if let Some(name) = chosen.iter().find(|name| used(name) > 1) {
        return Err(Error::invalid(format!("grid '{name}' is asked for twice by ⟨split⟩ and ⟨merge⟩"))
            .hint("name each grid once: a grid that is split or merged is left out itself"));
    }
    let mut sources: Vec<GridSource> = Vec::new();
    for name in chosen {
        let merge = merges.iter().find(|(_, parts)| parts.contains(name));
        match merge {
            Some((target, parts)) => {
                let source = GridSource::Merged(target.clone(), parts.clone());
                if !sources.contains(&source) {
                    sources.push(source);
                }
            }
            None if split.contains(name) => sources.push(GridSource::Split(name.clone())),
            None => sources.push(GridSource::Whole(name.clone())),
        }
    }
    for (number, computed) in eval.iter().enumerate() {
        if eval[..number].iter().any(|other| other.name == computed.name) {
            return Err(Error::invalid(format!("⟨eval={computed}⟩: the grid '{}' is computed twice", computed.name))
                .hint("give one expression for each grid; names mean the grids of the file, as they are in it"));
        }
        computed.parts(file)?;
        let own = file.find(&computed.name).ok().map(|entry| GridSource::Whole(entry.name.clone()));
        let source = GridSource::Computed(computed.clone());
        match sources.iter_mut().find(|source| own.as_ref() == Some(source)) {
            Some(replaced) => *replaced = source,
            None => sources.push(source),
        }
    }
    Ok(sources)
}

impl GridSource {
    /// Returns the names of the grids as the output will have them, before they are renamed.
    pub(crate) fn names(&self, file: &File) -> Result<Vec<String>> {
        Ok(match self {
            Self::Whole(name) => vec![file.find(name)?.base_name.clone()],
            Self::Split(name) => ["x", "y", "z"].map(|axis| format!("{name}.{axis}")).to_vec(),
            Self::Merged(name, _) => vec![name.clone()],
            Self::Computed(computed) => vec![computed.name.clone()],
        })
    }

    /// Returns what the report says of where the grids come from.
    pub(crate) fn origin(&self) -> String {
        match self {
            Self::Whole(name) | Self::Split(name) => name.clone(),
            Self::Merged(_, parts) => parts.join(", "),
            Self::Computed(computed) => computed.expression.to_string(),
        }
    }

    /// Reads the grids. `room` refuses bytes that are not to be had beside those of the file's grids.
    ///
    /// # Errors
    /// If a grid cannot be read, taken apart or put together so.
    pub(crate) fn read(&self, file: &File, room: &dyn Fn(u64) -> Result<()>) -> Result<Vec<NativeGrid>> {
        match self {
            Self::Whole(name) => Ok(vec![file.read(name)?]),
            Self::Split(name) => {
                let mut vectors = file.read(name)?;
                vectors.mend_metadata()?;
                room(vectors.info()?.memory)?;
                let names = self.names(file)?;
                names.iter().enumerate().map(|(c, name)| vectors.component(c, name)).collect()
            }
            Self::Merged(name, parts) => {
                let [x, y, z] = parts.each_ref().map(|part| file.read(part));
                let (mut x, y, z) = (x?, y?, z?);
                x.mend_metadata()?;
                let memory = [&x, &y, &z].map(|grid| grid.info().map(|info| info.memory));
                // The union of three topologies has as many leaves as all of them together, at most.
                let [a, b, c] = memory;
                room(3 * (a? + b? + c?))?;
                let mut merged = NativeGrid::merge([&x, &y, &z], name)?;
                merged.set_class(GridClass::Unknown)?;
                Ok(vec![merged])
            }
            Self::Computed(computed) => Ok(vec![computed.read(file, room)?]),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn merges_name_three_grids() {
        let merge: Merge = "v=vx, vy,vz".parse().unwrap();
        assert_eq!((merge.name.as_str(), merge.parts.join(" ").as_str()), ("v", "vx vy vz"));
        for text in ["v", "v=", "=a,b,c", "v=a,b", "v=a,b,c,d", "v=a,,c"] {
            assert!(text.parse::<Merge>().unwrap_err().contains("NAME=X,Y,Z"), "{text}");
        }
    }
}
