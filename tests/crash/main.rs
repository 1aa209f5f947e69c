//! Kills every service of a running cell at every step of a procedure, and the gateway at every write of its journal, and asks after each
//! blow what is true: nothing moves by itself, no bite is lost, none is made twice without a decision, and the journal's account is the
//! referee's.
//!
//! `tests/run crash` takes a sample, `tests/run crash --full` everything.

mod books;
mod campaign;
mod service;
mod strike;
mod tally;
mod truth;
mod world;

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::strike::{Extent, Schedule, Victim};
use crate::tally::Tally;

/// What breaks down the campaign itself.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Kills services and looks what moves.
#[derive(Debug, Parser)]
struct Arguments {
    /// Everything instead of a sample: more than 1,000 kills.
    #[arg(long)]
    full: bool,
    /// Of all that is drawn: the order of the blows, their moments, the knees, the operator's decisions.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cells beside each other.
    #[arg(long, default_value_t = 2)]
    cells: usize,
    /// Only this share of the blows: `0/4` is the first of four, so that machines can share the work.
    #[arg(long, value_parser = shard, default_value = "0/1")]
    shard: (usize, usize),
    /// Strikes nothing else: `gateway`, `instrument`, `arm links`...
    #[arg(long, value_parser = victim)]
    only: Option<Victim>,
}

fn victim(name: &str) -> std::result::Result<Victim, String> {
    let named = Victim::ALL.into_iter().find(|victim| victim.name() == name);
    named.ok_or_else(|| {
        format!(
            "must be one of {}",
            Victim::ALL.map(Victim::name).join(", ")
        )
    })
}

fn shard(text: &str) -> std::result::Result<(usize, usize), String> {
    let (part, of) = text.split_once('/').ok_or("not of the form 0/4")?;
    let number = |text: &str| text.parse::<usize>().map_err(|error| error.to_string());
    let (part, of) = (number(part)?, number(of)?);
    if part < of {
        Ok((part, of))
    } else {
        Err(format!("{part} is not below {of}"))
    }
}

#[tokio::main]
async fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let began = Instant::now();
    let extent = match arguments.full {
        true => Extent::Full,
        false => Extent::Sample,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(arguments.seed);
    let (part, of) = arguments.shard;
    let mut schedule = Schedule::new(extent, &mut rng);
    if let Some(only) = arguments.only {
        schedule.keep_only(only);
    }
    let schedule = schedule.part(part, of);
    let cells = arguments.cells.max(1);
    let campaigns: Vec<_> = (0..cells)
        .map(|cell| {
            let schedule = schedule.part(cell, cells);
            tokio::spawn(campaign::run(
                cell,
                schedule,
                arguments.seed + 100_000 * part as u64,
            ))
        })
        .collect();
    let mut tally = Tally::default();
    for campaign in campaigns {
        match campaign.await {
            Ok(part) => tally.add(part),
            Err(error) => {
                tally.disagreements += 1;
                tally.findings.push(format!("a cell ended: {error}"));
            }
        }
    }
    tally.print(arguments.seed, began.elapsed().as_secs_f64());
    ExitCode::from(u8::from(!tally.passed()))
}
