//! A simulated cell whose services may be killed one by one, with a case that is ready to be performed.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::time::Duration;

use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    ApprovePlanRequest, GetCaseRequest, PlanCaseRequest, RegisterCaseRequest, RevisePlanRequest,
};
use arthro_proto::instrument::v1 as instrument;
use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::simulator::v1::drive_fault_service_client::DriveFaultServiceClient;
use arthro_proto::simulator::v1::fault_service_client::FaultServiceClient;
use arthro_proto::simulator::v1::{
    BusOff, ClearDriveFaultsRequest, ClearFaultsRequest, DriveFault, InjectDriveFaultRequest,
    InjectLinkFaultRequest, LinkFaultKind, LinkFaultSpec, UrService, drive_fault,
};
use arthro_tests::Cell;
use arthro_tests::cell::signal;
use tonic::Streaming;
use tonic::transport::{Channel, Endpoint};

use crate::Result;
use crate::service::Service;
use crate::strike::Victim;
use crate::truth::Witness;

/// Bites of the plan: enough for a next one, few enough to be fast.
const BITES: usize = 2;
/// How long arms and drives may take to be ready after a start, wall time.
const READY_LIMIT: Duration = Duration::from_secs(60);
/// Large answers exceed the transport's default.
const MAX_ANSWER_BYTES: usize = 64 * 1024 * 1024;
const PROCESSES: [Victim; 5] = [
    Victim::Registration,
    Victim::Planning,
    Victim::Motion,
    Victim::Instrument,
    Victim::Gateway,
];

pub struct World {
    cell: Cell,
    pub witness: Witness,
    services: BTreeMap<Victim, Service>,
    pub case_id: String,
    pub plan_digest: String,
}

/// The part of a case that is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaseWork {
    Register,
    Plan,
}

impl World {
    /// A knee with an uploaded case that is not registered yet.
    pub async fn up(seed: u64) -> Result<Self> {
        let seed = seed.to_string();
        let cell = Cell::up_telling(&["--time-scale", "50", "--seed", &seed], Stdio::null()).await;
        let mut services = BTreeMap::new();
        for victim in PROCESSES {
            // Of `arthro up`; from now on they are ours.
            signal(cell.at.processes[victim.name()], "KILL").await;
            let mut service = Service::new(victim.name(), &cell.at.config, cell.folder());
            service.start().await?;
            services.insert(victim, service);
        }
        let witness = Witness::new(cell.url("simulator"), &cell.at.arms).await?;
        let mut this = Self {
            cell,
            witness,
            services,
            case_id: String::new(),
            plan_digest: String::new(),
        };
        this.ready().await?;
        this.case_id = this.cell.case().await;
        Ok(this)
    }

    /// Ends everything.
    pub async fn down(mut self) -> Result<()> {
        for service in self.services.values_mut().rev() {
            service.end().await?;
        }
        self.cell.teardown().await;
        Ok(())
    }

    pub fn service(&mut self, victim: Victim) -> Result<&mut Service> {
        let service = self.services.get_mut(&victim);
        service.ok_or_else(|| format!("{} is no process", victim.name()).into())
    }

    fn channel(&self, name: &str) -> Result<Channel> {
        Ok(Endpoint::from_shared(self.cell.url(name).to_owned())?.connect_lazy())
    }

    pub fn procedures(&self) -> Result<ProcedureServiceClient<Channel>> {
        let client = ProcedureServiceClient::new(self.channel("gateway")?);
        Ok(client.max_decoding_message_size(MAX_ANSWER_BYTES))
    }

    fn cases(&self) -> Result<CaseServiceClient<Channel>> {
        let client = CaseServiceClient::new(self.channel("gateway")?);
        Ok(client.max_decoding_message_size(MAX_ANSWER_BYTES))
    }

    pub fn motion(&self) -> Result<MotionServiceClient<Channel>> {
        Ok(MotionServiceClient::new(self.channel("motion")?))
    }

    fn instrument(&self) -> Result<InstrumentServiceClient<Channel>> {
        Ok(InstrumentServiceClient::new(self.channel("instrument")?))
    }
}

impl World {
    /// Registers or plans to the end; `struck` is called once, as soon as the work has begun.
    pub async fn work(&mut self, work: CaseWork, struck: Option<Victim>) -> Result<()> {
        let case_id = self.case_id.clone();
        let mut cases = self.cases()?;
        let begun = match work {
            CaseWork::Register => {
                let request = RegisterCaseRequest {
                    case_id,
                    ..Default::default()
                };
                let events = cases.register_case(request).await?.into_inner();
                self.heard(events, struck).await
            }
            CaseWork::Plan => {
                let request = PlanCaseRequest {
                    case_id,
                    ..Default::default()
                };
                let events = cases.plan_case(request).await?.into_inner();
                self.heard(events, struck).await
            }
        };
        match struck {
            // It was to fail, or was faster than the blow.
            Some(victim) => self.service(victim)?.start().await,
            None => begun,
        }
    }

    async fn heard<T>(
        &mut self,
        mut events: Streaming<T>,
        mut struck: Option<Victim>,
    ) -> Result<()> {
        loop {
            if let Some(victim) = struck.take() {
                self.service(victim)?.kill().await?;
            }
            if events.message().await?.is_none() {
                return Ok(());
            }
        }
    }

    pub async fn accept(&self) {
        let command = ["case", "accept", &self.case_id, "--operator", "campaign"];
        self.cell.done(&command).await;
    }

    /// Leaves a plan of a few bites, approved.
    pub async fn approve(&mut self) -> Result<()> {
        let mut cases = self.cases()?;
        let request = GetCaseRequest {
            case_id: self.case_id.clone(),
        };
        let case = cases.get_case(request).await?.into_inner();
        let mut bites = case.plan.ok_or("a planned case has a plan")?.bites;
        bites.truncate(BITES);
        let request = RevisePlanRequest {
            case_id: self.case_id.clone(),
            bites,
        };
        let revised = cases.revise_plan(request).await?.into_inner();
        self.plan_digest = revised.case.ok_or("a revised case")?.plan_digest;
        let request = ApprovePlanRequest {
            case_id: self.case_id.clone(),
            plan_digest: self.plan_digest.clone(),
            surgeon: "campaign".to_owned(),
        };
        cases.approve_plan(request).await?;
        Ok(())
    }
}

/// Faults on the wires, to be cleared.
#[derive(Clone, Copy, Debug)]
pub enum Cut {
    Arms(u64),
    Bus(u64),
}

impl World {
    /// Cuts a wire until it is mended.
    pub async fn cut(&self, victim: Victim) -> Result<Cut> {
        let simulator = self.channel("simulator")?;
        if victim == Victim::CanBus {
            let request = InjectDriveFaultRequest {
                node_id: 0,
                fault: Some(DriveFault {
                    fault: Some(drive_fault::Fault::BusOff(BusOff {})),
                }),
            };
            let injected = DriveFaultServiceClient::new(simulator)
                .inject_drive_fault(request)
                .await?;
            return Ok(Cut::Bus(injected.into_inner().fault_id));
        }
        let request = InjectLinkFaultRequest {
            arm: 0,
            fault: Some(LinkFaultSpec {
                service: UrService::Rtde.into(),
                kind: LinkFaultKind::Reset.into(),
                ..Default::default()
            }),
        };
        let injected = FaultServiceClient::new(simulator)
            .inject_link_fault(request)
            .await?;
        Ok(Cut::Arms(injected.into_inner().fault_id))
    }

    pub async fn mend(&self, cut: Cut) -> Result<()> {
        let simulator = self.channel("simulator")?;
        match cut {
            Cut::Arms(fault_id) => {
                let request = ClearFaultsRequest { fault_id };
                FaultServiceClient::new(simulator)
                    .clear_faults(request)
                    .await?;
            }
            Cut::Bus(fault_id) => {
                let request = ClearDriveFaultsRequest { fault_id };
                DriveFaultServiceClient::new(simulator)
                    .clear_drive_faults(request)
                    .await?;
            }
        }
        Ok(())
    }
}

impl World {
    /// What is under way by the services' word; nothing in one that does not answer.
    pub async fn under_way(&self) -> Option<String> {
        if let Ok(state) = self.arms().await {
            // Of an arm out of sight only the past is told.
            let busy = |arm: &&motion::ArmState| {
                arm.connected && (arm.moving || !arm.operation_id.is_empty())
            };
            if let Some(arm) = state.arms.iter().find(busy) {
                return Some(format!("{} is under way", arm.arm().as_str_name()));
            }
        }
        if let Ok(state) = self.axes().await {
            let busy = |axis: &&instrument::AxisState| {
                axis.fault_reason.is_empty() && (axis.moving || !axis.operation_id.is_empty())
            };
            if let Some(axis) = state.axes.iter().find(busy) {
                let name = axis.axis().as_str_name();
                return Some(format!(
                    "{name} is under way in {}: {axis:?}",
                    axis.drive_state
                ));
            }
        }
        None
    }

    /// Waits until nobody holds a lease on arms or drives.
    pub async fn leases_gone(&self) -> Result<()> {
        let gone = async {
            loop {
                let arms = self.motion()?.get_cell(motion::GetCellRequest {}).await?;
                let drives = self
                    .instrument()?
                    .list_axes(instrument::ListAxesRequest {})
                    .await?;
                if arms.into_inner().lease.is_none() && drives.into_inner().lease.is_none() {
                    return Ok(());
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        let gone = tokio::time::timeout(READY_LIMIT, gone).await;
        gone.map_err(|_| "leases are not lost")?
    }

    /// Waits until both arms and all drives are there.
    pub async fn ready(&self) -> Result<()> {
        let ready = async {
            loop {
                let arms = self.arms().await.is_ok_and(|state| {
                    state.arms.len() == 2
                        && state
                            .arms
                            .iter()
                            .all(|arm| arm.connected && arm.robot_mode == "RUNNING")
                });
                // What is faulty waits for the decision, which acknowledges it.
                let there = |axis: &instrument::AxisState| {
                    axis.nmt_state == "OPERATIONAL" || !axis.fault_reason.is_empty()
                };
                let drives = self
                    .axes()
                    .await
                    .is_ok_and(|state| state.axes.len() == 4 && state.axes.iter().all(there));
                if arms && drives {
                    return;
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        if tokio::time::timeout(READY_LIMIT, ready).await.is_err() {
            return Err(format!(
                "not ready within {READY_LIMIT:?}: {:?}, {:?}",
                self.arms().await,
                self.axes().await
            )
            .into());
        }
        Ok(())
    }

    async fn arms(&self) -> Result<motion::WatchStateResponse> {
        let request = motion::WatchStateRequest { period_s: 0.1 };
        let mut states = self.motion()?.watch_state(request).await?.into_inner();
        Ok(states.message().await?.ok_or("the arms tell no state")?)
    }

    async fn axes(&self) -> Result<instrument::WatchStateResponse> {
        let request = instrument::WatchStateRequest { period_s: 0.1 };
        let mut states = self.instrument()?.watch_state(request).await?.into_inner();
        Ok(states.message().await?.ok_or("the drives tell no state")?)
    }

    /// Waits until the forceps controller's clock has come so far.
    pub async fn controller_time(&self, until_s: f64) -> Result<()> {
        let request = motion::WatchStateRequest { period_s: 0.05 };
        let mut states = self.motion()?.watch_state(request).await?.into_inner();
        while let Some(state) = states.message().await? {
            if state
                .arms
                .first()
                .is_some_and(|arm| arm.controller_time_s >= until_s)
            {
                return Ok(());
            }
        }
        Ok(())
    }
}
