//! Text to tokens. A newline ends a statement, except inside brackets.

use super::Error;

/// One word of a program.
#[derive(Clone, Debug, PartialEq)]
pub enum Token {
    /// Name or keyword.
    Name(String),
    /// Whole number.
    Int(i32),
    /// Number.
    Float(f64),
    /// Text without its quotes.
    Text(String),
    /// Operator or bracket.
    Sign(&'static str),
    /// End of a statement.
    Newline,
}

/// A token and where it begins, from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The token.
    pub token: Token,
    /// Its line.
    pub line: u32,
    /// Its column, in characters.
    pub column: u32,
}

/// Longer ones first.
const SIGNS: [&str; 21] = [
    "==", "!=", "<=", ">=", "<", ">", "=", "+", "-", "*", "/", "%", "(", ")", "[", "]", ",", ":",
    ".", "?", ";",
];

/// All tokens of a text.
///
/// # Errors
/// A character that is none of the language, a text without end, a number that is none.
pub fn tokens(text: &str) -> Result<Vec<Placed>, Error> {
    let mut lexer = Lexer {
        rest: text,
        line: 1,
        column: 1,
        open: 0,
        placed: Vec::new(),
    };
    while lexer.step()? {}
    lexer.push(Token::Newline);
    Ok(lexer.placed)
}

struct Lexer<'a> {
    rest: &'a str,
    line: u32,
    column: u32,
    /// Open round and square brackets.
    open: u32,
    placed: Vec<Placed>,
}

impl Lexer<'_> {
    fn step(&mut self) -> Result<bool, Error> {
        let Some(first) = self.rest.chars().next() else {
            return Ok(false);
        };
        match first {
            '\n' => {
                if self.open == 0 {
                    self.push(Token::Newline);
                }
                self.line += 1;
                self.skip(1);
                self.column = 1;
            }
            '#' => self.skip_line(),
            // Labels of the programming screen: "$ 2 "MoveJ"".
            '$' => self.skip_line(),
            '"' => self.text()?,
            '0'..='9' => self.number()?,
            '.' if self.rest[1..].starts_with(|next: char| next.is_ascii_digit()) => {
                self.number()?
            }
            _ if first.is_alphabetic() || first == '_' => {
                let length = self.length_where(|next| next.is_alphanumeric() || next == '_');
                let name = self.rest[..length].to_owned();
                self.push(Token::Name(name));
                self.skip(length);
            }
            _ if first.is_whitespace() || first == '\u{feff}' => self.skip(first.len_utf8()),
            _ => self.sign()?,
        }
        Ok(true)
    }

    fn text(&mut self) -> Result<(), Error> {
        let body = &self.rest[1..];
        let Some(length) = body
            .find(['"', '\n'])
            .filter(|end| body[*end..].starts_with('"'))
        else {
            return Err(self.error("string without end"));
        };
        let text = body[..length].to_owned();
        self.push(Token::Text(text));
        self.skip(length + 2);
        Ok(())
    }

    fn number(&mut self) -> Result<(), Error> {
        let mut length = self.length_where(|next| next.is_ascii_digit() || next == '.');
        let exponent = &self.rest[length..];
        if exponent.starts_with(['e', 'E']) {
            let signed = usize::from(exponent[1..].starts_with(['+', '-']));
            let digits = exponent[1 + signed..]
                .bytes()
                .take_while(u8::is_ascii_digit)
                .count();
            if digits > 0 {
                length += 1 + signed + digits;
            }
        }
        let word = &self.rest[..length];
        let whole = word.parse::<i32>().ok().map(Token::Int);
        let token = whole.or_else(|| {
            word.parse::<f64>()
                .ok()
                .filter(|value| value.is_finite())
                .map(Token::Float)
        });
        let Some(token) = token else {
            return Err(self.error(format!("{word} is no number")));
        };
        self.push(token);
        self.skip(length);
        Ok(())
    }

    fn sign(&mut self) -> Result<(), Error> {
        let Some(sign) = SIGNS.into_iter().find(|sign| self.rest.starts_with(sign)) else {
            let first = self.rest.chars().next().unwrap_or_default();
            return Err(self.error(format!("unexpected character {first:?}")));
        };
        match sign {
            "(" | "[" => self.open += 1,
            ")" | "]" => self.open = self.open.saturating_sub(1),
            _ => {}
        }
        self.push(Token::Sign(sign));
        self.skip(sign.len());
        Ok(())
    }

    fn error(&self, text: impl Into<String>) -> Error {
        Error::new((self.line, self.column), text)
    }

    fn length_where(&self, belongs: impl Fn(char) -> bool) -> usize {
        self.rest
            .find(|next: char| !belongs(next))
            .unwrap_or(self.rest.len())
    }

    fn skip_line(&mut self) {
        self.skip(self.rest.find('\n').unwrap_or(self.rest.len()));
    }

    fn skip(&mut self, bytes: usize) {
        self.column += self.rest[..bytes].chars().count() as u32;
        self.rest = &self.rest[bytes..];
    }

    fn push(&mut self, token: Token) {
        self.placed.push(Placed {
            token,
            line: self.line,
            column: self.column,
        });
    }
}
