//! What was measured as comma-separated values.

use super::measurement::Measurement;

/// Columns of the table.
const COLUMNS: &str = "options,group,error,error_below,error_low,error_high,percentile_99,largest,seconds,seconds_min,\
                       seconds_max,seconds_q1,seconds_q3,runs,on_front,command";

/// Returns the table of all settings, a line each.
pub(super) fn csv(measurements: &[Measurement]) -> String {
    let mut text = format!("{COLUMNS}\n");
    for m in measurements {
        let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
        let pair = |v: Option<[f64; 2]>| v.map_or([None; 2], |v| v.map(Some)).map(number);
        let [low, high] = pair(m.error_interval);
        let [least, most] = pair(m.seconds_range);
        let [q1, q3] = pair(m.seconds_quartiles);
        let cells = [
            quoted(&m.options),
            quoted(&m.group),
            number(m.error),
            number(m.error_below),
            low,
            high,
            number(m.percentile_99),
            number(m.largest),
            number(m.seconds),
            least,
            most,
            q1,
            q3,
            m.runs.len().to_string(),
            m.on_front.to_string(),
            quoted(&m.command),
        ];
        text += &cells.join(",");
        text.push('\n');
    }
    text
}

/// Quotes a cell (RFC 4180).
fn quoted(cell: &str) -> String {
    format!("\"{}\"", cell.replace('"', "\"\""))
}
