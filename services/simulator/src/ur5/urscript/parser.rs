//! Tokens to the tree, by recursive descent of bounded depth.

mod expressions;

use super::{
    Error, Place,
    lexer::{Placed, Token},
    syntax::{Expression, Function, Scope, Statement, StatementKind, Step, Unit},
    value::Value,
};

/// Blocks and brackets inside each other.
const MAX_DEPTH: u32 = 60;
/// Operators and elements in one statement: bounds the depth of a chain such as 1 + 1 + 1...
const MAX_OPERATORS: u32 = 500;
/// Elements of one list.
const MAX_ITEMS: usize = 1000;

/// Reads all of an upload.
///
/// # Errors
/// The first token that does not belong.
pub fn parse(tokens: &[Placed]) -> Result<Unit, Error> {
    let mut parser = Parser {
        tokens,
        at: 0,
        depth: 0,
        operators: 0,
    };
    parser.skip_newlines();
    let secondary = parser.is_word("sec");
    if secondary || (parser.is_word("def") && parser.spans_everything()) {
        parser.at += 1;
        let main = parser.function(false)?;
        parser.skip_newlines();
        return match parser.peek() {
            None => Ok(Unit { main, secondary }),
            Some(_) => Err(parser.unexpected("the end of the program")),
        };
    }
    let body = parser.statements(&[])?;
    let main = Function {
        name: "unnamed".into(),
        params: Vec::new(),
        body,
        thread: false,
        place: (1, 1),
    };
    Ok(Unit {
        main,
        secondary: false,
    })
}

struct Parser<'a> {
    tokens: &'a [Placed],
    at: usize,
    depth: u32,
    operators: u32,
}

impl Parser<'_> {
    /// The `def` at hand is the whole upload: nothing but newlines follows its `end`.
    fn spans_everything(&self) -> bool {
        let words = |placed: &Placed| !matches!(placed.token, Token::Newline);
        let last = self.tokens.iter().rposition(words);
        let mut open = 0;
        for (index, placed) in self.tokens.iter().enumerate().skip(self.at) {
            let Token::Name(word) = &placed.token else {
                continue;
            };
            match word.as_str() {
                "def" | "thread" | "sec" | "if" | "while" => open += 1,
                "end" => open -= 1,
                _ => continue,
            }
            if open == 0 {
                return Some(index) == last;
            }
        }
        true
    }

    /// `name(params): body end`
    fn function(&mut self, thread: bool) -> Result<Function, Error> {
        let place = self.place();
        let name = self.name("a function name")?;
        let mut params = Vec::new();
        self.sign("(")?;
        while !self.take_sign(")") {
            let param = self.name("a parameter")?;
            let default = if self.take_sign("=") {
                Some(self.constant()?)
            } else {
                None
            };
            params.push((param, default));
            if !self.take_sign(",") {
                self.sign(")")?;
                break;
            }
        }
        self.sign(":")?;
        let body = self.block(&["end"])?;
        self.word("end")?;
        Ok(Function {
            name,
            params,
            body,
            thread,
            place,
        })
    }

    fn constant(&mut self) -> Result<Value, Error> {
        let place = self.place();
        let expression = self.expression()?;
        constant(&expression).ok_or_else(|| Error::new(place, "a default must be a constant"))
    }

    /// Statements up to one of these words, one level deeper.
    fn block(&mut self, ends: &[&str]) -> Result<Vec<Statement>, Error> {
        self.deeper(|parser| parser.statements(ends))
    }

    fn statements(&mut self, ends: &[&str]) -> Result<Vec<Statement>, Error> {
        let mut statements = Vec::new();
        loop {
            self.skip_newlines();
            let Some(token) = self.peek() else {
                return if ends.is_empty() {
                    Ok(statements)
                } else {
                    Err(self.unexpected("end"))
                };
            };
            if let Token::Name(word) = token
                && ends.contains(&word.as_str())
            {
                return Ok(statements);
            }
            let place = self.place();
            let kind = self.statement()?;
            statements.push(Statement { place, kind });
            // A statement may also begin on the line on which the last one ends: foreign programs do so.
            let another_follows = matches!(self.peek(), None | Some(Token::Name(_)));
            if !self.take_newline() && !another_follows {
                return Err(self.unexpected("the end of the line"));
            }
        }
    }

    fn statement(&mut self) -> Result<StatementKind, Error> {
        self.operators = 0;
        let Some(Token::Name(word)) = self.peek() else {
            return self.expression().map(StatementKind::Expression);
        };
        let word = word.clone();
        let kind = match word.as_str() {
            "def" | "thread" => {
                self.at += 1;
                return self.function(word == "thread").map(StatementKind::Define);
            }
            "if" => return self.conditional(),
            "while" => {
                self.at += 1;
                let condition = self.expression()?;
                self.sign(":")?;
                let body = self.block(&["end"])?;
                self.word("end")?;
                return Ok(StatementKind::While(condition, body));
            }
            "return" => {
                self.at += 1;
                let empty = matches!(self.peek(), None | Some(Token::Newline));
                return if empty {
                    Ok(StatementKind::Return(None))
                } else {
                    Ok(StatementKind::Return(Some(self.expression()?)))
                };
            }
            "kill" => {
                self.at += 1;
                return self.expression().map(StatementKind::Kill);
            }
            "join" => {
                self.at += 1;
                return self.expression().map(StatementKind::Join);
            }
            "global" | "local" => {
                self.at += 1;
                let scope = if word == "global" {
                    Scope::Global
                } else {
                    Scope::Local
                };
                return self.assignment(scope);
            }
            "break" => StatementKind::Break,
            "continue" => StatementKind::Continue,
            "enter_critical" => StatementKind::EnterCritical,
            "exit_critical" => StatementKind::ExitCritical,
            "halt" => StatementKind::Halt,
            _ if self.is_assignment() => return self.assignment(Scope::Nearest),
            _ => return self.expression().map(StatementKind::Expression),
        };
        self.at += 1;
        if self.take_sign("(") {
            self.sign(")")?;
        }
        Ok(kind)
    }

    fn conditional(&mut self) -> Result<StatementKind, Error> {
        let mut arms = Vec::new();
        let mut otherwise = Vec::new();
        self.word("if")?;
        loop {
            let condition = self.expression()?;
            self.sign(":")?;
            arms.push((condition, self.block(&["elif", "elseif", "else", "end"])?));
            if self.take_word("elif") || self.take_word("elseif") {
                continue;
            }
            if self.take_word("else") {
                self.sign(":")?;
                otherwise = self.block(&["end"])?;
            }
            self.word("end")?;
            return Ok(StatementKind::If { arms, otherwise });
        }
    }

    /// `name = ...`, or `name[...].member = ...`, which needs a look at what follows the last bracket.
    fn is_assignment(&self) -> bool {
        let mut open = 0;
        for placed in self.tokens.iter().skip(self.at + 1) {
            match &placed.token {
                Token::Sign("[") => open += 1,
                Token::Sign("]") => open -= 1,
                Token::Newline => return false,
                _ if open > 0 => {}
                Token::Sign("=") => return open == 0,
                Token::Sign(".") | Token::Name(_) => {}
                _ => return false,
            }
        }
        false
    }

    fn assignment(&mut self, scope: Scope) -> Result<StatementKind, Error> {
        let name = self.name("a variable")?;
        let mut path = Vec::new();
        loop {
            if self.take_sign("[") {
                path.extend(self.indices()?.into_iter().map(Step::Index));
            } else if self.take_sign(".") {
                path.push(Step::Member(self.name("a member")?));
            } else {
                break;
            }
            self.count_operator()?;
        }
        let declared_only =
            scope != Scope::Nearest && matches!(self.peek(), None | Some(Token::Newline));
        if declared_only && path.is_empty() {
            return Ok(StatementKind::Assign {
                scope,
                name,
                path,
                value: Expression::Literal(Value::None),
            });
        }
        self.sign("=")?;
        Ok(StatementKind::Assign {
            scope,
            name,
            path,
            value: self.expression()?,
        })
    }

    fn deeper<T>(&mut self, parse: impl FnOnce(&mut Self) -> Result<T, Error>) -> Result<T, Error> {
        if self.depth >= MAX_DEPTH {
            return Err(self.too_deep());
        }
        self.depth += 1;
        let outcome = parse(self);
        self.depth -= 1;
        outcome
    }

    fn count_operator(&mut self) -> Result<(), Error> {
        self.operators += 1;
        if self.operators > MAX_OPERATORS {
            return Err(Error::new(
                self.place(),
                format!("more than {MAX_OPERATORS} operators in one statement"),
            ));
        }
        Ok(())
    }

    fn too_deep(&self) -> Error {
        Error::new(
            self.place(),
            format!("nested deeper than {MAX_DEPTH} levels"),
        )
    }

    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.at).map(|placed| &placed.token)
    }

    /// Line and column of the token at hand.
    fn place(&self) -> Place {
        self.tokens
            .get(self.at)
            .or(self.tokens.last())
            .map_or((1, 1), |placed| (placed.line, placed.column))
    }

    fn skip_newlines(&mut self) {
        while self.take_newline() {}
    }

    fn take_newline(&mut self) -> bool {
        self.take(|token| matches!(token, Token::Newline | Token::Sign(";")))
    }

    fn is_sign(&self, sign: &str) -> bool {
        matches!(self.peek(), Some(Token::Sign(found)) if *found == sign)
    }

    fn is_word(&self, word: &str) -> bool {
        matches!(self.peek(), Some(Token::Name(found)) if found == word)
    }

    fn take_sign(&mut self, sign: &str) -> bool {
        self.take(|token| matches!(token, Token::Sign(found) if *found == sign))
    }

    fn take_word(&mut self, word: &str) -> bool {
        self.take(|token| matches!(token, Token::Name(found) if found == word))
    }

    fn take(&mut self, wanted: impl Fn(&Token) -> bool) -> bool {
        let taken = self.peek().is_some_and(wanted);
        self.at += usize::from(taken);
        taken
    }

    fn sign(&mut self, sign: &'static str) -> Result<(), Error> {
        if self.take_sign(sign) {
            Ok(())
        } else {
            Err(self.unexpected(sign))
        }
    }

    fn word(&mut self, word: &'static str) -> Result<(), Error> {
        if self.take_word(word) {
            Ok(())
        } else {
            Err(self.unexpected(word))
        }
    }

    fn name(&mut self, what: &'static str) -> Result<String, Error> {
        match self.peek() {
            Some(Token::Name(name)) if !is_keyword(name) => {
                let name = name.clone();
                self.at += 1;
                Ok(name)
            }
            _ => Err(self.unexpected(what)),
        }
    }

    fn unexpected(&self, wanted: &str) -> Error {
        let found = match self.peek() {
            None => "the end of the text".to_owned(),
            Some(Token::Newline) => "the end of the line".to_owned(),
            Some(Token::Name(name)) => name.clone(),
            Some(Token::Sign(sign)) => (*sign).to_owned(),
            Some(token) => format!("{token:?}"),
        };
        Error::new(self.place(), format!("{found} where {wanted} should be"))
    }
}

fn is_keyword(word: &str) -> bool {
    const KEYWORDS: [&str; 27] = [
        "def",
        "sec",
        "thread",
        "end",
        "if",
        "elif",
        "elseif",
        "else",
        "while",
        "break",
        "continue",
        "return",
        "kill",
        "join",
        "run",
        "global",
        "local",
        "and",
        "or",
        "xor",
        "not",
        "True",
        "False",
        "None",
        "enter_critical",
        "exit_critical",
        "halt",
    ];
    KEYWORDS.contains(&word)
}

fn constant(expression: &Expression) -> Option<Value> {
    match expression {
        Expression::Literal(value) => Some(value.clone()),
        Expression::List(items) => Some(Value::list(
            items.iter().map(constant).collect::<Option<_>>()?,
        )),
        Expression::Pose(items) => {
            let numbers = items
                .iter()
                .map(|item| constant(item)?.number())
                .collect::<Option<Vec<_>>>()?;
            Some(Value::Pose(numbers.try_into().ok()?))
        }
        _ => None,
    }
}
