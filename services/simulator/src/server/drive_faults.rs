//! The faults of the simulated drives over gRPC, and what the drives truly do.

mod words;

use std::sync::Arc;

use arthro_bootstrap::status;
use arthro_proto::simulator::v1::drive_fault_service_server::DriveFaultService;
use arthro_proto::simulator::v1::drive_truth::Position;
use arthro_proto::simulator::v1::{
    ActiveDriveFault, ClearDriveFaultsRequest, ClearDriveFaultsResponse, DriveTruth,
    GetDrivesRequest, GetDrivesResponse, InjectDriveFaultRequest, InjectDriveFaultResponse,
    ListDriveFaultsRequest, ListDriveFaultsResponse, WaitForDriveFaultRequest,
    WaitForDriveFaultResponse,
};
use tonic::{Request, Response, Status};

use crate::cell::axes::Axis;
use crate::epos4::{Bus, MAX_FAULTS, Node};

/// Hurts drives.
#[derive(Clone, Debug)]
pub struct DriveFaultApi {
    bus: Arc<Bus>,
}

impl DriveFaultApi {
    /// For the drives of this bus.
    pub fn new(bus: Arc<Bus>) -> Self {
        Self { bus }
    }

    /// The drive that a request means; none: all of them.
    fn chosen(&self, node_id: u32) -> Result<Option<u8>, Status> {
        if node_id == 0 {
            return Ok(None);
        }
        let there = self.bus.with_drives(|drives| {
            let ids = drives.nodes.iter().map(Node::node_id);
            ids.collect::<Vec<u8>>()
        });
        there
            .iter()
            .copied()
            .find(|id| u32::from(*id) == node_id)
            .map(Some)
            .ok_or_else(|| {
                status::invalid(
                    "node_id",
                    format!("{node_id} is not on the bus, {there:?} are; 0 means all"),
                )
            })
    }
}

#[tonic::async_trait]
impl DriveFaultService for DriveFaultApi {
    async fn inject_drive_fault(
        &self,
        request: Request<InjectDriveFaultRequest>,
    ) -> Result<Response<InjectDriveFaultResponse>, Status> {
        let InjectDriveFaultRequest { node_id, fault } = request.into_inner();
        let (fault, seed) = words::fault(fault)?;
        let node_id = self.chosen(node_id)?;
        if let Some(id) = node_id
            && fault.is_of_the_bus()
        {
            let text = format!("{id} must be 0 for a fault of the bus");
            return Err(status::invalid("node_id", text));
        }
        let fault_id = self.bus.inject(node_id, fault, seed).ok_or_else(|| {
            status::exhausted(
                "TOO_MANY_FAULTS",
                format!("more than {MAX_FAULTS} faults at once"),
                &[("limit", MAX_FAULTS.to_string())],
            )
        })?;
        Ok(Response::new(InjectDriveFaultResponse { fault_id }))
    }

    async fn list_drive_faults(
        &self,
        _request: Request<ListDriveFaultsRequest>,
    ) -> Result<Response<ListDriveFaultsResponse>, Status> {
        let faults = self
            .bus
            .faults()
            .into_iter()
            .map(|active| ActiveDriveFault {
                fault_id: active.id,
                node_id: active.node_id.map_or(0, u32::from),
                affected: active.affected,
                fault: Some(words::told(active.fault, active.seed)),
            });
        Ok(Response::new(ListDriveFaultsResponse {
            faults: faults.collect(),
        }))
    }

    async fn wait_for_drive_fault(
        &self,
        request: Request<WaitForDriveFaultRequest>,
    ) -> Result<Response<WaitForDriveFaultResponse>, Status> {
        let WaitForDriveFaultRequest { fault_id, affected } = request.into_inner();
        let met = self.bus.wait_for_fault(fault_id, affected.max(1)).await;
        met.map(|affected| Response::new(WaitForDriveFaultResponse { affected }))
            .ok_or_else(|| not_found(fault_id))
    }

    async fn clear_drive_faults(
        &self,
        request: Request<ClearDriveFaultsRequest>,
    ) -> Result<Response<ClearDriveFaultsResponse>, Status> {
        let id = request.into_inner().fault_id;
        let cleared = self.bus.clear((id != 0).then_some(id));
        if id != 0 && cleared == 0 {
            return Err(not_found(id));
        }
        Ok(Response::new(ClearDriveFaultsResponse {
            cleared: cleared as u32,
        }))
    }

    async fn get_drives(
        &self,
        _request: Request<GetDrivesRequest>,
    ) -> Result<Response<GetDrivesResponse>, Status> {
        let drives = self
            .bus
            .with_drives(|drives| drives.nodes.iter().map(truth).collect());
        Ok(Response::new(GetDrivesResponse {
            drives,
            bus_time_s: self.bus.now_s(),
        }))
    }
}

fn truth(node: &Node) -> DriveTruth {
    let axis = Axis::of_node(node.node_id());
    let position_qc = node.position_quadcounts();
    let position = position_qc / axis.qc_per_unit();
    let speed_qc_s = node.speed_quadcounts_s();
    DriveTruth {
        node_id: u32::from(node.node_id()),
        supplied: node.is_supplied(),
        network_state: node.network_state().to_string(),
        drive_state: node.drive_state().to_string(),
        position_qc,
        position: Some(if axis.is_feed() {
            Position::PositionMm(position)
        } else {
            Position::PositionDeg(position)
        }),
        speed_qc_s,
        current_ma: node.current_ma(),
        jaw_force_n: node.tool_force_n(),
        moving: speed_qc_s != 0.0,
    }
}

fn not_found(id: u64) -> Status {
    status::not_found(
        "FAULT_NOT_FOUND",
        format!("no drive fault has the id {id}"),
        &[("fault_id", id.to_string())],
    )
}
