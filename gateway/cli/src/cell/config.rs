//! The configuration of all services of a simulated cell, as one file.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use arthro_bootstrap::Service;
use arthro_gateway::config::{Calibration, Jaw, Pose};
use arthro_geometry::{Point3, Vector3};
use arthro_motion::config::ToolMount;
use arthro_motion::layout::Layout;
use arthro_simulator::scenario::{Scenario, SystemView};
use serde::Serialize;
use toml::{Table, Value};

use crate::arguments::ServiceName;
use crate::exit::Failure;

/// What the simulated jaw presses with, mA and N, calculated: friction and spring take 54 mA, motor, gear and screw make
/// 0.356 N of each further mA.
const JAW_FORCE_TABLE: [[f64; 2]; 2] = [[54.0, 0.0], [500.0, 159.0]];
/// How far outside its portal the arthroscope rests, mm.
const REST_OUTSIDE_MM: f64 = 80.0;

/// The file and what stands in it so far.
#[derive(Debug)]
pub struct Configuration {
    path: PathBuf,
    sections: Table,
}

impl Configuration {
    /// An empty configuration that is kept at `path`.
    pub fn new(path: PathBuf) -> Self {
        Self {
            path,
            sections: Table::new(),
        }
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The simulated cell: its case, its speed, and where its wires are.
    pub fn simulator(
        &mut self,
        folder: &Path,
        time_scale: f64,
        [forceps, arthroscope]: [IpAddr; 2],
    ) -> Result<(), Failure> {
        let mut config = arthro_simulator::config::Config {
            scenario: Some(folder.to_owned()),
            time_scale,
            ..Default::default()
        };
        config.forceps_arm.bind = forceps;
        config.arthroscope_arm.bind = arthroscope;
        // The bus has no port that clients expect.
        config.can_listen.set_port(0);
        self.section(ServiceName::Simulator, &config)
    }

    /// The four services behind the gateway.
    pub fn services(
        &mut self,
        scenario: &Scenario,
        arms: &[String],
        can: &str,
    ) -> Result<(), Failure> {
        let [forceps, arthroscope] = arms else {
            return Err(Failure::failed(
                "CELL_INCOMPLETE",
                format!("the cell has {} arms instead of two", arms.len()),
            ));
        };
        let view = scenario.system_view();
        let flange_from_tool = Pose::of(&view.flange_from_tool);
        let base = Pose::of(&view.forceps_base_from_arthroscope_base);
        let mut motion = arthro_motion::config::Config {
            layout: Layout::Measured(ToolMount {
                translation_mm: base.translation_mm,
                rotation_wxyz: base.rotation,
            }),
            ..Default::default()
        };
        for (arm, host) in [
            (&mut motion.arms.forceps, forceps),
            (&mut motion.arms.arthroscope, arthroscope),
        ] {
            arm.host.clone_from(host);
            // All of the cell shares this machine: a busy one is no dead link.
            arm.silence_s = 1.0;
            // Its joints lag by 9.5 to 10.5 ms.
            arm.limits.joint_lag_spread_s = 0.001;
            arm.flange_from_tool.rotation_wxyz = flange_from_tool.rotation;
            arm.flange_from_tool.translation_mm = flange_from_tool.translation_mm;
        }
        let mut instrument = arthro_instrument::config::Config {
            bus: can.to_owned(),
            ..Default::default()
        };
        instrument.bite.force_table = JAW_FORCE_TABLE.to_vec();
        type ConfigOf<S> = <S as Service>::Config;
        let registration = ConfigOf::<arthro_registration::Server>::default();
        let planning = ConfigOf::<arthro_planning::Server>::default();
        self.section(ServiceName::Registration, &registration)?;
        self.section(ServiceName::Planning, &planning)?;
        self.section(ServiceName::Motion, &motion)?;
        self.section(ServiceName::Instrument, &instrument)
    }

    /// The gateway: its services, its journal, and the cell's calibration.
    pub fn gateway(
        &mut self,
        scenario: &Scenario,
        folder: &Path,
        address: impl Fn(ServiceName) -> String,
    ) -> Result<(), Failure> {
        let view = scenario.system_view();
        let config = arthro_gateway::config::Config {
            journal: folder.join("journal.sqlite").into(),
            registration: address(ServiceName::Registration),
            planning: address(ServiceName::Planning),
            motion: address(ServiceName::Motion),
            instrument: address(ServiceName::Instrument),
            joint_opening_mm: Some(view.joint_gap_mm),
            jaw: Jaw {
                width_mm: view.jaw_width_mm,
                length_mm: view.jaw_length_mm,
                ..Jaw::default()
            },
            calibration: Some(Calibration {
                forceps_base_from_camera: Pose::of(&view.forceps_base_from_camera),
                forceps_base_from_arthroscope_base: Pose::of(
                    &view.forceps_base_from_arthroscope_base,
                ),
                forceps_portal_mm: view.portal_in_forceps_base.into(),
                arthroscope_portal_mm: view.portal_in_arthroscope_base.into(),
                forceps_base_from_tool_at_tray: Pose::of(&view.forceps_base_from_tool_at_tray),
                arthroscope_rest_mm: arthroscope_rest(&view).into(),
            }),
            ..Default::default()
        };
        self.section(ServiceName::Gateway, &config)
    }

    /// Keeps where a service listens, so that it comes back at the same address.
    pub fn listens(&mut self, service: ServiceName, address: SocketAddr) -> Result<(), Failure> {
        if let Some(Value::Table(section)) = self.sections.get_mut(service.as_str()) {
            let mut server = Table::new();
            server.insert("listen".to_owned(), Value::String(address.to_string()));
            section.insert("server".to_owned(), Value::Table(server));
        }
        self.write()
    }

    fn section(&mut self, service: ServiceName, config: &impl Serialize) -> Result<(), Failure> {
        let value = Value::try_from(config)
            .map_err(|error| Failure::failed("CONFIGURATION_UNWRITABLE", error))?;
        self.sections.insert(service.as_str().to_owned(), value);
        self.write()
    }

    fn write(&self) -> Result<(), Failure> {
        let text = toml::to_string(&self.sections)
            .map_err(|error| Failure::failed("CONFIGURATION_UNWRITABLE", error))?;
        Ok(std::fs::write(&self.path, text)?)
    }
}

/// Straight back from the portal, away from the other arm's.
fn arthroscope_rest(view: &SystemView) -> Point3 {
    let arthroscope_base_from_forceps_base = view.forceps_base_from_arthroscope_base.inverse();
    let other = arthroscope_base_from_forceps_base * view.portal_in_forceps_base;
    let aside = (view.portal_in_arthroscope_base - other)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::z);
    view.portal_in_arthroscope_base + aside * REST_OUTSIDE_MM
}
