//! Derivatives by the parameters that the settings name.

use super::report::{GradientReport, Row};
use super::{GradientSettings, Wrt};
use crate::app::Context;
use crate::differentiate::study::ad_mode::{AdMode, Choice, Mode, Task};
use crate::differentiate::study::parameter::{CAMERA, Parameter};
use crate::differentiate::study::subject::{Subject, depth_channel};
use crate::differentiate::study::{Study, StudyGradient};
use crate::error::{Error, Result};
use crate::render::differentiable::Adjoint;

/// Largest number of directions in forward mode, which walks every ray again for each few of them.
const MOST_DIRECTIONS: usize = 512;

impl GradientSettings {
    /// Returns the parameters that the settings name, in their order and without voxels.
    fn parameters<V: Subject>(&self, study: &Study<V>) -> Vec<Parameter> {
        let mut all: Vec<Parameter> = Vec::new();
        for (i, wrt) in self.wrt.iter().enumerate() {
            if self.wrt[..i].contains(wrt) {
                continue;
            }
            match wrt {
                Wrt::Step => all.push(Parameter::Step),
                Wrt::Camera => all.extend(
                    (0..study.setting.cameras.len())
                        .flat_map(|view| (0..CAMERA.len()).map(move |part| Parameter::Camera { view, part })),
                ),
                Wrt::Tf => {
                    let count = study.setting.transfer.as_ref().map_or(0, |t| t.parameters().len());
                    all.extend((0..count).map(Parameter::Transfer));
                }
                Wrt::Density | Wrt::Emission | Wrt::Albedo => {}
                Wrt::Background => all.extend((0..3).map(Parameter::Background)),
                Wrt::Extinction => all.push(Parameter::Extinction),
            }
        }
        all
    }

    /// Returns the numbers of the voxels' channels that the settings name.
    pub(super) fn channels<V: Subject>(&self) -> Vec<usize> {
        let last = depth_channel::<V>();
        let named = |channel: &usize| self.wrt.contains(if *channel == last { &Wrt::Density } else { &Wrt::Emission });
        (0..=last).filter(named).collect()
    }

    /// Differentiates by all that the settings name, without a report.
    ///
    /// # Errors
    /// If forward mode is requested for too many parameters, or the volume cannot be rendered.
    pub(in crate::app) fn gradient<V: Subject>(&self, study: &Study<V>) -> Result<StudyGradient> {
        let (parameters, channels) = (self.parameters(study), self.channels::<V>());
        let count = parameters.len() + channels.len() * study.voxels();
        study.gradient(self.plan(study, count, &channels)?.mode, &parameters, &channels)
    }

    /// Differentiates by all that the settings name; the report lists the parameters and the largest derivatives by
    /// voxel.
    pub(super) fn differentiate<V: Subject>(
        &self,
        study: &Study<V>,
        context: &Context,
    ) -> Result<(StudyGradient, GradientReport)> {
        let _stage = context.stage("derivatives");
        let (mut parameters, channels) = (self.parameters(study), self.channels::<V>());
        let count = parameters.len() + channels.len() * study.voxels();
        let plan = self.plan(study, count, &channels)?;
        context.detail(format!("plan: {} parameters, {}", count, plan.reason));
        let gradient = study.gradient(plan.mode, &parameters, &channels).map_err(|e| e.at(&self.input))?;
        let mut derivatives = gradient.derivatives.clone();
        for (voxel, derivative) in self.largest_by_voxel(&gradient, &channels) {
            parameters.push(voxel);
            derivatives.push(derivative);
        }
        let (mode, adjoint) = match plan.mode {
            AdMode::Forward => ("forward", None),
            AdMode::Reverse(Adjoint::Tape) => ("reverse", Some("tape")),
            AdMode::Reverse(Adjoint::Replay) => ("reverse", Some("replay")),
            AdMode::Reverse(Adjoint::Inversion) => ("reverse", Some("inversion")),
        };
        let report = GradientReport {
            input: self.input.clone(),
            loss: self.loss.name().to_owned(),
            value: gradient.value,
            parameters: count,
            mode,
            adjoint,
            reason: plan.reason,
            precision: if self.check { "f64" } else { "f32" },
            quadrature: V::quadrature(&study.setting),
            views: study.setting.cameras.len(),
            up: None,
            rows: rows(study, parameters, derivatives),
            checked: None,
            worst_relative_error: None,
            warnings: Vec::new(),
            tolerance: self.check.then_some(self.tolerance),
            output: self.output.clone(),
            report: None,
            seconds: 0.0,
            provenance: None,
        };
        Ok((gradient, report))
    }

    /// Chooses the AD mode for `count` parameters, the voxels' `channels` among them.
    ///
    /// # Errors
    /// If forward mode is requested for too many parameters.
    fn plan<V: Subject>(&self, study: &Study<V>, count: usize, channels: &[usize]) -> Result<Choice> {
        let task = Task { parameters: count, reach: study.loss.reach(), depth_alone: V::depth_alone(&study.setting) };
        // Pre-integration's forward mode takes four reverse passes.
        let mode = match self.mode {
            Mode::Auto if self.quadrature.is_preintegrated() => Mode::Reverse,
            mode => mode,
        };
        let plan = Choice::new(task, mode, self.adjoint);
        let bytes = if channels.is_empty() { 0 } else { count * study.field.values.len() * size_of::<V>() };
        if plan.mode == AdMode::Forward && (count > MOST_DIRECTIONS || bytes as u64 > self.limits.max_memory) {
            return Err(Error::unsupported(format!(
                "⟨mode=forward⟩ walks every ray again for each few of {count} parameters; it takes {MOST_DIRECTIONS} \
                 at most"
            ))
            .hint("use ⟨mode=reverse⟩, which finds all at once"));
        }
        Ok(plan)
    }

    /// Returns the voxels of the largest derivatives and these derivatives, as many as are listed.
    fn largest_by_voxel(&self, gradient: &StudyGradient, channels: &[usize]) -> Vec<(Parameter, f64)> {
        let mut order: Vec<usize> = (0..gradient.by_voxel.len()).collect();
        // The sort is stable: equal ones stay in their order.
        order.sort_by(|a, b| gradient.by_voxel[*b].abs().total_cmp(&gradient.by_voxel[*a].abs()));
        order.truncate(self.largest as usize);
        let voxel = |i: usize| Parameter::Voxel { voxel: i / channels.len(), channel: channels[i % channels.len()] };
        order.into_iter().map(|i| (voxel(i), gradient.by_voxel[i])).collect()
    }
}

/// Returns the rows of the report in the order of the parameters, not yet checked.
fn rows<V: Subject>(study: &Study<V>, parameters: Vec<Parameter>, derivatives: Vec<f64>) -> Vec<Row> {
    let described = study.described(&parameters).into_iter().zip(parameters).zip(derivatives);
    let row = |(((name, group, value), parameter), gradient)| Row {
        name,
        group,
        value,
        gradient,
        standard_error: None,
        difference: None,
        rounding: None,
        relative_error: None,
        parameter: Some(parameter),
    };
    described.map(row).collect()
}
