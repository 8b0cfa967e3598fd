//! The page of two sequences: plots over the frames, and the frames themselves.

use super::figures::{Figures, SequencesReport, Track};
use super::space::Space;
use crate::error::Result;
use crate::report::{Page, Plot, Series, StripFrame};
use crate::scene::film::Film;
use std::path::Path;

/// Frames of the moving picture.
const MOST_FRAMES: usize = 24;

/// Frames of the moving picture a second: slow enough to look at.
const RATE: u16 = 8;

/// Frames for the page, gathered while they are compared.
#[derive(Debug)]
pub(super) struct Gallery {
    /// Where the frames of the moving picture lie in the sequence: `MOST_FRAMES` around its middle.
    from: usize,
    moving: Vec<StripFrame>,
    /// The frame with the lowest PSNR so far.
    worst: Option<(f64, u32, StripFrame)>,
}

impl Gallery {
    /// Gathers frames of a sequence of `count`.
    pub(super) fn new(count: usize) -> Self {
        Self { from: count.saturating_sub(MOST_FRAMES) / 2, moving: Vec::new(), worst: None }
    }

    /// Adds the frame at `at` of the sequence with its number. `films` are those of the sequence beside, if there is
    /// one, of the first and of the reference.
    pub(crate) fn add(&mut self, at: usize, number: u32, films: &[&Film], psnr_db: f64) {
        let moves = (self.from..self.from + MOST_FRAMES).contains(&at);
        let is_worst = self.worst.as_ref().is_none_or(|(worst, ..)| psnr_db < *worst);
        if !moves && !is_worst {
            return;
        }
        let frame = StripFrame::new(films, films.len() - 2);
        // Sizes may change on the way; a moving picture has one.
        if is_worst {
            self.worst = Some((psnr_db, number, frame.clone()));
        }
        if moves && self.moving.first().is_none_or(|first| first.size() == frame.size()) {
            self.moving.push(frame);
        }
    }

    /// Makes the page, but for its provenance.
    ///
    /// # Errors
    /// If a picture or a plot cannot be drawn.
    pub(crate) fn page(
        &self,
        names: [&Path; 2],
        beside: Option<&Path>,
        space: Space,
        report: &SequencesReport,
    ) -> Result<Page> {
        let name = |path: &Path| path.display().to_string();
        let [a, b] = names.map(name);
        let beside = beside.map(name);
        let count = report.all.frames.len();
        let mut page = Page::new(format!("{a} beside {b}"), format!("{count} frames compared, by {}.", space.name()));
        let decibels = |v: Option<f64>| v.map_or_else(|| "identical".into(), |v| format!("{v:.2} dB"));
        let mut figures = vec![
            ("PSNR", decibels(report.all.psnr_db)),
            ("SSIM", format!("{:.4}", report.all.ssim)),
            ("relMSE", format!("{:.3e}", report.all.rel_mse)),
        ];
        if report.all.frames.iter().any(|figures| figures.flicker_psnr_db.is_some()) {
            figures.insert(1, ("PSNR of changes", decibels(report.all.flicker_psnr_db)));
        }
        figures.extend(report.all.flip.map(|flip| ("FLIP", format!("{flip:.4}"))));
        page.figures(&figures);
        let labels: Vec<&str> = beside.iter().map(String::as_str).chain([&a[..], &b[..]]).collect();
        if !self.moving.is_empty() {
            page.strip("Frames", &labels, &self.moving, RATE)?;
        }
        if let Some((psnr, number, frame)) = &self.worst {
            let heading =
                format!("Frame {number}, the furthest apart ({})", decibels(Some(*psnr).filter(|v| v.is_finite())));
            page.strip(&heading, &labels, std::slice::from_ref(frame), RATE)?;
            if let [.., own, reference] = frame.pictures() {
                page.wipe(&format!("Frame {number}, one over the other"), [&a, &b], [own, reference])?;
            }
        }
        let tracks: Vec<(&str, &Track)> =
            [(&a[..], &report.all)].into_iter().chain(beside.as_deref().zip(report.beside.as_ref())).collect();
        let mut plot = |heading: &str, y: &str, of: &dyn Fn(&Figures) -> Option<f64>| {
            let line = |(label, track): &(&str, &Track)| Series {
                label: (*label).to_owned(),
                points: track.frames.iter().filter_map(|g| Some((f64::from(g.frame), of(g)?))).collect(),
                dashed: false,
            };
            let series: Vec<Series> = tracks.iter().map(line).collect();
            if series.iter().any(|series| !series.points.is_empty()) {
                page.plot(heading, &Plot { x: "frame".into(), y: y.into(), series })?;
            }
            Ok::<(), crate::error::Error>(())
        };
        plot("PSNR", "PSNR (dB)", &|g| g.psnr_db)?;
        plot("Flicker", "PSNR of the change from the frame before (dB)", &|g| g.flicker_psnr_db)?;
        plot("SSIM", "SSIM", &|g| Some(g.ssim))?;
        plot("Relative error", "relMSE", &|g| Some(g.rel_mse))?;
        plot("FLIP", "FLIP", &|g| g.flip)?;
        Ok(page)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::super::figures::Gauge;
    use super::*;

    /// All frames around the middle may have failed, and the others are still compared.
    #[test]
    fn a_page_without_a_moving_picture_is_made() {
        let film = |v: f32| Film::of(2, 2, vec![[v, v, v, 1.0]; 4]);
        let (mut gallery, mut gauge) = (Gallery::new(100), Gauge::new(Space::Linear, false));
        let c = gauge.add(1, [&film(0.1), &film(0.2)]).unwrap();
        gallery.add(0, 1, &[&film(0.1), &film(0.2)], c.psnr_db);
        let all = gauge.closed();
        let report = SequencesReport {
            all,
            beside: None,
            left_out: vec![],
            failed: vec![],
            differ: true,
            differences: vec![],
            report: None,
        };
        let page = gallery.page([Path::new("a"), Path::new("b")], None, Space::Linear, &report).unwrap();
        assert!(page.html().contains("Frame 1, the furthest apart"));
    }
}
