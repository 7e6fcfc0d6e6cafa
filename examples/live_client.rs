//! Follows a running doorcam and prints who is where: `cargo run --example live_client -- http://127.0.0.1:8080`
//!
//! That address is also the default; `cargo run -- demo` starts a doorcam there. Where a token is needed, it is taken
//! from the variable DOORCAM_TOKEN. docs/api.md describes the messages.

use std::error::Error;

use serde::Deserialize;
use tungstenite::{ClientRequestBuilder, Message, connect};

/// What this client reads of an update. Keys that it does not name are ignored.
#[derive(Deserialize)]
struct Update {
    sequence: u64,
    /// Whether the map can be trusted: learning, watching, relearning, obstructed or misaligned.
    state: String,
    tracks: Vec<Track>,
    /// Updates that this client was too slow for; only there if there are any.
    #[serde(default)]
    missed: u64,
}

/// A person.
#[derive(Deserialize)]
struct Track {
    id: u64,
    /// How sure it is: tentative, confirmed or coasting.
    state: String,
    x_m: f64,
    y_m: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let url = std::env::args().nth(1).unwrap_or_else(|| "http://127.0.0.1:8080".into());
    let live = format!("{}/api/v1/live", url.trim_end_matches('/').replacen("http", "ws", 1));
    let mut request = ClientRequestBuilder::new(live.parse()?);
    if let Ok(token) = std::env::var("DOORCAM_TOKEN") {
        request = request.with_header("Authorization", format!("Bearer {token}"));
    }
    let (mut socket, _) = connect(request).map_err(|error| format!("{live}: {error}"))?;
    loop {
        match socket.read()? {
            Message::Text(text) => show(&serde_json::from_str(&text)?),
            Message::Close(_) => return Ok(()),
            // Pings are answered by tungstenite.
            _ => {}
        }
    }
}

fn show(update: &Update) {
    let missed = if update.missed > 0 { format!(" ({} missed)", update.missed) } else { String::new() };
    println!("update {}: {}, {} followed{missed}", update.sequence, update.state, update.tracks.len());
    for Track { id, state, x_m, y_m } in &update.tracks {
        println!("  {id}: {state} at x {x_m:.2} m, y {y_m:.2} m");
    }
}
