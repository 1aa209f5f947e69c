//! What is true in the cell, read from the controllers, the drives and the referee, and never from the services that are tried.

use std::time::Duration;

use arthro_proto::simulator::v1::drive_fault_service_client::DriveFaultServiceClient;
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_proto::simulator::v1::{GetAccountRequest, GetCellRequest, GetDrivesRequest};
use tonic::transport::Channel;
use ur_link::realtime::Realtime;

use crate::Result;

/// An arm that moved less has not moved, mm and rad.
const ARM_STILL_MM: f64 = 0.05;
const ARM_STILL_RAD: f64 = 0.05 / 180.0 * std::f64::consts::PI;
/// A drive that moved less has not moved, quadcounts.
const DRIVE_STILL_QC: f64 = 2.0;
/// The realtime interface that nobody commands through.
const REALTIME_PORT: u16 = 30_013;
/// A simulated controller answers within this time, wall time.
const ANSWER: Duration = Duration::from_secs(10);

/// Reads the truth.
#[derive(Clone)]
pub struct Witness {
    arms: Vec<String>,
    referee: RefereeServiceClient<Channel>,
    drives: DriveFaultServiceClient<Channel>,
}

/// Arms and drives at one time.
#[derive(Clone, Debug)]
pub struct Pose {
    pub cell_time_s: f64,
    arms: Vec<ArmPose>,
    drives_qc: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct ArmPose {
    joints_rad: [f64; 6],
    flange_mm: [f64; 3],
}

impl Witness {
    pub async fn new(simulator: &str, arms: &[String]) -> Result<Self> {
        let channel = Channel::from_shared(simulator.to_owned())?
            .connect()
            .await?;
        Ok(Self {
            arms: arms.to_vec(),
            referee: RefereeServiceClient::new(channel.clone()),
            drives: DriveFaultServiceClient::new(channel),
        })
    }

    pub async fn cell_time_s(&mut self) -> Result<f64> {
        let cell = self.referee.get_cell(GetCellRequest {}).await?;
        Ok(cell.into_inner().cell_time_s)
    }

    /// Closures of the jaw so far, whether they took tissue or not.
    pub async fn closures(&mut self) -> Result<u32> {
        let account = self.referee.get_account(GetAccountRequest {}).await?;
        let account = account.into_inner();
        Ok(account.bites + account.empty_bites)
    }

    /// Contacts that must not be, so far.
    pub async fn collisions(&mut self) -> Result<usize> {
        let account = self.referee.get_account(GetAccountRequest {}).await?;
        Ok(account.into_inner().collisions.len())
    }

    pub async fn pose(&mut self) -> Result<Pose> {
        let mut arms = Vec::new();
        for arm in &self.arms {
            let mut controller = Realtime::connect(arm, REALTIME_PORT, ANSWER).await?;
            let state = controller.newest(ANSWER).await?;
            let [x, y, z, ..] = state.actual_tool;
            arms.push(ArmPose {
                joints_rad: state.actual_q,
                flange_mm: [x, y, z].map(|metres| metres * 1000.0),
            });
        }
        let drives = self
            .drives
            .get_drives(GetDrivesRequest {})
            .await?
            .into_inner();
        let drives_qc = drives.drives.iter().map(|drive| drive.position_qc);
        Ok(Pose {
            drives_qc: drives_qc.collect(),
            cell_time_s: self.cell_time_s().await?,
            arms,
        })
    }

    /// Lets so much time of the cell go by.
    pub async fn let_pass(&mut self, seconds: f64) -> Result<()> {
        let until_s = self.cell_time_s().await? + seconds;
        while self.cell_time_s().await? < until_s {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        Ok(())
    }
}

impl Pose {
    /// What moved since `before`, as a sentence.
    pub fn moved_since(&self, before: &Self) -> Option<String> {
        for (number, (now, then)) in self.arms.iter().zip(&before.arms).enumerate() {
            let moved_mm = distance(&now.flange_mm, &then.flange_mm);
            let turned_rad = now
                .joints_rad
                .iter()
                .zip(&then.joints_rad)
                .map(|(now, then)| (now - then).abs())
                .fold(0.0, f64::max);
            if moved_mm > ARM_STILL_MM || turned_rad > ARM_STILL_RAD {
                return Some(format!(
                    "arm {number} moved {moved_mm:.3} mm, a joint {:.3} deg",
                    turned_rad.to_degrees()
                ));
            }
        }
        let drives = self.drives_qc.iter().zip(&before.drives_qc);
        let moved = |(number, (now, then)): (usize, (&f64, &f64))| {
            let moved_qc = (now - then).abs();
            (moved_qc > DRIVE_STILL_QC)
                .then(|| format!("drive {} moved {moved_qc:.1} quadcounts", number + 1))
        };
        drives.enumerate().find_map(moved)
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}
