use axum::extract::Request;
use axum::http::{Method, header};
use axum::response::{IntoResponse, Response};
use rust_embed::Embed;

use super::problem::Problem;
use super::tag::Tag;

/// The page: in the binary; in debug builds, from disk.
#[derive(Embed)]
#[folder = "web/"]
struct Web;

/// The name of the file that a path asks for.
fn name(path: &str) -> &str {
    match path {
        "/" => "index.html",
        "/api" => "reference.html",
        _ => path.strip_prefix('/').unwrap_or(path),
    }
}

/// Whether the page has a file of that path.
pub(super) fn has(path: &str) -> bool {
    Web::get(name(path)).is_some()
}

/// The page's file of that path, or a problem.
pub(super) fn serve(request: &Request) -> Response {
    let path = request.uri().path();
    let name = name(path);
    let Some(file) = Web::get(name) else {
        return Problem::not_found(&format!("there is nothing at {path}")).into_response();
    };
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        let problem = Problem::method_not_allowed(&format!("{} is not possible on {path}", request.method()));
        return ([(header::ALLOW, "GET,HEAD")], problem).into_response();
    }
    // The browser keeps files but asks each time whether they are still the ones: an update is seen at once.
    let tag = Tag::of(&file.metadata.sha256_hash());
    tag.answer(request.headers(), || ([(header::CONTENT_TYPE, content_type(name))], file.data))
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("json") => "application/json",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_page_has_a_type() {
        for name in Web::iter() {
            assert_ne!(content_type(&name), "application/octet-stream", "{name}");
        }
    }
}
