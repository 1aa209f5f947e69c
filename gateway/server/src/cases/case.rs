//! One case as a value: what it holds, how far it has come, and which change voids what.
//!
//! The chain is model + scene -> registration -> acceptance -> plan -> approval. Replacing a link
//! drops everything behind it, so that nothing can be approved that rests on something else than
//! what was looked at.

use arthro_bootstrap::Role;
use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Similarity, Vector3};
use bytes::Bytes;

use crate::approval::{Approval, Digest, Policy, Signatory};
use crate::config::Jaw;
use crate::error::{Error, Result};
use crate::verification::Verification;
use crate::words::words;

/// One patient's model, what the camera saw, how they fit, and which bites were approved.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Chosen by the gateway.
    pub id: String,
    /// For people to read.
    pub label: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub created_at_ms: i64,
    /// Grows with every change; a result computed for an older revision is not kept.
    pub revision: u64,
    /// What is known of the stored model.
    pub model: Option<ModelInfo>,
    /// What is known of the stored scene.
    pub scene: Option<SceneInfo>,
    /// The registration in force.
    pub registration: Option<Registration>,
    /// Who accepted the registration.
    pub acceptance: Option<Acceptance>,
    /// The landmarks touched for the registration in force.
    pub verification: Option<Verification>,
    /// The plan in force.
    pub plan: Option<Plan>,
    /// Who approved which digest.
    pub approval: Option<Approval>,
}

/// Who accepted a registration. What they took upon themselves stands in the registration: its verdict and reasons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Acceptance {
    /// Who.
    pub by: String,
    /// As what.
    pub role: Role,
    /// Milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
}

/// What is known of a stored model without reading it.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelInfo {
    /// SHA-256 of mesh and lesion.
    pub digest: Digest,
    /// Distance between the lesion's points, mm.
    pub lesion_spacing_mm: f64,
}

/// What is known of a stored scene without reading it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneInfo {
    /// SHA-256 of the cloud.
    pub digest: Digest,
    /// Points of the cloud.
    pub point_count: u32,
    /// Whether each point carries a unit normal.
    pub has_normals: bool,
}

/// The part of a registration that the gateway reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Registration {
    /// Where the model lies in the view.
    pub camera_from_ct: Similarity<Camera, Ct>,
    /// The registration service's own judgement.
    pub verdict: Verdict,
    /// Why the verdict is not ACCEPT.
    pub reasons: Vec<String>,
    /// The whole result as it came, without its residuals.
    pub encoded: Bytes,
}

words! {
    /// Judgement of a registration.
    Verdict {
        /// The evidence supports the pose.
        Accept = "ACCEPT",
        /// A person must look before it is used.
        Review = "REVIEW",
        /// Not to be used.
        Reject = "REJECT",
    }
}

/// The part of a plan that is executed and approved.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// In the order of execution, ct.
    pub bites: Vec<Bite>,
    /// The new free edge that the plan aims at, ct.
    pub contour: Vec<Point3>,
    /// How the arthroscope watches each bite, in their order; may be empty.
    pub views: Vec<View>,
    /// The jaw that the plan was made for.
    pub jaw: Jaw,
    /// The whole plan as it came.
    pub encoded: Bytes,
}

/// One bite of the jaw, ct.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bite {
    /// Middle of the jaw.
    pub center: Point3,
    /// Along the shaft, out of the tip; unit.
    pub approach: Vector3,
    /// The direction in which the jaw opens; unit, at right angles to `approach`.
    pub opening: Vector3,
    /// The point of the contour that the jaw's edge meets.
    pub contour_point: Point3,
}

/// How the arthroscope looks at one bite, ct.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where its shaft ends.
    pub tip: Point3,
    /// Along the shaft, out of the tip; unit.
    pub approach: Vector3,
    /// Turn of the optics about `approach`.
    pub roll_rad: f64,
}

words! {
    /// How far a case has come.
    Stage {
        /// Model or scene is missing.
        Created = "CREATED",
        /// Model and scene are there.
        Ready = "READY",
        /// A registration waits for acceptance.
        Registered = "REGISTERED",
        /// The registration was accepted.
        Accepted = "ACCEPTED",
        /// A plan waits for approval.
        Planned = "PLANNED",
        /// The plan in force is approved.
        Approved = "APPROVED",
    }
}

impl Case {
    /// A case that holds nothing yet.
    pub fn new(id: String, label: String, created_at_ms: i64) -> Self {
        Self {
            id,
            label,
            created_at_ms,
            revision: 0,
            model: None,
            scene: None,
            registration: None,
            acceptance: None,
            verification: None,
            plan: None,
            approval: None,
        }
    }

    /// How far the case has come; `plan_digest` is the digest of the plan in force.
    pub fn stage(&self, plan_digest: Option<Digest>, policy: Policy) -> Stage {
        if self.model.is_none() || self.scene.is_none() {
            Stage::Created
        } else if self.registration.is_none() {
            Stage::Ready
        } else if self.acceptance.is_none() {
            Stage::Registered
        } else if self.plan.is_none() {
            Stage::Accepted
        } else if plan_digest
            .and_then(|digest| self.approval_of(digest))
            .is_some_and(|approval| approval.is_complete(policy))
        {
            Stage::Approved
        } else {
            Stage::Planned
        }
    }

    /// The approval of exactly this digest, which may still need a second person.
    pub fn approval_of(&self, digest: Digest) -> Option<&Approval> {
        self.approval
            .as_ref()
            .filter(|approval| approval.digest == digest)
    }

    /// Puts another model in; voids registration, plan and approval.
    pub fn replace_model(&mut self, model: ModelInfo) {
        self.model = Some(model);
        self.void_registration();
    }

    /// Puts another scene in; voids registration, plan and approval.
    pub fn replace_scene(&mut self, scene: SceneInfo) {
        self.scene = Some(scene);
        self.void_registration();
    }

    /// Keeps a registration; it has to be accepted anew, and plan and approval are void.
    pub fn register(&mut self, registration: Registration) -> Result<()> {
        self.model_and_scene()?;
        self.void_registration();
        self.registration = Some(registration);
        Ok(())
    }

    /// A person accepts the registration in force; a doubtful one needs a surgeon, and a rejected one nobody accepts.
    pub fn accept(&mut self, acceptance: Acceptance) -> Result<()> {
        let registration = self.registration.as_ref().ok_or(Error::NotRegistered)?;
        if registration.verdict == Verdict::Reject {
            return Err(Error::RegistrationRejected {
                reasons: registration.reasons.clone(),
            });
        }
        if registration.verdict == Verdict::Review && acceptance.role != Role::Surgeon {
            return Err(Error::SurgeonNeeded {
                reasons: registration.reasons.clone(),
            });
        }
        self.acceptance = Some(acceptance);
        Ok(())
    }

    /// Keeps a plan, new or revised; voids the approval.
    pub fn replace_plan(&mut self, plan: Plan) -> Result<()> {
        self.accepted()?;
        self.plan = Some(plan);
        self.approval = None;
        Ok(())
    }

    /// A surgeon approves the plan in force, whose digest is `current`, having seen `seen`. Where two persons must, another
    /// surgeon is the second.
    pub fn approve(
        &mut self,
        surgeon: Signatory,
        seen: Digest,
        current: Digest,
        policy: Policy,
    ) -> Result<()> {
        self.see(seen, current)?;
        if !surgeon.may_approve() {
            return Err(Error::SurgeonMustSign {
                name: surgeon.name,
                role: surgeon.role,
            });
        }
        if policy.persons > 1 && self.approval_of(current).is_some() {
            return self.sign_second(surgeon, current);
        }
        self.approval = Some(Approval {
            surgeon,
            second: None,
            digest: current,
        });
        Ok(())
    }

    /// Another person puts their name to the plan that a surgeon approved.
    pub fn countersign(
        &mut self,
        person: Signatory,
        seen: Digest,
        current: Digest,
        policy: Policy,
    ) -> Result<()> {
        self.see(seen, current)?;
        if policy.persons < 2 {
            return Err(Error::NoSecondApproval);
        }
        if !policy.admits_second(&person) {
            return Err(Error::SurgeonMustSign {
                name: person.name,
                role: person.role,
            });
        }
        self.sign_second(person, current)
    }

    fn sign_second(&mut self, person: Signatory, digest: Digest) -> Result<()> {
        let approval = self
            .approval
            .as_mut()
            .filter(|approval| approval.digest == digest)
            .ok_or(Error::NotApproved { digest })?;
        if approval.surgeon.is(&person) {
            return Err(Error::SamePerson { name: person.name });
        }
        approval.second = Some(person);
        Ok(())
    }

    fn see(&self, seen: Digest, current: Digest) -> Result<()> {
        if self.plan.is_none() {
            return Err(Error::NotPlanned);
        }
        if seen != current {
            return Err(Error::DigestMismatch { seen, current });
        }
        Ok(())
    }

    /// Model and scene, both of which a registration needs.
    pub fn model_and_scene(&self) -> Result<(&ModelInfo, &SceneInfo)> {
        match (&self.model, &self.scene) {
            (Some(model), Some(scene)) => Ok((model, scene)),
            (None, _) => Err(Error::CaseIncomplete { missing: "model" }),
            (_, None) => Err(Error::CaseIncomplete { missing: "scene" }),
        }
    }

    /// The registration, once a person accepted it.
    pub fn accepted(&self) -> Result<&Registration> {
        let registration = self.registration.as_ref().ok_or(Error::NotRegistered)?;
        match self.acceptance {
            Some(_) => Ok(registration),
            None => Err(Error::NotAccepted),
        }
    }

    fn void_registration(&mut self) {
        self.registration = None;
        self.acceptance = None;
        self.verification = None;
        self.plan = None;
        self.approval = None;
    }
}

#[cfg(test)]
mod tests;
