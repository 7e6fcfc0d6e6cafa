use crate::Reconstructor;
use doorcam_core::light::PatchPair;

/// Passes a recording's frames of the empty room on to be learned: all single frames, but only independent averages.
/// Averages that share frames share noise, which would look like a pattern of the light.
#[derive(Debug, Default)]
pub(crate) struct Spaced {
    apart_s: f64,
    last_s: Option<f64>,
    /// The newest average, in case no better one ever comes.
    newest: Option<PatchPair>,
}

impl Spaced {
    /// For averages that are independent when `apart_s` seconds apart.
    pub fn new(apart_s: f64) -> Self {
        Self { apart_s, ..Self::default() }
    }

    /// Takes the next frame. The first average counts only once it is full.
    pub fn offer(&mut self, pair: &PatchPair, seconds: f64, reconstructor: &mut Reconstructor) {
        let first = *self.last_s.get_or_insert(seconds);
        let since = seconds - first;
        // A little less than `apart_s`, because capture times jitter. The average at the first frame is that frame
        // alone.
        if self.apart_s == 0.0 || since >= 0.98 * self.apart_s || since < 0.0 {
            self.last_s = Some(seconds);
            self.newest = None;
            reconstructor.learn(pair);
        } else if reconstructor.background().frames() == 0 {
            self.newest = Some(pair.clone());
        }
    }

    /// Called when there are no more frames of the empty room.
    pub fn finish(&mut self, reconstructor: &mut Reconstructor) {
        if let Some(newest) = self.newest.take() {
            reconstructor.learn(&newest);
        }
    }
}
