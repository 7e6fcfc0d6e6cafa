use serde::{Deserialize, Serialize};

/// Which brightness of a change is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Brightness {
    /// That of the least-squares refit: as the floor says.
    Measured,
    /// That of the solution itself, which the sparsity penalty of eq. 13 shrinks; the paper's figures show it.
    Shrunk,
}

impl Brightness {
    /// How a caption says it.
    pub fn words(self) -> &'static str {
        match self {
            Self::Measured => "measured brightness",
            Self::Shrunk => "brightness as shrunk by the penalty",
        }
    }
}
