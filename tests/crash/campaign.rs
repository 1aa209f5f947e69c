//! One cell of the campaign: procedures are performed, struck, looked at, decided about and performed to their end.

mod decide;
mod follow;
mod rest;

use std::collections::BTreeMap;

use arthro_bootstrap::status::reason;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    GetReportRequest, GetReportResponse, ListProceduresRequest, Procedure, ProcedureState,
    StartProcedureRequest, StepKind,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use tonic::Status;
use tonic::transport::Channel;

use crate::Result;
use crate::books::Books;
use crate::service::Started;
use crate::strike::{AtStep, AtWrite, Schedule, Victim};
use crate::tally::{Outcome, Tally};
use crate::world::{CaseWork, Cut, World};

/// Procedures on one knee; later bites find less tissue.
const PROCEDURES_A_KNEE: u32 = 8;
/// Procedures without a blow before what is left counts as never due.
const PROCEDURES_IN_VAIN: u32 = 3;
/// Decisions about one interruption before it counts as stuck.
const DECISIONS: u32 = 8;
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
                    eprintln!(
                        "{}: to be decided again: {}: {}, after {}",
                        self.name, procedure.reason, procedure.detail, self.last_blow
                    );
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
            if let Some(newest) = self.newest_procedure().await?
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
                // What the dead gateway held when it died.
                Err(status) if reason(&status).as_deref() == Some("LEASE_HELD") => {
                    self.world.leases_gone().await?;
                }
                Err(status) => return Err(status.into()),
            }
        }
    }

    async fn report(&mut self, procedure_id: &str) -> Result<GetReportResponse> {
        let request = GetReportRequest {
            procedure_id: procedure_id.to_owned(),
        };
        self.asked(|mut procedures| {
            let request = request.clone();
            async move { procedures.get_report(request).await }
        })
        .await
    }

    async fn newest_procedure(&mut self) -> Result<Option<Procedure>> {
        let request = ListProceduresRequest {
            page_size: 1,
            ..ListProceduresRequest::default()
        };
        let listed = self
            .asked(|mut procedures| {
                let request = request.clone();
                async move { procedures.list_procedures(request).await }
            })
            .await?;
        Ok(listed.procedures.into_iter().next())
    }

    /// Asks the gateway. One that dies meanwhile at the write it was told to die at is buried, and the next is asked.
    async fn asked<T, Asking>(
        &mut self,
        ask: impl Fn(ProcedureServiceClient<Channel>) -> Asking,
    ) -> Result<T>
    where
        Asking: Future<Output = std::result::Result<tonic::Response<T>, Status>>,
    {
        loop {
            match ask(self.world.procedures()?).await {
                Ok(answer) => return Ok(answer.into_inner()),
                Err(status) if is_gone(&status) && self.awaited.is_some() => {
                    let at = self.buried().await?;
                    self.tally
                        .blow(at.call.name(), "at rest", Outcome::Interrupted);
                }
                Err(status) => return Err(status.into()),
            }
        }
    }
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
