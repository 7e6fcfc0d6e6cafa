use std::io::Write;

use doorcam::text::one_line;
use doorcam_source::v4l2::{CameraReport, ControlReport, FormatReport, SizeReport, cameras};

/// List the cameras of this machine with their formats and controls
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each size is followed by the frame rates that the camera offers for it.
Prefer the stable name where there is one: it does not change when other cameras are plugged in.

Example:
  doorcam devices
  doorcam serve --source v4l2:/dev/video0")]
pub(super) struct Arguments {
    /// Print JSON, for programs
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let cameras = cameras();
    let mut out = std::io::stdout().lock();
    if arguments.json {
        serde_json::to_writer_pretty(&mut out, &cameras)?;
        writeln!(out)?;
        return Ok(());
    }
    if cameras.is_empty() {
        eprintln!("no cameras: plug one in, or check whether the kernel has detected it (dmesg)");
    }
    for (k, camera) in cameras.iter().enumerate() {
        if k > 0 {
            writeln!(out)?;
        }
        let mut text = Vec::new();
        write_camera(&mut text, camera)?;
        // Cameras name themselves and their controls.
        for line in String::from_utf8_lossy(&text).split_terminator('\n') {
            writeln!(out, "{}", one_line(line))?;
        }
    }
    Ok(())
}

fn write_camera(out: &mut impl Write, camera: &CameraReport) -> std::io::Result<()> {
    if let Some(error) = &camera.error {
        return writeln!(out, "{error}");
    }
    writeln!(out, "{}  {}  ({}, {})", camera.node, camera.card, camera.driver, camera.bus)?;
    if let Some(name) = &camera.stable_name {
        writeln!(out, "  stable name  v4l2:{name}")?;
    }
    writeln!(out, "  formats")?;
    for FormatReport { format, description, sizes, .. } in camera.formats.iter().filter(|f| f.usable) {
        writeln!(out, "    {format}  {description}")?;
        for size in sizes {
            writeln!(out, "      {}", size_line(size))?;
        }
    }
    let others: Vec<&str> = camera.formats.iter().filter(|f| !f.usable).map(|f| &f.format[..]).collect();
    if !others.is_empty() {
        writeln!(out, "    and, not usable: {}", others.join(", "))?;
    }
    if !camera.controls.is_empty() {
        writeln!(out, "  controls")?;
    }
    for control in &camera.controls {
        writeln!(out, "    {}", control_line(control))?;
    }
    Ok(())
}

fn size_line(SizeReport { size: [width, height], smallest, fps }: &SizeReport) -> String {
    let from = smallest.map(|[w, h]| format!("{w}x{h} to ")).unwrap_or_default();
    let rates: Vec<String> = fps.iter().map(|fps| format!("{}", (fps * 100.0).round() / 100.0)).collect();
    format!("{from}{width}x{height}  {}", rates.join(", ")).trim_end().to_owned()
}

fn control_line(control: &ControlReport) -> String {
    let value = control.value.map_or_else(|| "?".to_owned(), |v| v.to_string());
    let [low, high] = control.range;
    let menu: Vec<String> = control.menu.iter().map(|(value, name)| format!("{value} {name}")).collect();
    let meaning = if menu.is_empty() { String::new() } else { format!("  ({})", menu.join(", ")) };
    let inactive = if control.inactive { "  no effect now" } else { "" };
    format!("{:<28} {value:>6}  {low} to {high}, {} at power-on{meaning}{inactive}", control.name, control.default)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_described_line_by_line() {
        let camera = CameraReport {
            node: "/dev/video2".into(),
            stable_name: Some("usb-Maker_Cam_0001-video-index0".into()),
            card: "Cam".into(),
            driver: "uvcvideo".into(),
            bus: "usb-1".into(),
            formats: vec![
                FormatReport {
                    format: "YUYV".into(),
                    description: "YUYV 4:2:2".into(),
                    usable: true,
                    sizes: vec![SizeReport { size: [640, 480], smallest: None, fps: vec![30.0, 7.5] }],
                },
                FormatReport { format: "H264".into(), description: "H.264".into(), usable: false, sizes: Vec::new() },
            ],
            controls: vec![ControlReport {
                name: "Gain".into(),
                value: Some(4),
                range: [0, 100],
                default: 0,
                menu: Vec::new(),
                inactive: true,
            }],
            error: None,
        };
        let mut text = Vec::new();
        write_camera(&mut text, &camera).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert_eq!(
            text.lines().map(str::trim).collect::<Vec<_>>(),
            [
                "/dev/video2  Cam  (uvcvideo, usb-1)",
                "stable name  v4l2:usb-Maker_Cam_0001-video-index0",
                "formats",
                "YUYV  YUYV 4:2:2",
                "640x480  30, 7.5",
                "and, not usable: H264",
                "controls",
                "Gain                              4  0 to 100, 0 at power-on  no effect now",
            ]
        );
    }
}
