use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::super::camera::Fault;

/// Where the kernel lists video nodes.
const CLASS: &str = "/sys/class/video4linux";
/// Where udev links them by maker, model and serial number.
const BY_ID: &str = "/dev/v4l/by-id";

/// Identifies a camera whatever the number of its node is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    card: String,
    /// Which of the device's nodes: webcams have one for pictures and one for metadata.
    index: String,
    device: Option<Device>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Device {
    /// Vendor, product, serial number.
    Usb([String; 3]),
    Other(PathBuf),
}

impl Identity {
    /// Identity of a node such as `/dev/video0`; none if the kernel does not list it.
    pub fn of(node: &Path) -> Option<Self> {
        let class = Path::new(CLASS).join(fs::canonicalize(node).ok()?.file_name()?);
        let read = |path: PathBuf| fs::read_to_string(path).ok().map(|text| text.trim().to_owned());
        let device = fs::canonicalize(class.join("device")).ok();
        let usb = device.as_deref().and_then(Path::parent).and_then(|usb| {
            // A webcam without a serial number is identified by its model alone.
            let serial = read(usb.join("serial")).unwrap_or_default();
            Some(Device::Usb([read(usb.join("idVendor"))?, read(usb.join("idProduct"))?, serial]))
        });
        Some(Self {
            card: read(class.join("name"))?,
            index: read(class.join("index")).unwrap_or_default(),
            device: usb.or(device.map(Device::Other)),
        })
    }
}

/// Video nodes, ordered by number.
pub(super) fn nodes() -> Vec<PathBuf> {
    let mut numbers: Vec<u32> = fs::read_dir(CLASS)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.strip_prefix("video")?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers.into_iter().map(|n| PathBuf::from(format!("/dev/video{n}"))).collect()
}

/// The stable name of a node, if udev made one.
pub(super) fn stable_name(node: &Path) -> Option<String> {
    let leads_there = |link: &fs::DirEntry| fs::canonicalize(link.path()).is_ok_and(|target| target == node);
    let link = fs::read_dir(BY_ID).ok()?.flatten().find(leads_there)?;
    Some(link.file_name().to_string_lossy().into_owned())
}

/// The node of the camera called `name`. Once its identity is `known`, it is found under other numbers too, and no
/// other camera is accepted in its place.
pub(super) fn node(name: &str, known: Option<&Identity>) -> Result<PathBuf, Fault> {
    let named = named(name);
    let Some(known) = known else {
        return named.ok_or_else(|| Fault::absent(not_there(name)));
    };
    if let Some(node) = named.as_ref().filter(|node| Identity::of(node).is_none_or(|found| found == *known)) {
        return Ok(node.clone());
    }
    let elsewhere = nodes().into_iter().find(|node| Identity::of(node).as_ref() == Some(known));
    elsewhere.ok_or_else(|| match named {
        None => Fault::absent(format!("{name}: unplugged; waiting for it to come back")),
        Some(node) => Fault::absent(format!(
            "{}: another camera is there now; waiting for \"{}\" to come back (restart doorcam to use the other one)",
            node.display(),
            known.card
        )),
    })
}

fn named(name: &str) -> Option<PathBuf> {
    if name.contains('/') {
        return fs::canonicalize(name).ok();
    }
    let by_id = fs::canonicalize(Path::new(BY_ID).join(name)).ok();
    by_id.or_else(|| nodes().into_iter().find(|node| Identity::of(node).is_some_and(|found| found.card == name)))
}

fn not_there(name: &str) -> String {
    let some = nodes();
    let others = match &some[..] {
        [] => "there is no camera at all".to_owned(),
        some => {
            let names: Vec<String> = some.iter().map(|node| node.display().to_string()).collect();
            format!("there is {}", names.join(", "))
        }
    };
    format!("{name}: no such camera; {others} (doorcam devices lists them); waiting for it")
}

/// Why a node cannot be opened, and what to do about it.
pub(super) fn refused(node: &Path, error: &io::Error) -> Fault {
    let path = node.display();
    match error.kind() {
        io::ErrorKind::NotFound => Fault::absent(format!("{path}: unplugged; waiting for it to come back")),
        io::ErrorKind::PermissionDenied => {
            let group = fs::metadata(node).ok().and_then(|m| group_name(m.gid())).unwrap_or_else(|| "video".into());
            Fault::unusable(format!(
                "{path}: permission denied; join the group {group} (sudo usermod -aG {group} USER) and log in again"
            ))
        }
        _ => fault(node, "cannot be opened", error),
    }
}

/// Describes a failed operation on a device.
pub(super) fn fault(node: &Path, what: &str, error: &io::Error) -> Fault {
    use rustix::io::Errno;

    let path = node.display();
    match error.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::NODEV | Errno::NXIO | Errno::NOENT) => {
            Fault::absent(format!("{path}: unplugged; waiting for it to come back"))
        }
        Some(Errno::BUSY) => Fault::unusable(format!(
            "{path}: in use by another program; close it (fuser {path} names it) and doorcam continues"
        )),
        _ => Fault::unusable(format!("{path}: {what}: {error}")),
    }
}

fn group_name(id: u32) -> Option<String> {
    let groups = fs::read_to_string("/etc/group").ok()?;
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(id)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_say_what_to_do() {
        let node = Path::new("/dev/video7");
        let words = |errno| fault(node, "the format is refused", &io::Error::from_raw_os_error(errno)).reason;
        assert_eq!(words(19), "/dev/video7: unplugged; waiting for it to come back");
        assert!(words(16).starts_with("/dev/video7: in use by another program; close it (fuser /dev/video7"));
        assert!(words(22).starts_with("/dev/video7: the format is refused: Invalid argument"));
        assert_eq!(group_name(0).as_deref(), Some("root"));
    }

    #[test]
    fn a_camera_that_never_was_is_waited_for() {
        let fault = node("/dev/no-such-camera", None).unwrap_err();
        assert!(fault.reason.starts_with("/dev/no-such-camera: no such camera; there is "), "{fault}");
        assert_eq!(fault.kind, super::super::super::camera::FaultKind::Absent);
    }
}
