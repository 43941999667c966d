//! `host-gen campaign` in text: a table in Markdown.

use std::fmt::{self, Display, Formatter};

use crate::board::words::cause;
use crate::report::campaign::CampaignSummary;
use crate::simulate::faults::Defect;

impl Display for CampaignSummary {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "# Faults in the loop of {}\n", self.machine)?;
        writeln!(
            f,
            "Output of `host-gen campaign`, {} feedback. For the self-test, each fault is present from\nthe start. For the supervisor, it occurs with the loop closed. After a fault is detected,\nthe legs must be at rest within {:.0} ms.\n",
            self.feedback,
            1e3 * self.bound
        )?;
        writeln!(
            f,
            "| fault | self-test | with the loop closed | after | outputs within limits | at rest after |\n|---|---|---|---|---|---|"
        )?;
        for outcome in &self.outcomes {
            let names: Vec<_> = outcome.defects.iter().copied().map(Defect::name).collect();
            let test = outcome.self_test.map_or_else(|| "passes".to_owned(), cause);
            let (closed, after) = match (outcome.closed, outcome.worse_db) {
                (Some((why, after)), _) => (cause(why), format!("{:.1} ms", 1e3 * after)),
                (None, Some(db)) => (format!("goes on, performance {db:+.1} dB"), "–".to_owned()),
                (None, None) => ("goes on".to_owned(), "–".to_owned()),
            };
            let rest = match (outcome.safe, outcome.safe_after) {
                (true, Some(time)) => format!("{:.1} ms", 1e3 * time),
                (true, None) => "–".to_owned(),
                (false, _) => "TOO LATE".to_owned(),
            };
            writeln!(
                f,
                "| {} | {test} | {closed} | {after} | {} | {rest} |",
                names.join(" and "),
                if outcome.inside { "yes" } else { "NO" }
            )?;
        }
        Ok(())
    }
}
