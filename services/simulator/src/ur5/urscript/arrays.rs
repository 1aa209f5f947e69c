//! Arithmetic of lists of numbers and of matrices (lists of rows).

use nalgebra::DMatrix;

use super::{
    operators,
    syntax::Binary,
    value::{MAX_WEIGHT, Value},
};

/// An operator between a list and a list or a number. `None` when it has no meaning for them.
pub fn binary(operator: Binary, left: &Value, right: &Value) -> Option<Result<Value, String>> {
    let arithmetic = matches!(
        operator,
        Binary::Add | Binary::Subtract | Binary::Multiply | Binary::Divide | Binary::Modulo
    );
    if !arithmetic || !matches!((left, right), (Value::List(_), _) | (_, Value::List(_))) {
        return None;
    }
    if operator == Binary::Multiply
        && let (Some(a), Some(b)) = (matrix(left), matrix(right).or_else(|| column(right)))
    {
        return Some(product(&a, &b, matrix(right).is_none()));
    }
    Some(elementwise(operator, left, right))
}

/// Each element with its counterpart, or with the same number.
pub fn elementwise(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    let apply = |a: &Value, b: &Value| match (a, b) {
        (Value::List(_), _) | (_, Value::List(_)) => elementwise(operator, a, b),
        _ if a.number().is_some() && b.number().is_some() => operators::binary(operator, a, b),
        _ => Err(format!(
            "{} and {} in arithmetic of lists",
            a.kind(),
            b.kind()
        )),
    };
    let items: Result<Vec<_>, _> = match (left, right) {
        (Value::List(a), Value::List(b)) if a.len() == b.len() => {
            a.iter().zip(b.iter()).map(|(a, b)| apply(a, b)).collect()
        }
        (Value::List(a), Value::List(b)) => {
            return Err(format!("lists of {} and {} elements", a.len(), b.len()));
        }
        (Value::List(a), b) => a.iter().map(|a| apply(a, b)).collect(),
        (a, Value::List(b)) => b.iter().map(|b| apply(a, b)).collect(),
        (a, b) => return operators::binary(operator, a, b),
    };
    Ok(Value::list(items?))
}

/// A list of rows of numbers, all of one length.
pub fn matrix(value: &Value) -> Option<DMatrix<f64>> {
    let Value::List(rows) = value else {
        return None;
    };
    let rows: Vec<Vec<f64>> = rows
        .iter()
        .map(|row| match row {
            Value::List(_) => row.numbers(),
            _ => None,
        })
        .collect::<Option<_>>()?;
    let width = rows.first()?.len();
    if width == 0 || rows.iter().any(|row| row.len() != width) {
        return None;
    }
    Some(DMatrix::from_fn(rows.len(), width, |row, column| {
        rows[row][column]
    }))
}

/// As URScript writes it.
pub fn rows(matrix: &DMatrix<f64>) -> Value {
    let row = |row: usize| Value::floats(&matrix.row(row).iter().copied().collect::<Vec<_>>());
    Value::list((0..matrix.nrows()).map(row).collect())
}

fn column(value: &Value) -> Option<DMatrix<f64>> {
    let numbers = match value {
        Value::List(_) => value.numbers()?,
        _ => return None,
    };
    (!numbers.is_empty()).then(|| DMatrix::from_column_slice(numbers.len(), 1, &numbers))
}

fn product(a: &DMatrix<f64>, b: &DMatrix<f64>, as_list: bool) -> Result<Value, String> {
    if a.ncols() != b.nrows() {
        return Err(format!(
            "{}x{} and {}x{} do not multiply",
            a.nrows(),
            a.ncols(),
            b.nrows(),
            b.ncols()
        ));
    }
    if a.nrows() * b.ncols() > MAX_WEIGHT {
        return Err(format!("a product of more than {MAX_WEIGHT} elements"));
    }
    let product = a * b;
    Ok(if as_list {
        Value::floats(product.as_slice())
    } else {
        rows(&product)
    })
}
