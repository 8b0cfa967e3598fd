//! Two pictures one over the other, with a slider that moves the edge between them.

use super::picture;
use crate::error::Result;
use crate::scene::film::Film;
use maud::{Markup, html};

/// A wipe between two pictures. Without a script the left half shows the first, the right half the second.
///
/// # Errors
/// If a picture has no pixels.
pub(crate) fn of(labels: [&str; 2], films: [&Film; 2]) -> Result<Markup> {
    let [first, second] = [0, 1].map(|i| picture::film(films[i], labels[i]));
    let (first, second) = (first?, second?);
    Ok(html! {
        figure.wipe {
            div.frame { (second) (first) }
            (controls(labels, None))
        }
    })
}

/// A wipe between the first two pictures of the rows of the table beside it, by the script; hidden without it, since
/// the table shows them side by side.
pub(crate) fn of_table(labels: [&str; 2], names: &[&str]) -> Markup {
    html! {
        figure.wipe hidden {
            div.frame {}
            (controls(labels, Some(names)))
        }
    }
}

fn controls([first, second]: [&str; 2], names: Option<&[&str]>) -> Markup {
    html! {
        figcaption.controls hidden {
            @if let Some(names) = names {
                label { "View " select { @for name in names { option { (name) } } } }
            }
            label.range { span { (first) } input type="range" min="0" max="100" value="50" aria-label="edge between \
                 the pictures"; span { (second) } }
        }
    }
}
