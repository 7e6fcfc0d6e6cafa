use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{Extension, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval, timeout};
use utoipa::ToSchema;

use super::access::Pass;
use super::answers::{NoSocket, ROOM};
use super::problem::ProblemDetails;
use super::{FAREWELL, Shared};
use crate::watch::CrossingsReport;
use doorcam_engine::Update;

/// A client that takes no bytes for this long is disconnected.
const SEND_LIMIT: Duration = Duration::from_secs(10);
/// How often a client is pinged.
const PING: Duration = Duration::from_secs(15);
/// Number of pings in a row that a client may leave unanswered: one that has vanished without a word, as when its network
/// fails, would hold its connection for a quarter of an hour.
const UNANSWERED: u32 = 4;
/// Longest message from a client, in bytes: clients need to send nothing but pongs.
const LONGEST_MESSAGE: usize = 4096;

/// The live socket (WebSocket): each text message is the newest update.
///
/// A client that reads slowly misses the updates in between; the next update has an extra key, `missed`, with their
/// number. The schema of the messages is at `/api/v1/live.schema.json`. The client need send nothing but the pongs that
/// the protocol demands; one that answers none for a minute is disconnected. When doorcam ends, it closes sockets with
/// code 1001; when what let the client in has ended (its token was replaced, its session is over), with code 1008.
#[utoipa::path(
    get, path = "/live", tag = ROOM,
    responses(
        (status = 101, description = "The socket: each text message is an update"),
        (status = 426, response = NoSocket),
    )
)]
pub(super) async fn live(
    State(shared): State<Shared>,
    Extension(pass): Extension<Pass>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => {
            let problem = ProblemDetails::upgrade_required(&format!("this is a WebSocket: {}", rejection.body_text()));
            return ([(header::UPGRADE, "websocket")], problem).into_response();
        }
    };
    let upgrade = upgrade.max_message_size(LONGEST_MESSAGE).max_frame_size(LONGEST_MESSAGE);
    upgrade.read_buffer_size(LONGEST_MESSAGE).on_upgrade(move |socket| serve(socket, shared, pass))
}

/// A message of the live socket.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only its description matters")]
pub(super) struct LiveMessage {
    /// The update.
    #[schema(inline = false)]
    #[serde(flatten)]
    update: Update,
    /// How many updates this client missed right before this one; left out if none.
    #[schema(minimum = 1)]
    missed: Option<u64>,
    /// Who walked through the doorway, as `/crossings` tells it: with the first message of a socket and whenever it has
    /// changed, otherwise left out.
    crossings: Option<CrossingsReport>,
}

/// Counts a client until it is dropped.
struct Counted(Arc<AtomicUsize>);

impl Counted {
    fn new(clients: Arc<AtomicUsize>) -> Self {
        clients.fetch_add(1, Ordering::Relaxed);
        Self(clients)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Whether a client still answers.
#[derive(Debug, Default)]
struct Pulse {
    /// Pings since anything came from it.
    unanswered: u32,
}

impl Pulse {
    /// Notes that something has come from the client.
    fn felt(&mut self) {
        self.unanswered = 0;
    }

    /// Notes another ping; false if the client has left too many unanswered. Pings are counted and not seconds, so that
    /// clients are not blamed for a time in which doorcam itself was stopped.
    fn ping(&mut self) -> bool {
        self.unanswered += 1;
        self.unanswered <= UNANSWERED
    }
}

async fn serve(mut socket: WebSocket, shared: Shared, pass: Pass) {
    let _counted = Counted::new(Arc::clone(&shared.clients));
    let mut updates = shared.hub.subscribe();
    updates.mark_changed();
    let (mut last, mut told) = (None, None);
    let mut ending = shared.ending;
    let mut let_in = pin!(shared.access.ended(pass));
    let mut pulse = Pulse::default();
    let mut ping = interval(PING);
    ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let message = tokio::select! {
            changed = updates.changed() => {
                if changed.is_err() {
                    return;
                }
                let latest = updates.borrow_and_update().clone();
                let Some(latest) = latest else { continue };
                let sequence = latest.update.sequence;
                let crossings = Some(shared.hub.crossings());
                let news = if crossings == told { None } else { crossings.as_ref() };
                let text = match last.replace(sequence) {
                    Some(last) => text(&latest.json, sequence.saturating_sub(last + 1), news),
                    // What a client gets first may be minutes old.
                    None => text(&shared.hub.json(&latest), 0, news),
                };
                told = crossings;
                Message::Text(text)
            }
            received = socket.recv() => match received {
                Some(Ok(Message::Close(_))) | None => return,
                Some(Ok(_)) => {
                    pulse.felt();
                    continue;
                }
                Some(Err(_)) => return part(&mut socket, close_code::POLICY, "expected pongs, or short messages").await,
            },
            _ = ping.tick() => {
                if !pulse.ping() {
                    return;
                }
                Message::Ping(Bytes::new())
            }
            () = &mut let_in => return part(&mut socket, close_code::POLICY, "the token or session has ended").await,
            () = until(&mut ending) => return part(&mut socket, close_code::AWAY, "doorcam is shutting down").await,
        };
        if !matches!(timeout(SEND_LIMIT, socket.send(message)).await, Ok(Ok(()))) {
            return;
        }
    }
}

/// The text of an update, which is serialised once for all clients. What is told to one client alone is put before the
/// other keys, so that the message is still an update to clients that ignore it: `missed` if it missed updates, and
/// `crossings` if they are news.
fn text(json: &str, missed: u64, crossings: Option<&CrossingsReport>) -> Utf8Bytes {
    let missed = (missed > 0).then(|| format!("\"missed\":{missed},"));
    // Serialisation cannot fail, because all keys are strings.
    let crossings = crossings.and_then(|crossings| serde_json::to_string(crossings).ok());
    let crossings = crossings.map(|crossings| format!("\"crossings\":{crossings},"));
    match (json.strip_prefix('{'), missed, crossings) {
        (None, ..) | (_, None, None) => Utf8Bytes::from(json),
        (Some(keys), missed, crossings) => {
            format!("{{{}{}{keys}", missed.unwrap_or_default(), crossings.unwrap_or_default()).into()
        }
    }
}

/// Says farewell and waits until the client has disconnected, but not for long. Dropping the socket while a pong is still
/// unread would reset the connection, and the reset would overtake the farewell.
async fn part(socket: &mut WebSocket, code: u16, reason: &'static str) {
    let farewell = Message::Close(Some(CloseFrame { code, reason: Utf8Bytes::from_static(reason) }));
    let parting = async {
        socket.send(farewell).await?;
        while let Some(received) = socket.recv().await {
            received?;
        }
        Ok::<_, axum::Error>(())
    };
    // The connection ends whether or not the client answers.
    let _ = timeout(FAREWELL, parting).await;
}

/// Completes when the server ends or the sender is dropped.
pub(super) async fn until(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&e| e).await;
}

#[cfg(test)]
mod tests {
    use super::*;
    use jiff::Timestamp;

    #[test]
    fn who_answers_no_ping_is_given_up_and_who_answers_some_is_not() {
        let mut pulse = Pulse::default();
        let alive: Vec<_> = (0..6).map(|_| pulse.ping()).collect();
        assert_eq!(alive, [true, true, true, true, false, false]);
        let mut pulse = Pulse::default();
        for k in 1..100 {
            assert!(pulse.ping(), "{k}");
            if k % 4 == 0 {
                pulse.felt();
            }
        }
    }

    #[test]
    fn who_missed_something_gets_the_same_update_and_the_count() {
        let json = r#"{"version":1,"sequence":7}"#;
        assert_eq!(text(json, 0, None).as_str(), json);
        assert_eq!(text(json, 3, None).as_str(), r#"{"missed":3,"version":1,"sequence":7}"#);
    }

    #[test]
    fn who_does_not_know_the_crossings_yet_gets_the_same_update_and_them() {
        let crossings = CrossingsReport {
            available: true,
            reason: None,
            inside: 2,
            since: Timestamp::UNIX_EPOCH,
            came_in: 3,
            out: 1,
            back: 0,
            last: None,
        };
        let told = r#"{"available":true,"reason":null,"inside":2,"since":"1970-01-01T00:00:00Z","in":3,"out":1,"back":0,"last":null}"#;
        let json = r#"{"version":1}"#;
        assert_eq!(text(json, 0, Some(&crossings)).as_str(), format!("{{\"crossings\":{told},\"version\":1}}"));
        assert_eq!(
            text(json, 1, Some(&crossings)).as_str(),
            format!("{{\"missed\":1,\"crossings\":{told},\"version\":1}}")
        );
    }
}
