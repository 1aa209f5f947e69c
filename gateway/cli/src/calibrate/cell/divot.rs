//! The tool's tip: it is put into the divot, leaning this way and that, and seated there until the gauges read nothing.

use std::f64::consts::FRAC_PI_2;

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::nalgebra::{Matrix3, Rotation3};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_proto::simulator::v1::ReadDivotRequest;
use arthro_proto::simulator::v1::bench_service_client::BenchServiceClient;
use arthro_simulator::scenario::SystemView;
use tonic::transport::Channel;

use super::arm::Arm;
use crate::cell::Urls;
use crate::connection;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// Poses about the divot.
pub const POSES: u32 = 16;
/// The shaft leans up to this far from straight down, degrees.
const LEAN_DEG: f64 = 22.0;
/// And is turned about itself up to this far each way, degrees.
const TURN_DEG: f64 = 25.0;
/// The tip comes from this far above, mm.
const ABOVE_MM: f64 = 60.0;
/// Seated: the gauges read less than this, mm.
const SEATED_MM: f64 = 0.15;
/// Corrections tried.
const CORRECTIONS: u32 = 6;

/// Pivots about the divot.
pub async fn pivot(
    arm: &mut Arm,
    drawn: &SystemView,
    urls: &Urls,
    seed: u64,
    output: &Output,
) -> Result<Vec<Rigid<Base, Flange>>, Failure> {
    let mut gauge = Gauge {
        bench: BenchServiceClient::new(connection::open(&urls.simulator).await?),
        seed,
    };
    let bar = output.progress("divot", u64::from(POSES));
    let mut seat = drawn.divot_in_forceps_base;
    let above = seat + Vector3::z() * ABOVE_MM;
    let facing = approach(arm, &above).await?;
    let mut poses = Vec::new();
    for pose in 0..POSES {
        let rotation = leaning(pose) * facing;
        seat = seated(arm, &mut gauge, rotation, seat).await?;
        poses.push(arm.flange_at_rest().await?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    arm.go(&Rigid::new(leaning(0) * facing, above.coords))
        .await?;
    output.note(format!("the tip was seated in the divot in {POSES} poses"));
    Ok(poses)
}

/// Brings the tool above the divot, turned about its shaft by whichever quarter the arm can reach from where it is.
async fn approach(arm: &mut Arm, above: &Point3) -> Result<Rotation, Failure> {
    let mut refusal = None;
    for quarter in 0..4 {
        let facing = Rotation::from_scaled_axis(Vector3::x() * FRAC_PI_2 * f64::from(quarter));
        match arm.go(&Rigid::new(leaning(0) * facing, above.coords)).await {
            Ok(()) => return Ok(facing),
            Err(failure) if failure.kind == Kind::Refused => refusal = Some(failure),
            Err(failure) => return Err(failure),
        }
    }
    Err(refusal.unwrap_or_else(|| Failure::refused("OUT_OF_REACH", "the divot is out of reach")))
}

/// Moves until the gauges read nothing; where the believed tip is then.
async fn seated(
    arm: &mut Arm,
    gauge: &mut Gauge,
    rotation: Rotation,
    mut seat: Point3,
) -> Result<Point3, Failure> {
    let mut reading_mm = f64::INFINITY;
    for _ in 0..CORRECTIONS {
        arm.go(&Rigid::<Base, Tool>::new(rotation, seat.coords))
            .await?;
        arm.flange_at_rest().await?;
        let reading = gauge.read().await?;
        reading_mm = reading.norm();
        if reading_mm < SEATED_MM {
            return Ok(seat);
        }
        seat -= reading;
    }
    Err(Failure::new(
        Kind::Failed,
        "TIP_NOT_SEATED",
        format!(
            "the gauges still read {reading_mm:.2} mm after {CORRECTIONS} corrections, limit {SEATED_MM} mm"
        ),
    ))
}

/// The tool straight down, leaning evenly to all sides, its flange turned about the shaft in between.
pub fn leaning(pose: u32) -> Rotation {
    let down = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
        -Vector3::z(),
        Vector3::y(),
        Vector3::x(),
    ]));
    // The golden angle never repeats a side.
    let side = f64::from(pose) * 2.399_963;
    let lean_rad = LEAN_DEG.to_radians() * (f64::from(pose) / f64::from(POSES - 1)).sqrt();
    let lean = Rotation::from_scaled_axis(Vector3::new(side.cos(), side.sin(), 0.0) * lean_rad);
    let turn_rad = TURN_DEG.to_radians() * (2.0 * side).sin();
    let turn = Rotation::from_scaled_axis(Vector3::x() * turn_rad);
    lean * Rotation::from_rotation_matrix(&down) * turn
}

/// The dial gauges of the divot.
struct Gauge {
    bench: BenchServiceClient<Channel>,
    seed: u64,
}

impl Gauge {
    /// How far the tip holds the divot from its rest, mm.
    async fn read(&mut self) -> Result<Vector3, Failure> {
        self.seed = self.seed.wrapping_add(1);
        let request = ReadDivotRequest { seed: self.seed };
        let read = self.bench.read_divot(request).await?.into_inner();
        Ok(Vector3::new(read.x_mm, read.y_mm, read.z_mm))
    }
}
