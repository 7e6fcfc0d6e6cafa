use std::fmt::Write;
use std::io::{self, IsTerminal};

use doorcam::text::{OneLine, is_control};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::fmt::format::debug_fn;

/// Format of the logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Format {
    /// Lines for people
    Text,
    /// One JSON object per line, for programs
    Json,
}

/// Starts logging to stderr; RUST_LOG sets the filter.
///
/// Names of zones, files, cameras and hosts come from outside. Here, and nowhere else, the characters with which they
/// could forge a line or command a terminal are written out.
pub(super) fn start(format: Format) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let logs = tracing_subscriber::fmt().with_env_filter(filter).with_target(false);
    match format {
        Format::Text => {
            let field = debug_fn(|out, field, value| match field.name() {
                "message" => write!(OneLine(out), "{value:?}"),
                name => write!(OneLine(out), "{name}={value:?}"),
            });
            let logs = logs.fmt_fields(field.delimited(" "));
            logs.with_writer(io::stderr).with_ansi(io::stderr().is_terminal()).init();
        }
        Format::Json => logs.json().flatten_event(true).with_writer(|| JsonLines(io::stderr())).init(),
    }
}

/// Writes lines of JSON. JSON itself escapes only the oldest control characters.
struct JsonLines<W>(W);

impl<W: io::Write> io::Write for JsonLines<W> {
    /// Takes whole lines, as the log writes them.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(line);
        let escaped = |c: char| c != '\n' && is_control(c);
        if text.contains(escaped) {
            let mut safe = String::with_capacity(text.len() + 16);
            for c in text.chars() {
                match c {
                    // All of them are within JSON's 16 bits.
                    c if escaped(c) => safe.push_str(&format!("\\u{:04x}", u32::from(c))),
                    c => safe.push(c),
                }
            }
            self.0.write_all(safe.as_bytes())?;
        } else {
            self.0.write_all(line)?;
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn what_json_leaves_as_it_is_is_escaped_and_means_the_same() {
        let value = serde_json::json!({"message": "a\nb\u{1b}\u{9b}\u{2028}\u{202e}é\u{7f}"});
        let mut out = Vec::new();
        JsonLines(&mut out).write_all(format!("{value}\n").as_bytes()).unwrap();
        let line = String::from_utf8(out).unwrap();
        assert_eq!(line, "{\"message\":\"a\\nb\\u001b\\u009b\\u2028\\u202eé\\u007f\"}\n");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&line).unwrap(), value);
    }
}
