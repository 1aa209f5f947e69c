//! Markups from a file.

use serde_json::{Map, Value};

use super::{Error, Kind, MAX_BYTES, MAX_COORDINATE_MM, MAX_MARKUPS, MAX_POINTS, Markup};
use crate::stated::{Space, Stated, Unit};
use crate::surface::quoted;
use crate::{Point3, Vector3};

const SCHEMA: &str = "markups-schema-v";
const VERSIONS: [&str; 4] = ["1.0.0", "1.0.1", "1.0.2", "1.0.3"];
/// Most names that a refusal lists.
const MAX_LISTED: usize = 8;

/// Reads all markups.
///
/// # Errors
/// When the file, or any of its markups, is refused.
pub fn read(bytes: &[u8]) -> Result<Vec<Markup>, Error> {
    let file = parse(bytes)?;
    let entries = entries(&file)?;
    let markups = entries.iter().enumerate();
    markups
        .map(|(index, entry)| markup(entry, &format!("markups[{index}]")))
        .collect()
}

/// Reads the markup of a name, or the only one; what is wrong with others does not matter.
///
/// # Errors
/// When the file or that markup is refused, none has the name, or several could be meant.
pub fn read_one(bytes: &[u8], name: Option<&str>) -> Result<Markup, Error> {
    let file = parse(bytes)?;
    let entries = entries(&file)?;
    let name_of = |entry: &Value| {
        entry
            .get("name")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_owned()
    };
    let meant: Vec<(usize, &Value)> = entries
        .iter()
        .enumerate()
        .filter(|(_, entry)| name.is_none_or(|name| name_of(entry) == name))
        .collect();
    let list = |entries: &mut dyn Iterator<Item = &Value>| {
        let names: Vec<String> = entries
            .take(MAX_LISTED)
            .map(|entry| quoted(&name_of(entry)))
            .collect();
        names.join(", ")
    };
    match (meant.as_slice(), name) {
        ([(index, entry)], _) => markup(entry, &format!("markups[{index}]")),
        ([], Some(name)) => Err(Error::Unknown {
            name: quoted(name),
            known: list(&mut entries.iter()),
        }),
        _ => Err(Error::Ambiguous {
            count: meant.len(),
            known: list(&mut meant.iter().map(|(_, entry)| *entry)),
        }),
    }
}

fn parse(bytes: &[u8]) -> Result<Value, Error> {
    if bytes.len() > MAX_BYTES {
        return Err(Error::TooLarge { bytes: bytes.len() });
    }
    // Windows editors put a byte order mark in front.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice(bytes).map_err(|error| Error::Json(error.to_string()))
}

fn entries(file: &Value) -> Result<&[Value], Error> {
    let file = object(file, "the file")?;
    let schema = text(file, "@schema", "@schema")?
        .ok_or_else(|| refused("@schema", "is missing; must name a markups schema"))?;
    let version = schema
        .split_once(SCHEMA)
        .and_then(|(_, rest)| rest.split_once(".json"))
        .map(|(version, _)| version);
    if !version.is_some_and(|version| VERSIONS.contains(&version)) {
        let versions = VERSIONS.join(", ");
        let problem = format!("is {}; must be {SCHEMA} of {versions}", quoted(schema));
        return Err(refused("@schema", problem));
    }
    let entries = list(file, "markups", "markups")?
        .ok_or_else(|| refused("markups", "is missing; must be a list"))?;
    if !(1..=MAX_MARKUPS).contains(&entries.len()) {
        let problem = format!(
            "has {} entries; must have 1 .. {MAX_MARKUPS}",
            entries.len()
        );
        return Err(refused("markups", problem));
    }
    Ok(entries)
}

fn markup(entry: &Value, path: &str) -> Result<Markup, Error> {
    let entry = object(entry, path)?;
    let at = |field: &str| format!("{path}.{field}");
    let kind = kind(entry, &at("type"))?;
    let stated = Stated {
        space: space(entry, &at("coordinateSystem"))?,
        unit: unit(entry, &at("coordinateUnits"))?,
    };
    let to_lps_mm = stated.to_lps_mm();
    let path = at("controlPoints");
    let controls = list(entry, "controlPoints", &path)?.unwrap_or_default();
    if controls.len() > MAX_POINTS {
        let problem = format!(
            "has {} points; must be at most {MAX_POINTS}",
            controls.len()
        );
        return Err(refused(path, problem));
    }
    let (mut points, mut skipped) = (Vec::with_capacity(controls.len()), 0);
    for (index, control) in controls.iter().enumerate() {
        let path = format!("{path}[{index}]");
        let control = object(control, &path)?;
        if is_placed(control, &format!("{path}.positionStatus"))? {
            let position = position(control, &format!("{path}.position"))?;
            points.push(Point3::from(position.component_mul(&to_lps_mm)));
        } else {
            skipped += 1;
        }
    }
    Ok(Markup {
        name: text(entry, "name", &at("name"))?
            .unwrap_or_default()
            .to_owned(),
        kind,
        points,
        skipped,
    })
}

fn kind(entry: &Map<String, Value>, path: &str) -> Result<Kind, Error> {
    let known = Kind::ALL.map(Kind::word).join(", ");
    let word = text(entry, "type", path)?
        .ok_or_else(|| refused(path, format!("is missing; must be one of {known}")))?;
    let kind = Kind::ALL.into_iter().find(|kind| kind.word() == word);
    kind.ok_or_else(|| refused(path, format!("is {}; must be one of {known}", quoted(word))))
}

fn space(entry: &Map<String, Value>, path: &str) -> Result<Space, Error> {
    match text(entry, "coordinateSystem", path)? {
        None | Some("LPS") => Ok(Space::Lps),
        Some("RAS") => Ok(Space::Ras),
        Some(other) => Err(refused(
            path,
            format!("is {}; must be LPS or RAS", quoted(other)),
        )),
    }
}

/// A word, or a DICOM code of value, scheme and meaning.
fn unit(entry: &Map<String, Value>, path: &str) -> Result<Unit, Error> {
    let limit = r#"must be "mm" or ["mm", "UCUM", "millimeter"]"#;
    let word = match entry.get("coordinateUnits") {
        None => return Ok(Unit::Millimetre),
        Some(Value::String(word)) => word.as_str(),
        Some(Value::Array(code)) => match code.as_slice() {
            [Value::String(value), Value::String(scheme), _] if scheme == "UCUM" => value,
            _ => return Err(refused(path, format!("is no UCUM code; {limit}"))),
        },
        Some(other) => return Err(refused(path, format!("is {}; {limit}", sort(other)))),
    };
    match word {
        "mm" => Ok(Unit::Millimetre),
        other => Err(refused(path, format!("is {}; {limit}", quoted(other)))),
    }
}

fn is_placed(control: &Map<String, Value>, path: &str) -> Result<bool, Error> {
    match text(control, "positionStatus", path)? {
        None | Some("defined") => Ok(true),
        Some("undefined" | "preview") => Ok(false),
        Some(other) => {
            let problem = format!(
                "is {}; must be defined, undefined or preview",
                quoted(other)
            );
            Err(refused(path, problem))
        }
    }
}

fn position(control: &Map<String, Value>, path: &str) -> Result<Vector3, Error> {
    let values = list(control, "position", path)?
        .ok_or_else(|| refused(path, "is missing; must be three numbers"))?;
    let [x, y, z] = values else {
        let problem = format!("has {} values; must be three numbers", values.len());
        return Err(refused(path, problem));
    };
    let mut position = Vector3::zeros();
    for (axis, value) in [x, y, z].into_iter().enumerate() {
        let number = value.as_f64().ok_or_else(|| {
            refused(
                format!("{path}[{axis}]"),
                format!("is {}; must be a number", sort(value)),
            )
        })?;
        if !(-MAX_COORDINATE_MM..=MAX_COORDINATE_MM).contains(&number) {
            let problem = format!(
                "is {number} mm; must be {} .. {MAX_COORDINATE_MM} mm",
                -MAX_COORDINATE_MM
            );
            return Err(refused(format!("{path}[{axis}]"), problem));
        }
        position[axis] = number;
    }
    Ok(position)
}

// === values of a sort ===

fn object<'a>(value: &'a Value, path: &str) -> Result<&'a Map<String, Value>, Error> {
    let object = value.as_object();
    object.ok_or_else(|| refused(path, format!("is {}; must be an object", sort(value))))
}

fn text<'a>(
    object: &'a Map<String, Value>,
    field: &str,
    path: &str,
) -> Result<Option<&'a str>, Error> {
    let value = object.get(field);
    value
        .map(|value| {
            let text = value.as_str();
            text.ok_or_else(|| refused(path, format!("is {}; must be a string", sort(value))))
        })
        .transpose()
}

fn list<'a>(
    object: &'a Map<String, Value>,
    field: &str,
    path: &str,
) -> Result<Option<&'a [Value]>, Error> {
    let value = object.get(field);
    value
        .map(|value| {
            let list = value.as_array().map(Vec::as_slice);
            list.ok_or_else(|| refused(path, format!("is {}; must be a list", sort(value))))
        })
        .transpose()
}

fn sort(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(value) => value.to_string(),
        Value::Number(value) => value.to_string(),
        Value::String(text) => format!("the string {}", quoted(text)),
        Value::Array(_) => "a list".into(),
        Value::Object(_) => "an object".into(),
    }
}

fn refused(path: impl Into<String>, problem: impl Into<String>) -> Error {
    Error::Field {
        path: path.into(),
        problem: problem.into(),
    }
}
