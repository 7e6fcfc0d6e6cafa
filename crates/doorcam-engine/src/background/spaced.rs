use crate::Reconstructor;
use doorcam_core::light::PatchPair;

/// Hands a recording's frames of the empty room on to be learned: all of them, or of averages only those that are
/// independent. Averages that share frames share noise, and would make it look as if it were a pattern of the light.
#[derive(Debug, Default)]
pub(crate) struct Spaced {
    apart_s: f64,
    last_s: Option<f64>,
    /// The newest one, in case there is never a better.
    newest: Option<PatchPair>,
}

impl Spaced {
    /// For averages that are independent when `apart_s` seconds apart.
    pub fn new(apart_s: f64) -> Self {
        Self { apart_s, ..Self::default() }
    }

    /// The next frame. The first average counts only once it is full.
    pub fn offer(&mut self, pair: &PatchPair, seconds: f64, reconstructor: &mut Reconstructor) {
        let first = *self.last_s.get_or_insert(seconds);
        let since = seconds - first;
        // A little less, for capture jitters. The average that ends with the first frame is of that frame alone.
        if self.apart_s == 0.0 || since >= 0.98 * self.apart_s || since < 0.0 {
            self.last_s = Some(seconds);
            self.newest = None;
            reconstructor.learn(pair);
        } else if reconstructor.background().frames() == 0 {
            self.newest = Some(pair.clone());
        }
    }

    /// There are no more frames of the empty room.
    pub fn finish(&mut self, reconstructor: &mut Reconstructor) {
        if let Some(newest) = self.newest.take() {
            reconstructor.learn(&newest);
        }
    }
}
