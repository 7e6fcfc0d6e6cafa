//! The OpenAPI description, generated from the routes and the types of their answers.

use std::sync::LazyLock;

use axum::http::{HeaderMap, header};
use axum::response::Response;
use serde_json::{Map, Value, json};
use utoipa::OpenApi;

use super::answers::{
    Busy, Conflicting, Failed, Malformed, NoSocket, NotReady, NotYet, PEOPLE, PICTURES, ROOM, SETUP, STATE, Stale,
    TooLarge, TooMany, UNCHANGED, Unfit, Unknown, WrongToken,
};
use super::described;
use super::problem::ProblemDetails;
use super::tag::Tag;

/// Title, introduction, tags and shared components of the description.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "doorcam",
        description = "Who moves in the room behind a doorway, live.\n\n\
            Names end in their unit: `_m` metres, `_m_s` metres a second, `_s` seconds, `_ms` milliseconds, `_px` \
            pixels, `_deg` degrees. Positions are in the door frame: the origin is on the floor in the middle of the \
            opening, in the plane of the wall's hidden face; x points to the right for somebody on the visible side \
            who faces the door, y into the hidden room. Light is linear, relative to full scale.\n\n\
            Paths that begin with `/api/v1` keep their meaning; answers may gain keys. Errors are RFC 9457 problems."
    ),
    tags(
        (name = STATE, description = "The state of doorcam"),
        (name = ROOM, description = "What changed in the hidden room"),
        (name = PEOPLE, description = "Who is where, and what they did"),
        (name = PICTURES, description = "Pictures, for people"),
        (name = SETUP, description = "Calibration and the empty room"),
    ),
    components(
        schemas(super::live::LiveMessage, ProblemDetails),
        responses(
            NotYet, NotReady, Unknown, Malformed, TooLarge, Unfit, Conflicting, Stale, WrongToken, TooMany, NoSocket, Failed,
            Busy
        ),
    ),
)]
pub(super) struct About;

/// The description, as served and as kept in docs/openapi.json.
static DOCUMENT: LazyLock<String> = LazyLock::new(|| format!("{:#}\n", document()));

fn document() -> Value {
    // Serialisation cannot fail, because all keys are strings.
    let mut document = serde_json::to_value(described().into_openapi()).unwrap_or_default();
    let schemas = document.pointer_mut("/components/schemas").and_then(Value::as_object_mut);
    for one in schemas
        .into_iter()
        .flat_map(Map::values_mut)
        .filter_map(|schema| schema.get_mut("oneOf")?.as_array_mut())
        .flatten()
    {
        // An enum variant with a value is an object whose only key is the variant's name; serde accepts no other keys.
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

/// The JSON schema of the live socket's messages, as served and as kept in docs/live.schema.json.
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

/// The prefix of references to schemas in the description.
const REFERENCE: &str = "#/components/schemas/";

/// The messages of the live socket, as a JSON schema (2020-12).
pub fn live_schema_json() -> &'static str {
    &LIVE
}

/// The messages of the live socket, as a JSON schema (2020-12).
#[utoipa::path(
    get, path = "/live.schema.json", tag = ROOM,
    responses(
        (status = 200, description = "The schema", body = Object, content_type = "application/schema+json"),
        (status = 304, description = UNCHANGED),
    )
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
