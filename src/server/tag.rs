use std::hash::{DefaultHasher, Hasher};

use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::problem::ProblemDetails;

/// Identifies one state of an answer (RFC 9110: ETag). A client that names it in If-None-Match has that answer already.
pub(super) struct Tag(String);

impl Tag {
    /// The tag of an answer with this content.
    pub(super) fn of(content: &[u8]) -> Self {
        let mut hasher = DefaultHasher::new();
        hasher.write(content);
        Self(format!("{:016x}", hasher.finish()))
    }

    /// The tag of an answer that a run of the program counts.
    pub(super) fn numbered(run: u64, number: u64) -> Self {
        Self(format!("{run:x}-{number}"))
    }

    /// The answer, or 304 if the client has it. Clients may keep it but must revalidate it before each use.
    pub(super) fn answer<T: IntoResponse>(&self, asked: &HeaderMap, answer: impl FnOnce() -> T) -> Response {
        // Weak, because the tag does not depend on compression.
        let headers = [(header::ETAG, format!("W/\"{}\"", self.0)), (header::CACHE_CONTROL, "no-cache".into())];
        if self.is_known(asked) {
            return (StatusCode::NOT_MODIFIED, headers).into_response();
        }
        (headers, answer()).into_response()
    }

    pub(super) fn is_known(&self, asked: &HeaderMap) -> bool {
        self.is_named(asked, header::IF_NONE_MATCH)
    }

    fn is_named(&self, asked: &HeaderMap, name: HeaderName) -> bool {
        names(asked, name, |tag| tag == self.0)
    }
}

/// Whether a header lists a tag, without its quotes, that is one of those wanted, or "*".
fn names(asked: &HeaderMap, header: HeaderName, wanted: impl Fn(&str) -> bool) -> bool {
    let lists = asked.get_all(header).iter().filter_map(|list| list.to_str().ok());
    let mut known = lists.flat_map(|list| list.split(',')).map(str::trim);
    // A strong tag counts as well. Splitting at commas is safe, because no tag of ours has one.
    known.any(|tag| tag == "*" || wanted(tag.strip_prefix("W/").unwrap_or(tag).trim_matches('"')))
}

/// The state of something that a client may change, apart from what else an answer tells of it: its number in a run of
/// the program. It is the first part of the tags of such answers.
pub(super) struct Edition(String);

impl Edition {
    /// The state with this number.
    pub(super) fn new(run: u64, number: u32) -> Self {
        Self(format!("{run:x}.{number}"))
    }

    /// Answers with JSON, or with 304 if the client has it.
    pub(super) fn json(&self, asked: &HeaderMap, value: &impl Serialize) -> Response {
        tagged(asked, value, |body| Tag(format!("{}-{}", self.0, Tag::of(body).0)))
    }

    /// Whether a client may change it: it sends no If-Match, or one that names an answer with this state.
    pub(super) fn may_change(&self, asked: &HeaderMap) -> bool {
        let of_this = |tag: &str| tag.split_once('-').is_some_and(|(edition, _)| edition == self.0);
        !asked.contains_key(header::IF_MATCH) || names(asked, header::IF_MATCH, of_this)
    }
}

/// Whether a client may change what `json` answers with `value`: it sends no If-Match, or one that names this state.
/// Weak tags count (unlike in RFC 9110), because all tags of ours are weak and stand for one state.
pub(super) fn may_change(asked: &HeaderMap, value: &impl Serialize) -> bool {
    let of = |value| serde_json::to_vec(value).is_ok_and(|body| Tag::of(&body).is_named(asked, header::IF_MATCH));
    !asked.contains_key(header::IF_MATCH) || of(value)
}

/// Answers with JSON that changes rarely, or with 304.
pub(super) fn json(asked: &HeaderMap, value: &impl Serialize) -> Response {
    tagged(asked, value, Tag::of)
}

fn tagged(asked: &HeaderMap, value: &impl Serialize, tag: impl FnOnce(&[u8]) -> Tag) -> Response {
    match serde_json::to_vec(value) {
        Ok(body) => tag(&body).answer(asked, || ([(header::CONTENT_TYPE, "application/json")], body)),
        Err(e) => ProblemDetails::internal(&e.to_string()).into_response(),
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn only_the_current_state_may_be_changed_by_who_names_a_state() {
        let answer = json(&HeaderMap::new(), &"one");
        let tag = answer.headers()[header::ETAG].clone();
        let naming = |tag: HeaderValue| HeaderMap::from_iter([(header::IF_MATCH, tag)]);
        assert!(may_change(&HeaderMap::new(), &"one") && may_change(&naming("*".parse().unwrap()), &"one"));
        assert!(may_change(&naming(tag.clone()), &"one") && !may_change(&naming(tag), &"two"));
        assert!(!may_change(&naming(HeaderValue::from_bytes(b"\xff").unwrap()), &"one"));
    }

    #[test]
    fn an_edition_stays_the_same_while_what_else_is_told_changes() {
        let (first, second) = (Edition::new(0xabc, 1), Edition::new(0xabc, 2));
        let tag =
            |edition: &Edition, people: u32| edition.json(&HeaderMap::new(), &people).headers()[header::ETAG].clone();
        assert_ne!(tag(&first, 0), tag(&first, 1));
        let naming = |tag: HeaderValue| HeaderMap::from_iter([(header::IF_MATCH, tag)]);
        assert!(first.may_change(&naming(tag(&first, 0))) && first.may_change(&naming(tag(&first, 1))));
        assert!(!second.may_change(&naming(tag(&first, 0))) && second.may_change(&naming("*".parse().unwrap())));
        let known = HeaderMap::from_iter([(header::IF_NONE_MATCH, tag(&first, 1))]);
        assert_eq!(first.json(&known, &1).status(), StatusCode::NOT_MODIFIED);
        assert_eq!(first.json(&known, &2).status(), StatusCode::OK);
    }

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
