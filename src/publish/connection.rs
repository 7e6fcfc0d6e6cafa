//! The connection to the broker: made again whenever it is lost, but never in a hurry.

use std::time::{Duration, Instant};

use rumqttc::{Event, EventLoop, Outgoing, Packet, Publish};
use tokio::sync::mpsc;
use tokio::time::sleep;

use crate::config::brief;
use doorcam_source::camera::Backoff;

/// First and longest delay before reconnecting to the broker.
const RETRY: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(30)];
/// A connection that has lasted this long is a good one: after it, delays begin anew. A broker that accepts connections
/// and ends them at once is no better than one that accepts none.
pub(super) const HEALTHY: Duration = Duration::from_secs(60);

/// A change of the connection, or what came through it.
pub(super) enum News {
    Made,
    Heard(Publish),
    Lost(Lost),
    Closed,
}

/// The end of a connection, or of an attempt.
pub(super) struct Lost {
    pub(super) why: String,
    /// How long the connection lasted; none if there was none.
    pub(super) lasted: Option<Duration>,
}

/// When to try again.
struct Retry(Backoff);

impl Retry {
    fn new(seed: u64) -> Self {
        let [first, longest] = RETRY;
        Self(Backoff::new(first, longest, seed))
    }

    /// The delay after a connection that lasted so long, or that never came about.
    fn after(&mut self, lasted: Option<Duration>) -> Duration {
        if lasted.is_some_and(|lasted| lasted >= HEALTHY) {
            self.0.reset();
        }
        self.0.next_delay()
    }
}

/// Polls the connection and reconnects with increasing delays until a disconnect has been sent.
pub(super) async fn keep_connected(mut connection: EventLoop, seed: u64, tell: mpsc::Sender<News>) {
    let mut retry = Retry::new(seed);
    let mut made: Option<Instant> = None;
    let mut leaving = false;
    loop {
        let news = match connection.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                made = Some(Instant::now());
                News::Made
            }
            Ok(Event::Incoming(Packet::Publish(publish))) => News::Heard(publish),
            Ok(event) => {
                leaving |= event == Event::Outgoing(Outgoing::Disconnect);
                continue;
            }
            // Wait for the broker to close the connection once it has read everything. Closing it here with
            // unread acknowledgements would reset it, and the broker would miss the last messages.
            Err(_) if leaving => News::Closed,
            Err(error) => {
                let why = brief(&error.to_string().split_whitespace().collect::<Vec<_>>().join(" "));
                News::Lost(Lost { why, lasted: made.take().map(|made| made.elapsed()) })
            }
        };
        let (delay, over) = match &news {
            News::Made | News::Heard(_) => (None, false),
            News::Lost(lost) => (Some(retry.after(lost.lasted)), false),
            News::Closed => (None, true),
        };
        if tell.send(news).await.is_err() || over {
            return;
        }
        if let Some(delay) = delay {
            sleep(delay).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_grow_until_a_connection_has_lasted_for_a_minute() {
        let mut retry = Retry::new(1);
        let sum: Duration = (0..7).map(|_| retry.after(Some(Duration::from_secs(1)))).sum();
        assert!(sum > Duration::from_secs(25), "seven short connections take {sum:?}");
        let more: Duration = (0..20).map(|_| retry.after(None)).sum();
        assert!(more <= 20 * RETRY[1] && more >= 10 * RETRY[1], "{more:?}");
        assert!(retry.after(Some(HEALTHY)) <= RETRY[0]);
        assert!(retry.after(Some(HEALTHY - Duration::from_millis(1))) > RETRY[0] / 2);
    }
}
