//! Rows as CSV (RFC 4180), read and sent a part at a time: a client that reads slowly holds neither rows nor the file.

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::{StreamExt, stream};
use serde::Serialize;

use super::super::Shared;
use super::super::problem::ProblemDetails;
use super::turns::{Asking, further};
use crate::history::{History, StoreError, Until};

/// Characters at the start of a cell that make spreadsheets take it for a formula.
const FORMULA: [char; 11] = ['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠'];

/// A text such that spreadsheets show it and do not calculate it: with a ' before it, which they hide. Numbers are not
/// changed, as these are doorcam's own.
pub(super) fn as_text(cell: String) -> String {
    if cell.starts_with(FORMULA) || cell.trim_start().starts_with(FORMULA) { format!("'{cell}") } else { cell }
}

/// The header row and the rows that `part` gives from a place on, with the place of the next part, if there is one.
pub(super) fn csv<R: Serialize + 'static, P: Send + 'static>(
    shared: Shared,
    asking: Asking,
    columns: &[&str],
    first: Option<P>,
    part: impl Fn(&History, P, &Until) -> Result<(Vec<R>, Option<P>), StoreError> + Clone + Send + Sync + 'static,
) -> Response {
    let head = match text(&[columns]) {
        Ok(head) => head,
        Err(e) => return ProblemDetails::internal(&e.to_string()).into_response(),
    };
    let parts = stream::try_unfold(first, move |place| {
        let (shared, part) = (shared.clone(), part.clone());
        async move {
            let Some(place) = place else { return Ok(None) };
            let read = move |history: &History, until: &Until| {
                part(history, place, until).map(|(rows, next)| (text(&rows), next))
            };
            match further(shared, asking, read).await {
                Ok((rows, next)) => rows.map(|rows| Some((rows, next))).map_err(|e| e.to_string()),
                // The client sees that the answer is not complete.
                Err(refused) => Err(format!("{refused:?}")),
            }
        }
    });
    let body = Body::from_stream(stream::iter([Ok(head)]).chain(parts));
    ([(header::CONTENT_TYPE, "text/csv; charset=utf-8; header=present")], body).into_response()
}

fn text(rows: &[impl Serialize]) -> Result<Bytes, csv::Error> {
    let mut csv = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    rows.iter().try_for_each(|row| csv.serialize(row))?;
    Ok(csv.into_inner().map_err(|e| e.into_error())?.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_with_commas_quotes_and_line_breaks_stay_one_column() {
        let rows = vec![(1, "bed, \"left\""), (2, "two\nlines")];
        assert_eq!(text(&rows).unwrap(), "1,\"bed, \"\"left\"\"\"\n2,\"two\nlines\"\n");
        assert_eq!(text(&[["id", "zone"]]).unwrap(), "id,zone\n");
    }

    #[test]
    fn what_spreadsheets_take_for_a_formula_becomes_text() {
        for formula in ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "  =1", "＝1", "＋1", "－1", "＠1"]
        {
            assert_eq!(as_text(formula.into()), format!("'{formula}"));
        }
        for text in ["", "bed", "1-2", "a=b", "'=1", "Küche, left", "спальня"] {
            assert_eq!(as_text(text.into()), text);
        }
    }
}
