//! The renderer that a scene calls for.

use super::composited::Composited;
use super::direct::DirectRenderer;
use super::film::{self, Aov, Rendered, Sampling, View};
use super::path::PathTracer;
use super::shaded::Shaded;
use super::tiles::Watch;

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
}
