//! The renderer that a scene calls for.

use super::composited::Composited;
use super::deep::{Deep, DeepRows};
use super::direct::DirectRenderer;
use super::film::{self, Aov, Rendered, Sampling, View};
use super::path::PathTracer;
use super::shaded::Shaded;
use super::tiles::Watch;
use std::ops::Range;

/// A renderer of any kind.
pub enum Renderer<'a> {
    /// Emission and absorption along straight rays.
    Direct(DirectRenderer<'a>),
    /// Shaded surfaces along straight rays.
    Shaded(Composited<Shaded<'a>>),
    /// Scattered light along paths.
    Paths(PathTracer<'a>),
}

impl Renderer<'_> {
    /// Renders a picture as [`film::render`] does.
    pub fn render<'c, 'w>(
        &self,
        view: impl Into<View<'c>>,
        sampling: Sampling,
        aovs: &[Aov],
        watch: impl Into<Watch<'w>>,
    ) -> Option<Rendered> {
        match self {
            Self::Direct(direct) => direct.render(view, sampling, aovs, watch),
            Self::Shaded(shaded) => film::render(shaded, view, sampling, aovs, watch),
            Self::Paths(paths) => film::render(paths, view, sampling, aovs, watch),
        }
    }

    /// Renders rows of a deep picture as [`Deep::rows`] does.
    pub fn deep<'w>(&self, picture: &Deep<'_>, rows: Range<usize>, watch: impl Into<Watch<'w>>) -> Option<DeepRows> {
        match self {
            Self::Direct(DirectRenderer::Density(density)) => picture.rows(density, rows, watch),
            Self::Direct(DirectRenderer::Labels(labels)) => picture.rows(labels, rows, watch),
            Self::Direct(DirectRenderer::PreShaded(volume)) => picture.rows(volume, rows, watch),
            Self::Shaded(shaded) => picture.rows(shaded, rows, watch),
            Self::Paths(paths) => picture.rows(paths, rows, watch),
        }
    }
}
