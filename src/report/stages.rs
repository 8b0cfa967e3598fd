//! Time by stage, as a bar and a table.

use super::plot::PALETTE;
use maud::{Markup, html};

/// A bar in which each stage has its share of the length, and a table of seconds and shares.
pub(crate) fn bar_and_table(stages: &[(impl AsRef<str>, f64)]) -> Markup {
    // Durations from clocks that were set back must not distort the bar.
    let length = |seconds: f64| if seconds.is_finite() { seconds.max(0.0) } else { 0.0 };
    let total: f64 = stages.iter().map(|s| length(s.1)).sum();
    if stages.is_empty() {
        return html! { p { "No stages were timed." } };
    }
    let share = |seconds: f64| if total > 0.0 { 100.0 * length(seconds) / total } else { 0.0 };
    html! {
        div.stages aria-hidden="true" {
            @for (i, (_, seconds)) in stages.iter().enumerate() {
                @if share(*seconds) > 0.0 {
                    div class={ "c" (i % PALETTE.len()) } style={ "flex-grow:" (format!("{:.3}", share(*seconds))) } {}
                }
            }
        }
        table.figures {
            thead {
                tr { th scope="col" { "Stage" } th scope="col" { "Time" } th scope="col" { "Share" } }
            }
            tbody {
                @for (i, (name, seconds)) in stages.iter().enumerate() {
                    tr {
                        th scope="row" { span class={ "swatch c" (i % PALETTE.len()) } {} (name.as_ref()) }
                        td { (format!("{seconds:.2} s")) }
                        td { (format!("{:.1} %", share(*seconds))) }
                    }
                }
            }
            tfoot {
                tr { th scope="row" { "Total" } td { (format!("{total:.2} s")) } td {} }
            }
        }
    }
}
