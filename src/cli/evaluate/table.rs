//! The tables for people: one row per recording, and rows by person and by distance, with aligned columns.

use std::path::Path;

use doorcam_engine::Quantiles;
use doorcam_engine::evaluation::{Report, RowFigures};

/// The two title lines of each column.
const TITLES: [[&str; 2]; 18] = [
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
    ["", "unwatched"],
    ["", "directions"],
    ["crossings", "right, missed, false"],
];

/// The two title lines of each column of the rows of a recording.
const ROW_TITLES: [[&str; 2]; 7] = [
    ["", ""],
    ["", "targets"],
    ["", "detected"],
    ["", "missed"],
    ["", "directions"],
    ["mean", "m"],
    ["in ellipse", "%"],
];

/// Shown for a figure that does not exist.
const NONE: &str = "–";

pub(super) fn table(reports: &[Report]) -> String {
    let mut text = aligned(TITLES, reports.iter().map(row));
    for report in reports {
        text += &rows(report);
    }
    text
}

/// A recording's rows by person and by distance, below its name; empty if they are not wanted.
fn rows(report: &Report) -> String {
    let people = report.by_person.iter().flatten().map(|row| (format!("person {}", row.id), &row.figures));
    let metres = report.by_distance.iter().flatten();
    let metres = metres.map(|row| (format!("{} to {} m", row.from_m, row.to_m), &row.figures));
    let rows: Vec<_> = people.chain(metres).map(|(name, figures)| figures_row(name, figures)).collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut titles = ROW_TITLES;
    let name = name(report);
    titles[0][1] = &name;
    format!("\n{}", aligned(titles, rows.into_iter()))
}

/// Title lines and rows with aligned columns, the first one to the left.
fn aligned<const N: usize>(titles: [[&str; 2]; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let titles = [0, 1].map(|line| titles.map(|title| title[line].to_owned()));
    let rows: Vec<_> = titles.into_iter().chain(rows).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..N).map(width).collect();
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

fn name(report: &Report) -> String {
    let name = Path::new(&report.recording).file_name();
    name.map_or_else(|| report.recording.clone(), |name| name.to_string_lossy().into_owned())
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| NONE.to_owned(), |v| format!("{v:.3}"))
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| NONE.to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn figures_row(name: String, figures: &RowFigures) -> [String; ROW_TITLES.len()] {
    [
        name,
        figures.targets.to_string(),
        figures.detected.to_string(),
        figures.missed.to_string(),
        figures.directions.to_string(),
        metres(figures.mean_error_m),
        percent(figures.ellipse_share),
    ]
}

fn row(report: &Report) -> [String; TITLES.len()] {
    let pair = |q: Quantiles| format!("{:.2} / {:.2}", q.p50, q.p99);
    let crossings = report.crossings;
    [
        name(report),
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
        report.timing_ms.map_or_else(|| NONE.to_owned(), |t| format!("{}, {}", pair(t.solve), pair(t.total))),
        report.unwatched.to_string(),
        report.directions.to_string(),
        format!("{}, {}, {}", crossings.right, crossings.missed, crossings.strays),
    ]
}

#[cfg(test)]
mod tests {
    use doorcam_engine::evaluation::{CrossingCounts, DistanceRow, PersonRow, ReportTiming};

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
            crossings: CrossingCounts { right: 2, missed: 0, strays: 1 },
            unwatched: 12,
            directions: 4,
            by_person: None,
            by_distance: None,
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
                                    mean   RMSE    p95  bound  efficiency  missed          false            in ellipse  GOSPA               solve, total                                    crossings
recording         frames  targets      m      m      m      m           %       %  false  tracks  switches           %      m               p50 / p99 ms  unwatched  directions  right, missed, false
evening               60       55  0.112  0.140  0.300  0.021        15.0     5.5   1204       0         2       100.0  0.100  0.30 / 1.00, 1.50 / 12.25         12           4               2, 0, 1
much-longer-ñame      60        0      –      –      –      –           –       –   1204       0         2           –  0.100                          –         12           4               2, 0, 1
";
        assert_eq!(format!("\n{}", table(&[full, empty])), expected);
    }

    #[test]
    fn rows_by_person_and_by_distance_stand_below_the_name_of_their_recording() {
        let figures = RowFigures {
            targets: 55,
            detected: 52,
            missed: 3,
            directions: 4,
            mean_error_m: Some(0.1124),
            ellipse_share: Some(0.95),
        };
        let nobody = RowFigures { detected: 0, mean_error_m: None, ellipse_share: None, ..figures.clone() };
        let wanted = Report {
            by_person: Some(vec![PersonRow { id: 12, figures: figures.clone() }]),
            by_distance: Some(vec![
                DistanceRow { from_m: 0, to_m: 1, figures: nobody },
                DistanceRow { from_m: 2, to_m: 3, figures },
            ]),
            ..report()
        };
        let expected = "
                                                   mean  in ellipse
evening    targets  detected  missed  directions      m           %
person 12       55        52       3           4  0.112        95.0
0 to 1 m        55         0       3           4      –           –
2 to 3 m        55        52       3           4  0.112        95.0
";
        let text = table(&[wanted, report()]);
        assert_eq!(text.lines().count(), 4 + expected.lines().count());
        assert!(text.ends_with(expected), "{text}");
    }
}
