//! The multisine in each leg on the board.

use nalgebra::Complex;
use shared::LEGS;
use shared::controller::ControllerReport;
use shared::link::Request;
use shared::multisine::LineParts;
use shared::supervisor::Mode;
use shared::table::ValidTable;

use super::lines::{Response, calibration};
use super::{AFTER, FrfError, MeasuredLine, MeasurementSettings, Pass, RationalFit, evaluate};
use crate::board::link::Client;
use crate::control::LinearLaw;
use crate::design::Study;
use crate::progress::Progress;

/// One experiment: the multisine in one leg.
pub struct Experiment {
    /// By window, line and channel, sensors, then forces: X of Re(X·e^(jωt)), with t from the begin
    /// of the signal, in the channel's unit.
    pub windows: Vec<Vec<Vec<Complex<f64>>>>,
}

/// What the experiments of a measurement have in common.
pub struct Course<'a> {
    pub study: &'a Study,
    pub table: &'a ValidTable,
    /// The law of the closed loop; none with the loop open.
    pub law: Option<&'a LinearLaw>,
    pub settings: MeasurementSettings,
    /// The mode in which the board stays during the measurement.
    pub mode: Mode,
    pub progress: &'a dyn Progress,
}

impl Course<'_> {
    /// Measures the lines of a pass, with amplitudes for the plant of `fit`, or that of the model.
    pub fn pass(
        &self,
        client: &mut Client,
        mut pass: Pass,
        fit: Option<&RationalFit>,
    ) -> Result<Vec<MeasuredLine>, FrfError> {
        let hertz = pass.hertz();
        let responses = match fit {
            Some(fit) => Response::of_fit(self.study, self.table, self.law, &hertz, fit),
            None => Response::of_model(self.study, self.table, self.law, &hertz),
        };
        pass.set_amplitudes(self.study, self.table, &responses, self.settings.amplitude);
        let experiments = self.experiments(client, &pass)?;
        let lines = 0..hertz.len();
        let lines =
            lines.filter_map(|line| evaluate(self.study, self.law, &pass, &experiments, line));
        Ok(lines.collect())
    }

    /// The experiments of a pass, one for each leg.
    fn experiments(&self, client: &mut Client, pass: &Pass) -> Result<Vec<Experiment>, FrfError> {
        // Before anything moves.
        let samples = self.settings.samples(pass)?;
        client.command(pass.lines())?;
        let legs = 0..LEGS;
        legs.map(|leg| self.experiment(client, pass, leg, samples))
            .collect()
    }

    fn experiment(
        &self,
        client: &mut Client,
        pass: &Pass,
        leg: usize,
        samples: u32,
    ) -> Result<Experiment, FrfError> {
        let windows = self.windows(client, pass, leg, samples);
        // However the windows ended, also without a link that answers.
        let ended = client.end_injection();
        let windows = windows?;
        ended?;
        self.well(client.report()?, pass, leg)?;
        let mut forces = windows.iter().flatten().map(|c| c[c.len() - LEGS + leg]);
        if !forces.all(|force| force.norm() > 0.0) {
            return Err(FrfError::Nothing { leg: leg + 1 });
        }
        Ok(Experiment { windows })
    }

    /// Fails if the board has a fault or has changed its mode.
    fn well(
        &self,
        report: ControllerReport,
        pass: &Pass,
        leg: usize,
    ) -> Result<ControllerReport, FrfError> {
        let leg = leg + 1;
        match report.fault {
            Some(fault) => Err(FrfError::Fault {
                leg,
                why: fault.cause,
                amplitude: pass.force(),
            }),
            None if report.mode != self.mode => Err(FrfError::Changed { leg }),
            None => Ok(report),
        }
    }

    /// Injects the multisine into `leg` for so many samples and fetches its windows.
    fn windows(
        &self,
        client: &mut Client,
        pass: &Pass,
        leg: usize,
        samples: u32,
    ) -> Result<Vec<Vec<Vec<Complex<f64>>>>, FrfError> {
        let settling = self.settings.settling;
        client.command(Request::Inject(pass.injection(leg, samples)))?;
        let ControllerReport { injected, .. } = client.report()?;
        let mut windows = Vec::new();
        for window in settling + 1..=settling + self.settings.averages {
            let end = injected + u64::from(window) * u64::from(pass.samples()) + u64::from(AFTER);
            let over = |report: &ControllerReport| {
                report.injecting == 0 || report.mode != self.mode || report.fault.is_some()
            };
            let report = client.wait_for(|report| report.at >= end || over(report))?;
            self.well(report, pass, leg)?;
            let mut lines = Vec::new();
            for line in 0..pass.turns.len() {
                let answer = client.line(line)?;
                if answer.windows != window {
                    return Err(FrfError::Slow { leg: leg + 1 });
                }
                lines.push(self.parts(&answer));
            }
            windows.push(lines);
            self.progress.advance();
        }
        Ok(windows)
    }

    /// The parts of the sensors, then of the forces, in their units.
    fn parts(&self, answer: &LineParts) -> Vec<Complex<f64>> {
        let table = self.table.get();
        let kinds = if table.complement().is_some() { 2 } else { 1 };
        let codes = answer
            .parts
            .map(|[re, im]| Complex::new(f64::from(re), f64::from(im)));
        let sensors = (0..kinds * LEGS).map(|i| codes[i] * f64::from(calibration(table, i).gain));
        let forces = (0..LEGS).map(|i| codes[2 * LEGS + i] / f64::from(table.actuators[i].gain));
        sensors.chain(forces).collect()
    }
}
