use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes};
use axum::http::{Response, StatusCode};
use hyper::body::{Frame, SizeHint};

use super::slots::Busy;

/// The body of an answer. Its connection is not idle until all of it has been handed over.
pub(super) struct Answered {
    body: Body,
    _busy: Option<Busy>,
}

/// An answer whose connection is busy until it is sent, or for good if it becomes a live socket.
pub(super) fn answered(answer: Response<Body>, busy: Busy) -> Response<Answered> {
    let busy = if answer.status() == StatusCode::SWITCHING_PROTOCOLS {
        busy.for_good();
        None
    } else {
        Some(busy)
    };
    answer.map(|body| Answered { body, _busy: busy })
}

impl hyper::body::Body for Answered {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
