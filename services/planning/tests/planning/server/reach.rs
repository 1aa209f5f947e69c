//! Reachability as clients ask for it, alone and of a plan.

use super::*;

/// Which bites of the phantom a portal reaches when the joint is opened so far.
fn reach_options(case: &Request, opening_mm: f64) -> proto::CheckReachabilityOptions {
    proto::CheckReachabilityOptions {
        model: Some(mesh_header(case)),
        joint: Some(opened(opening_mm)),
        portals: vec![point(case.portals[0]).unwrap()],
        bites: vec![
            point(phantom::START).unwrap(),
            point(phantom::GOAL).unwrap(),
        ],
        jaw_length_mm: 4.5,
    }
}

/// A joint of which no bone was scanned.
fn opened(opening_mm: f64) -> proto::JointOptions {
    proto::JointOptions {
        opening_mm,
        ..Default::default()
    }
}

fn reach_messages(case: &Request, options: proto::CheckReachabilityOptions) -> Vec<ReachPayload> {
    let mut messages = vec![ReachPayload::Options(options)];
    messages.extend(model_chunks(case).into_iter().map(ReachPayload::Model));
    messages
}

#[tokio::test]
async fn reachability_is_told_for_each_bite_and_portal() {
    use proto::reachability::Answer;
    let mut context = Context::start().await;
    let case = papers_case();
    let open = reach_messages(&case, reach_options(&case, 8.0));
    let open = context.reach(open).await.unwrap();
    assert_eq!(open.reachable_bites, 2);
    let Some(Answer::Clearance(room)) = &open.answers[1].answer else {
        panic!("{open:?}");
    };
    assert!(room.femur_mm > 0.5 && room.tibia_mm > 0.5 && room.insertion_mm > 30.0);

    let closed = reach_messages(&case, reach_options(&case, -5.0));
    let closed = context.reach(closed).await.unwrap();
    let obstructions: Vec<_> = closed
        .answers
        .iter()
        .filter_map(|answer| match &answer.answer {
            Some(Answer::Obstruction(obstruction)) => Some((answer.bite, obstruction)),
            _ => None,
        })
        .collect();
    let (bite, obstruction) = obstructions[0];
    assert_eq!(obstruction.reason, "JOINT_GAP_TOO_SMALL");
    let needed_mm = obstruction.limit_mm.unwrap();
    assert!(needed_mm > obstruction.value_mm.unwrap() && !obstruction.remedy.is_empty());
    // The place is in ct: on the ball, over the joint line.
    assert!(
        (40.0..70.0).contains(&obstruction.at.unwrap().y_mm),
        "{obstruction:?}"
    );
    let enough = reach_messages(&case, reach_options(&case, needed_mm));
    let enough = context.reach(enough).await.unwrap();
    assert!(matches!(
        enough.answers[bite as usize].answer,
        Some(Answer::Clearance(_))
    ));
}

#[tokio::test]
async fn a_reachability_question_that_cannot_be_right_is_refused_by_field() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut bad = reach_options(&case, f64::NAN);
    bad.jaw_length_mm = 0.0;
    bad.bites[1].x_mm = f64::INFINITY;
    let refusal = context.reach(reach_messages(&case, bad)).await.unwrap_err();
    let expected = [
        "options.jaw_length_mm",
        "options.bites[1].x_mm",
        "options.joint.opening_mm",
    ];
    assert_eq!(violated_fields(&refusal), expected);

    let mut none = reach_options(&case, 8.0);
    none.portals.clear();
    let refusal = context
        .reach(reach_messages(&case, none))
        .await
        .unwrap_err();
    assert_eq!(violated_fields(&refusal), ["options.portals"]);

    let mut messages = reach_messages(&case, reach_options(&case, 8.0));
    messages.push(ReachPayload::Femur(common::MeshChunk::default()));
    let refusal = context.reach(messages).await.unwrap_err();
    assert_eq!(violated_fields(&refusal), ["options.joint.femur"]);

    let mut steep = reach_options(&case, 8.0);
    steep.joint = Some(proto::JointOptions {
        limits: Some(proto::ReachLimits {
            clearance_mm: Some(-1.0),
            ..Default::default()
        }),
        ..opened(8.0)
    });
    let refusal = context
        .reach(reach_messages(&case, steep))
        .await
        .unwrap_err();
    assert_eq!(
        violated_fields(&refusal),
        ["options.joint.limits.clearance_mm"]
    );
}

#[tokio::test]
async fn a_scanned_bone_in_the_way_is_named_with_its_triangle() {
    use proto::reachability::Answer;
    let mut context = Context::start().await;
    let case = papers_case();
    let mut bone = papers_case();
    for vertex in &mut bone.model.vertices {
        *vertex += arthro_geometry::phantom::SUPERIOR * 3.0;
    }
    let mut options = reach_options(&case, 8.0);
    options.joint = Some(proto::JointOptions {
        tibia: Some(mesh_header(&bone)),
        ..opened(8.0)
    });
    let mut messages = reach_messages(&case, options);
    messages.extend(model_chunks(&bone).into_iter().map(ReachPayload::Tibia));
    let answers = context.reach(messages).await.unwrap().answers;
    let Some(Answer::Obstruction(obstruction)) = &answers[1].answer else {
        panic!("{answers:?}");
    };
    assert_eq!(obstruction.reason, "SHAFT_HITS_TIBIA");
    let triangle = obstruction.triangle.unwrap() as usize;
    let at = obstruction.at.unwrap();
    let at = Point3::new(at.x_mm, at.y_mm, at.z_mm);
    let corner = bone.model.corners(triangle)[0];
    assert!((corner - at).norm() < 3.0, "{corner} {at}");

    let mut metres = papers_case();
    for vertex in &mut metres.model.vertices {
        *vertex /= 1000.0;
    }
    let mut options = reach_options(&case, 8.0);
    options.joint = Some(proto::JointOptions {
        femur: Some(mesh_header(&metres)),
        ..opened(8.0)
    });
    let mut messages = reach_messages(&case, options);
    messages.extend(model_chunks(&metres).into_iter().map(ReachPayload::Femur));
    let refusal = context.reach(messages).await.unwrap_err();
    assert_eq!(violated_fields(&refusal), ["femur"]);
}

#[tokio::test]
async fn a_plan_keeps_clear_of_the_bones_or_says_how_far_the_joint_must_open() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut asked = tear_options(&case);
    asked.joint = Some(opened(8.0));
    let events = context.plan(messages(asked.clone(), &case)).await.unwrap();
    let Some(Event::Plan(plan)) = events.last() else {
        panic!("{events:?}");
    };
    assert_eq!(plan.clearances.len(), plan.bites.len());
    for room in &plan.clearances {
        assert!(room.femur_mm >= 0.5 && room.tibia_mm >= 0.5, "{room:?}");
    }

    asked.joint = Some(opened(-6.0));
    let refusal = context.refusal(messages(asked, &case)).await;
    assert_eq!(refusal.code(), Code::FailedPrecondition);
    let reason = status::reason(&refusal);
    assert_eq!(reason.as_deref(), Some("JOINT_GAP_TOO_SMALL"), "{refusal}");
    assert!(refusal.message().contains("open"), "{refusal}");
}
