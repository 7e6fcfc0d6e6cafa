use nalgebra::DMatrix;

use super::BodyTable;
use super::columns::Columns;
use super::place::Place;

/// The effect of bodies on whitened measurements.
#[derive(Debug, Clone)]
pub(super) struct Whitened {
    /// Per side, a column for each place of the table.
    columns: [Columns; 2],
    /// Derivatives of `columns` by the log of the radius.
    by_radius: [Columns; 2],
}

impl Whitened {
    pub fn new(table: &BodyTable, whiten: &[DMatrix<f32>; 2]) -> Self {
        let whitened = |columns: &[Columns; 2]| [0, 1].map(|s| Columns::new(&(&whiten[s] * columns[s].matrix())));
        Self { columns: whitened(&table.columns), by_radius: whitened(&table.by_radius) }
    }

    /// Number of whitened values of one side.
    pub fn values(&self, s: usize) -> usize {
        self.columns[s].rows()
    }

    /// Writes the effect of a body of unit radiance at a place on the patch of one side, and its derivatives by
    /// azimuth, log range and log radius. `widening` is the log of the body's radius relative to the table's.
    pub fn body(&self, s: usize, at: Place, widening: f64, [value, by_azimuth, by_range, by_radius]: [&mut [f32]; 4]) {
        value.fill(0.0);
        by_azimuth.fill(0.0);
        by_range.fill(0.0);
        by_radius.fill(0.0);
        for (place, [w, wa, wr]) in BodyTable::stencil(at) {
            let ((column, step), (wider, wider_step)) =
                (self.columns[s].column(place), self.by_radius[s].column(place));
            let [ww, w, wa, wr] = [w * wider_step, w * step, wa * step, wr * step];
            let out = value.iter_mut().zip(&mut *by_azimuth).zip(&mut *by_range).zip(&mut *by_radius);
            for ((&x, &r), (((v, va), vr), vw)) in column.iter().zip(wider).zip(out) {
                let x = f32::from(x);
                *v += w * x;
                *va += wa * x;
                *vr += wr * x;
                *vw += ww * f32::from(r);
            }
        }
        value.iter_mut().zip(&*by_radius).for_each(|(v, r)| *v += widening as f32 * r);
    }
}
