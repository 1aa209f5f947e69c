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
