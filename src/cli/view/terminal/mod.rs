//! Pictures in a terminal.

mod blocks;
mod kitty;
mod sixel;

use crate::error::{Error, Result};
use crate::report::sheet::Canvas;
use clap::ValueEnum;
use std::io::Write;

/// How a terminal draws pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Graphics {
    /// Kitty's graphics protocol: kitty, Ghostty
    Kitty,
    /// Sixels: foot, mlterm, WezTerm, contour
    Sixel,
    /// Half blocks in 24-bit color, which nearly all terminals have
    Blocks,
}

/// Columns and rows of a terminal that does not tell.
const CELLS: [usize; 2] = [80, 24];
/// Width of a cell in pixels where a terminal does not tell.
const CELL: usize = 9;

impl Graphics {
    /// Returns what the environment says the terminal can do; blocks unless it is sure. `variable` returns the value of
    /// an environment variable.
    pub(crate) fn detected(variable: impl Fn(&str) -> Option<String>) -> Self {
        let get = |name: &str| variable(name).unwrap_or_default();
        let (term, program) = (get("TERM"), get("TERM_PROGRAM"));
        // Multiplexers pass no pictures on.
        if !get("TMUX").is_empty() || term.starts_with("screen") || term.starts_with("tmux") {
            return Self::Blocks;
        }
        if !get("KITTY_WINDOW_ID").is_empty()
            || ["xterm-kitty", "xterm-ghostty"].contains(&&*term)
            || program == "ghostty"
        {
            return Self::Kitty;
        }
        let sixel = ["foot", "mlterm", "contour", "yaft"].iter().any(|name| term.starts_with(name));
        if sixel || term.contains("sixel") || program == "WezTerm" { Self::Sixel } else { Self::Blocks }
    }
}

/// Draws a picture on standard output, no wider than the terminal.
///
/// # Errors
/// If standard output cannot be written. A closed pipe is no error.
pub(super) fn show(canvas: &Canvas, graphics: Graphics) -> Result<()> {
    let (columns, pixels) = width();
    let most = match graphics {
        Graphics::Blocks => columns,
        Graphics::Kitty | Graphics::Sixel => pixels,
    };
    let width = canvas.width.min(most.max(1));
    let height = (canvas.height * width).div_ceil(canvas.width.max(1)).max(1);
    let fitted = if width < canvas.width { canvas.resampled(width, height) } else { canvas.clone() };
    let bytes = match graphics {
        Graphics::Kitty => kitty::encode(&fitted)?,
        Graphics::Sixel => sixel::encode(&fitted),
        Graphics::Blocks => blocks::encode(&fitted),
    };
    let mut out = std::io::stdout().lock();
    match out.write_all(&bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::io("standard output", e)),
        _ => Ok(()),
    }
}

/// Width of the terminal in columns and in pixels.
fn width() -> (usize, usize) {
    let told = rustix::termios::tcgetwinsize(std::io::stdout()).ok();
    let columns = told.map(|size| usize::from(size.ws_col)).filter(|n| *n > 0).unwrap_or(CELLS[0]);
    let pixels = told.map(|size| usize::from(size.ws_xpixel)).filter(|n| *n > 0).unwrap_or(columns * CELL);
    (columns, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_sure_terminals_get_more_than_blocks() {
        let with = |given: &[(&str, &str)]| {
            Graphics::detected(|name| given.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
        };
        assert_eq!(with(&[]), Graphics::Blocks);
        assert_eq!(with(&[("TERM", "xterm-256color")]), Graphics::Blocks);
        assert_eq!(with(&[("TERM", "xterm-kitty")]), Graphics::Kitty);
        assert_eq!(with(&[("TERM", "xterm-256color"), ("KITTY_WINDOW_ID", "1")]), Graphics::Kitty);
        assert_eq!(with(&[("TERM", "xterm-kitty"), ("TMUX", "/tmp/t,1,0")]), Graphics::Blocks);
        assert_eq!(with(&[("TERM", "foot-extra")]), Graphics::Sixel);
        assert_eq!(with(&[("TERM", "xterm-256color"), ("TERM_PROGRAM", "WezTerm")]), Graphics::Sixel);
        assert_eq!(with(&[("TERM", "screen.xterm-kitty")]), Graphics::Blocks);
    }
}
