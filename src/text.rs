//! Text from outside, made safe for a line that people read: a log, an error on a terminal, a list of names.

use std::borrow::Cow;
use std::fmt::{self, Write};

/// Whether a character is not itself shown but changes how what follows is shown: control characters (line breaks and
/// the beginnings of terminals' commands are some), the line breaks of Unicode, byte order marks, and those that change
/// the direction of text.
pub fn is_control(c: char) -> bool {
    let of_unicode =
        matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}');
    c.is_control() || of_unicode
}

/// The text with each such character written out: `\n`, `\u{1b}`.
pub fn one_line(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let mut line = String::with_capacity(text.len() + 16);
    // Writing to a string cannot fail.
    let _ = OneLine(&mut line).write_str(text);
    Cow::Owned(line)
}

/// Writes text on as [`one_line`] does.
pub struct OneLine<'a>(pub &'a mut dyn Write);

impl Write for OneLine<'_> {
    fn write_str(&mut self, mut text: &str) -> fmt::Result {
        while let Some((at, c)) = text.char_indices().find(|&(_, c)| is_control(c)) {
            self.0.write_str(&text[..at])?;
            write!(self.0, "{}", c.escape_default())?;
            text = &text[at + c.len_utf8()..];
        }
        self.0.write_str(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_forge_a_line_or_command_a_terminal_is_written_out() {
        for (text, line) in [
            ("bed", "bed"),
            ("Küche, спальня 寝室 👩‍👩‍👧 غرفة", "Küche, спальня 寝室 👩‍👩‍👧 غرفة"),
            ("a\nERROR forged\r\tb", "a\\nERROR forged\\r\\tb"),
            ("\u{1b}[31m\u{7}\0\u{7f}", "\\u{1b}[31m\\u{7}\\u{0}\\u{7f}"),
            ("\u{85}\u{9b}2J", "\\u{85}\\u{9b}2J"),
            ("a\u{2028}b\u{2029}c", "a\\u{2028}b\\u{2029}c"),
            ("\u{202e}txt\u{2066}x\u{2069}", "\\u{202e}txt\\u{2066}x\\u{2069}"),
        ] {
            assert_eq!(one_line(text), line);
        }
    }
}
