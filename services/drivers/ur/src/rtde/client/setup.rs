//! Which fields are exchanged, and how often: asks a controller for recipes and judges its answers.

use std::marker::PhantomData;

use super::{Client, refused};
use crate::{
    Error,
    rtde::{
        fields,
        inbox::Wanted,
        recipe::{Inputs, Outputs},
        sample::Subscription,
        wire::{self, MAX_NAMES_BYTES, Reply, Request, Type, Version},
    },
};

/// The fields a controller sends us, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputRecipe {
    /// As the controller numbers it.
    pub id: u8,
    /// One for each field.
    pub types: Vec<Type>,
}

/// The fields we send a controller, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputRecipe {
    /// As the controller numbers it.
    pub id: u8,
    /// One for each field.
    pub types: Vec<Type>,
}

impl OutputRecipe {
    pub(in crate::rtde) fn wanted(&self, version: Version) -> Wanted {
        Wanted {
            version,
            recipe: self.id,
            payload_bytes: self.types.iter().map(|kind| kind.bytes()).sum(),
        }
    }
}

/// A typed input recipe that a controller accepted.
#[derive(Debug)]
pub struct Publication<I> {
    pub(in crate::rtde) id: u8,
    inputs: PhantomData<I>,
}

impl Client {
    /// Asks for these fields, `frequency_hz` times a second; 0 is every control cycle. Version 1 knows only that.
    ///
    /// # Errors
    /// [`Error::Value`] for a rate that the controller does not have, [`Error::Field`] or [`Error::FieldSince`] when a
    /// field is missing or of another type; connection failures.
    pub async fn setup_outputs(
        &mut self,
        frequency_hz: f64,
        fields: &[(&str, Type)],
    ) -> Result<OutputRecipe, Error> {
        let frequency_hz = self.frequency_hz(frequency_hz)?;
        let request = Request::SetupOutputs {
            frequency_hz: (self.version == Version::V2).then_some(frequency_hz),
            names: names(fields)?,
        };
        match self.ask(request, "answer to the output recipe").await? {
            Reply::SetupOutputs { recipe, types } => {
                self.check(fields, &types, fields::output)?;
                if recipe == Some(0) {
                    return Err(unusable("output recipe"));
                }
                Ok(OutputRecipe {
                    id: recipe.unwrap_or_default(),
                    types,
                })
            }
            answer => Err(refused("output recipe", &answer)),
        }
    }

    /// Asks for the fields of `S` as [`Client::setup_outputs`] does, and for the timestamp, by which freshness is judged.
    ///
    /// # Errors
    /// As [`Client::setup_outputs`].
    pub async fn subscribe<S: Outputs>(
        &mut self,
        frequency_hz: f64,
    ) -> Result<Subscription<S>, Error> {
        let recipe = self
            .setup_outputs(frequency_hz, &Subscription::<S>::fields())
            .await?;
        let every = self.cycles_between(self.frequency_hz(frequency_hz)?);
        Ok(Subscription::new(
            recipe,
            self.controller.max_frequency_hz() / every,
        ))
    }

    /// Claims the inputs of `I`.
    ///
    /// # Errors
    /// As [`Client::setup_inputs`].
    pub async fn publish<I: Inputs>(&mut self) -> Result<Publication<I>, Error> {
        let recipe = self.setup_inputs(I::FIELDS).await?;
        Ok(Publication {
            id: recipe.id,
            inputs: PhantomData,
        })
    }

    /// The rate to ask for: 0 is the highest.
    fn frequency_hz(&self, wanted_hz: f64) -> Result<f64, Error> {
        let max_hz = self.controller.max_frequency_hz();
        let (allowed, limit) = match (self.version, self.controller.is_cb3()) {
            (Version::V1, _) => (max_hz..=max_hz, "0, or every cycle: rtde version 1"),
            (Version::V2, true) => (f64::MIN_POSITIVE..=max_hz, "0 to 125: CB3"),
            (Version::V2, false) => (f64::MIN_POSITIVE..=max_hz, "0 to 500: e-Series"),
        };
        if wanted_hz == 0.0 {
            Ok(max_hz)
        } else if allowed.contains(&wanted_hz) {
            Ok(wanted_hz)
        } else {
            Err(Error::Value {
                field: "frequency_hz",
                value: wanted_hz,
                limit,
            })
        }
    }

    /// A controller sends in every n-th cycle.
    fn cycles_between(&self, frequency_hz: f64) -> f64 {
        (self.controller.max_frequency_hz() / frequency_hz)
            .round()
            .max(1.0)
    }

    /// Claims these inputs.
    ///
    /// # Errors
    /// [`Error::Field`] or [`Error::FieldSince`] when one is missing, taken by another client (`IN_USE`) or of another
    /// type; connection failures.
    pub async fn setup_inputs(&mut self, fields: &[(&str, Type)]) -> Result<InputRecipe, Error> {
        match self
            .ask(
                Request::SetupInputs {
                    names: names(fields)?,
                },
                "answer to the input recipe",
            )
            .await?
        {
            Reply::SetupInputs { recipe, types } => {
                self.check(fields, &types, fields::input)?;
                if recipe == 0 {
                    return Err(unusable("input recipe"));
                }
                Ok(InputRecipe { id: recipe, types })
            }
            answer => Err(refused("input recipe", &answer)),
        }
    }

    fn check(
        &self,
        fields: &[(&str, Type)],
        answers: &[Type],
        known: fn(&str) -> Option<fields::Field>,
    ) -> Result<(), Error> {
        if answers.len() != fields.len() {
            let answer = format!("{} types for {} names", answers.len(), fields.len());
            return Err(Error::Refused {
                request: "recipe".into(),
                answer,
            });
        }
        let mut answered = fields.iter().zip(answers);
        let Some(((name, wanted), answer)) =
            answered.find(|((_, wanted), answer)| wanted != *answer)
        else {
            return Ok(());
        };
        match known(name).and_then(|field| field.since) {
            Some(since) if *answer == Type::NotFound && !self.controller.has(&since) => {
                Err(Error::FieldSince {
                    name: (*name).to_owned(),
                    since,
                    found: self.controller,
                })
            }
            _ => Err(Error::Field {
                name: (*name).to_owned(),
                answer: *answer,
                wanted: *wanted,
            }),
        }
    }
}

fn names(fields: &[(&str, Type)]) -> Result<Vec<String>, Error> {
    let bytes = fields.iter().map(|(name, _)| name.len() + 1).sum::<usize>();
    if bytes > MAX_NAMES_BYTES {
        return Err(Error::Wire(wire::Error::Names(bytes)));
    }
    Ok(fields.iter().map(|(name, _)| (*name).to_owned()).collect())
}

fn unusable(request: &str) -> Error {
    Error::Refused {
        request: request.to_owned(),
        answer: "recipe 0".into(),
    }
}
