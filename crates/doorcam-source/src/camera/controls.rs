use std::collections::BTreeMap;
use std::io;
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// What to do with one of a camera's controls.
///
/// A camera that adjusts itself changes the whole picture by more than a person does, so automatics are switched off
/// unless requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "SettingText", into = "SettingText")]
pub enum Setting {
    /// The automatic finds a value and is then switched off.
    Lock,
    /// The automatic stays on.
    Auto,
    /// The control is left as it is.
    Leave,
    /// This value, in the driver's units.
    Value(i64),
}

/// A setting as written in a file.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum SettingText {
    Number(i64),
    Word(String),
}

impl From<Setting> for SettingText {
    fn from(setting: Setting) -> Self {
        match setting {
            Setting::Lock => Self::Word("lock".into()),
            Setting::Auto => Self::Word("auto".into()),
            Setting::Leave => Self::Word("leave".into()),
            Setting::Value(value) => Self::Number(value),
        }
    }
}

impl TryFrom<SettingText> for Setting {
    type Error = String;

    fn try_from(text: SettingText) -> Result<Self, String> {
        match text {
            SettingText::Number(value) => Ok(Self::Value(value)),
            SettingText::Word(word) => match &word[..] {
                "lock" => Ok(Self::Lock),
                "auto" => Ok(Self::Auto),
                "leave" => Ok(Self::Leave),
                _ => Err(format!(
                    "\"{word}\" is not a setting, expected \"lock\", \"auto\", \"leave\" or a whole number"
                )),
            },
        }
    }
}

/// What to do with each control that affects the measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlSettings {
    /// Exposure time, in units of 100 µs.
    pub exposure: Setting,
    /// Gain, in the driver's units.
    pub gain: Setting,
    /// White balance, in kelvin.
    pub white_balance: Setting,
    /// Focus, in the driver's units: a lens that hunts for focus shifts the picture.
    pub focus: Setting,
    /// Mains frequency whose flicker the exposure avoids: 0 (off), 1 (50 Hz), 2 (60 Hz).
    pub power_line: Setting,
    /// How long automatics run before they are locked.
    pub settle: Duration,
}

/// A control and its automatic, by V4L2's identifiers (linux/v4l2-controls.h).
struct Knob {
    name: &'static str,
    value: u32,
    automatic: Option<Automatic>,
    /// Selects the setting of this control.
    setting: fn(&ControlSettings) -> Setting,
}

struct Automatic {
    id: u32,
    off: i64,
    on: i64,
    /// Another automatic that must be off as well.
    also_off: Option<u32>,
}

const KNOBS: [Knob; 5] = [
    Knob {
        name: "exposure",
        value: 0x009a_0902,
        // 1 is manual, 3 aperture priority, which is what webcams call automatic. 0x009a_0903 (exposure_auto_priority)
        // lets the camera lower its frame rate.
        automatic: Some(Automatic { id: 0x009a_0901, off: 1, on: 3, also_off: Some(0x009a_0903) }),
        setting: |s| s.exposure,
    },
    Knob {
        name: "gain",
        value: 0x0098_0913,
        automatic: Some(Automatic { id: 0x0098_0912, off: 0, on: 1, also_off: None }),
        setting: |s| s.gain,
    },
    Knob {
        name: "white_balance",
        value: 0x0098_091a,
        automatic: Some(Automatic { id: 0x0098_090c, off: 0, on: 1, also_off: None }),
        setting: |s| s.white_balance,
    },
    Knob {
        name: "focus",
        value: 0x009a_090a,
        automatic: Some(Automatic { id: 0x009a_090c, off: 0, on: 1, also_off: None }),
        setting: |s| s.focus,
    },
    Knob { name: "power_line", value: 0x0098_0918, automatic: None, setting: |s| s.power_line },
];

/// Access to a camera's controls.
pub(crate) trait Controls {
    fn get(&self, id: u32) -> io::Result<i64>;
    fn set(&self, id: u32, value: i64) -> io::Result<()>;
}

/// The state of the controls after [`keep`].
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Kept {
    /// Values by name, as last read.
    pub(crate) values: BTreeMap<&'static str, i64>,
    /// One line for each control that does not have the requested value.
    pub(crate) mismatches: Vec<String>,
}

/// Sets the controls as requested and reads them back. Values that automatics have found are taken from `locked`, and
/// stored there once `settled`.
pub(crate) fn keep(
    camera: &impl Controls,
    settings: &ControlSettings,
    locked: &mut BTreeMap<String, i64>,
    settled: bool,
) -> Kept {
    let mut kept = Kept::default();
    for knob in &KNOBS {
        if let Err(mismatch) = keep_one(camera, knob, (knob.setting)(settings), locked, settled) {
            kept.mismatches.push(mismatch);
        }
        if let Ok(value) = camera.get(knob.value) {
            kept.values.insert(knob.name, value);
        }
    }
    kept
}

fn keep_one(
    camera: &impl Controls,
    knob: &Knob,
    setting: Setting,
    locked: &mut BTreeMap<String, i64>,
    settled: bool,
) -> Result<(), String> {
    let wanted = match setting {
        Setting::Leave => return Ok(()),
        Setting::Auto => {
            // A control that has no automatic is not a mismatch.
            if let Some(automatic) = &knob.automatic
                && camera.get(automatic.id).is_ok()
            {
                bring(camera, knob.name, automatic.id, automatic.on)?;
            }
            return Ok(());
        }
        Setting::Value(value) => {
            if camera.get(knob.value).is_err() {
                return Err(format!("{}: asked for {value}, but the camera has no such control", knob.name));
            }
            value
        }
        Setting::Lock => match (camera.get(knob.value), locked.get(knob.name)) {
            (_, Some(&value)) => value,
            (Ok(found), None) if settled => {
                locked.insert(knob.name.to_owned(), found);
                found
            }
            // The control does not exist, or has not settled yet.
            _ => return if settled { switch_off(camera, knob) } else { Ok(()) },
        },
    };
    switch_off(camera, knob)?;
    bring(camera, knob.name, knob.value, wanted)
}

/// Switches a control's automatic off, if it has one.
fn switch_off(camera: &impl Controls, knob: &Knob) -> Result<(), String> {
    let Some(automatic) = &knob.automatic else { return Ok(()) };
    for (id, off) in [Some((automatic.id, automatic.off)), automatic.also_off.map(|id| (id, 0))].into_iter().flatten() {
        if camera.get(id).is_ok() {
            bring(camera, knob.name, id, off)?;
        }
    }
    Ok(())
}

fn bring(camera: &impl Controls, name: &str, id: u32, wanted: i64) -> Result<(), String> {
    let read = || camera.get(id).map_err(|e| format!("{name}: cannot be read back: {e}"));
    if read()? == wanted {
        return Ok(());
    }
    // The value read back decides: a driver may accept a value without taking it.
    let answer = camera.set(id, wanted);
    match (read()?, answer) {
        (value, _) if value == wanted => Ok(()),
        (value, Ok(())) => Err(format!("{name}: asked for {wanted}, the camera has {value}")),
        (value, Err(e)) => Err(format!("{name}: asked for {wanted}, the camera refuses ({e}) and has {value}")),
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    const EXPOSURE: u32 = 0x009a_0902;
    const EXPOSURE_AUTO: u32 = 0x009a_0901;
    const GAIN: u32 = 0x0098_0913;

    /// Controls with a range; the exposure cannot be set while its automatic is on.
    struct Camera(RefCell<BTreeMap<u32, i64>>);

    impl Camera {
        fn new(values: &[(u32, i64)]) -> Self {
            Self(RefCell::new(values.iter().copied().collect()))
        }

        fn value(&self, id: u32) -> i64 {
            self.0.borrow()[&id]
        }
    }

    impl Controls for Camera {
        fn get(&self, id: u32) -> io::Result<i64> {
            self.0.borrow().get(&id).copied().ok_or_else(|| io::Error::from_raw_os_error(22))
        }

        fn set(&self, id: u32, value: i64) -> io::Result<()> {
            let automatic = self.get(EXPOSURE_AUTO).is_ok_and(|mode| mode != 1);
            if id == EXPOSURE && automatic {
                return Err(io::Error::from_raw_os_error(13));
            }
            self.0.borrow_mut().insert(id, value.clamp(0, 1000));
            Ok(())
        }
    }

    fn settings(exposure: Setting, gain: Setting) -> ControlSettings {
        let leave = Setting::Leave;
        ControlSettings {
            exposure,
            gain,
            white_balance: Setting::Lock,
            focus: leave,
            power_line: leave,
            settle: Duration::ZERO,
        }
    }

    #[test]
    fn an_automatic_runs_until_it_has_settled_and_its_value_survives_a_replug() {
        let wanted = settings(Setting::Lock, Setting::Leave);
        let mut locked = BTreeMap::new();
        let camera = Camera::new(&[(EXPOSURE, 312), (EXPOSURE_AUTO, 3)]);
        keep(&camera, &wanted, &mut locked, false);
        assert_eq!((camera.value(EXPOSURE_AUTO), locked.len()), (3, 0));
        let kept = keep(&camera, &wanted, &mut locked, true);
        assert_eq!((camera.value(EXPOSURE_AUTO), kept.values["exposure"]), (1, 312));
        assert!(kept.mismatches.is_empty(), "{:?}", kept.mismatches);
        // The same camera after a replug, with its power-on values.
        let again = Camera::new(&[(EXPOSURE, 156), (EXPOSURE_AUTO, 3)]);
        keep(&again, &wanted, &mut locked, false);
        assert_eq!((again.value(EXPOSURE_AUTO), again.value(EXPOSURE)), (1, 312));
    }

    #[test]
    fn values_are_set_read_back_and_put_right_again() {
        let camera = Camera::new(&[(EXPOSURE, 156), (EXPOSURE_AUTO, 3), (GAIN, 5)]);
        let wanted = settings(Setting::Value(200), Setting::Value(2000));
        let kept = keep(&camera, &wanted, &mut BTreeMap::new(), false);
        assert_eq!(camera.value(EXPOSURE), 200);
        assert_eq!(kept.mismatches, ["gain: asked for 2000, the camera has 1000"]);
        camera.0.borrow_mut().insert(EXPOSURE, 17);
        keep(&camera, &wanted, &mut BTreeMap::new(), true);
        assert_eq!(camera.value(EXPOSURE), 200);
    }

    #[test]
    fn what_a_camera_does_not_have_is_told_only_where_a_value_was_asked_for() {
        let camera = Camera::new(&[]);
        let kept = keep(&camera, &settings(Setting::Lock, Setting::Auto), &mut BTreeMap::new(), true);
        assert_eq!(kept, Kept::default());
        let kept = keep(&camera, &settings(Setting::Lock, Setting::Value(3)), &mut BTreeMap::new(), true);
        assert_eq!(kept.mismatches, ["gain: asked for 3, but the camera has no such control"]);
    }

    #[test]
    fn settings_are_words_or_numbers() {
        let read = |text: &str| serde_json::from_str::<Setting>(text).map_err(|e| e.to_string());
        assert_eq!(read("\"lock\""), Ok(Setting::Lock));
        assert_eq!(read("156"), Ok(Setting::Value(156)));
        assert!(
            read("\"loud\"").unwrap_err().contains("\"loud\" is not a setting, expected \"lock\", \"auto\", \"leave\"")
        );
    }
}
