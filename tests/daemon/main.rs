//! Tests of the real program: each command and each part of the daemon, started on a free port and used as people and
//! other programs use it.

mod access;
#[path = "../common/mod.rs"]
mod common;
#[path = "../../fuzz/inputs.rs"]
mod inputs;

mod api;
mod bench;
mod brightness;
mod calibration;
mod crb;
mod crossings;
mod daemon_recording;
mod endurance;
mod errors;
mod evaluate;
mod examples;
mod extreme;
mod frame_loop;
mod history;
mod history_hostile;
mod history_kill;
mod history_lost;
mod hostile;
mod input;
mod live;
mod moved;
mod mqtt;
mod openapi;
mod operations;
mod page;
mod people;
mod process_limits;
mod record;
mod reference_authors;
mod reference_iteration;
mod reload;
mod replay;
mod room;
mod simulate;
mod uncertainty;
mod visible;
mod watching;
mod webhooks;
mod zones;
