//! Names of prims and properties.

use std::collections::BTreeSet;

/// Names that are taken beneath one prim.
#[derive(Debug, Clone, Default)]
pub(crate) struct Names(BTreeSet<String>);

impl Names {
    /// Returns an identifier like `wanted` that nothing else beneath the prim has, and takes it.
    pub(crate) fn take(&mut self, wanted: &str) -> String {
        let base = identifier(wanted);
        let mut name = base.clone();
        let mut number = 1_u32;
        while !self.0.insert(name.clone()) {
            name = format!("{base}_{number}");
            number += 1;
        }
        name
    }
}

/// Returns an identifier of ASCII letters, digits and underscores that does not start with a digit.
pub(crate) fn identifier(text: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = text.chars().map(plain).collect();
    if name.starts_with(|c: char| c.is_ascii_digit()) || name.is_empty() { format!("_{name}") } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_identifiers_and_differ() {
        let mut names = Names::default();
        let taken = ["density", "density[1]", "density 1 ", "density", "2d", "é", ""].map(|n| names.take(n));
        assert_eq!(taken, ["density", "density_1_", "density_1__1", "density_1", "_2d", "_", "__1"]);
    }
}
