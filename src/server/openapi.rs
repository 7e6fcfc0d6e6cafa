//! The API's description, made from the routes and the types that they answer with.

use std::sync::LazyLock;

use axum::http::{HeaderMap, header};
use axum::response::Response;
use serde_json::{Map, Value, json};
use utoipa::{OpenApi, ToResponse, ToSchema};

use super::described;
use super::problem::Problem;
use super::tag::Tag;

/// Tags, which group the routes.
pub(super) const STATE: &str = "State";
pub(super) const ROOM: &str = "Room";
pub(super) const PEOPLE: &str = "People";
pub(super) const PICTURES: &str = "Pictures";
pub(super) const SETUP: &str = "Setup";

/// Of answers that have an ETag.
pub(super) const UNCHANGED: &str = "The client has it already: If-None-Match names its ETag";

/// What goes before the routes.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "doorcam",
        description = "Who moves in the room behind a doorway, live.\n\n\
            Names end in their unit: `_m` metres, `_m_s` metres a second, `_s` seconds, `_ms` milliseconds, `_px` pixels, \
            `_deg` degrees. Places are in the door frame: the origin on the floor in the middle of the opening, in the wall's \
            hidden face; x to the right for who faces the door from the visible side, y into the hidden room. Light is linear, \
            relative to full scale.\n\n\
            Paths that begin with `/api/v1` keep their meaning; keys may be added to answers. Errors are RFC 9457 problems."
    ),
    tags(
        (name = STATE, description = "How doorcam is doing"),
        (name = ROOM, description = "What changed in the hidden room"),
        (name = PEOPLE, description = "Who is where, and what they did"),
        (name = PICTURES, description = "Pictures, for people"),
        (name = SETUP, description = "Calibration and the empty room"),
    ),
    components(schemas(super::live::LiveMessage, Problem), responses(NotYet, NotReady, Unknown, Malformed, TooLarge, Unfit, Conflicting, WrongToken, TooMany, NoSocket, Failed)),
)]
pub(super) struct About;

/// An image file.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "only its description matters")]
pub(super) struct Picture(Vec<u8>);

/// An error, as a response that several routes have.
macro_rules! problems {
    ($($(#[$description:meta])* $name:ident)*) => {$(
        $(#[$description])*
        #[derive(ToResponse)]
        #[response(content_type = "application/problem+json")]
        #[expect(dead_code, reason = "only its description matters")]
        pub(super) struct $name(Problem);
    )*};
}

problems! {
    /// Not there yet: the detail says what is waited for
    NotYet
    /// No fresh update
    NotReady
    /// There is no such thing
    Unknown
    /// The request cannot be read: the detail says what was expected
    Malformed
    /// The body is too large
    TooLarge
    /// It can be read, but not used: the detail says why
    Unfit
    /// Not possible with this source, or not any more
    Conflicting
    /// Without a token, or with a wrong one
    WrongToken
    /// Too many wrong tokens: Retry-After tells when another is looked at
    TooMany
    /// Only a WebSocket is served here
    NoSocket
    /// An error of doorcam's own
    Failed
}

/// The document, served and in docs/openapi.json.
static DOCUMENT: LazyLock<String> = LazyLock::new(|| format!("{:#}\n", document()));

fn document() -> Value {
    // Its keys are strings, as JSON wants them: there is nothing that serialisation could refuse.
    let mut document = serde_json::to_value(described().into_openapi()).unwrap_or_default();
    let schemas = document.pointer_mut("/components/schemas").and_then(Value::as_object_mut);
    for one in schemas
        .into_iter()
        .flat_map(Map::values_mut)
        .filter_map(|schema| schema.get_mut("oneOf")?.as_array_mut())
        .flatten()
    {
        // A variant that has a value is an object with its name as the only key, and is read as nothing else.
        if one["properties"].as_object().is_some_and(|properties| properties.len() == 1) && one["required"].is_array() {
            one["additionalProperties"] = Value::Bool(false);
        }
    }
    document
}

/// The API's description (OpenAPI 3.1), as JSON.
pub fn openapi_json() -> &'static str {
    &DOCUMENT
}

/// The messages of the live socket as a JSON schema, served and in docs/live.schema.json.
static LIVE: LazyLock<String> = LazyLock::new(|| {
    let document = document();
    let schemas = &document["components"]["schemas"];
    let mut used = Map::new();
    let mut wanted = vec!["LiveMessage".to_owned()];
    while let Some(name) = wanted.pop() {
        if !used.contains_key(&name) {
            let schema = schemas[&name].to_string();
            let names = schema.split(REFERENCE).skip(1).filter_map(|rest| rest.split('"').next());
            wanted.extend(names.map(str::to_owned));
            used.insert(name, serde_json::from_str(&schema.replace(REFERENCE, "#/$defs/")).unwrap_or_default());
        }
    }
    let schema = json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A message of doorcam's live socket",
        "$ref": "#/$defs/LiveMessage",
        "$defs": used,
    });
    format!("{schema:#}\n")
});

/// How the description refers to its schemas.
const REFERENCE: &str = "#/components/schemas/";

/// The messages of the live socket, as a JSON schema (2020-12).
pub fn live_schema_json() -> &'static str {
    &LIVE
}

/// The messages of the live socket, as a JSON schema (2020-12).
#[utoipa::path(
    get, path = "/live.schema.json", tag = ROOM,
    responses((status = 200, description = "The schema", body = Object, content_type = "application/schema+json"), (status = 304, description = UNCHANGED))
)]
pub(super) async fn live_schema(asked: HeaderMap) -> Response {
    let answer = || ([(header::CONTENT_TYPE, "application/schema+json")], live_schema_json());
    Tag::of(live_schema_json().as_bytes()).answer(&asked, answer)
}

/// This description (OpenAPI 3.1).
#[utoipa::path(
    get, path = "/openapi.json", tag = STATE,
    responses((status = 200, description = "The description", body = Object), (status = 304, description = UNCHANGED))
)]
pub(super) async fn openapi(asked: HeaderMap) -> Response {
    let answer = || ([(header::CONTENT_TYPE, "application/json")], openapi_json());
    Tag::of(openapi_json().as_bytes()).answer(&asked, answer)
}
