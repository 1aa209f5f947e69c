//! One cell of the campaign: procedures are performed, struck, looked at, decided about and performed to their end.

use std::collections::BTreeMap;
use std::time::Duration;

use arthro_proto::gateway::v1::{
    GetReportRequest, GetReportResponse, Procedure, ProcedureState, RecoverProcedureRequest,
    RecoveryAction, StartProcedureRequest, Step, StepKind, StepState, WatchProcedureRequest,
};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tonic::Status;

use crate::Result;
use crate::books::{Books, Difference, interrupted_bite};
use crate::service::Started;
use crate::strike::{AtStep, AtWrite, Moment, Schedule, Victim};
use crate::tally::{Outcome, Tally};
use crate::truth::Pose;
use crate::world::{CaseWork, Cut, World};

/// Procedures on one knee; later bites find less tissue.
const PROCEDURES_A_KNEE: u32 = 8;
/// Procedures without a blow before what is left counts as never due.
const PROCEDURES_IN_VAIN: u32 = 3;
/// A procedure is looked at so long, cell time, before it is decided about.
const HOLD_S: f64 = 8.0;
/// Everything must have come to rest within this time of the cell, unless it is moved.
const REST_LIMIT_S: f64 = 600.0;
/// Without a word of the procedure for so long, wall time, something hangs.
const SILENCE: Duration = Duration::from_secs(90);
/// Decisions about one interruption before it counts as stuck.
const DECISIONS: u32 = 8;
/// A step whose length is not known yet is taken for so long, cell time.
const STEP_S: f64 = 1.0;
/// Cells that may break down before the campaign gives up.
const BREAKDOWNS: u32 = 3;

/// One cell with what is still to be struck in it.
struct Campaign<'a> {
    name: String,
    world: World,
    schedule: &'a mut Schedule,
    tally: &'a mut Tally,
    rng: ChaCha8Rng,
    /// How long each kind of step takes, cell time.
    lengths_s: BTreeMap<i32, f64>,
    /// The write at which the present gateway dies.
    awaited: Option<AtWrite>,
    /// For people who read of what was found.
    last_blow: String,
}

/// How a procedure came to a halt.
enum Halt {
    Over,
    Interrupted(Box<Procedure>),
    Struck(AtStep, Option<Cut>),
    GatewayDied,
}

/// Strikes everything that is scheduled for one cell.
pub async fn run(cell: usize, mut schedule: Schedule, seed: u64) -> Tally {
    let mut tally = Tally::default();
    let mut breakdowns = 0;
    let mut knee = 0;
    while !schedule.is_empty() {
        knee += 1;
        let name = format!("seed {seed}, cell {cell}, knee {knee}");
        // The blows of a cell are drawn from its own seed, so that cells do not wait for each other.
        let seed = seed + 1000 * cell as u64 + knee;
        if let Err(error) = on_one_knee(&name, &mut schedule, &mut tally, seed).await {
            tally.disagreements += 1;
            tally.findings.push(format!("{name}: {error}"));
            eprintln!("{name}: broke down: {error}");
            breakdowns += 1;
            if breakdowns == BREAKDOWNS {
                break;
            }
        }
    }
    tally
}

async fn on_one_knee(
    name: &str,
    schedule: &mut Schedule,
    tally: &mut Tally,
    seed: u64,
) -> Result<()> {
    let mut campaign = Campaign {
        name: name.to_owned(),
        world: World::up(seed).await?,
        schedule,
        tally,
        rng: ChaCha8Rng::seed_from_u64(seed),
        lengths_s: BTreeMap::new(),
        awaited: None,
        last_blow: String::new(),
    };
    campaign.prepare_case().await?;
    let collisions = campaign.world.witness.collisions().await?;
    let mut in_vain = 0;
    for _ in 0..PROCEDURES_A_KNEE {
        if campaign.schedule.is_empty() {
            break;
        }
        let before = campaign.schedule.len();
        campaign.procedure().await?;
        in_vain = match campaign.schedule.len() == before {
            true => in_vain + 1,
            false => 0,
        };
        if in_vain == PROCEDURES_IN_VAIN {
            let left = std::mem::take(campaign.schedule);
            return Err(format!("these blows were never due: {left:?}").into());
        }
    }
    let collisions = campaign.world.witness.collisions().await? - collisions;
    if collisions > 0 {
        campaign.found(format!("{collisions} collisions"));
        campaign.tally.disagreements += 1;
    }
    campaign.world.down().await
}

impl Campaign<'_> {
    /// From the uploaded case to an approved plan; who computes and who keeps is killed on the way.
    async fn prepare_case(&mut self) -> Result<()> {
        for (work, phase, computing) in [
            (CaseWork::Register, "REGISTER", Victim::Registration),
            (CaseWork::Plan, "PLAN", Victim::Planning),
        ] {
            for victim in [computing, Victim::Gateway] {
                self.world.work(work, Some(victim)).await?;
                self.tally.blow(victim.name(), phase, Outcome::WentOn);
            }
            self.world.work(work, None).await?;
            if work == CaseWork::Register {
                self.world.accept().await;
            }
        }
        self.world.approve().await
    }

    /// One procedure from its start to its end.
    async fn procedure(&mut self) -> Result<()> {
        self.tally.procedures += 1;
        let mut books = Books::open(self.world.witness.closures().await?);
        self.raise_gateway().await?;
        let procedure_id = self.started().await?;
        let mut decided = 0;
        let mut setbacks = 0;
        loop {
            let halt = self.follow(&procedure_id).await?;
            let struck = match halt {
                Halt::Over => break,
                Halt::Interrupted(procedure) => {
                    setbacks += 1;
                    *self.tally.setbacks.entry(procedure.reason).or_default() += 1;
                    if setbacks > DECISIONS {
                        return Err(format!("stuck after: {}", procedure.detail).into());
                    }
                    self.at_rest().await?;
                    None
                }
                Halt::Struck(at, cut) => {
                    setbacks = 0;
                    if self.after_blow(&procedure_id, at, cut).await? {
                        break;
                    }
                    Some((at.victim.name(), word(at.kind)))
                }
                Halt::GatewayDied => {
                    setbacks = 0;
                    let (at, step) = self.after_write(&procedure_id).await?;
                    Some((at.call.name(), step))
                }
            };
            let report = self.report(&procedure_id).await?;
            if is_over(&report) {
                // The blow came after the last write.
                if let Some((victim, phase)) = struck {
                    self.tally.blow(victim, &phase, Outcome::WentOn);
                }
                break;
            }
            let outcome = self.judge(&mut books, &report).await?;
            if let Some((victim, phase)) = struck {
                self.tally.blow(victim, &phase, outcome);
                eprintln!("{}: {}: {outcome:?}", self.name, self.last_blow);
            }
            self.decide(&mut books, &report, &mut decided).await?;
        }
        let report = self.report(&procedure_id).await?;
        self.judge(&mut books, &report).await?;
        let difference = books.close(&report);
        self.differ(&report, difference);
        self.world.ready().await
    }

    /// The gateway as it is wanted next: under strace while there are writes to die at and no other blows.
    async fn raise_gateway(&mut self) -> Result<()> {
        while self.schedule.steps.is_empty() && self.awaited.is_none() {
            if self.schedule.writes.is_empty() {
                return Ok(());
            }
            let at = self.schedule.writes.remove(0);
            let gateway = self.world.service(Victim::Gateway)?;
            gateway.end().await?;
            match gateway.start_to_die(at).await? {
                Started::Up => self.awaited = Some(at),
                Started::Struck => self
                    .tally
                    .blow(at.call.name(), "start", Outcome::Interrupted),
            }
        }
        Ok(())
    }

    /// After the gateway's death: who comes next, and where the journal stood.
    async fn after_write(&mut self, procedure_id: &str) -> Result<(AtWrite, String)> {
        let at = self.buried().await?;
        let report = self.report(procedure_id).await?;
        let step = report
            .steps
            .last()
            .map_or_else(String::new, |step| word(step.kind()));
        self.at_rest().await?;
        Ok((at, step))
    }

    /// Buries a gateway that died at a write, and raises the next.
    async fn buried(&mut self) -> Result<AtWrite> {
        let at = self.awaited.take().ok_or("the gateway ended by itself")?;
        self.last_blow = format!("gateway at {} {}", at.call.name(), at.number);
        self.world.service(Victim::Gateway)?.died().await?;
        self.raise_gateway().await?;
        if self.awaited.is_none() {
            self.world.service(Victim::Gateway)?.start().await?;
        }
        Ok(at)
    }

    /// A procedure under way: a new one, or the one that a gateway began as it died.
    async fn started(&mut self) -> Result<String> {
        loop {
            if let Some(newest) = self.world.newest_procedure().await?
                && !matches!(
                    newest.state(),
                    ProcedureState::Completed | ProcedureState::Aborted
                )
            {
                return Ok(newest.procedure_id);
            }
            let request = StartProcedureRequest {
                case_id: self.world.case_id.clone(),
                plan_digest: self.world.plan_digest.clone(),
                operator: "campaign".to_owned(),
            };
            match self.world.procedures()?.start_procedure(request).await {
                Ok(started) => {
                    let procedure = started.into_inner().procedure;
                    return Ok(procedure.ok_or("a started procedure")?.procedure_id);
                }
                Err(status) if is_gone(&status) => {
                    let at = self.buried().await?;
                    self.tally
                        .blow(at.call.name(), "start", Outcome::Interrupted);
                }
                Err(status) if status.message().contains("holds the lease") => {
                    self.world.leases_gone().await?;
                }
                Err(status) => return Err(status.into()),
            }
        }
    }

    async fn report(&self, procedure_id: &str) -> Result<GetReportResponse> {
        let request = GetReportRequest {
            procedure_id: procedure_id.to_owned(),
        };
        Ok(self
            .world
            .procedures()?
            .get_report(request)
            .await?
            .into_inner())
    }
}

impl Campaign<'_> {
    /// Watches a procedure and strikes what is due, until it halts.
    async fn follow(&mut self, procedure_id: &str) -> Result<Halt> {
        let request = WatchProcedureRequest {
            procedure_id: procedure_id.to_owned(),
        };
        let mut states = match self.world.procedures()?.watch_procedure(request).await {
            Ok(states) => states.into_inner(),
            Err(status) if is_gone(&status) => return Ok(Halt::GatewayDied),
            Err(status) => return Err(status.into()),
        };
        let mut before: Option<Step> = None;
        loop {
            let message = match tokio::time::timeout(SILENCE, states.message()).await? {
                Ok(Some(message)) => message,
                Ok(None) | Err(_) => return Ok(Halt::GatewayDied),
            };
            let procedure = message.procedure.ok_or("a message without procedure")?;
            match procedure.state() {
                ProcedureState::Completed | ProcedureState::Aborted => {
                    let last = before.as_ref().or(procedure.step.as_ref());
                    if let Some(step) = last.cloned() {
                        self.strike_at_the_end(&step).await?;
                    }
                    return Ok(Halt::Over);
                }
                ProcedureState::Interrupted => return Ok(Halt::Interrupted(procedure.into())),
                _ => {}
            }
            let Some(step) = procedure.step else {
                continue;
            };
            for (kind, moment) in moments(before.as_ref(), &step) {
                while let Some(at) = self.schedule.take(kind, moment) {
                    let cut = self.strike(at, &step).await?;
                    if at.victim.is_needed() {
                        return Ok(Halt::Struck(at, cut));
                    }
                    self.world.service(at.victim)?.start().await?;
                    self.tally
                        .blow(at.victim.name(), &word(kind), Outcome::WentOn);
                }
            }
            before = Some(step);
        }
    }

    async fn strike(&mut self, at: AtStep, step: &Step) -> Result<Option<Cut>> {
        if at.moment == Moment::Middle {
            let length_s = self.lengths_s.get(&step.kind).copied().unwrap_or(STEP_S);
            let into_s = length_s * self.rng.random_range(0.1..0.9);
            let reached = self
                .world
                .controller_time(step.started_controller_s + into_s);
            tokio::time::timeout(SILENCE, reached).await??;
        }
        self.last_blow = format!(
            "{} at {} of {} {}",
            at.victim.name(),
            at.moment.name(),
            word(at.kind),
            step.sequence
        );
        if at.victim.is_process() {
            self.world.service(at.victim)?.kill().await?;
            return Ok(None);
        }
        Ok(Some(self.world.cut(at.victim).await?))
    }

    /// What was due at the end of the last step is struck when the procedure is over.
    async fn strike_at_the_end(&mut self, last: &Step) -> Result<()> {
        while let Some(at) = self.schedule.take(last.kind(), Moment::End) {
            let cut = self.strike(at, last).await?;
            self.bring_back(at, cut, false).await?;
            self.tally
                .blow(at.victim.name(), &word(at.kind), Outcome::WentOn);
        }
        Ok(())
    }

    /// Brings back what was struck, early or late, and waits until everything rests. Whether the procedure is over.
    async fn after_blow(
        &mut self,
        procedure_id: &str,
        at: AtStep,
        cut: Option<Cut>,
    ) -> Result<bool> {
        let early = self.rng.random_bool(0.5);
        if at.victim.is_process() && early {
            self.world.service(at.victim)?.start().await?;
        }
        if at.victim != Victim::Gateway {
            match self.follow_to_halt(procedure_id).await? {
                Halt::Over => {
                    self.bring_back(at, cut, early).await?;
                    self.tally
                        .blow(at.victim.name(), &word(at.kind), Outcome::WentOn);
                    return Ok(true);
                }
                Halt::Interrupted(_) => {}
                _ => return Err("the gateway ended by itself".into()),
            }
        }
        let rest = self.rest().await?;
        self.bring_back(at, cut, early).await?;
        self.hold(&rest).await?;
        Ok(false)
    }

    async fn bring_back(&mut self, at: AtStep, cut: Option<Cut>, early: bool) -> Result<()> {
        if let Some(cut) = cut {
            self.world.mend(cut).await?;
        }
        if at.victim.is_process() && !early {
            self.world.service(at.victim)?.start().await?;
        }
        Ok(())
    }

    /// The same without blows.
    async fn follow_to_halt(&mut self, procedure_id: &str) -> Result<Halt> {
        let kept = std::mem::take(self.schedule);
        let halt = self.follow(procedure_id).await;
        *self.schedule = kept;
        halt
    }

    async fn at_rest(&mut self) -> Result<()> {
        let rest = self.rest().await?;
        self.hold(&rest).await
    }

    /// Waits until what was commanded has ended and nothing moves.
    async fn rest(&mut self) -> Result<Pose> {
        let since_s = self.world.witness.cell_time_s().await?;
        let mut before = self.world.witness.pose().await?;
        loop {
            self.world.witness.let_pass(1.0).await?;
            let under_way = self.world.under_way().await;
            let now = self.world.witness.pose().await?;
            let unrest = now.moved_since(&before).or(under_way);
            let Some(unrest) = unrest else {
                return Ok(now);
            };
            if now.cell_time_s - since_s > REST_LIMIT_S {
                return Err(format!("no rest within {REST_LIMIT_S} s: {unrest}").into());
            }
            before = now;
        }
    }

    /// From rest on nothing may move, nor the jaw close, until somebody decides.
    async fn hold(&mut self, rest: &Pose) -> Result<()> {
        let closures = self.world.witness.closures().await?;
        self.world.leases_gone().await?;
        for _ in 0..4 {
            self.world.witness.let_pass(HOLD_S / 4.0).await?;
            let now = self.world.witness.pose().await?;
            if let Some(moved) = now.moved_since(rest) {
                self.tally.moved_by_itself += 1;
                self.found(format!(
                    "{moved} within {:.1} s of rest",
                    now.cell_time_s - rest.cell_time_s
                ));
                break;
            }
        }
        let closed = self.world.witness.closures().await? - closures;
        if closed > 0 {
            self.tally.moved_by_itself += 1;
            self.found(format!("the jaw closed {closed} times by itself"));
        }
        Ok(())
    }
}

impl Campaign<'_> {
    /// Compares journal and referee, and learns from the journal.
    async fn judge(&mut self, books: &mut Books, report: &GetReportResponse) -> Result<Outcome> {
        for step in &report.steps {
            if step.state() == StepState::Done
                && step.ended_controller_s > step.started_controller_s
            {
                let length_s = step.ended_controller_s - step.started_controller_s;
                self.lengths_s.insert(step.kind, length_s);
            }
        }
        let difference = books.compare(report, self.world.witness.closures().await?);
        self.differ(report, difference);
        let last = report.steps.last();
        if let Some(step) = last.filter(|step| step.state() == StepState::Intended) {
            self.tally.disagreements += 1;
            self.found(format!("{} is still INTENDED", word(step.kind())));
        }
        let in_doubt = last.is_some_and(|step| step.state() == StepState::InDoubt);
        Ok(if in_doubt {
            Outcome::InDoubt
        } else {
            Outcome::Interrupted
        })
    }

    fn differ(&mut self, report: &GetReportResponse, difference: Difference) {
        self.tally.bites_lost += difference.lost;
        self.tally.bites_repeated += difference.repeated;
        self.tally.disagreements += difference.disagreements.len() as u32;
        for disagreement in difference.disagreements {
            let steps: Vec<String> = report
                .steps
                .iter()
                .map(|step| {
                    format!(
                        "{} {} {}",
                        word(step.kind()),
                        step.bite,
                        step.state().as_str_name()
                    )
                })
                .collect();
            self.found(format!("{disagreement}; journal: {}", steps.join(", ")));
        }
    }

    fn found(&mut self, what: String) {
        let finding = format!("{}, after {}: {what}", self.name, self.last_blow);
        eprintln!("FOUND: {finding}");
        self.tally.findings.push(finding);
    }

    /// The operator knows what is true and mostly decides by it; now and then the bite is given up, or made again.
    async fn decide(
        &mut self,
        books: &mut Books,
        report: &GetReportResponse,
        decided: &mut i32,
    ) -> Result<()> {
        let procedure = report
            .procedure
            .as_ref()
            .ok_or("a report without procedure")?;
        if procedure.state() != ProcedureState::Interrupted {
            self.tally.disagreements += 1;
            self.found(format!(
                "{} instead of INTERRUPTED",
                procedure.state().as_str_name()
            ));
        }
        let bite = interrupted_bite(report, *decided);
        let made = books.made(report, bite) > 0;
        let action = match self.rng.random_range(0..20) {
            0 => RecoveryAction::Withdraw,
            1 if made => {
                books.decide_repeat(bite);
                RecoveryAction::RepeatBite
            }
            _ if made => {
                *decided = bite + 1;
                RecoveryAction::MarkDone
            }
            _ => RecoveryAction::RepeatBite,
        };
        self.world.ready().await?;
        let request = RecoverProcedureRequest {
            procedure_id: procedure.procedure_id.clone(),
            action: action.into(),
            operator: "campaign".to_owned(),
        };
        match self.world.procedures()?.recover_procedure(request).await {
            Ok(_) => Ok(()),
            // It died in the call; `follow` sees that.
            Err(status) if is_gone(&status) && self.awaited.is_some() => Ok(()),
            Err(status) => Err(format!("{} refused: {status}", action.as_str_name()).into()),
        }
    }
}

/// The moments that have come between two messages. A message may tell of the next step without having told of the end of
/// the last.
fn moments(before: Option<&Step>, now: &Step) -> Vec<(StepKind, Moment)> {
    let mut moments = Vec::new();
    if let Some(before) = before.filter(|before| before.state() == StepState::Intended)
        && (before.sequence != now.sequence || now.state() == StepState::Done)
    {
        moments.push((before.kind(), Moment::End));
    }
    let is_new = before.is_none_or(|before| before.sequence != now.sequence);
    if is_new && now.state() == StepState::Intended {
        moments.push((now.kind(), Moment::Begin));
        moments.push((now.kind(), Moment::Middle));
    }
    moments
}

/// Whether it was the connection that failed, and not the gateway that refused.
fn is_gone(status: &Status) -> bool {
    status.details().is_empty()
        && matches!(
            status.code(),
            tonic::Code::Unavailable | tonic::Code::Unknown | tonic::Code::Cancelled
        )
}

fn is_over(report: &GetReportResponse) -> bool {
    let procedure = report.procedure.as_ref();
    procedure.is_some_and(|procedure| {
        matches!(
            procedure.state(),
            ProcedureState::Completed | ProcedureState::Aborted
        )
    })
}

fn word(kind: StepKind) -> String {
    kind.as_str_name()
        .trim_start_matches("STEP_KIND_")
        .to_owned()
}
