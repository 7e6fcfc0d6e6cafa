//! OpenAPI parts that several routes share: tags, error responses and images.

use utoipa::{ToResponse, ToSchema};

use super::problem::ProblemDetails;

/// Tags that group the routes.
pub(super) const STATE: &str = "State";
pub(super) const ROOM: &str = "Room";
pub(super) const PEOPLE: &str = "People";
pub(super) const PICTURES: &str = "Pictures";
pub(super) const SETUP: &str = "Setup";

/// Description of status 304 for responses that have an ETag.
pub(super) const UNCHANGED: &str = "Not modified: If-None-Match names the current ETag";

/// Description of If-Match for what can be changed.
pub(super) const IF_MATCH: &str = "Change it only if this is its current ETag (or \"*\"); otherwise the answer is 412";

/// An image file.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "only its description matters")]
pub(super) struct Picture(Vec<u8>);

/// Error responses that several routes share.
macro_rules! problems {
    ($($(#[$description:meta])* $name:ident)*) => {$(
        $(#[$description])*
        #[derive(ToResponse)]
        #[response(content_type = "application/problem+json")]
        #[expect(dead_code, reason = "only its description matters")]
        pub(super) struct $name(ProblemDetails);
    )*};
}

problems! {
    /// Not available yet; the detail says what is missing
    NotYet
    /// Not ready: doorcam is not watching, or the history cannot be read
    NotReady
    /// Not found
    Unknown
    /// The request cannot be parsed; the detail says what was expected
    Malformed
    /// The body is too large
    TooLarge
    /// The request can be parsed but not used; the detail says why
    Unfit
    /// Not possible with this source, or no longer possible
    Conflicting
    /// Changed since: If-Match does not name the current ETag
    Stale
    /// No token, or a wrong one
    WrongToken
    /// Too many wrong tokens; Retry-After says when to try again
    TooMany
    /// This endpoint only serves WebSocket connections
    NoSocket
    /// An internal error of doorcam
    Failed
    /// Too much is asked for at the same time; Retry-After says when to try again
    Busy
}
