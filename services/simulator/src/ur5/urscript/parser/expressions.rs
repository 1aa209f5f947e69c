//! Expressions, from the loosest operator to the tightest.

use std::sync::Arc;

use super::{MAX_ITEMS, Parser, is_keyword};
use crate::ur5::urscript::{
    Error, Place,
    lexer::Token,
    syntax::{Binary, Call, Expression, Step, Unary},
    value::Value,
};

impl Parser<'_> {
    pub(super) fn expression(&mut self) -> Result<Expression, Error> {
        self.deeper(Self::disjunction)
    }

    fn disjunction(&mut self) -> Result<Expression, Error> {
        let mut left = self.conjunction()?;
        loop {
            if self.is_word("or") || self.is_word("xor") {
                self.count_operator()?;
            }
            if self.take_word("or") {
                left = Expression::Or(Box::new(left), Box::new(self.conjunction()?));
            } else if self.take_word("xor") {
                left =
                    Expression::Binary(Binary::Xor, Box::new(left), Box::new(self.conjunction()?));
            } else {
                return Ok(left);
            }
        }
    }

    fn conjunction(&mut self) -> Result<Expression, Error> {
        let mut left = self.negation()?;
        while self.take_word("and") {
            self.count_operator()?;
            left = Expression::And(Box::new(left), Box::new(self.negation()?));
        }
        Ok(left)
    }

    fn negation(&mut self) -> Result<Expression, Error> {
        if self.take_word("not") {
            let operand = self.deeper(Self::negation)?;
            return Ok(Expression::Unary(Unary::Not, Box::new(operand)));
        }
        self.binary(0)
    }

    /// Comparisons, sums, products: from the loosest to the tightest.
    fn binary(&mut self, level: usize) -> Result<Expression, Error> {
        let Some(operators) = BINARY.get(level) else {
            return self.signed();
        };
        let mut left = self.binary(level + 1)?;
        loop {
            let found = operators.iter().find(|(sign, _)| self.is_sign(sign));
            let Some((_, operator)) = found else {
                return Ok(left);
            };
            self.at += 1;
            self.count_operator()?;
            left = Expression::Binary(*operator, Box::new(left), Box::new(self.binary(level + 1)?));
        }
    }

    fn signed(&mut self) -> Result<Expression, Error> {
        if self.take_sign("-") {
            return Ok(match self.deeper(Self::signed)? {
                Expression::Literal(Value::Int(value)) => {
                    Expression::Literal(Value::Int(value.wrapping_neg()))
                }
                Expression::Literal(Value::Float(value)) => {
                    Expression::Literal(Value::Float(-value))
                }
                operand => Expression::Unary(Unary::Negate, Box::new(operand)),
            });
        }
        if self.take_sign("+") {
            return self.deeper(Self::signed);
        }
        let mut operand = self.primary()?;
        loop {
            if self.take_sign("[") {
                for index in self.indices()? {
                    self.count_operator()?;
                    operand = Expression::Index(Box::new(operand), Box::new(index));
                }
            } else if self.take_sign(".") {
                self.count_operator()?;
                let place = self.place();
                let name = self.name("a member")?;
                operand = if self.take_sign("(") {
                    let call = self.call(place, name)?;
                    method(operand, call).ok_or_else(|| {
                        Error::new(place, "a method needs a variable in front of it")
                    })?
                } else {
                    Expression::Member(Box::new(operand), name)
                };
            } else {
                return Ok(operand);
            }
        }
    }

    /// `index]`, or `row, column]` of a matrix.
    pub(super) fn indices(&mut self) -> Result<Vec<Expression>, Error> {
        let mut indices = vec![self.expression()?];
        if self.take_sign(",") {
            indices.push(self.expression()?);
        }
        self.sign("]")?;
        Ok(indices)
    }

    fn primary(&mut self) -> Result<Expression, Error> {
        // After an operator the value may stand on the next line.
        self.skip_newlines();
        let Some(placed) = self.tokens.get(self.at) else {
            return Err(self.unexpected("a value"));
        };
        let token = placed.token.clone();
        let place = self.place();
        self.at += 1;
        Ok(match token {
            Token::Int(value) => Expression::Literal(Value::Int(value)),
            Token::Float(value) => Expression::Literal(Value::Float(value)),
            Token::Text(text) => Expression::Literal(Value::Text(Arc::from(text))),
            Token::Sign("(") => {
                let inner = self.expression()?;
                self.sign(")")?;
                inner
            }
            Token::Sign("[") => Expression::List(self.items("]")?),
            Token::Name(name) => match name.as_str() {
                "True" | "true" => Expression::Literal(Value::Bool(true)),
                "False" | "false" => Expression::Literal(Value::Bool(false)),
                "None" => Expression::Literal(Value::None),
                "run" => {
                    let name = self.name("a thread")?;
                    self.sign("(")?;
                    Expression::Run(self.call(place, name)?)
                }
                "p" if self.take_sign("[") => {
                    let mut items = self.items("]")?;
                    match (items.len(), items.pop()) {
                        (6, Some(last)) => {
                            items.push(last);
                            Expression::Pose(items)
                        }
                        // A variable may be named p, too.
                        (1, Some(index)) => {
                            Expression::Index(Box::new(Expression::Name(name)), Box::new(index))
                        }
                        (count, _) => {
                            self.at -= 1;
                            let text = format!("a pose has 6 elements, not {count}");
                            return Err(Error::new(self.place(), text));
                        }
                    }
                }
                _ if is_keyword(&name) => {
                    self.at -= 1;
                    return Err(self.unexpected("a value"));
                }
                _ if self.take_sign("(") => Expression::Call(self.call(place, name)?),
                _ => Expression::Name(name),
            },
            Token::Sign(_) | Token::Newline => {
                self.at -= 1;
                return Err(self.unexpected("a value"));
            }
        })
    }

    /// Arguments after the opening bracket.
    fn call(&mut self, place: Place, name: String) -> Result<Call, Error> {
        let (mut positional, mut named) = (Vec::new(), Vec::new());
        while !self.take_sign(")") {
            let by_name = matches!(self.peek(), Some(Token::Name(_)))
                && self
                    .tokens
                    .get(self.at + 1)
                    .is_some_and(|next| next.token == Token::Sign("="));
            if by_name {
                let param = self.name("a parameter")?;
                self.sign("=")?;
                named.push((param, self.expression()?));
            } else if named.is_empty() {
                positional.push(self.expression()?);
            } else {
                return Err(Error::new(
                    self.place(),
                    "an argument without name after one with name",
                ));
            }
            if !self.take_sign(",") {
                self.sign(")")?;
                break;
            }
        }
        Ok(Call {
            place,
            name,
            positional,
            named,
        })
    }

    fn items(&mut self, close: &'static str) -> Result<Vec<Expression>, Error> {
        let mut items = Vec::new();
        while !self.take_sign(close) {
            items.push(self.expression()?);
            if items.len() > MAX_ITEMS {
                return Err(Error::new(
                    self.place(),
                    format!("more than {MAX_ITEMS} elements in a list"),
                ));
            }
            if !self.take_sign(",") {
                self.sign(close)?;
                break;
            }
        }
        Ok(items)
    }
}

/// `a[i].b` and `.append(c)` to the method of a part of a variable. `None` when no variable is in front.
fn method(mut operand: Expression, call: Call) -> Option<Expression> {
    let mut path = Vec::new();
    loop {
        match operand {
            Expression::Name(name) => {
                path.reverse();
                return Some(Expression::Method { name, path, call });
            }
            Expression::Index(inner, index) => {
                path.push(Step::Index(*index));
                operand = *inner;
            }
            Expression::Member(inner, name) => {
                path.push(Step::Member(name));
                operand = *inner;
            }
            _ => return None,
        }
    }
}

const BINARY: [&[(&str, Binary)]; 3] = [
    &[
        ("==", Binary::Equal),
        ("!=", Binary::NotEqual),
        ("<=", Binary::LessEqual),
        (">=", Binary::GreaterEqual),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("+", Binary::Add), ("-", Binary::Subtract)],
    &[
        ("*", Binary::Multiply),
        ("/", Binary::Divide),
        ("%", Binary::Modulo),
    ],
];
