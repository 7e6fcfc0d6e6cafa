use std::hash::{DefaultHasher, Hasher};

use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::problem::Problem;

/// What tells one state of an answer from every other (RFC 9110: ETag). Who names it in If-None-Match has the answer already.
pub(super) struct Tag(String);

impl Tag {
    /// Of what an answer consists of.
    pub(super) fn of(content: &[u8]) -> Self {
        let mut hasher = DefaultHasher::new();
        hasher.write(content);
        Self(format!("{:016x}", hasher.finish()))
    }

    /// Of something that a run of the program counts.
    pub(super) fn numbered(run: u64, number: u64) -> Self {
        Self(format!("{run:x}-{number}"))
    }

    /// The answer, or 304 to who has it. It may be kept, but not be shown again without asking.
    pub(super) fn answer<T: IntoResponse>(&self, asked: &HeaderMap, answer: impl FnOnce() -> T) -> Response {
        // Weak: the same answer, compressed or not.
        let headers = [(header::ETAG, format!("W/\"{}\"", self.0)), (header::CACHE_CONTROL, "no-cache".into())];
        if self.is_known(asked) {
            return (StatusCode::NOT_MODIFIED, headers).into_response();
        }
        (headers, answer()).into_response()
    }

    pub(super) fn is_known(&self, asked: &HeaderMap) -> bool {
        let lists = asked.get_all(header::IF_NONE_MATCH).iter().filter_map(|list| list.to_str().ok());
        let mut known = lists.flat_map(|list| list.split(',')).map(str::trim);
        // A strong tag is as good here; none of these has a comma in it.
        known.any(|tag| tag == "*" || tag.strip_prefix("W/").unwrap_or(tag).trim_matches('"') == self.0)
    }
}

/// Answers with JSON that changes rarely, or with 304.
pub(super) fn json(asked: &HeaderMap, value: &impl Serialize) -> Response {
    match serde_json::to_vec(value) {
        Ok(body) => Tag::of(&body).answer(asked, || ([(header::CONTENT_TYPE, "application/json")], body)),
        Err(e) => Problem::internal(&e.to_string()).into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_known_alone_in_a_list_and_weakly() {
        let tag = Tag::numbered(0xabc, 7);
        let known =
            |list: &'static str| tag.is_known(&HeaderMap::from_iter([(header::IF_NONE_MATCH, list.parse().unwrap())]));
        assert!(known("\"abc-7\"") && known("\"x\", W/\"abc-7\" ,\"y\"") && known("*"));
        assert!(!known("\"abc-71\"") && !known("") && !tag.is_known(&HeaderMap::new()));
        let answer = |asked| tag.answer(&asked, || "whole");
        assert_eq!(answer(HeaderMap::new()).headers()[header::ETAG], "W/\"abc-7\"");
        let again = answer(HeaderMap::from_iter([(header::IF_NONE_MATCH, "\"abc-7\"".parse().unwrap())]));
        assert_eq!(
            (again.status(), &again.headers()[header::ETAG]),
            (StatusCode::NOT_MODIFIED, &"W/\"abc-7\"".parse().unwrap())
        );
    }
}
