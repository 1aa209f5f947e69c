//! Where the voxels of a file are: its size, space, directions, origin and unit, carried to LPS and mm.

use super::Error;
use super::header::Header;
use crate::nalgebra::Matrix3;
use crate::ply::{Space, Stated, Unit};
use crate::scan::Lattice;
use crate::{Point3, Vector3};

pub(super) fn lattice(header: &Header, stated: Option<Stated>) -> Result<Lattice, Error> {
    if header.need("dimension")? != "3" {
        return Err(header.refuse("dimension", "3: one value a voxel"));
    }
    let size = numbers::<usize>(header.need("sizes")?.split_ascii_whitespace())
        .ok_or_else(|| header.refuse("sizes", "three whole numbers"))?;
    let to_lps = to_lps(header, stated)?;
    let to_mm = to_mm(header, stated)?;
    let to_lps_mm = Matrix3::from_diagonal(&(to_lps * to_mm));
    let steps = to_lps_mm * steps(header)?;
    let origin = Point3::from(to_lps_mm * origin(header)?);
    Ok(Lattice::new(size, origin, steps)?)
}

/// Factors -1 and 1 on the coordinates of the file's space, or the stated one.
fn to_lps(header: &Header, stated: Option<Stated>) -> Result<Vector3, Error> {
    let Some(word) = header.get("space") else {
        let space = stated.ok_or(Error::Unstated("space"))?.space;
        return Ok(signs(space));
    };
    let to_lps = match word.to_ascii_lowercase().as_str() {
        "left-posterior-superior" | "lps" => signs(Space::Lps),
        "right-anterior-superior" | "ras" => signs(Space::Ras),
        "left-anterior-superior" | "las" => Vector3::new(1.0, -1.0, 1.0),
        _ => {
            return Err(header.refuse(
                "space",
                "left-posterior-superior, right-anterior-superior or left-anterior-superior",
            ));
        }
    };
    match stated {
        Some(Stated { space, .. }) if signs(space) != to_lps => Err(Error::Contradiction {
            field: "space",
            file: word.to_owned(),
            caller: format!("{space:?}"),
        }),
        _ => Ok(to_lps),
    }
}

fn signs(space: Space) -> Vector3 {
    match space {
        Space::Lps => Vector3::new(1.0, 1.0, 1.0),
        Space::Ras => Vector3::new(-1.0, -1.0, 1.0),
    }
}

/// Millimetres a unit of the file.
fn to_mm(header: &Header, stated: Option<Stated>) -> Result<f64, Error> {
    let field = if header.get("space directions").is_some() {
        "space units"
    } else {
        "units"
    };
    let caller = stated.map(|stated| stated.unit);
    let unit = match header.get(field) {
        None => match caller {
            Some(unit) => unit,
            None if header.get("space").is_some() => Unit::Millimetre,
            None => return Err(Error::Unstated("unit")),
        },
        Some(words) => {
            let unit = unit(words)
                .ok_or_else(|| header.refuse(field, r#""mm" three times or "m" three times"#))?;
            if let Some(caller) = caller.filter(|caller| *caller != unit) {
                return Err(Error::Contradiction {
                    field: "unit",
                    file: format!("{unit:?}"),
                    caller: format!("{caller:?}"),
                });
            }
            unit
        }
    };
    Ok(match unit {
        Unit::Millimetre => 1.0,
        Unit::Metre => 1000.0,
    })
}

/// The one unit of three quoted words.
fn unit(words: &str) -> Option<Unit> {
    let [first, second, third] = words
        .split_ascii_whitespace()
        .map(|word| word.trim_matches('"'))
        .collect::<Vec<_>>()[..]
    else {
        return None;
    };
    match first {
        "mm" | "millimeter" | "millimetre" if first == second && second == third => {
            Some(Unit::Millimetre)
        }
        "m" | "meter" | "metre" if first == second && second == third => Some(Unit::Metre),
        _ => None,
    }
}

/// Steps between voxels in the file's own axes and unit, as columns.
fn steps(header: &Header) -> Result<Matrix3<f64>, Error> {
    const FIELD: &str = "space directions";
    if let Some(words) = header.get(FIELD) {
        let columns = vectors::<3>(words)
            .ok_or_else(|| header.refuse(FIELD, "three vectors (x,y,z) of finite numbers"))?;
        return Ok(Matrix3::from_columns(&columns));
    }
    let Some(words) = header.get("spacings") else {
        return Err(Error::Missing(FIELD));
    };
    let spacings = numbers::<f64>(words.split_ascii_whitespace())
        .filter(|spacings| spacings.iter().all(|spacing| *spacing > 0.0))
        .ok_or_else(|| header.refuse("spacings", "three numbers greater than 0"))?;
    Ok(Matrix3::from_diagonal(&Vector3::from(spacings)))
}

/// Centre of the first voxel in the file's own axes and unit.
fn origin(header: &Header) -> Result<Vector3, Error> {
    const FIELD: &str = "space origin";
    match header.get(FIELD) {
        Some(words) => match vectors::<1>(words) {
            Some([origin]) => Ok(origin),
            None => Err(header.refuse(FIELD, "a vector (x,y,z) of finite numbers")),
        },
        None if header.get("space directions").is_some() => Err(Error::Missing(FIELD)),
        None => Ok(Vector3::zeros()),
    }
}

/// `(x,y,z) (x,y,z)`; spaces inside the brackets are allowed.
fn vectors<const N: usize>(words: &str) -> Option<[Vector3; N]> {
    let mut vectors = Vec::new();
    let mut rest = words.trim();
    while !rest.is_empty() && vectors.len() <= N {
        let (vector, after) = rest.strip_prefix('(')?.split_once(')')?;
        vectors.push(Vector3::from(numbers::<f64>(vector.split(','))?));
        rest = after.trim_start();
    }
    vectors
        .try_into()
        .ok()
        .filter(|vectors: &[Vector3; N]| vectors.iter().flatten().all(|c| c.is_finite()))
}

fn numbers<'a, T: std::str::FromStr>(words: impl Iterator<Item = &'a str>) -> Option<[T; 3]> {
    // One more than wanted, so that a fourth is not passed over.
    let numbers: Vec<T> = words
        .take(4)
        .map(|word| word.trim().parse().ok())
        .collect::<Option<_>>()?;
    numbers.try_into().ok()
}
