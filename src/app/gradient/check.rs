//! Difference quotients beside the derivatives.

use super::GradientSettings;
use super::report::{GradientReport, Row};
use crate::app::Context;
use crate::differentiate::study::Study;
use crate::differentiate::study::difference::Quotient;
use crate::differentiate::study::subject::Subject;
use crate::error::Result;
use std::collections::BTreeMap;
use std::time::Instant;

/// Number of parameters of each group that a check samples.
const SAMPLE: usize = 24;
/// Number of values of the loss that a difference quotient takes, on average.
const EVALUATIONS: f64 = 6.0;

impl GradientSettings {
    /// Returns the numbers of the rows that are checked: all if the settings say so, else at most [`SAMPLE`] of each
    /// group, evenly spaced.
    fn sample(&self, rows: &[Row]) -> Vec<usize> {
        if self.all {
            return (0..rows.len()).collect();
        }
        let mut groups: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        rows.iter().enumerate().for_each(|(i, row)| groups.entry(row.group).or_default().push(i));
        let spaced = |all: Vec<usize>| {
            let count = all.len().min(SAMPLE);
            (0..count).map(|k| all[k * all.len() / count]).collect::<Vec<_>>()
        };
        let mut chosen: Vec<usize> = groups.into_values().flat_map(spaced).collect();
        chosen.sort_unstable();
        chosen
    }

    /// Sets difference quotients and relative errors beside the derivatives of the rows that are checked.
    pub(super) fn compare<V: Subject<Double = V>>(
        &self,
        study: &mut Study<V>,
        report: &mut GradientReport,
        context: &Context,
    ) -> Result<()> {
        let chosen = self.sample(&report.rows);
        let begun = Instant::now();
        study.value().map_err(|e| e.at(&self.input))?;
        // Of two to nine values each.
        let seconds = EVALUATIONS * chosen.len() as f64 * begun.elapsed().as_secs_f64();
        context.note(format!(
            "check: {} of {} parameters, about {:.0} s{}",
            chosen.len(),
            report.parameters,
            seconds.ceil(),
            if chosen.len() < report.rows.len() { "; ⟨all⟩ checks all that are listed" } else { "" }
        ));
        report.checked = Some(chosen.len());
        let bar = context.steps(chosen.len() as u64, "check");
        for number in chosen {
            let row = &mut report.rows[number];
            let Some(parameter) = row.parameter else { continue };
            let quotient = study.difference(parameter).map_err(|e| e.part(row.name.clone()).at(&self.input))?;
            (row.difference, row.rounding) = (Some(quotient.value), Some(quotient.rounding));
            bar.inc(1);
        }
        drop(bar);
        let mut largest: BTreeMap<&str, f64> = BTreeMap::new();
        for row in &report.rows {
            let most = largest.entry(row.group).or_default();
            *most = most.max(row.gradient.abs()).max(row.difference.map_or(0.0, f64::abs));
        }
        let mut worst = 0.0_f64;
        for row in &mut report.rows {
            let Some((value, rounding)) = row.difference.zip(row.rounding) else { continue };
            let error = Quotient { value, rounding }.error(row.gradient, 1e-6 * largest[row.group]);
            // A NaN must not look like agreement.
            worst = if error.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(error) };
            row.relative_error = Some(error);
        }
        report.worst_relative_error = Some(worst);
        Ok(())
    }
}
