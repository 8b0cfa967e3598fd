//! Tables of labels as text, as FreeSurfer, 3D Slicer and ITK-SNAP write them.
//!
//! A line of FreeSurfer's look-up tables and of 3D Slicer's `.ctbl` is `label name R G B A`, one of ITK-SNAP's label
//! descriptions `label R G B alpha visible mesh "name"`. R, G and B are display-referred sRGB at levels of 255. A is at
//! levels of 255 in one kind and from 0 to 1 in the other; FreeSurfer writes 0 for opaque labels, so that an A of 0 in
//! all lines counts as opaque. `#` begins a comment. Label 0 is the background, and clear.

use super::{Loaded, Options, Source, color};
use crate::error::{Error, Result};
use crate::scene::transfer::{Class, Transfer};

/// Advice on the lines of a table.
const EXPECTED: &str = "lines of label, name, red, green, blue and alpha (FreeSurfer, 3D Slicer) are expected, or of \
                        label, red, green, blue, alpha, visible, mesh and a quoted name (ITK-SNAP); colors at levels \
                        of 0 to 255";

/// True if a text may be a table of labels: its first line that is no comment begins with a number.
pub(super) fn is_table(text: &str) -> bool {
    let first = rows(text).next();
    first.is_some_and(|(_, line)| line.split_whitespace().next().is_some_and(|word| word.parse::<i32>().is_ok()))
}

/// Returns the lines that are no comments, with their numbers.
fn rows(text: &str) -> impl Iterator<Item = (usize, &str)> {
    // Lines end by a line feed, a carriage return, or both.
    let lines = text.split('\n').flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'));
    let lines = lines.enumerate().map(|(number, line)| (number + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Color of a label, before alphas are understood.
struct Row {
    label: i32,
    name: String,
    /// Display-referred color, 0 to 1.
    rgb: [f64; 3],
    /// Alpha, 0 to 1.
    alpha: f64,
}

/// Reads a table of labels; the extinction of the options is that of an opaque label.
///
/// # Errors
/// If a line cannot be used, or a unit distance or a preset was asked for.
pub(super) fn load(text: &str, options: &Options) -> Result<Loaded> {
    if options.preset.is_some() || options.unit_distance.is_some() {
        return Err(Error::invalid("a table of labels is one function, and states no opacities per length")
            .hint("leave out the name of a preset and the unit distance"));
    }
    let row = |(number, line)| {
        row(line).ok_or_else(|| Error::invalid(format!("line {number} is no label: '{line}'")).hint(EXPECTED))
    };
    let mut rows = rows(text).map(row).collect::<Result<Vec<_>>>()?;
    rows.retain(|row| row.label != 0);
    rows.sort_by_key(|row| row.label);
    let all_opaque = rows.iter().all(|row| row.alpha == 0.0);
    let extinction = options.extinction.unwrap_or(1.0);
    let class = |Row { label, name, rgb, alpha }| {
        let [r, g, b] = rgb.map(color::linear);
        Class { label, name, rgbs: [r, g, b, extinction * if all_opaque { 1.0 } else { alpha }] }
    };
    let transfer = Transfer::Labels { classes: rows.into_iter().map(class).collect() };
    let transfer = transfer.checked().map_err(|e| e.hint(EXPECTED))?;
    Ok(Loaded {
        transfer,
        albedo: None,
        source: Source::LabelTable,
        name: None,
        presets: Vec::new(),
        notes: Vec::new(),
    })
}

fn row(line: &str) -> Option<Row> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let label = words.first()?.parse().ok()?;
    let numbers = |words: &[&str]| words.iter().map(|word| word.parse::<f64>().ok()).collect::<Option<Vec<_>>>();
    // A table of FreeSurfer's own has a level of 256.
    let level = |v: f64| (0.0..=256.0).contains(&v).then_some((v / 255.0).min(1.0));
    if let Some((front, name)) = line.split_once('"') {
        let front: Vec<&str> = front.split_whitespace().collect();
        let [r, g, b, alpha, visible, _] = numbers(front.get(1..)?)?.try_into().ok()?;
        let rgb = [level(r)?, level(g)?, level(b)?];
        if !(0.0..=1.0).contains(&alpha) {
            return None;
        }
        let alpha = if visible == 0.0 { 0.0 } else { alpha };
        return Some(Row { label, name: name.trim_end_matches('"').to_owned(), rgb, alpha });
    }
    // Names may have spaces.
    let [r, g, b, alpha] = numbers(words.get(words.len().checked_sub(4)?..)?)?.try_into().ok()?;
    let name = words.get(1..words.len() - 4)?.join(" ");
    Some(Row { label, name, rgb: [level(r)?, level(g)?, level(b)?], alpha: level(alpha)? })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn classes(text: &str) -> Vec<Class> {
        assert!(is_table(text));
        match load(text, &Options { extinction: Some(2.0), ..Options::default() }).unwrap().transfer {
            Transfer::Labels { classes } => classes,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn tables_of_three_programs_are_read() {
        let freesurfer =
            "# a comment\n\n0   Unknown 0 0 0 0\n17 Left-Hippocampus 220 216 20 0\n2 Left-White 255 255 255 0\n";
        let found = classes(freesurfer);
        assert_eq!(
            found.iter().map(|class| (class.label, &class.name[..])).collect::<Vec<_>>(),
            [(2, "Left-White"), (17, "Left-Hippocampus")]
        );
        assert_eq!(found[0].rgbs, [1.0, 1.0, 1.0, 2.0]);
        let slicer = "# Color table file\n0 Background 0 0 0 0\n1 right lung 0 0 255 255\n2 skin 255 0 0 51\n";
        let found = classes(slicer);
        assert_eq!((found[0].name.as_str(), found[0].rgbs), ("right lung", [0.0, 0.0, 1.0, 2.0]));
        assert!((found[1].rgbs[3] - 0.4).abs() < 1e-12);
        let snap = "    0     0    0    0        0  0  0    \"Clear Label\"\n    1   255    0    0        1  1  1    \
                    \"Label 1\"\n    2   0  0  255   0.5  0  1  \"hidden\"\n";
        let found = classes(snap);
        assert_eq!((found[0].name.as_str(), found[0].rgbs), ("Label 1", [1.0, 0.0, 0.0, 2.0]));
        assert_eq!(found[1].rgbs[3], 0.0);
        assert_eq!(classes("1 a 1 2 3 0\r2 b 256 2 3 0\r3 c 1 2 3 0\r\n").len(), 3);
    }

    #[test]
    fn lines_that_are_no_labels_are_named() {
        for (text, line) in
            [("1 a 0 0 0 0\n2 b 0 0\n", "line 2"), ("1 a 0 0 300 0\n", "line 1"), ("1 a 0 x 0 0", "line 1")]
        {
            let error = load(text, &Options::default()).unwrap_err().to_string();
            assert!(error.contains(line), "{error}");
        }
        assert!(load("1 a 0 0 0 0\n1 b 1 1 1 1\n", &Options::default()).unwrap_err().to_string().contains("ascend"));
        assert!(load("0 a 0 0 0 0\n", &Options::default()).is_err());
        assert!(!is_table("hello\n1 2 3") && !is_table("# only a comment"));
    }
}
