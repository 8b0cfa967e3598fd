//! One line of the table.

use serde::Serialize;
use std::collections::BTreeMap;

/// A figure beside what it is measured against. `python/bench.py` adds rows of the same shape.
#[derive(Debug, Serialize)]
pub struct Row {
    /// B3, B10, ...
    pub id: &'static str,
    /// What is done.
    pub work: String,
    /// What the other side takes.
    pub peer: Option<String>,
    /// What ours takes.
    pub ours: String,
    /// The figure that the goal is about.
    pub ratio: Option<f64>,
    /// What the ratio should be.
    pub goal: Option<String>,
    /// Whether it is.
    pub met: Option<bool>,
    /// Medians behind the figures, in seconds unless the name says otherwise.
    pub detail: BTreeMap<&'static str, f64>,
}

impl Row {
    /// A row whose ratio should be at most `limit`.
    pub fn at_most(id: &'static str, work: impl Into<String>, ours: String, ratio: f64, limit: f64) -> Self {
        let (goal, met) = (Some(format!("<= {limit}")), Some(ratio <= limit));
        Self { ratio: Some(ratio), goal, met, ..Self::figure(id, work, ours) }
    }

    /// A row whose ratio should be at least `limit`.
    pub fn at_least(id: &'static str, work: impl Into<String>, ours: String, ratio: f64, limit: f64) -> Self {
        let (goal, met) = (Some(format!(">= {limit}")), Some(ratio >= limit));
        Self { ratio: Some(ratio), goal, met, ..Self::figure(id, work, ours) }
    }

    /// A row that says how fast something is.
    pub fn figure(id: &'static str, work: impl Into<String>, ours: String) -> Self {
        let detail = BTreeMap::new();
        Self { id, work: work.into(), peer: None, ours, ratio: None, goal: None, met: None, detail }
    }

    /// The same with a figure of the other side.
    pub fn against(self, peer: String) -> Self {
        Self { peer: Some(peer), ..self }
    }

    /// The same with one more median.
    pub fn with(mut self, name: &'static str, value: f64) -> Self {
        self.detail.insert(name, value);
        self
    }
}

/// The rows as a Markdown table.
pub fn table(rows: &[Row]) -> String {
    let mut out = "| id | work | peer | ours | ratio | goal | met |\n|---|---|---|---|---|---|---|\n".to_owned();
    for r in rows {
        let or_dash = |text: &Option<String>| text.clone().unwrap_or_else(|| "–".into());
        let ratio = or_dash(&r.ratio.map(|v| format!("{v:.2}")));
        let met = r.met.map_or("–", |m| if m { "yes" } else { "NO" });
        let (peer, goal) = (or_dash(&r.peer), or_dash(&r.goal));
        out += &format!("| {} | {} | {peer} | {} | {ratio} | {goal} | {met} |\n", r.id, r.work, r.ours);
    }
    out
}
