use nalgebra::DMatrix;

use super::body_table::{BodyTable, Stencil};
use super::columns::Columns;
use super::hidden_light::HiddenLight;

/// An effect of bodies on the whitened measurements of one side.
#[derive(Debug, Clone)]
pub(super) struct Effect {
    /// A column for each place of the table.
    columns: Columns,
    /// Derivatives of `columns` by the log of the radius.
    by_radius: Columns,
}

/// The effects of bodies on whitened measurements, per side.
#[derive(Debug, Clone)]
pub(super) struct Whitened {
    /// Light of a body of unit radiance.
    own: [Effect; 2],
    /// Per colour, the light that a body hides (negative); none in a room that is not known.
    hidden: Option<[[Effect; 3]; 2]>,
}

impl Whitened {
    pub fn new(table: &BodyTable, hidden: Option<&HiddenLight>, whiten: &[DMatrix<f32>; 2]) -> Self {
        let whitened = |s: usize, columns: &Columns| Columns::new(&(&whiten[s] * columns.matrix()));
        let own = [0, 1]
            .map(|s| Effect { columns: whitened(s, &table.columns[s]), by_radius: whitened(s, &table.by_radius[s]) });
        let effect = |light: &HiddenLight, s: usize, c: usize| Effect {
            columns: Columns::new(&(&whiten[s] * &light.columns[s][c])),
            by_radius: Columns::new(&(&whiten[s] * &light.by_radius[s][c])),
        };
        let hidden = hidden.map(|light| [0, 1].map(|s| [0, 1, 2].map(|c| effect(light, s, c))));
        Self { own, hidden }
    }

    /// Number of whitened values of one side.
    pub fn values(&self, s: usize) -> usize {
        self.own[s].columns.rows()
    }

    /// Whether it is known what bodies hide.
    pub fn knows_hidden(&self) -> bool {
        self.hidden.is_some()
    }

    /// Writes the effect of a body of unit radiance at the place of a stencil on the patch of one side, and its
    /// derivatives by azimuth, log range and log radius. `widening` is the log of the body's radius relative to the
    /// table's.
    pub fn body(&self, s: usize, at: &Stencil, widening: f64, out: [&mut [f32]; 4]) {
        self.own[s].interpolate(at, widening, out);
    }

    /// Like [`Self::body`], for the light of one colour that the body hides.
    pub fn hidden(&self, s: usize, c: usize, at: &Stencil, widening: f64, out: [&mut [f32]; 4]) {
        match &self.hidden {
            Some(hidden) => hidden[s][c].interpolate(at, widening, out),
            None => out.into_iter().for_each(|out| out.fill(0.0)),
        }
    }
}

impl Effect {
    fn interpolate(&self, at: &Stencil, widening: f64, [value, by_azimuth, by_range, by_radius]: [&mut [f32]; 4]) {
        value.fill(0.0);
        by_azimuth.fill(0.0);
        by_range.fill(0.0);
        by_radius.fill(0.0);
        for &(place, [w, wa, wr]) in at {
            let ((column, step), (wider, wider_step)) = (self.columns.column(place), self.by_radius.column(place));
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
