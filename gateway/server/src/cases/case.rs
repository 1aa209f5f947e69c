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
mod tests {
    use super::*;
    use crate::approval::Second;
    use arthro_bootstrap::{Caller, Role};

    fn registration(verdict: Verdict) -> Registration {
        Registration {
            camera_from_ct: Similarity::identity(),
            verdict,
            reasons: vec!["OVERLAP_LOW".to_owned()],
            encoded: Bytes::new(),
        }
    }

    fn plan() -> Plan {
        Plan {
            bites: Vec::new(),
            contour: Vec::new(),
            views: Vec::new(),
            jaw: Jaw::default(),
            encoded: Bytes::new(),
        }
    }

    fn by(role: Role) -> Acceptance {
        Acceptance {
            by: "somebody".to_owned(),
            role,
            at_ms: 0,
        }
    }

    fn digest(byte: u8) -> Digest {
        Digest::from_bytes([byte; 32])
    }

    fn model() -> ModelInfo {
        ModelInfo {
            digest: digest(1),
            lesion_spacing_mm: 0.5,
        }
    }

    fn scene() -> SceneInfo {
        SceneInfo {
            digest: digest(2),
            point_count: 3,
            has_normals: true,
        }
    }

    fn approved() -> Case {
        let mut case = Case::new("c".to_owned(), "knee".to_owned(), 0);
        case.replace_model(model());
        case.replace_scene(scene());
        case.register(registration(Verdict::Review)).unwrap();
        case.accept(by(Role::Surgeon)).unwrap();
        case.replace_plan(plan()).unwrap();
        case.approve(surgeon("Dr. Adams"), digest(3), digest(3), ONE)
            .unwrap();
        assert_eq!(case.stage(Some(digest(3)), ONE), Stage::Approved);
        case
    }

    const ONE: Policy = Policy {
        persons: 1,
        second: Second::Surgeon,
    };
    const TWO_SURGEONS: Policy = Policy { persons: 2, ..ONE };
    const WITH_OPERATOR: Policy = Policy {
        persons: 2,
        second: Second::Operator,
    };

    fn signatory(name: &str, role: Role) -> Signatory {
        let caller = Caller::Certified {
            name: name.to_owned(),
            role,
        };
        Signatory::new(&caller, name.to_owned(), 0)
    }

    fn surgeon(name: &str) -> Signatory {
        signatory(name, Role::Surgeon)
    }

    #[test]
    fn one_of_two_surgeons_is_not_enough() {
        let mut case = approved();
        let digest = digest(3);
        assert_eq!(case.stage(Some(digest), TWO_SURGEONS), Stage::Planned);
        case.approve(surgeon("Dr. Brown"), digest, digest, TWO_SURGEONS)
            .unwrap();
        assert_eq!(case.stage(Some(digest), TWO_SURGEONS), Stage::Approved);
        let approval = case.approval.unwrap();
        assert_eq!(approval.surgeon.name, "Dr. Adams");
        assert_eq!(approval.second.unwrap().name, "Dr. Brown");
    }

    #[test]
    fn the_same_person_is_no_second_one_in_whatever_letters() {
        let mut case = approved();
        let digest = digest(3);
        for name in ["Dr. Adams", "dr. adams", "  DR.   Adams "] {
            for policy in [TWO_SURGEONS, WITH_OPERATOR] {
                let refusals = [
                    case.approve(surgeon(name), digest, digest, policy),
                    case.countersign(surgeon(name), digest, digest, policy),
                    case.countersign(
                        signatory(name, Role::Operator),
                        digest,
                        digest,
                        WITH_OPERATOR,
                    ),
                ];
                for refusal in refusals {
                    assert!(matches!(refusal, Err(Error::SamePerson { .. })));
                }
            }
        }
        assert_eq!(case.stage(Some(digest), TWO_SURGEONS), Stage::Planned);
    }

    #[test]
    fn an_operator_countersigns_only_where_that_is_configured() {
        let mut case = approved();
        let digest = digest(3);
        let operator = signatory("Olsen", Role::Operator);
        assert!(matches!(
            case.countersign(operator.clone(), digest, digest, TWO_SURGEONS),
            Err(Error::SurgeonMustSign { .. })
        ));
        assert!(matches!(
            case.countersign(operator.clone(), digest, digest, ONE),
            Err(Error::NoSecondApproval)
        ));
        case.countersign(operator, digest, digest, WITH_OPERATOR)
            .unwrap();
        assert_eq!(case.stage(Some(digest), WITH_OPERATOR), Stage::Approved);
    }

    #[test]
    fn nobody_but_a_surgeon_approves_first() {
        let mut case = approved();
        case.replace_plan(plan()).unwrap();
        let digest = digest(3);
        for role in [Role::Viewer, Role::Operator, Role::Service] {
            assert!(matches!(
                case.approve(signatory("Olsen", role), digest, digest, WITH_OPERATOR),
                Err(Error::SurgeonMustSign { .. })
            ));
        }
        assert!(matches!(
            case.countersign(
                signatory("Olsen", Role::Operator),
                digest,
                digest,
                WITH_OPERATOR
            ),
            Err(Error::NotApproved { .. })
        ));
        assert!(case.approval.is_none());
    }

    #[test]
    fn a_second_name_under_another_digest_does_not_count() {
        let mut case = approved();
        assert!(matches!(
            case.approve(surgeon("Dr. Brown"), digest(3), digest(4), TWO_SURGEONS),
            Err(Error::DigestMismatch { .. })
        ));
        // Another plan in force: the first name has to be put to it anew.
        case.approve(surgeon("Dr. Brown"), digest(4), digest(4), TWO_SURGEONS)
            .unwrap();
        assert_eq!(case.stage(Some(digest(4)), TWO_SURGEONS), Stage::Planned);
    }

    #[test]
    fn another_model_voids_everything_behind_it() {
        let mut case = approved();
        case.replace_model(model());
        assert_eq!(case.stage(None, ONE), Stage::Ready);
        assert!(case.approval.is_none() && case.plan.is_none());
    }

    #[test]
    fn another_registration_has_to_be_accepted_anew() {
        let mut case = approved();
        case.register(registration(Verdict::Accept)).unwrap();
        assert_eq!(case.stage(None, ONE), Stage::Registered);
        assert!(matches!(case.replace_plan(plan()), Err(Error::NotAccepted)));
    }

    #[test]
    fn a_revised_plan_is_not_approved() {
        let mut case = approved();
        case.replace_plan(plan()).unwrap();
        assert_eq!(case.stage(Some(digest(3)), ONE), Stage::Planned);
    }

    #[test]
    fn an_approval_of_another_digest_does_not_count() {
        let case = approved();
        assert_eq!(case.stage(Some(digest(4)), ONE), Stage::Planned);
    }

    #[test]
    fn a_rejected_registration_is_not_accepted() {
        let mut case = approved();
        case.register(registration(Verdict::Reject)).unwrap();
        assert!(matches!(
            case.accept(by(Role::Surgeon)),
            Err(Error::RegistrationRejected { .. })
        ));
    }

    #[test]
    fn a_doubtful_registration_is_accepted_by_a_surgeon_only() {
        let mut case = approved();
        case.register(registration(Verdict::Review)).unwrap();
        for role in [Role::Viewer, Role::Operator, Role::Service] {
            let refused = case.accept(by(role));
            assert!(
                matches!(refused, Err(Error::SurgeonNeeded { .. })),
                "{role}"
            );
            assert_eq!(case.stage(None, ONE), Stage::Registered);
        }
        case.accept(by(Role::Surgeon)).unwrap();
        assert_eq!(case.stage(None, ONE), Stage::Accepted);
    }

    #[test]
    fn another_registration_scene_or_model_voids_what_was_touched() {
        let touched = || Case {
            verification: Some(Verification::new(digest(9))),
            ..approved()
        };
        let mut cases = [touched(), touched(), touched()];
        cases[0].register(registration(Verdict::Accept)).unwrap();
        cases[1].replace_scene(scene());
        cases[2].replace_model(model());
        assert!(cases.iter().all(|case| case.verification.is_none()));
    }

    #[test]
    fn a_digest_that_was_not_seen_is_not_approved() {
        let mut case = approved();
        case.replace_plan(plan()).unwrap();
        assert!(matches!(
            case.approve(surgeon("Dr. Adams"), digest(3), digest(4), ONE),
            Err(Error::DigestMismatch { .. })
        ));
        assert!(case.approval.is_none());
    }
}
