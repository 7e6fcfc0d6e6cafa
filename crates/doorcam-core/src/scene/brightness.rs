use serde::{Deserialize, Serialize};

/// Which brightness is shown for a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Brightness {
    /// Brightness as measured on the floor, from the least-squares refit.
    Measured,
    /// Brightness of the solution itself, which the sparsity penalty of eq. 13 shrinks; the paper's figures show this.
    Shrunk,
}

impl Brightness {
    /// The wording in captions.
    pub fn words(self) -> &'static str {
        match self {
            Self::Measured => "measured brightness",
            Self::Shrunk => "brightness as shrunk by the penalty",
        }
    }
}
