//! Endings of file names.

use std::path::Path;

/// True if the name of a path ends so, behind a stem and a dot and in whichever case.
pub(crate) fn ends_in(path: &Path, ending: &str) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    name.strip_suffix(ending).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.'))
}
