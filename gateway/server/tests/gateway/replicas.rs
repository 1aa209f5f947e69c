//! Registration and planning with several replicas, some of which fail.

use arthro_bootstrap::status;
use arthro_gateway::clients::replicas::RESTARTS_MAX;
use arthro_gateway::clients::replicas::addresses::Addresses;
use arthro_proto::gateway::v1 as proto;
use tonic::{Code, Status};
use tonic_health::ServingStatus;

use super::bench::{Bench, plan_request, reason};
use super::fakes::PATIENCE;
use super::fakes::replica::Replica;

/// A gateway between these replicas, and a case that can be registered.
async fn bench(replicas: &[Replica]) -> (Bench, String) {
    let addresses = replicas.iter().map(|replica| replica.address.clone());
    let addresses = Addresses::List(addresses.collect());
    let mut bench = Bench::with(|config| {
        config.registration = addresses.clone();
        config.planning = addresses;
    })
    .await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    (bench, case_id)
}

async fn two() -> [Replica; 2] {
    [Replica::new().await, Replica::new().await]
}

fn hold(replicas: &[Replica], computation: &str) {
    for replica in replicas {
        replica.world.hold(computation);
    }
}

/// The index of the replica that began first.
async fn begins(replicas: &[Replica; 2], computation: &str) -> usize {
    let [a, b] = replicas;
    let first = async {
        tokio::select! {
            () = a.computes(computation) => 0,
            () = b.computes(computation) => 1,
        }
    };
    tokio::time::timeout(PATIENCE, first).await.unwrap()
}

fn register_request(case_id: &str) -> proto::RegisterCaseRequest {
    proto::RegisterCaseRequest {
        case_id: case_id.to_owned(),
        ..proto::RegisterCaseRequest::default()
    }
}

/// Registers without unwrapping.
async fn registers(
    bench: &mut Bench,
    case_id: &str,
) -> Result<Vec<proto::RegisterCaseResponse>, Status> {
    let call = bench.cases.register_case(register_request(case_id));
    let mut events = call.await?.into_inner();
    let mut all = Vec::new();
    while let Some(event) = events.message().await? {
        all.push(event);
    }
    Ok(all)
}

#[tokio::test]
async fn a_registration_survives_the_death_of_its_replica() {
    let mut replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    hold(&replicas, "REGISTER");
    let call = bench.cases.register_case(register_request(&case_id));
    let mut answers = call.await.unwrap().into_inner();
    let mut events = vec![answers.message().await.unwrap().unwrap()];
    let doomed = begins(&replicas, "REGISTER").await;
    replicas[doomed].kill().await;
    replicas[1 - doomed].world.let_go();
    while let Some(event) = answers.message().await.unwrap() {
        events.push(event);
    }

    let notes: Vec<_> = events
        .iter()
        .filter_map(|event| event.begun_anew.as_ref())
        .collect();
    let [note] = notes.as_slice() else {
        panic!("one note: {events:?}");
    };
    assert_eq!(
        (note.times, &note.lost_replica),
        (1, &replicas[doomed].address)
    );
    let case = bench.get(&case_id).await.case.unwrap();
    assert_eq!(case.state(), proto::CaseState::Registered);
}

#[tokio::test]
async fn a_plan_survives_the_death_of_its_replica() {
    let mut replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    bench.register(&case_id).await;
    bench.accept(&case_id).await.unwrap();
    hold(&replicas, "PLAN");
    let call = bench.cases.plan_case(plan_request(&case_id));
    let mut answers = call.await.unwrap().into_inner();
    assert!(answers.message().await.unwrap().is_some());
    let doomed = begins(&replicas, "PLAN").await;
    replicas[doomed].kill().await;
    replicas[1 - doomed].world.let_go();
    let mut notes = 0;
    while let Some(event) = answers.message().await.unwrap() {
        notes += usize::from(event.begun_anew.is_some());
    }
    assert_eq!(notes, 1);
    let case = bench.get(&case_id).await.case.unwrap();
    assert_eq!(case.state(), proto::CaseState::Planned);
}

#[tokio::test]
async fn with_every_replica_dead_the_call_is_refused_with_its_reason() {
    let mut replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    for replica in &mut replicas {
        replica.kill().await;
    }
    for _ in 0..5 {
        let refusal = registers(&mut bench, &case_id).await.unwrap_err();
        assert_eq!(refusal.code(), Code::Unavailable);
        assert_eq!(
            status::reason(&refusal).as_deref(),
            Some("REGISTRATION_UNAVAILABLE")
        );
    }
    // After a few failures nothing is tried any more, and the refusal says what each suffers from.
    let refusal = registers(&mut bench, &case_id).await.unwrap_err();
    for replica in &replicas {
        let told = format!("{} failed several times", replica.address);
        assert!(refusal.message().contains(&told), "{refusal:?}");
    }
}

#[tokio::test]
async fn a_replica_that_comes_back_takes_calls_again() {
    let mut replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    replicas[0].kill().await;
    for _ in 0..4 {
        bench.register(&case_id).await;
    }
    assert_eq!(replicas[1].count("REGISTER"), 4);
    replicas[0].rebirth().await;
    let back = async {
        while replicas[0].count("REGISTER") == 0 {
            bench.register(&case_id).await;
        }
    };
    tokio::time::timeout(PATIENCE, back).await.unwrap();
}

#[tokio::test]
async fn calls_are_spread_evenly() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    for _ in 0..20 {
        bench.register(&case_id).await;
    }
    let counts = [0, 1].map(|index| replicas[index].count("REGISTER"));
    assert_eq!(counts, [10, 10]);
}

#[tokio::test]
async fn a_slow_replica_gets_no_more_while_another_is_free() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    hold(&replicas, "REGISTER");
    let mut cases = bench.cases.clone();
    let slow_call = cases
        .register_case(register_request(&case_id))
        .await
        .unwrap();
    let slow = begins(&replicas, "REGISTER").await;
    replicas[1 - slow].world.let_go();
    for _ in 0..5 {
        bench.register(&case_id).await;
    }
    assert_eq!(replicas[slow].count("REGISTER"), 1);
    assert_eq!(replicas[1 - slow].count("REGISTER"), 5);
    drop(slow_call);
}

#[tokio::test]
async fn a_replica_that_does_not_serve_leaves_and_comes_back() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    replicas[0].says(ServingStatus::NotServing).await;
    // The next look finds it; from then on all calls go to the other.
    let left = async {
        loop {
            let before = replicas[0].count("REGISTER");
            for _ in 0..4 {
                bench.register(&case_id).await;
            }
            if replicas[0].count("REGISTER") == before {
                return;
            }
        }
    };
    tokio::time::timeout(PATIENCE, left).await.unwrap();
    replicas[0].says(ServingStatus::Serving).await;
    let before = replicas[0].count("REGISTER");
    let back = async {
        while replicas[0].count("REGISTER") == before {
            bench.register(&case_id).await;
        }
    };
    tokio::time::timeout(PATIENCE, back).await.unwrap();
}

#[tokio::test]
async fn a_replica_without_room_passes_the_call_on() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    let full = status::exhausted("TOO_MANY_COMPUTATIONS", "2 are under way", &[]);
    *replicas[0].world.computing_refusal.lock().unwrap() = Some(full.clone());
    for _ in 0..4 {
        bench.register(&case_id).await;
    }
    assert_eq!(replicas[1].count("REGISTER"), 4);
    *replicas[1].world.computing_refusal.lock().unwrap() = Some(full);
    assert_eq!(
        reason(registers(&mut bench, &case_id).await),
        "TOO_MANY_COMPUTATIONS"
    );
}

#[tokio::test]
async fn a_call_that_breaks_every_replica_is_given_up() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    for replica in &replicas {
        let broken = status::unavailable("BROKEN", "the connection broke", &[]);
        *replica.world.computing_refusal.lock().unwrap() = Some(broken);
    }
    let refusal = registers(&mut bench, &case_id).await.unwrap_err();
    assert_eq!(refusal.code(), Code::Unavailable);
    let tried: usize = replicas
        .iter()
        .map(|replica| replica.count("REGISTER"))
        .sum();
    assert_eq!(tried, 1 + RESTARTS_MAX as usize);
}

#[tokio::test]
async fn a_refused_request_is_not_sent_to_another_replica() {
    let replicas = two().await;
    let (mut bench, case_id) = bench(&replicas).await;
    bench.register(&case_id).await;
    bench.accept(&case_id).await.unwrap();
    let request = proto::PlanCaseRequest {
        region_percent: 101.0,
        ..plan_request(&case_id)
    };
    let mut events = bench.cases.plan_case(request).await.unwrap().into_inner();
    let refusal = events.message().await.unwrap_err();
    assert_eq!(refusal.code(), Code::InvalidArgument);
    let tried: usize = replicas.iter().map(|replica| replica.count("PLAN")).sum();
    assert_eq!(tried, 1);
}

#[tokio::test]
async fn the_addresses_of_a_name_are_the_replicas() {
    let replica = Replica::new().await;
    let port = replica.address.rsplit(':').next().unwrap();
    let name = format!("dns:///localhost:{port}");
    let mut bench = Bench::with(|config| config.registration = name.into()).await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    // Where the name has an address that nobody serves, it is passed over.
    bench.register(&case_id).await;
    assert_eq!(replica.count("REGISTER"), 1);
}

#[tokio::test]
async fn a_name_without_addresses_is_told() {
    let name = "dns:///no-such-host.invalid:50051".to_owned();
    let mut bench = Bench::with(|config| config.registration = name.into()).await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    let refusal = registers(&mut bench, &case_id).await.unwrap_err();
    assert_eq!(refusal.code(), Code::Unavailable);
    assert!(
        refusal.message().contains("stands for no address"),
        "{refusal:?}"
    );
}
