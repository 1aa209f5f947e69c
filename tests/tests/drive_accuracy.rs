//! How exact the service is, measured at the true mechanisms: positions, forces, contact, results of bites, and that no
//! sequence of commands, stops and faults takes a shaft beyond its travel.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    reason = "a test says why it failed by panicking"
)]

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use arthro_authority::{OperationState, TTL_MIN};
use arthro_instrument::axis::Axis;
use arthro_instrument::bite::{BiteEnd, BiteResult};
use arthro_instrument::config::Config;
use arthro_instrument::drives::{Command, Report};
use arthro_simulator::bench::JawConfig;
use arthro_simulator::epos4::Fault;
use arthro_tests::drives::{DriveWorld, PATIENCE, STEP_S, alone, side_by_side};
use epos4_link::canopen::heartbeat;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tokio::sync::watch;

/// Moves of each axis.
const MOVES: usize = 100;
/// What the spring of the simulated jaw adds to the current, mA/mm: measured by closing an empty one.
const SPRING_MA_PER_MM: f64 = 1.4;
/// Nothing between the blades.
const EMPTY: JawConfig = jaw(0.0, 60.0, 90.0);
/// So thin that the jaw counts as closed on it, and so hard that it is not cut.
const THIN: JawConfig = jaw(0.25, 1000.0, 1000.0);
/// Nothing closes on this.
const THICK_AND_HARD: JawConfig = jaw(6.0, 1000.0, 1000.0);

const fn jaw(thickness_mm: f64, stiffness_n_mm: f64, cut_n: f64) -> JawConfig {
    JawConfig {
        opening_mm: 10.0,
        closed_feed_mm: 10.0,
        tissue_thickness_mm: thickness_mm,
        tissue_stiffness_n_mm: stiffness_n_mm,
        tissue_cut_n: cut_n,
    }
}

fn config() -> Config {
    let mut config = Config::default();
    config.bite.spring_ma_per_mm = SPRING_MA_PER_MM;
    config.bite.current_limit_ma = 800.0;
    config
}

async fn homed(jaw: JawConfig, config: Config) -> DriveWorld {
    let mut world = DriveWorld::with(jaw, config).await;
    world.home_all().await;
    world
}

/// Opens the jaw, puts something between the blades and bites.
async fn bite(world: &mut DriveWorld, jaw: JawConfig, current_limit_ma: f64) -> Report {
    world.succeed(Command::OpenJaw).await;
    world.put_into_jaw(jaw);
    world.run(Command::Bite { current_limit_ma }).await
}

// === positions ===

async fn move_at_random(axis: Axis) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(axis.index() as u64);
    let mut world = homed(EMPTY, config()).await;
    let travel = world.handle.cell().axes[axis.index()].spec.travel;
    // The blades end the feed of the forceps, and its switch is just at the lower end.
    let highest = if axis.closes_jaw() {
        9.9
    } else {
        travel.highest
    };
    let mut worst_qc = 0.0_f64;
    for _ in 0..MOVES {
        let target = rng.random_range(travel.lowest..highest);
        world.move_to(axis, target).await;
        world.settle().await;
        let off_qc = world.off_qc(axis, target);
        assert!(off_qc <= 1.0, "{axis} is {off_qc} qc off {target}");
        worst_qc = worst_qc.max(off_qc);
    }
    worst_qc
}

#[test]
fn every_axis_stands_within_a_quadcount_of_its_target() {
    let worst_qc = side_by_side(4, |place| move_at_random(Axis::ALL[place]));
    for (axis, worst_qc) in Axis::ALL.into_iter().zip(worst_qc) {
        println!("{axis}: {MOVES} moves, {worst_qc:.3} qc off at most");
    }
}

#[test]
fn homing_finds_the_true_edge() {
    alone(async {
        let world = homed(EMPTY, config()).await;
        // A cycle of 0.4 ms at the 0.5 mm/s of the approach is 4.3 quadcounts; the drive then takes where it is.
        for axis in [Axis::ForcepsFeed, Axis::ArthroscopeFeed] {
            let zero_qc = world.zero_qc(axis).abs();
            assert!(zero_qc <= 6.0, "{axis} is {zero_qc} qc off");
        }
    });
}

// === bites ===

/// The true force of a bite into what is not cut, N, and what was told of it.
async fn press(world: &mut DriveWorld, current_limit_ma: f64) -> (f64, BiteEnd) {
    let report = bite(world, THIN, current_limit_ma).await;
    assert_eq!(report.operation.state, OperationState::Done, "{report:?}");
    (world.settle().await.jaw_force_n, report.bite.unwrap())
}

#[test]
fn a_bite_presses_with_the_force_that_is_set() {
    alone(async {
        let mut world = homed(THIN, config()).await;
        let mut config = config();
        for current_ma in [150.0, 280.0, 420.0] {
            let (force_n, _) = press(&mut world, current_ma).await;
            config.bite.force_table.push([current_ma, force_n]);
        }
        println!("measured: {:?}", config.bite.force_table);
        let table = config.bite.force_table.clone();
        let [lowest_n, highest_n] = [0, 2].map(|place| config.bite.force_table[place][1]);
        let mut world = homed(THIN, config).await;
        for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let set_n = lowest_n + share * (highest_n - lowest_n);
            let table = world.handle.cell().bite.force.clone().unwrap();
            let (true_n, end) = press(&mut world, table.current_ma(set_n).unwrap()).await;
            let told_n = end.force_n;
            println!("set {set_n:.1} N, truly {true_n:.1} N, told {told_n:?}");
            assert!(
                (true_n / set_n - 1.0).abs() <= 0.1,
                "{true_n} N of {set_n} N"
            );
            assert!(told_n.is_none_or(|told_n| (told_n / true_n - 1.0).abs() <= 0.1));
        }
        // What is too thick to close on, soft and stiff, is pressed with the same.
        for stiffness_n_mm in [30.0, 100.0, 300.0] {
            let [current_ma, set_n] = table[1];
            let report = bite(&mut world, jaw(6.0, stiffness_n_mm, 1000.0), current_ma).await;
            assert_eq!(report.operation.reason, "JAW_NOT_CLOSED", "{report:?}");
            let true_n = world.settle().await.jaw_force_n;
            println!("{stiffness_n_mm} N/mm: set {set_n:.1} N, truly {true_n:.1} N");
            assert!(
                (true_n / set_n - 1.0).abs() <= 0.1,
                "{true_n} N of {set_n} N"
            );
            world.succeed(Command::OpenJaw).await;
        }
    });
}

#[test]
fn contact_is_told_where_the_blades_meet_the_tissue() {
    alone(async {
        let mut world = homed(EMPTY, config()).await;
        for thickness_mm in [3.0, 5.0, 7.0] {
            let report = bite(&mut world, jaw(thickness_mm, 60.0, 90.0), 400.0).await;
            let told_mm = report.bite.and_then(|end| end.contact_mm).unwrap();
            let true_mm = 10.0 - thickness_mm;
            println!("{thickness_mm} mm of tissue: met at {true_mm} mm, told {told_mm:.3} mm");
            assert!((told_mm - true_mm).abs() <= 0.1, "{report:?}");
        }
    });
}

#[test]
fn every_result_of_a_bite_has_its_cause() {
    alone(async {
        let mut world = homed(EMPTY, config()).await;
        let mut result = async |jaw: JawConfig, limit_ma| {
            let report = bite(&mut world, jaw, limit_ma).await;
            let reason = report.operation.reason.clone();
            (report.bite.map(|end| end.result), reason)
        };
        let none = String::new();
        assert_eq!(
            result(EMPTY, 400.0).await,
            (Some(BiteResult::ClosedEmpty), none.clone())
        );
        assert_eq!(
            result(THIN, 300.0).await,
            (Some(BiteResult::ClosedOnTissue), none)
        );
        let not_closed = "JAW_NOT_CLOSED".to_owned();
        assert_eq!(
            result(THICK_AND_HARD, 300.0).await,
            (Some(BiteResult::NotClosed), not_closed)
        );
        // A hot motor gets its nominal 500 mA and no more: too little, and below the limit that was set.
        world.succeed(Command::OpenJaw).await;
        world.inject(Some(2), Fault::I2tLevel(200.0));
        let report = bite(&mut world, THICK_AND_HARD, 750.0).await;
        assert_eq!(report.bite.map(|end| end.result), Some(BiteResult::Stalled));
        assert_eq!(report.operation.reason, "JAW_STALLED");
    });
}

// === travel ===

/// One command on an axis, and what comes between.
async fn interrupt(world: &mut DriveWorld, rng: &mut ChaCha8Rng, axis: Axis) {
    let travel = world.handle.cell().axes[axis.index()].spec.travel;
    let target = match rng.random_range(0..5) {
        0 => travel.lowest,
        1 => travel.highest,
        _ => rng.random_range(travel.lowest..=travel.highest),
    };
    let bites = axis.closes_jaw() && rng.random_bool(0.3);
    let loses_lease = rng.random_bool(0.02);
    if loses_lease {
        world.handle.release(world.token).await.ok();
        world.take_command(TTL_MIN).await;
    }
    let command = if bites {
        Command::Bite {
            current_limit_ma: rng.random_range(130.0..800.0),
        }
    } else {
        Command::Move { axis, target }
    };
    let ticket = world.begin(command).await;
    if loses_lease {
        if let Ok(mut ticket) = ticket {
            world.ended(&mut ticket).await;
        }
        while !matches!(world.handle.lease().await, Ok(None)) {
            world.pass(0.1).await;
        }
        world.take_command(Duration::from_secs(60)).await;
        return;
    }
    let Ok(mut ticket) = ticket else {
        return;
    };
    let moves_on = rng.random_range(0.0..1.2);
    match rng.random_range(0..6) {
        0 => {}
        1 => {
            world.pass(moves_on).await;
            world.handle.stop("the test".to_owned()).await.unwrap();
        }
        2 => {
            // The next command comes while the drives still brake.
            world.pass(moves_on).await;
            let handle = world.handle.clone();
            let stopping = tokio::spawn(async move { handle.stop("the test".to_owned()).await });
            world.pass(rng.random_range(0.0..0.02)).await;
            let target = rng.random_range(travel.lowest..=travel.highest);
            if let Ok(mut next) = world.begin(Command::Move { axis, target }).await {
                world.ended(&mut next).await;
            }
            stopping.await.unwrap().unwrap();
        }
        3 | 4 => {
            world.pass(moves_on).await;
            let code = [0x2310, 0x8611, 0x4380, 0x5113][rng.random_range(0..4)];
            let id = world.inject(Some(rng.random_range(1..=4)), Fault::Emergency(code));
            world.bus.clear(Some(id));
            world
                .until("at fault", |state| {
                    state.axes.iter().any(|axis| axis.fault.is_some())
                })
                .await;
        }
        _ => {
            world.pass(moves_on).await;
            let id = world.inject(None, Fault::StoOpen);
            world.pass(0.1).await;
            world.bus.clear(Some(id));
        }
    }
    world.ended(&mut ticket).await;
}

/// Sequences on one axis until all are done or time is up; how many.
async fn run_sequences(seed: usize, left: &AtomicU64, until: Option<Instant>) -> u64 {
    let axis = Axis::ALL[seed % 4];
    let mut rng = ChaCha8Rng::seed_from_u64(seed as u64);
    let mut world = homed(EMPTY, config()).await;
    let spec = world.handle.cell().axes[axis.index()].spec.clone();
    let [low_qc, high_qc] = [spec.travel.lowest, spec.travel.highest]
        .map(|end| f64::from(spec.drivetrain.to_quadcounts(end)) + world.zero_qc(axis));
    world.forget_extremes();
    let mut done = 0;
    let take = |left: u64| left.checked_sub(1);
    while until.is_none_or(|until| Instant::now() < until)
        && left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, take)
            .is_ok()
    {
        for _ in 0..3 {
            interrupt(&mut world, &mut rng, axis).await;
            while world.faults() != [None; 4] {
                world.settle().await;
                world.until_ready().await;
                // A fault that comes late ends it.
                world.run(Command::Recover(Axis::ALL.to_vec())).await;
            }
        }
        world.settle().await;
        let (lowest_qc, highest_qc) = world.truth().extremes_qc[axis.index()];
        assert!(
            lowest_qc >= low_qc - 1.0 && highest_qc <= high_qc + 1.0,
            "{axis} was between {lowest_qc} and {highest_qc} qc, its travel is {low_qc} to {high_qc} qc, seed {seed}, sequence {done}"
        );
        world.check();
        done += 1;
    }
    done
}

#[test]
fn no_sequence_of_commands_stops_and_faults_leads_beyond_the_travel() {
    const WORLDS: usize = 8;
    const TIME: Duration = Duration::from_secs(20);
    // As many as fit into some seconds, or as many as are asked for.
    let asked = std::env::var("ARTHRO_SEQUENCES").ok();
    let asked: Option<u64> = asked.map(|asked| asked.parse().unwrap());
    let until = asked.is_none().then(|| Instant::now() + TIME);
    let left = AtomicU64::new(asked.unwrap_or(u64::MAX));
    let done = side_by_side(WORLDS, |seed| run_sequences(seed, &left, until));
    let done: u64 = done.iter().sum();
    println!("{done} sequences of three commands");
    assert!(done >= asked.unwrap_or(WORLDS as u64));
}

// === the host dies ===

#[test]
fn a_drive_begins_to_brake_when_its_host_is_dead() {
    alone(async {
        let mut world = homed(EMPTY, config()).await;
        let axis = Axis::ArthroscopeFeed;
        let host = world.handle.cell().host_node_id;
        let timeout_s = world.handle.cell().heartbeat_timeout.as_secs_f64();
        let (heard, last) = watch::channel(Duration::ZERO);
        let mut listener = world.bus.join();
        let listening = tokio::spawn(async move {
            while let Some(stamped) = listener.heard().await {
                if heartbeat::decode(&stamped.frame).is_some_and(|(from, _)| from == host) {
                    heard.send_replace(stamped.stamp);
                }
            }
        });
        let target = 14.0;
        world.begin(Command::Move { axis, target }).await.unwrap();
        world
            .until_truly("moving", |truth| {
                truth.speeds_qc_s[axis.index()] > 200_000.0
            })
            .await;
        world.kill_host().await;
        let begun = Instant::now();
        while world.bus.members() > 1 {
            assert!(begun.elapsed() < PATIENCE, "the connection stands");
            world.pass(STEP_S).await;
        }
        listening.abort();
        listening.await.err();
        let last_s = last.borrow().as_secs_f64();
        let stood = world.settle().await;
        let braked_s = stood.enabled_s[axis.index()] + STEP_S - last_s;
        println!("brakes {:.1} ms after the last heartbeat", 1e3 * braked_s);
        assert!(braked_s <= timeout_s + 0.005, "{braked_s} s");
        assert!(world.creep_qc(&stood, 1.0).await <= 2.0);
    });
}
