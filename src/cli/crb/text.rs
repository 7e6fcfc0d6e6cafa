//! Tables and CSV.

use doorcam_core::bound::{Bound, Choice, Strategy};

use super::Row;

/// One row per strategy and target, with aligned columns.
pub(super) fn table(choice: Option<Choice>, rows: &[Row]) -> String {
    let mut cells: Vec<Vec<String>> = Vec::new();
    let titles = ["strategy", "phi1", "phi2", "x", "y", "sd c", "sd phi1", "sd phi2", "sd x", "sd y", "corr", "error"];
    let mut title = titles.map(String::from).to_vec();
    let mut units = ["", "deg", "deg", "m", "m", "%", "deg", "deg", "m", "m", "xy", "m"].map(String::from).to_vec();
    if let Some(choice) = choice {
        let unit = if matches!(choice, Choice::Patch | Choice::Door | Choice::Wall) { "m" } else { "" };
        title.insert(1, choice.name().into());
        units.insert(1, unit.into());
    }
    cells.extend([title, units]);
    for (row, strategy, bound) in lines(rows) {
        let [sd_x, sd_y] = deviations(bound);
        let mut line = vec![strategy.name().to_owned()];
        line.extend(row.value(choice).map(|(_, value)| value.to_string()));
        line.extend([row.angles.alpha1, row.angles.alpha2].map(|a| format!("{:.1}", a.to_degrees())));
        line.extend(row.place.map(|v| format!("{v:.2}")));
        line.push(short(100.0 * bound.sd_c));
        line.extend([bound.sd_phi1, bound.sd_phi2].map(|a| short(a.to_degrees())));
        line.extend([sd_x, sd_y].map(short));
        line.push(correlation(bound).map_or_else(|| short(f64::INFINITY), |value| format!("{value:.3}")));
        line.push(short(bound.error_m()));
        cells.push(line);
    }
    let width = |column: usize| cells.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..cells[0].len()).map(width).collect();
    let mut text = String::new();
    for line in &cells {
        let mut aligned = format!("{:<1$}", line[0], widths[0]);
        for (cell, width) in line.iter().zip(&widths).skip(1) {
            aligned += &format!("  {cell:>width$}");
        }
        text += aligned.trim_end();
        text.push('\n');
    }
    text
}

/// The columns that other programs read. For a sweep, the swept value comes first and the metres last.
pub(super) fn csv(choice: Option<Choice>, rows: &[Row]) -> String {
    let mut text = choice.map_or_else(String::new, |choice| format!("{},", choice.name()));
    text += "strategy,phi1_deg,phi2_deg,sd_c,sd_phi1_rad,sd_phi2_rad";
    text += if choice.is_some() { ",x_m,y_m,sd_x_m,sd_y_m,corr_xy,error_m\n" } else { "\n" };
    for (row, strategy, bound) in lines(rows) {
        let [phi1, phi2] = [row.angles.alpha1, row.angles.alpha2].map(degrees);
        if let Some((_, value)) = row.value(choice) {
            text += &format!("{value},");
        }
        text += &format!("{},{phi1},{phi2},{:e},{:e},{:e}", strategy.name(), bound.sd_c, bound.sd_phi1, bound.sd_phi2);
        if choice.is_some() {
            let ([x, y], [sd_x, sd_y]) = (row.place, deviations(bound));
            let correlation = correlation(bound).unwrap_or(0.0);
            text += &format!(",{x},{y},{sd_x:e},{sd_y:e},{correlation},{:e}", bound.error_m());
        }
        text.push('\n');
    }
    text
}

/// Degrees without rounding errors in the last digits: 60 rather than 59.99999999999999.
fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * 1e9).round() / 1e9
}

fn lines(rows: &[Row]) -> impl Iterator<Item = (&Row, Strategy, &Bound)> {
    let strategies = Strategy::ALL.into_iter().enumerate();
    strategies.flat_map(move |(k, strategy)| rows.iter().map(move |row| (row, strategy, &row.bounds[k])))
}

fn deviations(bound: &Bound) -> [f64; 2] {
    [0, 1].map(|k| bound.covariance_m2[k][k].sqrt())
}

/// The correlation of x and y; none where the pixels do not determine it.
fn correlation(bound: &Bound) -> Option<f64> {
    let [sd_x, sd_y] = deviations(bound);
    let correlation = bound.covariance_m2[0][1] / (sd_x * sd_y);
    (sd_x.is_finite() && correlation.is_finite()).then_some(correlation)
}

/// Three significant digits; a dash for what the pixels do not determine.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value != 0.0 && !(1e-4..1e5).contains(&value) {
        return format!("{value:.2e}");
    }
    let decimals = (2.0 - value.abs().max(1e-4).log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}")
}
