//! Commands and answers of a page: in blocks of `console`, a command begins with `$ ` and is followed by its answer.

/// What is typed, and what is answered.
pub struct Exchange {
    pub command: String,
    pub answer: String,
}

/// All of a page, in its order. A command goes on over a backslash at the end of a line, and to the END of what it is fed.
pub fn exchanges(page: &str) -> Vec<Exchange> {
    let mut exchanges: Vec<Exchange> = Vec::new();
    let mut lines = page.lines();
    while lines.by_ref().any(|line| line == "```console") {
        let mut block = lines.by_ref().take_while(|line| *line != "```");
        while let Some(line) = block.next() {
            let Some(first) = line.strip_prefix("$ ") else {
                if let Some(last) = exchanges.last_mut() {
                    last.answer.push_str(line);
                    last.answer.push('\n');
                }
                continue;
            };
            let mut command = first.to_owned();
            while command.ends_with('\\') {
                command.push('\n');
                command.push_str(block.next().unwrap_or_default());
            }
            if command.contains("<<END") {
                for line in block.by_ref() {
                    command.push('\n');
                    command.push_str(line);
                    if line == "END" {
                        break;
                    }
                }
            }
            exchanges.push(Exchange {
                command,
                answer: String::new(),
            });
        }
    }
    exchanges
}
