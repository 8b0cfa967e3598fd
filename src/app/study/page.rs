//! The page of a study.

use super::front;
use super::measurement::Measurement;
use super::recommendation::Recommendation;
use super::report::StudyReport;
use crate::error::Result;
use crate::report::{Cloud, Dot, ErrorMaps, Page, Scatter, short};
use crate::scene::film::Film;

/// Most settings whose pictures are shown.
const MOST_PICTURES: usize = 5;

/// Pictures of a study.
pub(super) struct Gallery {
    /// Picture of the reference.
    pub reference: Film,
    /// Pictures of settings, each with its number among the measurements.
    pub films: Vec<(usize, Film)>,
}

/// Returns the numbers of the settings whose pictures are shown: those that are recommended for an error, or as many of
/// the front, evenly spaced.
pub(super) fn pictured(report: &StudyReport) -> Vec<usize> {
    let all = &report.measurements;
    let number = |options: &str| all.iter().position(|m| m.options == options);
    let wanted = [&report.recommended].into_iter().chain(&report.recommendations);
    let mut chosen: Vec<usize> = wanted.filter_map(|r| r.options.as_deref()).filter_map(number).collect();
    let front = front::of(all);
    chosen.extend(front.first().into_iter().chain(front.last()).filter_map(|m| number(&m.options)));
    let seconds = |i: &usize| all[*i].seconds.unwrap_or_default();
    chosen.sort_by(|a, b| seconds(a).total_cmp(&seconds(b)).then(a.cmp(b)));
    chosen.dedup();
    let count = chosen.len().min(MOST_PICTURES);
    (0..count).map(|k| chosen[k * (chosen.len() - 1) / (count - 1).max(1)]).collect()
}

/// Makes the page of a study.
///
/// # Errors
/// If a picture or the plot cannot be drawn.
pub(super) fn of(report: &StudyReport, gallery: Option<&Gallery>) -> Result<Page> {
    let StudyReport { study, input, measurements, reference, recommended, .. } = report;
    let name = input.file_name().unwrap_or(input.as_os_str()).to_string_lossy();
    let size = report.size.map(|[w, h]| format!(", on pictures of {w} x {h} pixels")).unwrap_or_default();
    let count = measurements.len();
    let mut page = Page::new(
        format!("{name}, error against time of {study}"),
        format!(
            "{count} settings, {}{size}. Errors are root mean squares of the differences from the reference, divided \
             by the root mean square of the reference.",
            report.runs()
        ),
    );
    if !report.complete {
        page.warnings(&[("The study was stopped: this page is incomplete.", "Resume it to measure the rest.")]);
    }
    page.figures(&[
        ("Settings", count.to_string()),
        ("That no other beats", front::of(measurements).len().to_string()),
        ("Uncertainty", if reference.uncertainty > 0.0 { reference.uncertain_by() } else { "not known".into() }),
        ("Study took", format!("{:.0} s", report.seconds)),
    ]);
    let wanted = format!("{}: {}", recommended.wanted(), recommended.reached());
    page.commands(
        "Recommended",
        &recommended.command.iter().map(|c| (wanted.as_str(), c.as_str())).collect::<Vec<_>>(),
    );
    page.scatter("Error against time", &plot(report))?;
    let rows = |of: &dyn Fn(&Recommendation) -> bool| -> Vec<(String, String)> {
        let all = report.recommendations.iter().filter(|r| of(r));
        let words = |r: &Recommendation| r.command.clone().unwrap_or_else(|| "-".into());
        all.map(|r| (format!("{}: {}", r.wanted(), r.reached()), words(r))).collect()
    };
    page.commands("By error", &rows(&|r| r.error_at_most.is_some()));
    page.commands("By time", &rows(&|r| r.seconds_at_most.is_some()));
    if let Some(Gallery { reference, films }) = gallery.filter(|gallery| !gallery.films.is_empty()) {
        let label = |m: &Measurement| (m.options.clone(), format!("error {}", m.error_in_words()));
        let rows = films.iter().map(|(number, film)| (label(&measurements[*number]), film)).collect();
        page.error_maps("Pictures and their errors", &ErrorMaps { reference, rows })?;
    }
    page.wide_table(
        "All settings",
        &["Setting", "Error", "Interval", "99 % below", "Largest", "Seconds", "Quartiles", "Runs"],
        &measurements.iter().map(row).collect::<Vec<_>>(),
    );
    let options = [("Made by", reference.options.clone()), ("Uncertain by", reference.uncertain_by())];
    let found = [("Uncertainty", reference.method.clone()), ("Took", format!("{} s", short(reference.seconds)))];
    let rows = options.into_iter().chain(found).map(|(name, value)| vec![name.to_owned(), value]);
    page.texts("Reference", &rows.collect::<Vec<_>>());
    page.provenance(&report.provenance.rows());
    Ok(page)
}

fn row(m: &Measurement) -> Vec<String> {
    let number = |v: Option<f64>| v.map_or_else(|| "-".into(), |v| format!("{v:.2e}"));
    let pair = |v: Option<[f64; 2]>, text: fn(f64) -> String| {
        v.map_or_else(|| "-".into(), |[low, high]| format!("{} … {}", text(low), text(high)))
    };
    vec![
        format!("{}{}", m.options, if m.on_front { " ★" } else { "" }),
        m.error_in_words(),
        pair(m.error_interval.filter(|_| m.error.is_some()), |v| format!("{v:.1e}")),
        number(m.percentile_99),
        number(m.largest),
        m.seconds.map_or_else(|| "-".into(), short),
        pair(m.seconds_quartiles, short),
        m.runs.len().to_string(),
    ]
}

/// Returns the plot: a cloud of settings for each group, their intervals, and the front.
fn plot(report: &StudyReport) -> Scatter {
    let mut groups: Vec<Cloud> = Vec::new();
    for m in &report.measurements {
        let Some((x, y)) = m.point() else { continue };
        let dot = Dot { x, y, x_range: m.seconds_quartiles, y_range: m.error_interval.filter(|_| m.error.is_some()) };
        match groups.iter_mut().find(|cloud| cloud.label == m.group) {
            Some(cloud) => cloud.dots.push(dot),
            None => groups.push(Cloud { label: m.group.clone(), dots: vec![dot] }),
        }
    }
    Scatter {
        x: "seconds".into(),
        y: "error / RMS of the reference".into(),
        clouds: groups,
        front: front::of(&report.measurements).into_iter().filter_map(Measurement::point).collect(),
        floor: ("uncertainty of the reference".into(), report.reference.uncertainty),
    }
}
