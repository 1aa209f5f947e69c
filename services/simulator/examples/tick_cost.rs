//! Prints what a tick of the cell costs, part by part, in microseconds of processor time.
//!
//! 50 times real time is 6250 ticks a second: 160 us for everything, clients included.

use std::hint::black_box;
use std::sync::{Arc, Mutex};

use arthro_simulator::cell::{Cell, TICK_S, axes};
use arthro_simulator::scenario::{Scenario, Spec};
use arthro_simulator::{epos4, ur5};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scenario = Scenario::phantom(Spec::default())?;
    let joints_rad = scenario.spec.layout.start_joints_rad;

    let mut cell = Cell::new(&scenario);
    let truth_us = cost_us(|| cell.tick(black_box(&joints_rad), |_, _, _| axes::start_qc()))?;

    let mut arm = ur5::Controller::new(ur5::Config {
        joints_rad: joints_rad[0],
        powered: true,
        ..ur5::Config::default()
    });
    let arm_us = cost_us(|| arm.tick())?;

    let bus = epos4::Bus::new(axes::drives());
    let mechanics =
        axes::Mechanisms::new(&axes::Axis::ALL).act(&axes::start_qc(), axes::JawLoad::default());
    let mut now_s = 0.0;
    let mut drives_us = |steps: u32| {
        cost_us(|| {
            for _ in 0..steps {
                now_s += TICK_S / f64::from(steps);
                bus.tick(TICK_S / f64::from(steps), now_s, &mechanics);
            }
        })
    };
    let (standing_us, turning_us) = (drives_us(1)?, drives_us(8)?);

    let shared = Arc::new(Mutex::new(arm));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let servers_us = runtime.block_on(async {
        let free = ur5::ServerOptions {
            ports: ur5::Ports::FREE,
            ..ur5::ServerOptions::default()
        };
        let servers = ur5::serve(shared, free).await?;
        cost_us(|| servers.ticked())
    })?;

    println!("truth {truth_us:.1}  arm {arm_us:.1}  servers of an arm {servers_us:.1}");
    let rest_us = truth_us + 2.0 * (arm_us + servers_us);
    for (drives, drives_us) in [("standing", standing_us), ("turning", turning_us)] {
        println!(
            "drives {drives}: {drives_us:.1}, a tick {:.1}",
            rest_us + drives_us
        );
    }
    Ok(())
}

/// Mean over many calls, of this thread's time on a processor.
fn cost_us(mut call: impl FnMut()) -> std::io::Result<f64> {
    const CALLS: u32 = 20_000;
    for _ in 0..CALLS / 10 {
        call();
    }
    let before = on_processor_us()?;
    for _ in 0..CALLS {
        call();
    }
    Ok((on_processor_us()? - before) / f64::from(CALLS))
}

fn on_processor_us() -> std::io::Result<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanoseconds = text
        .split_whitespace()
        .next()
        .and_then(|word| word.parse::<f64>().ok());
    nanoseconds
        .map(|nanoseconds| nanoseconds / 1000.0)
        .ok_or_else(|| std::io::Error::other("schedstat holds no number"))
}
