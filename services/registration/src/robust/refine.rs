//! The fine stage: Gauss-Newton over rotation, translation and scale on the heights of the view's points over the
//! fitted surface, Tukey's weights, scale clamped.
//!
//! Pairs go from the view to the model: every view point lies on the model, not the other way round; paired the other
//! way a partial view draws the scale down without end. Residuals are weighed in the view's millimetres: in the
//! model's, a growing scale would shrink them all.

use arthro_geometry::{Rotation, Similarity, Vector3};

use super::equations::{Equations, Information, Step};
use crate::contact::{Contact, contacts, weights};
use crate::model::Model;
use crate::pipeline::Iteration;
use crate::problem::Pose;
use crate::scale::ScaleRange;
use crate::view::Seen;

/// A pose that moves no point farther than this in a step rests, units.
const RESTING_UNITS: f64 = 2e-4;
/// A step turns by no more than this, rad: beyond it the linear model says nothing.
const LARGEST_TURN_RAD: f64 = 0.3;
/// Damping, as a share of the information: keeps a direction that nothing holds from running away.
const DAMPING: f64 = 1e-7;

/// How to refine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settings {
    pub(crate) steps: u32,
    /// Deviation that residuals are taken to have at least in the first step, units; it sinks to the data's own.
    pub(crate) first_deviation_units: f64,
    pub(crate) allowed: ScaleRange,
}

/// A refined pose and what held it.
#[derive(Clone, Debug)]
pub(crate) struct Refined {
    pub(crate) pose: Pose,
    /// The state before each step.
    pub(crate) trace: Vec<Iteration>,
}

/// Refines `start` until it rests or the steps are used up.
pub(crate) fn refine(model: &Model, seen: &Seen, start: Pose, settings: &Settings) -> Refined {
    let mut refined = Refined {
        pose: start,
        trace: Vec::new(),
    };
    let mut least_units = settings.first_deviation_units;
    for _ in 0..settings.steps {
        let contacts = contacts(model, seen, &refined.pose);
        let weights = weights(model, &contacts, least_units * model.unit_mm);
        refined.trace.push(Iteration {
            mse_mm2: weighted_mse_mm2(&contacts, &weights),
            scale: 1.0 / refined.pose.scale,
        });
        let Some((next, moved_mm)) = step(&contacts, &weights, &refined.pose, settings.allowed)
        else {
            break;
        };
        refined.pose = next;
        if moved_mm < RESTING_UNITS * model.unit_mm && least_units <= 1e-3 {
            break;
        }
        least_units *= 0.6;
        if least_units < 0.02 {
            least_units = 0.0;
        }
    }
    refined
}

fn weighted_mse_mm2(contacts: &[Contact], weights: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (contact, weight) in contacts.iter().zip(weights) {
        sum += weight * contact.foot.height_mm.powi(2);
        total += weight;
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

/// How a small step changes a contact's height, residuals weighed in the view's millimetres.
pub(crate) fn jacobian(contact: &Contact, arm: &Vector3) -> Step {
    let normal = contact.foot.normal;
    let turn = contact.carried.coords.cross(&normal);
    Step::from([
        turn.x,
        turn.y,
        turn.z,
        normal.x,
        normal.y,
        normal.z,
        arm.dot(&normal) - contact.foot.height_mm,
    ])
}

/// Normal equations of the weighted contacts.
pub(crate) fn equations(contacts: &[Contact], weights: &[f64], pose: &Pose) -> Equations {
    let mut equations = Equations::zeros();
    for (contact, weight) in contacts
        .iter()
        .zip(weights)
        .filter(|(_, weight)| **weight > 0.0)
    {
        let row = jacobian(contact, &(contact.carried.coords - pose.translation_mm));
        equations.add(*weight, &row, contact.foot.height_mm);
    }
    equations
}

/// The pose after one step, and how far it moves the points at most; `None` if the contacts do not determine it.
fn step(
    contacts: &[Contact],
    weights: &[f64],
    pose: &Pose,
    allowed: ScaleRange,
) -> Option<(Pose, f64)> {
    let mut equations = equations(contacts, weights, pose);
    let damping = DAMPING * equations.information.trace();
    equations.information += Information::from_diagonal_element(damping);
    let (step, scale) = equations.solved(pose.scale, allowed)?;
    let next = moved(pose, &step, scale);
    let motion = next * pose.inverse();
    let farthest_mm = contacts
        .iter()
        .step_by(contacts.len() / 16 + 1)
        .map(|contact| (motion * contact.carried - contact.carried).norm())
        .fold(0.0, f64::max);
    Some((next, farthest_mm))
}

/// The pose turned and shifted by `step` about the model's centre, its scale set to `scale`.
fn moved(pose: &Pose, step: &Step, scale: f64) -> Pose {
    let turn = step
        .fixed_rows::<3>(0)
        .into_owned()
        .cap_magnitude(LARGEST_TURN_RAD);
    let turn = Rotation::from_scaled_axis(turn);
    let shift: Vector3 = step.fixed_rows::<3>(3).into_owned();
    Similarity::new(
        scale,
        turn * pose.rotation,
        turn * pose.translation_mm + shift,
    )
}
