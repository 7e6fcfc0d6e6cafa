//! The syntax of a source on the command line.

use std::path::PathBuf;
use std::str::FromStr;

use doorcam_source::{Pace, ReplayOptions};

/// Where frames come from.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceSpec {
    /// As given on the command line.
    pub text: String,
    /// The parsed text.
    pub place: Place,
}

/// The place that a source is read from.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// `replay:DIR[,loop][,rate=max]`
    Replay(PathBuf, ReplayOptions),
    /// `v4l2:NAME`
    Camera(String),
    /// `simulate:SCENARIO[,seed=N][,once][,rate=max]`
    Simulate(Simulated),
}

/// A simulated doorway.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Name or file of the scenario.
    pub scenario: String,
    /// Seed of its noise.
    pub seed: u64,
    /// The pace of its frames.
    pub pace: Pace,
    /// Whether to end after one pass.
    pub once: bool,
}

impl FromStr for SourceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let place = match text.split_once(':') {
            Some(("replay", rest)) => replay(rest)?,
            Some(("v4l2", "")) => return Err("expected a camera after v4l2:, such as v4l2:/dev/video0".into()),
            Some(("v4l2", name)) => Place::Camera(name.into()),
            Some(("simulate", rest)) => simulate(rest)?,
            _ => {
                return Err("expected v4l2:CAMERA, replay:DIR[,loop][,rate=max] or \
                     simulate:SCENARIO[,seed=N][,once][,rate=max]"
                    .into());
            }
        };
        Ok(Self { text: text.into(), place })
    }
}

fn replay(rest: &str) -> Result<Place, String> {
    let mut options = ReplayOptions { pace: Pace::Recorded, looped: false };
    let mut directory = rest;
    // Options are taken from the end, so that a directory's name may contain commas.
    while let Some((before, option)) = directory.rsplit_once(',') {
        match option {
            "loop" => options.looped = true,
            "rate=max" => options.pace = Pace::Max,
            _ => break,
        }
        directory = before;
    }
    if directory.is_empty() {
        return Err("expected a directory after replay:".into());
    }
    Ok(Place::Replay(directory.into(), options))
}

fn simulate(rest: &str) -> Result<Place, String> {
    let mut simulated = Simulated { scenario: String::new(), seed: 1, pace: Pace::Recorded, once: false };
    let mut scenario = rest;
    while let Some((before, option)) = scenario.rsplit_once(',') {
        match option.split_once('=') {
            None if option == "once" => simulated.once = true,
            None if option == "loop" => simulated.once = false,
            Some(("rate", "max")) => simulated.pace = Pace::Max,
            Some(("seed", seed)) => {
                simulated.seed =
                    seed.parse().map_err(|_| format!("seed={seed}: expected a whole number of 0 or above"))?;
            }
            _ => break,
        }
        scenario = before;
    }
    if scenario.is_empty() {
        return Err("expected a scenario after simulate:, such as simulate:two-crossing".into());
    }
    Ok(Place::Simulate(Simulated { scenario: scenario.into(), ..simulated }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_read() {
        let read = |text: &str| text.parse::<SourceSpec>().map(|s| s.place);
        let replay =
            |directory: &str, pace, looped| Ok(Place::Replay(directory.into(), ReplayOptions { pace, looped }));
        assert_eq!(read("replay:a/b"), replay("a/b", Pace::Recorded, false));
        assert_eq!(read("replay:a,loop,rate=max"), replay("a", Pace::Max, true));
        assert_eq!(read("replay:a,b,loop"), replay("a,b", Pace::Recorded, true));
        assert_eq!(read("v4l2:/dev/video0"), Ok(Place::Camera("/dev/video0".into())));
        assert_eq!(read("v4l2:Maker: Cam"), Ok(Place::Camera("Maker: Cam".into())));
        let simulated = |scenario: &str, seed, pace, once| {
            Ok(Place::Simulate(Simulated { scenario: scenario.into(), seed, pace, once }))
        };
        assert_eq!(read("simulate:two-crossing"), simulated("two-crossing", 1, Pace::Recorded, false));
        assert_eq!(read("simulate:a,b.toml,seed=7,once,rate=max"), simulated("a,b.toml", 7, Pace::Max, true));
        assert_eq!(read("simulate:x,seed=y"), Err("seed=y: expected a whole number of 0 or above".into()));
        assert!(read("simulate:").unwrap_err().contains("expected a scenario"));
        assert!(read("v4l2:").unwrap_err().contains("expected a camera"));
        assert!(read("replay:").unwrap_err().contains("expected a directory"));
        assert!(read("webcam").unwrap_err().contains("expected v4l2:CAMERA, replay:DIR"));
    }
}
