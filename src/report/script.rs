//! The script of the page: sliders through slices, and wipes between pictures. Without it the page shows the same
//! pictures at rest.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

/// Text of the script. It has no `<`, so that it stands in HTML as it is.
pub(crate) const SCRIPT: &str = include_str!("page.js");

/// Content security policy of the page: it shows pictures and styles that it contains, runs this very script alone, and
/// loads nothing.
pub(crate) fn policy() -> String {
    let hash = STANDARD.encode(Sha256::digest(SCRIPT.as_bytes()));
    format!("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'")
}
