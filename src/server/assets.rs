use axum::extract::Request;
use axum::http::{Method, header};
use axum::response::{IntoResponse, Response};
use rust_embed::Embed;

use super::problem::ProblemDetails;
use super::tag::Tag;

/// The files of the page: in the binary, or on disk for debug builds.
#[derive(Embed)]
#[folder = "web/"]
struct Web;

/// The name of the file at a path.
fn name(path: &str) -> &str {
    match path {
        "/" => "index.html",
        "/api" => "reference.html",
        _ => path.strip_prefix('/').unwrap_or(path),
    }
}

/// Whether the page has a file at this path.
pub(super) fn has(path: &str) -> bool {
    Web::get(name(path)).is_some()
}

/// The page's file at the requested path, or a problem.
pub(super) fn serve(request: &Request) -> Response {
    let path = request.uri().path();
    let name = name(path);
    let Some(file) = Web::get(name) else {
        return ProblemDetails::not_found(&format!("there is nothing at {path}")).into_response();
    };
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        let problem = ProblemDetails::method_not_allowed(&format!("{} is not possible on {path}", request.method()));
        return ([(header::ALLOW, "GET,HEAD")], problem).into_response();
    }
    // Browsers cache the files but revalidate them each time, so a new version of the page shows at once.
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
