//! The table for people: one row per recording, with aligned columns.

use std::path::Path;

use doorcam_engine::Quantiles;
use doorcam_engine::evaluation::Report;

/// The two title lines of each column.
const TITLES: [[&str; 2]; 15] = [
    ["", "recording"],
    ["", "frames"],
    ["", "targets"],
    ["mean", "m"],
    ["RMSE", "m"],
    ["p95", "m"],
    ["bound", "m"],
    ["efficiency", "%"],
    ["missed", "%"],
    ["", "false"],
    ["false", "tracks"],
    ["", "switches"],
    ["in ellipse", "%"],
    ["GOSPA", "m"],
    ["solve, total", "p50 / p99 ms"],
];

/// Shown for a figure that does not exist.
const NONE: &str = "–";

pub(super) fn table(reports: &[Report]) -> String {
    let titles = [0, 1].map(|line| TITLES.map(|title| title[line].to_owned()));
    let rows: Vec<_> = titles.into_iter().chain(reports.iter().map(row)).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..TITLES.len()).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        let mut line = format!("{:<1$}", row[0], widths[0]);
        for (cell, width) in row.iter().zip(&widths).skip(1) {
            line += &format!("  {cell:>width$}");
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn row(report: &Report) -> [String; TITLES.len()] {
    let none = || NONE.to_owned();
    let metres = |value: Option<f64>| value.map_or_else(none, |v| format!("{v:.3}"));
    let percent = |share: Option<f64>| share.map_or_else(none, |s| format!("{:.1}", 100.0 * s));
    let pair = |q: Quantiles| format!("{:.2} / {:.2}", q.p50, q.p99);
    let name = Path::new(&report.recording).file_name();
    [
        name.map_or_else(|| report.recording.clone(), |name| name.to_string_lossy().into_owned()),
        report.scored_frames.to_string(),
        report.targets.to_string(),
        metres(report.mean_error_m),
        metres(report.rmse_m),
        metres(report.p95_error_m),
        metres(report.bound_m),
        percent(report.efficiency),
        percent(report.missed_share),
        report.strays.to_string(),
        report.false_tracks.to_string(),
        report.id_switches.to_string(),
        percent(report.ellipse_share),
        metres(report.gospa_m),
        report.timing_ms.map_or_else(none, |t| format!("{}, {}", pair(t.solve), pair(t.total))),
    ]
}

#[cfg(test)]
mod tests {
    use doorcam_engine::evaluation::ReportTiming;

    use super::*;

    fn report() -> Report {
        Report {
            recording: "recordings/evening".into(),
            frames: 75,
            scored_frames: 60,
            targets: 55,
            detected: 52,
            missed: 3,
            strays: 1204,
            mean_error_m: Some(0.1124),
            rmse_m: Some(0.14),
            p95_error_m: Some(0.2996),
            gospa_m: Some(0.1),
            id_switches: 2,
            timing_ms: None,
            gospa: None,
            people: 1,
            missed_share: Some(3.0 / 55.0),
            tracks: 1,
            false_tracks: 0,
            ellipse_share: Some(1.0),
            median_nees: Some(1.2),
            bound_m: Some(0.021),
            efficiency: Some(0.15),
        }
    }

    #[test]
    fn rows_and_titles_are_aligned_and_nothing_is_a_dash() {
        let q = |p50, p99| Quantiles { p50, p99 };
        let timing = ReportTiming { solve: q(0.3, 1.0), track: q(0.1, 0.2), total: q(1.5, 12.25) };
        let full = Report { timing_ms: Some(timing), ..report() };
        let empty = Report {
            recording: "a/much-longer-ñame".into(),
            targets: 0,
            mean_error_m: None,
            rmse_m: None,
            p95_error_m: None,
            bound_m: None,
            efficiency: None,
            missed_share: None,
            ellipse_share: None,
            ..report()
        };
        let expected = "
                                    mean   RMSE    p95  bound  efficiency  missed          false            in ellipse  GOSPA               solve, total
recording         frames  targets      m      m      m      m           %       %  false  tracks  switches           %      m               p50 / p99 ms
evening               60       55  0.112  0.140  0.300  0.021        15.0     5.5   1204       0         2       100.0  0.100  0.30 / 1.00, 1.50 / 12.25
much-longer-ñame      60        0      –      –      –      –           –       –   1204       0         2           –  0.100                          –
";
        assert_eq!(format!("\n{}", table(&[full, empty])), expected);
    }
}
