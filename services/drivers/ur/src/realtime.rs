//! The realtime interface (port 30003, read-only on 30013): one packet of doubles each control cycle. UR advises RTDE
//! instead since 3.5; controllers of all ages have this one.

use std::{io, time::Duration};

use tokio::{net::TcpStream, time::timeout_at};

use crate::{Error, RobotMode, RuntimeState, SafetyMode};

const SERVICE: &str = "realtime";

/// Sizes of the packet by software, in bytes. The columns of each are the first ones of the next.
pub const SIZES: [(usize, &str); 6] = [
    (1044, "3.0"),
    (1060, "3.2"),
    (1108, "3.5 and 5.0"),
    (1116, "3.10 and 5.4"),
    (1140, "5.9"),
    (1220, "5.10"),
];
/// Longest packet taken: room for what later software may add.
pub const MAX_PACKET_BYTES: usize = 4096;

/// The arm in one control cycle. Columns are those of UR's table, from 1. m, rad, s, N, Nm, A, V, °C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// s since the controller started. Column 1.
    pub time_s: f64,
    /// Commanded positions, speeds, accelerations, currents and moments of the joints. 2, 8, 14, 20, 26.
    pub target_q: [f64; 6],
    /// rad/s.
    pub target_qd: [f64; 6],
    /// rad/s^2.
    pub target_qdd: [f64; 6],
    /// A.
    pub target_current: [f64; 6],
    /// Nm.
    pub target_moment: [f64; 6],
    /// Measured positions. 32.
    pub actual_q: [f64; 6],
    /// rad/s. 38.
    pub actual_qd: [f64; 6],
    /// A. 44.
    pub actual_current: [f64; 6],
    /// A. 50.
    pub control_current: [f64; 6],
    /// Base from tool, measured: m and rotation vector. 56.
    pub actual_tool: [f64; 6],
    /// m/s, rad/s. 62.
    pub actual_tool_speed: [f64; 6],
    /// N, Nm. 68.
    pub tool_force: [f64; 6],
    /// Base from tool, commanded. 74.
    pub target_tool: [f64; 6],
    /// m/s, rad/s. 80.
    pub target_tool_speed: [f64; 6],
    /// Digital inputs. 86.
    pub digital_inputs: u64,
    /// °C. 87.
    pub motor_temperatures: [f64; 6],
    /// Time the controller took for its cycle. 93.
    pub controller_timer: f64,
    /// Power and brakes. 95.
    pub robot_mode: RobotMode,
    /// As in RTDE. 96.
    pub joint_modes: [i32; 6],
    /// What the safety system allows. 102.
    pub safety_mode: SafetyMode,
    /// m/s^2. 109.
    pub tool_acceleration: [f64; 3],
    /// 0..1. 118.
    pub speed_scaling: f64,
    /// Linear momentum. 119.
    pub momentum: f64,
    /// V. 122.
    pub main_voltage: f64,
    /// V. 123.
    pub robot_voltage: f64,
    /// A. 124.
    pub robot_current: f64,
    /// V. 125.
    pub joint_voltages: [f64; 6],
    /// Digital outputs; 1060 bytes and more. 131.
    pub digital_outputs: Option<u64>,
    /// Whether a program runs; 1060 bytes and more. 132.
    pub program: Option<RuntimeState>,
    /// m, m/s; 1108 bytes and more. 133, 136.
    pub elbow: Option<[[f64; 3]; 2]>,
    /// What the safety system says; 1116 bytes and more. 139.
    pub safety_status: Option<SafetyMode>,
    /// kg, m, kg m^2; 1220 bytes and more. 143, 144, 147.
    pub payload: Option<Payload>,
}

/// What the arm carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    /// kg.
    pub mass_kg: f64,
    /// From the flange, m.
    pub center_of_gravity: [f64; 3],
    /// kg m^2.
    pub inertia: [f64; 6],
}

/// The first packet of `bytes`, its size included, or `None` while it is incomplete.
///
/// # Errors
/// [`Error::RealtimeSize`]: the packet of software 1.x, whose columns are others, or no packet.
pub fn first(bytes: &[u8]) -> Result<Option<&[u8]>, Error> {
    let Some(size) = bytes.first_chunk::<4>() else {
        return Ok(None);
    };
    let size = i32::from_be_bytes(*size);
    let whole = usize::try_from(size)
        .ok()
        .filter(|size| known(*size))
        .ok_or(Error::RealtimeSize { size })?;
    Ok(bytes.get(..whole))
}

/// A size of [`SIZES`], or of software later than those.
fn known(size: usize) -> bool {
    let [.., (newest, _)] = SIZES;
    SIZES.iter().any(|(known, _)| *known == size)
        || (newest..=MAX_PACKET_BYTES).contains(&size) && size % 8 == 4
}

impl State {
    /// Reads a packet that [`first`] cut; `None` when it has fewer bytes than 3.0 sends. Columns of later software than
    /// this crate knows are passed over.
    pub fn decode(packet: &[u8]) -> Option<Self> {
        let columns = Columns(packet.get(4..)?);
        Some(Self {
            time_s: columns.at(1)?,
            target_q: columns.some(2)?,
            target_qd: columns.some(8)?,
            target_qdd: columns.some(14)?,
            target_current: columns.some(20)?,
            target_moment: columns.some(26)?,
            actual_q: columns.some(32)?,
            actual_qd: columns.some(38)?,
            actual_current: columns.some(44)?,
            control_current: columns.some(50)?,
            actual_tool: columns.some(56)?,
            actual_tool_speed: columns.some(62)?,
            tool_force: columns.some(68)?,
            target_tool: columns.some(74)?,
            target_tool_speed: columns.some(80)?,
            digital_inputs: columns.bits(86)?,
            motor_temperatures: columns.some(87)?,
            controller_timer: columns.at(93)?,
            robot_mode: RobotMode::from_code(columns.code(95)?),
            joint_modes: columns.some(96)?.map(code),
            safety_mode: SafetyMode::from_code(columns.code(102)?),
            tool_acceleration: columns.some(109)?,
            speed_scaling: columns.at(118)?,
            momentum: columns.at(119)?,
            main_voltage: columns.at(122)?,
            robot_voltage: columns.at(123)?,
            robot_current: columns.at(124)?,
            joint_voltages: columns.some(125)?,
            digital_outputs: columns.bits(131),
            program: columns.code(132).map(RuntimeState::from_code),
            elbow: columns
                .some(133)
                .zip(columns.some(136))
                .map(|(at, speed)| [at, speed]),
            safety_status: columns.code(139).map(SafetyMode::from_code),
            payload: columns.some(147).and_then(|inertia| {
                Some(Payload {
                    mass_kg: columns.at(143)?,
                    center_of_gravity: columns.some(144)?,
                    inertia,
                })
            }),
        })
    }
}

/// Doubles by the number of their column.
struct Columns<'a>(&'a [u8]);

impl Columns<'_> {
    fn at(&self, column: usize) -> Option<f64> {
        self.bits(column).map(f64::from_bits)
    }

    fn some<const N: usize>(&self, column: usize) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for (number, value) in values.iter_mut().enumerate() {
            *value = self.at(column + number)?;
        }
        Some(values)
    }

    fn bits(&self, column: usize) -> Option<u64> {
        let bytes = self.0.get(8 * (column - 1)..)?.first_chunk()?;
        Some(u64::from_be_bytes(*bytes))
    }

    fn code(&self, column: usize) -> Option<i32> {
        self.at(column).map(code)
    }
}

/// The interface sends codes as doubles; what is none becomes a code that nobody has.
fn code(value: f64) -> i32 {
    if value.fract() == 0.0 && (-1e6..=1e6).contains(&value) {
        value as i32
    } else {
        i32::MIN
    }
}

/// A connection to port 30003 or 30013. It never reconnects and sends nothing.
pub struct Realtime {
    stream: TcpStream,
    inbox: Box<[u8]>,
    end: usize,
}

impl Realtime {
    /// Connects; packets flow at once.
    ///
    /// # Errors
    /// No connection within `limit`.
    pub async fn connect(host: &str, port: u16, limit: Duration) -> Result<Self, Error> {
        Ok(Self {
            stream: crate::error::connect(SERVICE, host, port, limit).await?,
            inbox: vec![0; 16 * MAX_PACKET_BYTES].into_boxed_slice(),
            end: 0,
        })
    }

    /// Waits for a packet and gives the newest there is. Cancel safe.
    ///
    /// # Errors
    /// Nothing within `silence`, a violated protocol, a broken connection.
    pub async fn newest(&mut self, silence: Duration) -> Result<State, Error> {
        tokio::task::consume_budget().await;
        let deadline = crate::error::deadline(silence);
        let mut newest = None;
        loop {
            let room = self.inbox.len() - self.end;
            match self.stream.try_read(&mut self.inbox[self.end..]) {
                Ok(0) => return newest.ok_or(Error::Closed { service: SERVICE }),
                Ok(bytes) => {
                    self.end += bytes;
                    newest = self.take_newest()?.or(newest);
                    if let Some(state) = newest
                        && bytes < room
                    {
                        return Ok(state);
                    }
                    continue;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(source) => {
                    return Err(Error::Io {
                        service: SERVICE,
                        source,
                    });
                }
            }
            if let Some(state) = newest {
                return Ok(state);
            }
            timeout_at(deadline, self.stream.readable())
                .await
                .map_err(|_| Error::Timeout {
                    what: "packet of the realtime interface",
                    limit: silence,
                })?
                .map_err(|source| Error::Io {
                    service: SERVICE,
                    source,
                })?;
        }
    }

    fn take_newest(&mut self) -> Result<Option<State>, Error> {
        let (mut used, mut last) = (0, None);
        while let Some(packet) = first(&self.inbox[used..self.end])? {
            last = Some(used..used + packet.len());
            used += packet.len();
        }
        let newest = last.and_then(|packet| State::decode(&self.inbox[packet]));
        self.inbox.copy_within(used..self.end, 0);
        self.end -= used;
        Ok(newest)
    }
}

#[cfg(test)]
mod tests;
