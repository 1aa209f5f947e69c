//! Cuts the text that arrives at a script interface into programs. Nothing on the wire says where a program ends but its
//! own last `end`.

/// Longest program taken.
const MAX_BYTES: usize = 1 << 20;

/// Text of one connection.
#[derive(Debug, Default)]
pub struct Upload {
    /// Lines of the unit at hand.
    unit: String,
    /// The last line, still without its end.
    line: Vec<u8>,
    /// `def`, `if`... without their `end` yet.
    open: u32,
}

impl Upload {
    /// Takes bytes and gives the programs that are complete now. `None` when one grows too long.
    pub fn feed(&mut self, bytes: &[u8]) -> Option<Vec<String>> {
        let mut complete = Vec::new();
        for byte in bytes {
            self.line.push(*byte);
            if *byte == b'\n' {
                complete.extend(self.end_line());
            }
            if self.unit.len() + self.line.len() > MAX_BYTES {
                return None;
            }
        }
        Some(complete)
    }

    /// No more bytes will come: what there is counts as complete.
    pub fn finish(&mut self) -> Option<String> {
        self.end_line()
            .or_else(|| Some(std::mem::take(&mut self.unit)))
            .filter(|unit| !unit.trim().is_empty())
    }

    fn end_line(&mut self) -> Option<String> {
        let line = String::from_utf8_lossy(&self.line).into_owned();
        self.line.clear();
        match first_word(&line) {
            "" if self.open == 0 => return None,
            "def" | "sec" | "thread" | "if" | "while" | "for" | "switch" => self.open += 1,
            "end" => self.open = self.open.saturating_sub(1),
            _ => {}
        }
        self.unit.push_str(&line);
        (self.open == 0).then(|| std::mem::take(&mut self.unit))
    }
}

/// Empty for blank lines, comments and labels.
fn first_word(line: &str) -> &str {
    let line = line.trim_start();
    let length = line
        .find(|next: char| !(next.is_alphanumeric() || next == '_'))
        .unwrap_or(line.len());
    &line[..length]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_in_small_pieces_is_complete_at_its_last_end() {
        let text =
            "# title\n\ndef a():\n  if True:\n    sync()\n  end\n  # end\nend\nset_payload(1.0)\n";
        let mut upload = Upload::default();
        let found: Vec<_> = text
            .bytes()
            .flat_map(|byte| upload.feed(&[byte]).unwrap())
            .collect();
        assert_eq!(found, [&text[9..text.len() - 17], "set_payload(1.0)\n"]);
    }

    #[test]
    fn a_program_without_end_is_refused_before_it_fills_the_memory() {
        let mut upload = Upload::default();
        assert_eq!(upload.feed(b"def a():\n"), Some(vec![]));
        assert_eq!(upload.feed(&vec![b'x'; MAX_BYTES]), None);
    }

    #[test]
    fn the_last_line_may_lack_its_newline() {
        let mut upload = Upload::default();
        assert_eq!(upload.feed(b"stopj(2.0)"), Some(vec![]));
        assert_eq!(upload.finish().as_deref(), Some("stopj(2.0)"));
        assert_eq!(upload.finish(), None);
    }
}
