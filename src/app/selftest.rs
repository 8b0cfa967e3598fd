//! The numerics of this program on this machine: every hard case, beside the naive formula.

use crate::app::Context;
use crate::app::use_case::{Report, Status, use_case};
use crate::arch::Arch;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::hard_cases::{Area, Case, Formula, Naive, cases};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Instant;

/// Settings of a self-test.
///
/// ```
/// use cumulo::prelude::*;
///
/// let some = SelftestSettings { cases: vec!["softplus".into()], ..SelftestSettings::default() };
/// assert_eq!(some.run(&Context::default())?.status()?, Status::Success);
/// # Ok::<(), Error>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SelftestSettings {
    /// Names of cases and of areas to run; none for all.
    pub cases: Vec<String>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report of a self-test.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct SelftestReport {
    /// Name and version of the program.
    software: &'static str,
    /// Instruction set of the inner loops.
    instruction_set: String,
    /// Number of cases that passed.
    passed: usize,
    /// Number of cases that failed.
    failed: usize,
    /// Wall time in seconds.
    seconds: f64,
    /// The cases, area by area.
    cases: Vec<Measured>,
}

/// A case with its figures.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Measured {
    /// Name of the case.
    name: &'static str,
    /// Part of the program that it belongs to.
    area: Area,
    /// Input, and what goes wrong on it.
    hazard: &'static str,
    /// Formula that the program uses.
    formula: &'static str,
    /// Meaning of error and bound, and their unit.
    figure: &'static str,
    /// Error of the program; null if a result is not finite, or was refused.
    error: Option<f64>,
    /// Largest error with which the case passes.
    bound: f64,
    /// True if the error is at most the bound.
    passed: bool,
    /// Formula that the program's is compared with.
    naive_formula: &'static str,
    /// Error of the naive formula on the same input; null if a result is not finite.
    naive_error: Option<f64>,
    /// Why the naive formula passes as well, where it does.
    naive_reason: Option<&'static str>,
}

impl Measured {
    fn of(case: &Case) -> Self {
        let [error, naive] = [Formula::Cumulo, Formula::Naive].map(|formula| case.measure(formula));
        Self {
            name: case.name,
            area: case.area,
            hazard: case.hazard,
            formula: case.remedy,
            figure: case.figure,
            error: Some(error).filter(|error| error.is_finite()),
            bound: case.bound,
            passed: case.passes(error),
            naive_formula: case.naive_formula,
            naive_error: Some(naive).filter(|error| error.is_finite()),
            naive_reason: match case.naive {
                Naive::Fails(_) => None,
                Naive::Holds(reason) => Some(reason),
            },
        }
    }
}

impl fmt::Display for SelftestReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figure = |error: Option<f64>| match error {
            None => "infinite".into(),
            Some(0.0) => "0".into(),
            Some(error) => format!("{error:.1e}"),
        };
        writeln!(f, "{} on {}", self.software, self.instruction_set)?;
        writeln!(f, "  {:<28}{:<19}{:>9}{:>9}{:>10}  result  figure", "case", "area", "error", "bound", "naive")?;
        for case in &self.cases {
            let Measured { name, area, figure: what, .. } = case;
            let [error, bound, naive] = [case.error, Some(case.bound), case.naive_error].map(figure);
            let result = if case.passed { "pass" } else { "FAIL" };
            writeln!(f, "  {name:<28}{area:<19}{error:>9}{bound:>9}{naive:>10}  {result:<6}  {what}")?;
        }
        for case in self.cases.iter().filter(|case| !case.passed) {
            writeln!(f, "  {} fails: {}; used is {}", case.name, case.hazard, case.formula)?;
        }
        let Self { passed, failed, seconds, .. } = self;
        write!(f, "  {passed} of {} cases pass, in {seconds:.1} s", passed + failed)
    }
}

use_case!(SelftestSettings => SelftestReport, limits);

impl Report for SelftestReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(true, self.failed > 0))
    }
}

impl SelftestSettings {
    /// Runs the cases.
    ///
    /// # Errors
    /// If a name is that of no case and no area, or the work was stopped.
    pub fn run(&self, context: &Context) -> Result<SelftestReport> {
        let begun = Instant::now();
        let chosen = self.selected()?;
        let stage = context.steps(chosen.len() as u64, "selftest");
        let cancel = context.cancel();
        let measured = chosen.par_iter().map(|case| {
            if cancel.requested() {
                return Err(Error::cancelled());
            }
            let measured = Measured::of(case);
            stage.inc(1);
            Ok(measured)
        });
        let cases: Vec<Measured> = measured.collect::<Result<_>>()?;
        let passed = cases.iter().filter(|case| case.passed).count();
        Ok(SelftestReport {
            software: concat!("cumulo ", env!("CARGO_PKG_VERSION")),
            instruction_set: Arch::default().name(),
            passed,
            failed: cases.len() - passed,
            seconds: begun.elapsed().as_secs_f64(),
            cases,
        })
    }

    /// Returns the cases that are named, in their usual order.
    fn selected(&self) -> Result<Vec<&'static Case>> {
        let named = |name: &String, case: &Case| *name == case.name || *name == case.area.name();
        if let Some(unknown) = self.cases.iter().find(|name| !cases().any(|case| named(name, case))) {
            let areas = Area::ALL.map(Area::name).join(", ");
            return Err(Error::invalid(format!("'{unknown}' is no case and no area"))
                .hint(format!("the areas are {areas}; without names all cases run, and are listed")));
        }
        Ok(cases().filter(|case| self.cases.is_empty() || self.cases.iter().any(|name| named(name, case))).collect())
    }
}
