use nalgebra::{DMatrix, DMatrixView};

use super::BodyTable;
use super::place::Place;

/// Bodies as whitened measurements show them.
#[derive(Debug, Clone)]
pub(super) struct Whitened {
    /// Per side, a column for each place of the table.
    columns: [DMatrix<f32>; 2],
    by_radius: [DMatrix<f32>; 2],
}

impl Whitened {
    pub fn new(table: &BodyTable, whiten: &[DMatrix<f32>; 2]) -> Self {
        let whitened = |values: &[Vec<f32>; 2]| {
            [0, 1].map(|s| {
                let cells = table.cells[s];
                &whiten[s] * DMatrixView::from_slice(&values[s], cells, values[s].len() / cells.max(1))
            })
        };
        Self { columns: whitened(&table.columns), by_radius: whitened(&table.by_radius) }
    }

    pub fn scale(&mut self, factor: f32) {
        self.columns.iter_mut().chain(&mut self.by_radius).for_each(|columns| *columns *= factor);
    }

    /// Values of one side.
    pub fn values(&self, s: usize) -> usize {
        self.columns[s].nrows()
    }

    /// A body of unit radiance at a place, as the patch of one side shows it, of a radius that differs by a factor from the
    /// table's (`widening`: its log), and the derivatives by azimuth, log range and log radius.
    pub fn body(&self, s: usize, at: Place, widening: f64, [value, by_azimuth, by_range, by_radius]: [&mut [f32]; 4]) {
        value.fill(0.0);
        by_azimuth.fill(0.0);
        by_range.fill(0.0);
        by_radius.fill(0.0);
        for (place, [w, wa, wr]) in BodyTable::stencil(at) {
            let (column, wider) = (self.columns[s].column(place), self.by_radius[s].column(place));
            let columns = column.as_slice().iter().zip(wider.as_slice());
            let out = value.iter_mut().zip(&mut *by_azimuth).zip(&mut *by_range).zip(&mut *by_radius);
            for ((x, r), (((v, va), vr), vw)) in columns.zip(out) {
                *v += w * x;
                *va += wa * x;
                *vr += wr * x;
                *vw += w * r;
            }
        }
        value.iter_mut().zip(&*by_radius).for_each(|(v, r)| *v += widening as f32 * r);
    }
}
