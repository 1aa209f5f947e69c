//! The faults of the simulated controllers over gRPC.

mod words;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use arthro_bootstrap::status;
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::fault_service_server::FaultService;
use arthro_proto::simulator::v1::inject_robot_fault_request::Fault;
use arthro_proto::simulator::v1::{
    ClearFaultsRequest, ClearFaultsResponse, InjectLinkFaultRequest, InjectLinkFaultResponse,
    InjectRobotFaultRequest, InjectRobotFaultResponse, LinkFault, ListFaultsRequest,
    ListFaultsResponse, RobotFaults, WaitForLinkFaultRequest, WaitForLinkFaultResponse,
};
use tonic::{Request, Response, Status};

pub(super) use self::words::in_range;

use crate::clock::lock;
use crate::ur5::{
    Breakdown, Button, Control, Controller, Safeguard, Series, Shared, Teller, link_fault,
    servers::Links,
};

/// A controller that can be hurt.
#[derive(Clone, Debug)]
pub struct Patient {
    /// Which arm of the cell; unspecified for a controller that runs alone.
    pub arm: common::Arm,
    /// The controller.
    pub controller: Shared,
    /// Its connections.
    pub links: Arc<Links>,
}

/// Hurts controllers.
#[derive(Clone, Debug)]
pub struct FaultApi {
    patients: Arc<[Patient]>,
    last_id: Arc<AtomicU64>,
}

impl FaultApi {
    /// For these controllers.
    pub fn new(patients: Vec<Patient>) -> Self {
        Self {
            patients: patients.into(),
            last_id: Arc::default(),
        }
    }

    /// The controllers that a request means.
    fn chosen(&self, arm: i32) -> Result<Vec<&Patient>, Status> {
        let arm = common::Arm::try_from(arm).map_err(|_| unknown("arm", arm))?;
        let chosen: Vec<_> = self
            .patients
            .iter()
            .filter(|patient| arm == common::Arm::Unspecified || patient.arm == arm)
            .collect();
        if chosen.is_empty() {
            let name = arm.as_str_name();
            return Err(status::invalid(
                "arm",
                format!("{name} is not simulated here"),
            ));
        }
        Ok(chosen)
    }

    /// Packets that a fault has met on all controllers; `None` when there is none of this id.
    fn affected(&self, id: u64) -> Option<u64> {
        let counts = self.patients.iter().filter_map(|it| it.links.affected(id));
        counts.reduce(|sum, count| sum + count)
    }
}

#[tonic::async_trait]
impl FaultService for FaultApi {
    async fn inject_link_fault(
        &self,
        request: Request<InjectLinkFaultRequest>,
    ) -> Result<Response<InjectLinkFaultResponse>, Status> {
        let request = request.into_inner();
        let chosen = self.chosen(request.arm)?;
        let fault = request
            .fault
            .ok_or_else(|| status::invalid("fault", "must be set"))?;
        let spec = words::spec(&fault)?;
        let fault_id = self.last_id.fetch_add(1, Ordering::Relaxed) + 1;
        for patient in chosen {
            if !patient.links.inject(fault_id, spec.clone()) {
                self.patients.iter().for_each(|patient| {
                    patient.links.clear(Some(fault_id));
                });
                return Err(status::exhausted(
                    "TOO_MANY_FAULTS",
                    format!("more than {} faults at once", link_fault::MAX_FAULTS),
                    &[("limit", link_fault::MAX_FAULTS.to_string())],
                ));
            }
        }
        Ok(Response::new(InjectLinkFaultResponse { fault_id }))
    }

    async fn inject_robot_fault(
        &self,
        request: Request<InjectRobotFaultRequest>,
    ) -> Result<Response<InjectRobotFaultResponse>, Status> {
        let request = request.into_inner();
        let chosen = self.chosen(request.arm)?;
        let fault = request
            .fault
            .ok_or_else(|| status::invalid("fault", "must be set"))?;
        let deed = Deed::of(fault)?;
        for patient in &chosen {
            deed.allowed(&lock(&patient.controller))?;
        }
        for patient in chosen {
            deed.on(&mut lock(&patient.controller));
        }
        Ok(Response::new(InjectRobotFaultResponse {}))
    }

    async fn list_faults(
        &self,
        _request: Request<ListFaultsRequest>,
    ) -> Result<Response<ListFaultsResponse>, Status> {
        let links = self.patients.iter().flat_map(|patient| {
            let faults = patient.links.list().into_iter();
            faults.map(|fault| LinkFault {
                fault_id: fault.id,
                arm: patient.arm.into(),
                fault: Some(words::told(&fault.spec)),
                affected: fault.affected,
            })
        });
        let robots = self.patients.iter().map(|patient| {
            let controller = lock(&patient.controller);
            robot_faults(patient.arm, &controller)
        });
        Ok(Response::new(ListFaultsResponse {
            links: links.collect(),
            robots: robots.collect(),
        }))
    }

    async fn wait_for_link_fault(
        &self,
        request: Request<WaitForLinkFaultRequest>,
    ) -> Result<Response<WaitForLinkFaultResponse>, Status> {
        let WaitForLinkFaultRequest { fault_id, affected } = request.into_inner();
        let wanted = affected.max(1);
        loop {
            let mut changes: Vec<_> = self
                .patients
                .iter()
                .map(|patient| Box::pin(patient.links.changed()))
                .collect();
            for change in &mut changes {
                change.as_mut().enable();
            }
            let affected = self.affected(fault_id).ok_or_else(|| not_found(fault_id))?;
            if affected >= wanted {
                return Ok(Response::new(WaitForLinkFaultResponse { affected }));
            }
            any(changes).await;
        }
    }

    async fn clear_faults(
        &self,
        request: Request<ClearFaultsRequest>,
    ) -> Result<Response<ClearFaultsResponse>, Status> {
        let id = request.into_inner().fault_id;
        let only = (id != 0).then_some(id);
        let counts = self.patients.iter().map(|it| it.links.clear(only));
        let cleared: usize = counts.sum();
        if only.is_none() {
            self.patients
                .iter()
                .for_each(|patient| heal(&mut lock(&patient.controller)));
        } else if cleared == 0 {
            return Err(not_found(id));
        }
        Ok(Response::new(ClearFaultsResponse {
            cleared: cleared as u32,
        }))
    }
}

// === arms ===

/// Something to do to an arm, with its numbers checked.
#[derive(Clone, Debug)]
enum Deed {
    ProtectiveStop(String),
    Button(Button, Press),
    Safeguard(Safeguard),
    Joint(usize, JointState),
    Violation,
    ExtraLag([f64; 6]),
    EncoderOffset([f64; 6]),
    SpeedSlider(f64),
    Control(Control),
    PowerOff,
    Claim(Teller, Option<crate::ur5::Version>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Press {
    Down,
    Up,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum JointState {
    Failed,
    Whole,
}

impl Deed {
    fn of(fault: Fault) -> Result<Self, Status> {
        Ok(match fault {
            Fault::ProtectiveStop(reason) => Self::ProtectiveStop(reason),
            Fault::EmergencyStop(stop) => Self::Button(
                words::button(stop.button)?,
                if stop.pressed { Press::Down } else { Press::Up },
            ),
            Fault::Safeguard(state) => Self::Safeguard(words::safeguard(state)?),
            Fault::Joint(fault) => {
                let joint = fault.joint as usize;
                if joint > 5 {
                    let text = format!("{joint} must be within 0 .. 5");
                    return Err(status::invalid("joint.joint", text));
                }
                let state = if fault.failed {
                    JointState::Failed
                } else {
                    JointState::Whole
                };
                Self::Joint(joint, state)
            }
            Fault::Violation(_) => Self::Violation,
            Fault::ExtraLagS(lag) => {
                Self::ExtraLag(words::joints("extra_lag_s", &lag, 0.0..=10.0, "0 .. 10 s")?)
            }
            Fault::EncoderOffsetRad(offset) => Self::EncoderOffset(words::joints(
                "encoder_offset_rad",
                &offset,
                -1.0..=1.0,
                "-1 .. 1 rad",
            )?),
            Fault::SpeedSlider(fraction) => {
                words::in_range("speed_slider", fraction, 0.0..=1.0, "0 .. 1")?;
                Self::SpeedSlider(fraction)
            }
            Fault::Control(place) => Self::Control(words::control(place)?),
            Fault::PowerOff(_) => Self::PowerOff,
            Fault::Version(claim) => {
                let (teller, version) = words::claim(&claim)?;
                Self::Claim(teller, version)
            }
        })
    }

    /// Refuses what this controller cannot suffer now.
    fn allowed(&self, controller: &Controller) -> Result<(), Status> {
        let mode = controller.robot_mode();
        match self {
            Self::ProtectiveStop(_) if mode != ur_link::RobotMode::Running => Err(status::refused(
                "ARM_NOT_RUNNING",
                format!("robot mode is {mode}; only a running arm has a protective stop"),
                &[("robot_mode", mode.to_string())],
            )),
            Self::Control(_) if controller.series() == Series::Cb3 => Err(status::refused(
                "NO_REMOTE_CONTROL",
                "a CB3 does not tell local from remote control",
                &[],
            )),
            _ => Ok(()),
        }
    }

    fn on(&self, controller: &mut Controller) {
        match self {
            Self::ProtectiveStop(reason) => controller.protective_stop(reason),
            Self::Button(button, Press::Down) => controller.press_emergency_stop(*button),
            Self::Button(button, Press::Up) => controller.release_emergency_stop(*button),
            Self::Safeguard(state) => controller.set_safeguard(*state),
            Self::Joint(joint, state) => {
                controller.set_joint_failed(*joint, *state == JointState::Failed);
            }
            Self::Violation => controller.break_down(Breakdown::Violation),
            Self::ExtraLag(lag_s) => controller.set_extra_lag(*lag_s),
            Self::EncoderOffset(offset_rad) => controller.slip_encoders(*offset_rad),
            Self::SpeedSlider(fraction) => controller.set_speed_slider(*fraction),
            Self::Control(control) => controller.set_control(*control),
            Self::PowerOff => controller.power_off(),
            Self::Claim(teller, version) => controller.claim_version(*teller, *version),
        }
    }
}

/// Undoes what stays.
fn heal(controller: &mut Controller) {
    for button in [Button::Robot, Button::System] {
        controller.release_emergency_stop(button);
    }
    controller.set_safeguard(Safeguard::Clear);
    for joint in 0..6 {
        controller.set_joint_failed(joint, false);
    }
    controller.set_extra_lag([0.0; 6]);
    controller.slip_encoders([0.0; 6]);
    controller.set_control(Control::Remote);
    for teller in [Teller::Rtde, Teller::Dashboard, Teller::Primary] {
        controller.claim_version(teller, None);
    }
}

fn robot_faults(arm: common::Arm, controller: &Controller) -> RobotFaults {
    let condition = controller.condition();
    let failed = (0..).zip(condition.failed_joints);
    RobotFaults {
        arm: arm.into(),
        robot_mode: controller.robot_mode().to_string(),
        safety_mode: controller.safety_mode().to_string(),
        robot_button_pressed: condition.robot_button_pressed,
        system_button_pressed: condition.system_button_pressed,
        safeguard: words::told_safeguard(condition.safeguard).into(),
        failed_joints: failed
            .filter_map(|(joint, failed)| failed.then_some(joint))
            .collect(),
        extra_lag_s: condition.extra_lag_s.to_vec(),
        encoder_offset_rad: condition.encoder_offset_rad.to_vec(),
        speed_slider: condition.speed_slider,
        control: words::told_control(controller.control()).into(),
        timestamp_s: controller.timestamp_s(),
    }
}

// === answers ===

/// Waits for the first of some events.
async fn any<F: Future<Output = ()> + Unpin>(mut events: Vec<F>) {
    std::future::poll_fn(|context| {
        let ready = events
            .iter_mut()
            .any(|event| std::pin::Pin::new(event).poll(context).is_ready());
        if ready {
            std::task::Poll::Ready(())
        } else {
            std::task::Poll::Pending
        }
    })
    .await;
}

fn not_found(id: u64) -> Status {
    status::not_found(
        "FAULT_NOT_FOUND",
        format!("no link fault has the id {id}"),
        &[("fault_id", id.to_string())],
    )
}

fn unknown(field: &str, number: i32) -> Status {
    status::invalid(field, format!("{number} is none of the values"))
}
