use serde::{Deserialize, Serialize};

/// Which changes a facet may show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum ModelKind {
    /// Eq. 13 as written: c_L, c_R >= 0 and v any unit vector, so a facet may become brighter or darker in each colour.
    /// People mostly darken: they block the light of the wall behind them.
    Signed,
    /// As in the authors' program: v >= 0, and only the background may become darker.
    Published,
}

impl ModelKind {
    /// The name used in configurations and updates.
    pub fn name(self) -> &'static str {
        match self {
            ModelKind::Signed => "signed",
            ModelKind::Published => "published",
        }
    }
}
