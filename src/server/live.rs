use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::response::Response;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval, timeout};

use super::{FAREWELL, Shared};

/// A client that takes no bytes for this long is gone.
const SEND_LIMIT: Duration = Duration::from_secs(10);
/// How often a client is asked whether it is there.
const PING: Duration = Duration::from_secs(15);
/// Clients have nothing to say but pongs.
const LONGEST_MESSAGE: usize = 4096;

/// GET /api/v1/live: each text message is an update, the newest one; who is slow misses the ones between (the sequence
/// numbers tell how many).
pub(super) async fn live(State(shared): State<Shared>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(LONGEST_MESSAGE).on_upgrade(move |socket| serve(socket, shared))
}

/// Counts a client for as long as it lives.
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

async fn serve(mut socket: WebSocket, shared: Shared) {
    let _counted = Counted::new(Arc::clone(&shared.clients));
    let mut updates = shared.hub.subscribe();
    updates.mark_changed();
    let mut ending = shared.ending;
    let mut ping = interval(PING);
    ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let message = tokio::select! {
            changed = updates.changed() => {
                if changed.is_err() {
                    return;
                }
                let latest = updates.borrow_and_update().clone();
                match latest {
                    Some(latest) => Message::Text(Utf8Bytes::from(&*latest.json)),
                    None => continue,
                }
            }
            received = socket.recv() => match received {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => continue,
            },
            _ = ping.tick() => Message::Ping(Bytes::new()),
            () = until(&mut ending) => {
                let reason = Utf8Bytes::from_static("doorcam is shutting down");
                let farewell = Message::Close(Some(CloseFrame { code: close_code::AWAY, reason }));
                // It is over either way.
                let _ = timeout(FAREWELL, part(&mut socket, farewell)).await;
                return;
            }
        };
        if !matches!(timeout(SEND_LIMIT, socket.send(message)).await, Ok(Ok(()))) {
            return;
        }
    }
}

/// Says farewell and waits until the client has left. A socket that is dropped with a pong of the client's still unread
/// resets the connection, and the reset overtakes the farewell.
async fn part(socket: &mut WebSocket, farewell: Message) -> Result<(), axum::Error> {
    socket.send(farewell).await?;
    while let Some(received) = socket.recv().await {
        received?;
    }
    Ok(())
}

/// Completes when the server ends, or is gone.
async fn until(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&e| e).await;
}
