//! The API's description: it is complete, docs/ has the same one as the code, and the daemon serves it.

use crate::common::{Daemon, grey_recording, manifest};
use serde_json::Value;

/// Checks a file in docs/ that is generated from the code. UPDATE_DOCS=1 writes it again.
fn generated(name: &str, text: &str) {
    let path = format!("{}/docs/{name}", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, text).expect("a writable docs/");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == text, "docs/{name} is out of date: UPDATE_DOCS=1 cargo test --test daemon openapi");
}

fn document() -> Value {
    serde_json::from_str(doorcam::server::openapi_json()).expect("JSON")
}

#[test]
fn the_description_in_docs_is_that_of_the_code() {
    generated("openapi.json", doorcam::server::openapi_json());
    generated("live.schema.json", doorcam::server::live_schema_json());
}

#[test]
fn the_description_is_whole() {
    let document = document();
    assert!(document["openapi"].as_str().unwrap().starts_with("3.1."));
    let said = |value: &Value| value.as_str().is_some_and(|text| !text.trim().is_empty());
    for (path, operations) in document["paths"].as_object().unwrap() {
        for (method, operation) in operations.as_object().unwrap() {
            assert!(said(&operation["summary"]), "{method} {path} says what it is");
            assert!(operation["responses"].as_object().is_some_and(|r| !r.is_empty()), "{method} {path}");
        }
    }
    for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
        assert!(said(&schema["description"]), "{name} says what it is");
        for (key, property) in schema["properties"].as_object().into_iter().flatten() {
            // The description of a key that may be null is beside its type.
            let one_of = property["oneOf"].as_array().into_iter().flatten();
            let told = std::iter::once(property).chain(one_of).any(|value| said(&value["description"]));
            assert!(told, "{name}.{key} says what it is");
        }
    }
    // Every reference resolves.
    let text = doorcam::server::openapi_json();
    for reference in text.split("\"$ref\": \"#").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert!(document.pointer(reference).is_some(), "{reference}");
    }
}

#[test]
fn the_description_is_served() {
    let dir = grey_recording(&manifest(), 3);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    assert_eq!(daemon.json("/api/v1/openapi.json"), document());
}
