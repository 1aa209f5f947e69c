//! Our clients: how late a state is when it is seen, and how many are.

use std::time::Duration;

use ur_link::{
    Error,
    rtde::{Client, Reader, Sample},
};

use crate::{PORT, now_s};

const PATIENCE: Duration = Duration::from_secs(5);
/// Not counted at the beginning, s.
const WARM_UP_S: f64 = 0.3;
/// A state older than this must not seem younger, s.
const FRESH_S: f64 = 0.008;

ur_link::outputs! {
    /// The recipe that ur_rtde asks for by default on this software.
    struct Recipe {
        timestamp: f64,
        target_q: [f64; 6],
        target_qd: [f64; 6],
        target_qdd: [f64; 6],
        target_current: [f64; 6],
        target_moment: [f64; 6],
        actual_q: [f64; 6],
        actual_qd: [f64; 6],
        actual_current: [f64; 6],
        joint_control_output: [f64; 6],
        actual_TCP_pose: [f64; 6],
        actual_TCP_speed: [f64; 6],
        actual_TCP_force: [f64; 6],
        target_TCP_pose: [f64; 6],
        target_TCP_speed: [f64; 6],
        actual_digital_input_bits: u64,
        joint_temperatures: [f64; 6],
        actual_execution_time: f64,
        robot_mode: i32,
        joint_mode: [i32; 6],
        safety_mode: i32,
        safety_status: i32,
        actual_tool_accelerometer: [f64; 3],
        speed_scaling: f64,
        target_speed_fraction: f64,
        actual_momentum: f64,
        actual_main_voltage: f64,
        actual_robot_voltage: f64,
        actual_robot_current: f64,
        actual_joint_voltage: [f64; 6],
        actual_digital_output_bits: u64,
        runtime_state: u32,
        standard_analog_input0: f64,
        standard_analog_input1: f64,
        standard_analog_output0: f64,
        standard_analog_output1: f64,
        robot_status_bits: u32,
        safety_status_bits: u32,
        payload: f64,
        payload_cog: [f64; 3],
        payload_inertia: [f64; 6],
        output_int_register_2 as number: i32,
        output_int_register_12: i32,
        output_int_register_13: i32,
        output_int_register_14: i32,
        output_int_register_15: i32,
        output_int_register_16: i32,
        output_int_register_17: i32,
        output_int_register_18: i32,
        output_int_register_19: i32,
        output_double_register_12: f64,
        output_double_register_13: f64,
        output_double_register_14: f64,
        output_double_register_15: f64,
        output_double_register_16: f64,
        output_double_register_17: f64,
        output_double_register_18: f64,
        output_double_register_19: f64,
    }
}

/// What was seen.
#[derive(Default)]
struct Seen {
    began_s: Option<f64>,
    latencies_us: Vec<f64>,
    first: Option<i32>,
    last: i32,
    /// States that came late and did not say so, or after missed ones that were not told of.
    dissembled: u64,
    counted_s: f64,
}

impl Seen {
    /// Notes a sample; false once it has been long enough.
    fn note(&mut self, sample: &Sample<Recipe>, seconds: f64) -> bool {
        let now = now_s();
        let age_s = now - sample.timestamp_s;
        let began_s = *self.began_s.get_or_insert(now);
        if now - began_s < WARM_UP_S {
            self.last = sample.state.number;
            return true;
        }
        self.first.get_or_insert(sample.state.number);
        let told_s = sample.age().as_secs_f64();
        let gap = sample.state.number.wrapping_sub(self.last);
        // The age is told without what the quickest state took.
        let hides_age = told_s < FRESH_S && age_s > FRESH_S + 0.002;
        if hides_age || gap > 1 && sample.skipped == 0 {
            self.dissembled += 1;
        }
        self.last = sample.state.number;
        self.latencies_us.push(age_s * 1e6);
        self.counted_s = now - began_s - WARM_UP_S;
        self.counted_s < seconds
    }

    fn json(mut self) -> String {
        self.latencies_us.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = self.latencies_us.len().saturating_sub(1);
            self.latencies_us
                .get((share * last as f64).round() as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        let states = i64::from(self.last) - i64::from(self.first.unwrap_or(self.last));
        format!(
            "{{\"p50\": {:.1}, \"p99\": {:.1}, \"p999\": {:.1}, \"distinct_s\": {:.0}, \"taken_s\": {:.0}, \"missed\": {}, \"dissembled\": {}}}",
            at(0.5),
            at(0.99),
            at(0.999),
            self.latencies_us.len() as f64 / self.counted_s,
            states as f64 / self.counted_s,
            states + 1 - self.latencies_us.len() as i64,
            self.dissembled,
        )
    }
}

/// Reads for so many seconds by one of our clients.
pub fn read(kind: &str, host: &str, hz: f64, seconds: f64) -> String {
    let mut seen = Seen::default();
    match kind {
        "client" => {
            let executor = tokio::runtime::Builder::new_current_thread()
                .enable_all()
                .build()
                .unwrap();
            executor
                .block_on(by_client(host, hz, seconds, &mut seen))
                .unwrap();
        }
        "reader" => {
            let mut reader = Reader::connect(host, PORT, hz, PATIENCE).unwrap();
            while seen.note(&reader.next(PATIENCE).unwrap(), seconds) {}
        }
        "latest" => {
            let reader = Reader::connect(host, PORT, hz, PATIENCE).unwrap();
            let latest = reader.keep_latest(PATIENCE).unwrap();
            let mut last = 0;
            loop {
                let sample = latest.newer_than(last, PATIENCE).unwrap();
                last = sample.number;
                if !seen.note(&sample, seconds) {
                    break;
                }
            }
        }
        other => eprintln!("link: no client of kind {other}"),
    }
    seen.json()
}

async fn by_client(host: &str, hz: f64, seconds: f64, seen: &mut Seen) -> Result<(), Error> {
    let mut client = Client::connect(host, PORT, PATIENCE).await?;
    let mut states = client.subscribe::<Recipe>(hz).await?;
    client.start().await?;
    while seen.note(&client.sample(&mut states, PATIENCE).await?, seconds) {}
    Ok(())
}
