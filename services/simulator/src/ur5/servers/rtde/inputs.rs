//! What a client writes: data packages by its recipes of inputs.
//!
//! The fields of a recipe are taken from the front of a package and what follows them is left: ur-rtde 1.6.5 sends a tool
//! offset of nothing but zeros in a recipe that has no room for it. A package with fewer bytes or without a recipe is
//! ignored, which the client is told. None of this ends its connection.

use ur_link::rtde::wire::{Reply, Text, Type, Value};

use super::{Client, Hub, Shared, lock};
use crate::ur5::Input;

/// At most one warning in so much time of the controller.
const WARNING_EVERY_S: f64 = 1.0;
/// Level of a text: warning.
const WARNING: u8 = 2;

/// Fields of a recipe of inputs, in order.
pub(super) type Recipe = [(Input, Type)];

/// Why a package is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum Ignored {
    #[error("it has no recipe byte")]
    Empty,
    #[error("input recipe {recipe} is not set up, the last is {last}")]
    Unknown { recipe: u8, last: usize },
    #[error("input recipe {recipe} needs {needed} bytes of fields, {came} came")]
    Short {
        recipe: u8,
        needed: usize,
        came: usize,
    },
}

/// When a client was warned last, and what it was not told since.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    last_s: Option<f64>,
    untold: u64,
}

impl Client {
    /// Writes the inputs of a data package, or ignores it and warns the client.
    pub(super) fn write_inputs(&self, payload: &[u8], hub: &Hub, controller: &Shared) {
        match self.inputs(payload) {
            Ok(values) => {
                let mut controller = lock(controller);
                values
                    .into_iter()
                    .for_each(|(input, value)| controller.write_input(input, value));
            }
            Err(ignored) => self.warn(ignored, controller),
        }
        // One that is ignored keeps pace too.
        if lock(&self.session).started {
            self.answered(hub);
        }
    }

    fn inputs(&self, payload: &[u8]) -> Result<Vec<(Input, Value)>, Ignored> {
        let (recipe, fields) = payload.split_first().ok_or(Ignored::Empty)?;
        let inputs = {
            let session = lock(&self.session);
            usize::from(*recipe)
                .checked_sub(1)
                .and_then(|index| session.inputs.get(index).cloned())
                .ok_or(Ignored::Unknown {
                    recipe: *recipe,
                    last: session.inputs.len(),
                })?
        };
        values(&inputs, fields).ok_or_else(|| Ignored::Short {
            recipe: *recipe,
            needed: inputs.iter().map(|(_, kind)| kind.bytes()).sum(),
            came: fields.len(),
        })
    }

    fn warn(&self, ignored: Ignored, controller: &Shared) {
        let now_s = lock(controller).timestamp_s();
        let mut session = lock(&self.session);
        let version = session.version;
        let warnings = &mut session.warnings;
        if warnings
            .last_s
            .is_some_and(|last_s| now_s < last_s + WARNING_EVERY_S)
        {
            warnings.untold = warnings.untold.saturating_add(1);
            return;
        }
        let text = Text {
            message: match warnings.untold {
                0 => format!("data package ignored: {ignored}"),
                untold => format!("data package ignored: {ignored}; and {untold} before it"),
            },
            source: "RTDE".to_owned(),
            level: WARNING,
        };
        let mut bytes = Vec::new();
        Reply::Text(text).encode(version, &mut bytes);
        // A client that does not read must not lose its connection by warnings; the next bad package tries again.
        if self.outlet.offer(&bytes, &[]) {
            *warnings = Warnings {
                last_s: Some(now_s),
                untold: 0,
            };
        } else {
            warnings.untold = warnings.untold.saturating_add(1);
        }
    }
}

/// The fields from the front; `None` when bytes are missing.
fn values(recipe: &Recipe, mut fields: &[u8]) -> Option<Vec<(Input, Value)>> {
    recipe
        .iter()
        .map(|(input, kind)| Some((*input, Value::decode(*kind, &mut fields)?)))
        .collect()
}
