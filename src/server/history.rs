//! Events and occupancy over REST, in JSON or CSV, page by page.

mod csv;
mod turns;

use axum::Json;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use jiff::{SignedDuration, Timestamp};
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use self::csv::{as_text, csv};
pub(super) use self::turns::Turns;
use self::turns::{Asking, answer};
use super::Shared;
use super::answers::{Malformed, NotReady, PEOPLE};
use super::problem::ProblemDetails;
use crate::history::{Cut, EventPage, EventQuery, IntervalPage, IntervalQuery, SpanPage, SpanQuery};
use doorcam_core::tracking::EventKind;

/// Default number of events in a JSON answer.
const ROWS: usize = 100;
/// Most rows of a JSON answer.
const MOST_ROWS: usize = 1000;
/// Default and largest number of rows in CSV, which is for spreadsheets.
const MOST_CSV_ROWS: usize = 10_000;
/// Default period of an occupancy request.
const DAY: SignedDuration = SignedDuration::from_hours(24);
/// Most characters of a wrong value that its refusal repeats.
const LONGEST_SHOWN: usize = 40;
/// Most characters of the reason for a refusal.
const LONGEST_REASON: usize = 300;
/// The longest step, in seconds: a leap year.
const LONGEST_STEP_S: f64 = 366.0 * 86_400.0;

/// The query parameters of `/events`.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WantedEvents {
    /// Only events with larger numbers than this. Without `after` and `from`, the newest events.
    after: Option<u64>,
    /// Only events at or after this time, RFC 3339.
    #[serde(default, deserialize_with = "instant")]
    from: Option<Timestamp>,
    /// Only events before this time.
    #[serde(default, deserialize_with = "instant")]
    to: Option<Timestamp>,
    /// Only events of these kinds, separated by commas: `enter`, `exit`, `dwell`, `zone_enter`, `zone_exit`, `cross_in`,
    /// `cross_out`, `cross_back`.
    #[param(
        pattern = "^((zone_)?(enter|exit)|dwell|cross_(in|out|back))(,((zone_)?(enter|exit)|dwell|cross_(in|out|back)))*$"
    )]
    kind: Option<String>,
    /// Only events of this track.
    track: Option<u64>,
    /// Only events of this zone.
    zone: Option<String>,
    /// At most this many: by default 100, up to 1000; in CSV, by default and up to 10,000.
    #[param(minimum = 1, maximum = 10_000)]
    limit: Option<usize>,
    /// JSON or CSV; by default, what `Accept` names.
    #[param(inline)]
    format: Option<Format>,
}

/// The query parameters of `/occupancy`.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WantedOccupancy {
    /// Only spans with larger numbers than this; not with `step`.
    after: Option<u64>,
    /// From this time on, RFC 3339; by default a day before `to`.
    #[serde(default, deserialize_with = "instant")]
    from: Option<Timestamp>,
    /// Until this time; by default now.
    #[serde(default, deserialize_with = "instant")]
    to: Option<Timestamp>,
    /// Length of the intervals to sum up over, in seconds. Without it, the answer has the spans as they are.
    #[param(minimum = 1.0, maximum = 31_622_400.0)]
    step: Option<f64>,
    /// Of this zone; without it, of the whole room.
    zone: Option<String>,
    /// At most this many: by default and up to 1000; in CSV, 10,000.
    #[param(minimum = 1, maximum = 10_000)]
    limit: Option<usize>,
    /// JSON or CSV; by default, what `Accept` names.
    #[param(inline)]
    format: Option<Format>,
}

/// The format of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Format {
    Json,
    Csv,
}

/// Who came, went and stayed.
///
/// With `after` or `from`, the answer has the first events that match; otherwise the newest ones. `oldest` and `newest`
/// are the numbers of the first and last event kept: a client that asked for events after a number below `oldest` - 1
/// has missed some. If there are more events, `next` is the `after` of the next page, and the header `Link` has its
/// address.
#[utoipa::path(
    get, path = "/events", tag = PEOPLE, params(WantedEvents),
    responses(
        (
            status = 200, description = "The events",
            content((EventPage = "application/json"), (String = "text/csv; charset=utf-8; header=present")),
        ),
        (status = 400, response = Malformed), (status = 503, response = NotReady),
    )
)]
pub(super) async fn events(
    State(shared): State<Shared>,
    uri: Uri,
    headers: HeaderMap,
    wanted: Result<Query<WantedEvents>, QueryRejection>,
) -> Response {
    let asked = wanted.map_err(|e| e.body_text()).and_then(|Query(wanted)| {
        let format = format(wanted.format, &headers);
        let limit = rows(wanted.limit, ROWS, format)?;
        numbers([wanted.after, wanted.track])?;
        let kinds = kinds(wanted.kind.as_deref())?;
        let WantedEvents { after, from, to, track, zone, .. } = wanted;
        Ok((EventQuery { after, from, to, kinds, track, zone, limit }, format))
    });
    let (query, format) = match asked {
        Ok(asked) => asked,
        Err(why) => return refused(&why, "after, from, to, kind, track, zone, limit, format"),
    };
    match format {
        Format::Json => match answer(shared, Asking::Page, move |history, until| history.events(&query, until)).await {
            Ok(page) => paged(&uri, page.next.map(|after| ("after", after.to_string())), Json(page)),
            Err(refused) => refused.into_response(),
        },
        Format::Csv => {
            let (asked, whole) = (shared.clone(), query.clone());
            let cut = match answer(asked, Asking::Page, move |history, until| history.events_cut(&whole, until)).await {
                Ok(cut) => cut,
                Err(refused) => return refused.into_response(),
            };
            let columns = ["sequence", "kind", "time", "track", "x_m", "y_m", "zone", "through", "reason", "speed_m_s"];
            // From a time on, so that it begins with the first events and not with the newest.
            let query = EventQuery { from: query.from.or(Some(Timestamp::MIN)), limit: MOST_ROWS, ..query };
            let rows = csv(shared, Asking::Page, &columns, begin(&cut), move |history, (after, last), until| {
                let part = EventQuery { after, ..query.clone() };
                let mut events = history.events(&part, until)?.events;
                events.retain(|event| event.sequence <= last);
                events.iter_mut().for_each(|event| event.zone = event.zone.take().map(as_text));
                let next =
                    events.last().map(|event| (Some(event.sequence), last)).filter(|(after, _)| *after < Some(last));
                Ok((events, next))
            });
            paged(&uri, cut.next.map(|after| ("after", after.to_string())), rows)
        }
    }
}

/// How many people were there, over time.
///
/// Without `step`, the answer has spans in which the number stayed the same; times that no span covers were not
/// watched. With `step`, it has intervals of that length, each with the time that was watched.
#[utoipa::path(
    get, path = "/occupancy", tag = PEOPLE, params(WantedOccupancy),
    responses(
        (
            status = 200, description = "The spans or intervals",
            content((OccupancyPage = "application/json"), (String = "text/csv; charset=utf-8; header=present")),
        ),
        (status = 400, response = Malformed), (status = 503, response = NotReady),
    )
)]
pub(super) async fn occupancy(
    State(shared): State<Shared>,
    uri: Uri,
    headers: HeaderMap,
    wanted: Result<Query<WantedOccupancy>, QueryRejection>,
) -> Response {
    let asked = wanted.map_err(|e| e.body_text()).and_then(|Query(wanted)| {
        let format = format(wanted.format, &headers);
        let limit = rows(wanted.limit, MOST_ROWS, format)?;
        numbers([wanted.after, None])?;
        let to = wanted.to.unwrap_or_else(Timestamp::now);
        let from = wanted.from.unwrap_or_else(|| to.checked_sub(DAY).unwrap_or(Timestamp::MIN));
        if from >= to {
            return Err(format!("from is {from} and to is {to}, expected from to be before to"));
        }
        Ok((wanted, from, to, limit, format))
    });
    let expected = "after, from, to, step, zone, limit, format";
    let (wanted, from, to, limit, format) = match asked {
        Ok(asked) => asked,
        Err(why) => return refused(&why, expected),
    };
    let WantedOccupancy { after, step, zone, .. } = wanted;
    let Some(step) = step else {
        let query = SpanQuery { after, from, to, zone, limit };
        return spans(shared, &uri, query, format).await;
    };
    if !(1.0..=LONGEST_STEP_S).contains(&step) || after.is_some() {
        return refused(&format!("step is {step}, expected 1 to {LONGEST_STEP_S} seconds, without after"), expected);
    }
    let step = SignedDuration::try_from_secs_f64(step).unwrap_or(DAY);
    let query = IntervalQuery { from, to, step, zone, limit };
    intervals(shared, &uri, query, format).await
}

async fn spans(shared: Shared, uri: &Uri, query: SpanQuery, format: Format) -> Response {
    if format == Format::Json {
        return match answer(shared, Asking::Page, move |history, until| history.spans(&query, until)).await {
            Ok(page) => paged(uri, page.next.map(|after| ("after", after.to_string())), Json(page)),
            Err(refused) => refused.into_response(),
        };
    }
    let (asked, whole) = (shared.clone(), query.clone());
    let cut = match answer(asked, Asking::Page, move |history, until| history.spans_cut(&whole, until)).await {
        Ok(cut) => cut,
        Err(refused) => return refused.into_response(),
    };
    let columns = ["id", "zone", "people", "from", "to"];
    let rows = csv(shared, Asking::Page, &columns, begin(&cut), move |history, (after, last), until| {
        let part = SpanQuery { after, limit: MOST_ROWS, ..query.clone() };
        let mut spans = history.spans(&part, until)?.spans;
        spans.retain(|span| span.id <= last);
        spans.iter_mut().for_each(|span| span.zone = span.zone.take().map(as_text));
        let next = spans.last().map(|span| (Some(span.id), last)).filter(|(after, _)| *after < Some(last));
        Ok((spans, next))
    });
    paged(uri, cut.next.map(|after| ("after", after.to_string())), rows)
}

/// Where to begin to read a page in parts: `after`, and the last number.
fn begin(cut: &Cut) -> Option<(Option<u64>, u64)> {
    cut.ends.map(|[first, last]| (first.checked_sub(1), last))
}

async fn intervals(shared: Shared, uri: &Uri, query: IntervalQuery, format: Format) -> Response {
    let columns = ["from", "to", "most", "mean", "occupied_s", "watched_s"];
    if format == Format::Json {
        return match answer(shared, Asking::Sum, move |history, until| history.intervals(&query, until)).await {
            Ok(page) => paged(uri, page.next.map(|from| ("from", from.to_string())), Json(page)),
            Err(refused) => refused.into_response(),
        };
    }
    let next = query.next();
    let rows =
        csv(shared, Asking::Sum, &columns, Some((query.from, query.limit)), move |history, (from, limit), until| {
            let part = IntervalQuery { from, limit: limit.min(MOST_ROWS), ..query.clone() };
            let page = history.intervals(&part, until)?;
            let left = limit - page.intervals.len();
            Ok((page.intervals, page.next.filter(|_| left > 0).map(|from| (from, left))))
        });
    paged(uri, next.map(|from| ("from", from.to_string())), rows)
}

/// Spans without `step`, intervals with it.
#[derive(ToSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its description matters")]
enum OccupancyPage {
    Spans(SpanPage),
    Intervals(IntervalPage),
}

fn refused(why: &str, parameters: &str) -> Response {
    // It may repeat a name of any length.
    let why = why.char_indices().nth(LONGEST_REASON).map_or(why, |(end, _)| &why[..end]);
    ProblemDetails::bad_request(&format!(
        "{why} (parameters: {parameters}; times as in RFC 3339, with + written as %2B)"
    ))
    .into_response()
}

/// The format that the request names, or else the one that the client accepts.
fn format(named: Option<Format>, headers: &HeaderMap) -> Format {
    let accepts = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok()).unwrap_or_default();
    let csv = accepts.split(',').any(|kind| kind.split(';').next().is_some_and(|kind| kind.trim() == "text/csv"));
    named.unwrap_or(if csv { Format::Csv } else { Format::Json })
}

fn rows(limit: Option<usize>, usual: usize, format: Format) -> Result<usize, String> {
    let (usual, most) = if format == Format::Csv { (MOST_CSV_ROWS, MOST_CSV_ROWS) } else { (usual, MOST_ROWS) };
    let limit = limit.unwrap_or(usual);
    if (1..=most).contains(&limit) { Ok(limit) } else { Err(format!("limit is {limit}, expected 1 to {most}")) }
}

/// A time, or what is expected of one.
fn instant<'de, D: serde::Deserializer<'de>>(value: D) -> Result<Option<Timestamp>, D::Error> {
    let text = String::deserialize(value)?;
    text.parse().map(Some).map_err(|_| {
        let shown: String = text.chars().take(LONGEST_SHOWN).collect();
        let (first, last) = (Timestamp::MIN, Timestamp::MAX);
        serde::de::Error::custom(format!("{shown:?} is no time, expected one as in RFC 3339, {first} to {last}"))
    })
}

/// Checks that numbers of events, spans or tracks fit SQLite's integers.
fn numbers(given: [Option<u64>; 2]) -> Result<(), String> {
    match given.into_iter().flatten().find(|&number| i64::try_from(number).is_err()) {
        Some(number) => Err(format!("{number} is too large, expected at most {}", i64::MAX)),
        None => Ok(()),
    }
}

/// Parses a list such as `enter,exit`.
fn kinds(names: Option<&str>) -> Result<Vec<EventKind>, String> {
    let kind = |name: &str| {
        let all = EventKind::ALL.map(EventKind::name).join(", ");
        let known = EventKind::ALL.into_iter().find(|kind| kind.name() == name);
        let name: String = name.chars().take(LONGEST_SHOWN).collect();
        known.ok_or_else(|| format!("kind is {name:?}, expected some of {all}, separated by commas"))
    };
    names.into_iter().flat_map(|names| names.split(',')).map(kind).collect()
}

/// Adds a link to the next page, if there is one (RFC 8288). It is relative to the page that was asked for, so that it
/// is right wherever a proxy has put doorcam.
fn paged(uri: &Uri, next: Option<(&str, String)>, page: impl IntoResponse) -> Response {
    let mut response = page.into_response();
    if let Some((name, value)) = next {
        let others = uri.query().unwrap_or_default().split('&').filter(|pair| {
            let key = pair.split('=').next();
            !pair.is_empty() && key != Some(name)
        });
        let query: String = others.map(|pair| format!("{pair}&")).collect();
        let page = uri.path().rsplit('/').next().unwrap_or_default();
        let link = format!("<{page}?{query}{name}={value}>; rel=\"next\"");
        if let Ok(link) = HeaderValue::from_str(&link) {
            response.headers_mut().insert(header::LINK, link);
        }
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_page_is_the_same_question_from_there_on() {
        let uri = Uri::from_static("/events?after=3&kind=enter&limit=2");
        let response = paged(&uri, Some(("after", "5".into())), "");
        assert_eq!(response.headers()[header::LINK], "<events?kind=enter&limit=2&after=5>; rel=\"next\"");
        assert_eq!(paged(&uri, None, "").headers().get(header::LINK), None);
    }

    #[test]
    fn csv_comes_if_it_is_named_or_accepted() {
        let accepting = |kinds: &'static str| HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(kinds))]);
        assert_eq!(format(None, &accepting("text/html, text/csv;q=0.9")), Format::Csv);
        assert_eq!(format(None, &accepting("*/*")), Format::Json);
        assert_eq!(format(Some(Format::Json), &accepting("text/csv")), Format::Json);
    }

    #[test]
    fn kinds_are_known_by_name() {
        assert_eq!(kinds(Some("enter,zone_exit")), Ok(vec![EventKind::Enter, EventKind::ZoneExit]));
        let crossings = vec![EventKind::CrossIn, EventKind::CrossOut, EventKind::CrossBack];
        assert_eq!(kinds(Some("cross_in,cross_out,cross_back")), Ok(crossings));
        assert_eq!(kinds(None), Ok(Vec::new()));
        assert!(
            kinds(Some("arrive")).unwrap_err().starts_with("kind is \"arrive\", expected some of enter, exit, dwell")
        );
    }
}
