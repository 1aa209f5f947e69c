//! Markups to a file.

use serde_json::{Value, json};

use super::Markup;

const SCHEMA: &str = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#";

/// The file of these markups, in LPS and mm; points that are not finite have no place in JSON and come
/// out as `null`, which no reader takes.
pub fn write(markups: &[Markup]) -> Vec<u8> {
    let entries: Vec<Value> = markups.iter().map(entry).collect();
    let file = json!({ "@schema": SCHEMA, "markups": entries });
    format!("{file:#}\n").into_bytes()
}

fn entry(markup: &Markup) -> Value {
    let controls: Vec<Value> = markup
        .points
        .iter()
        .enumerate()
        .map(|(index, point)| {
            let number = index + 1;
            json!({
                "id": number.to_string(),
                "label": format!("{}-{number}", markup.name),
                "position": [point.x, point.y, point.z],
                "selected": true,
                "locked": false,
                "visibility": true,
                "positionStatus": "defined",
            })
        })
        .collect();
    json!({
        "type": markup.kind.word(),
        "name": markup.name,
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "locked": false,
        "fixedNumberOfControlPoints": false,
        "labelFormat": "%N-%d",
        "controlPoints": controls,
    })
}
