//! The figures of a demo, beside the limits they are held to.
//!
//! What is said of tissue, target error, portal and collisions is the referee's account of the
//! simulated truth, never the services' own belief.

use arthro_proto::gateway::v1::Procedure;
use arthro_proto::planning::v1::ResectionPlan;
use arthro_proto::registration::v1::RegistrationResult;
use arthro_proto::simulator::v1::{GetAccountResponse, ScoreRegistrationResponse};
use arthro_simulator::scenario::Source;
use serde_json::{Value, json};

use crate::commands::show;
use crate::exit::{Failure, Kind};

/// Target registration error allowed on the phantom and on a given surface, mm.
const TRE_LIMIT_MM: [f64; 2] = [1.0, 1.5];
/// Distance of the shaft to the portal allowed at every controller tick while inside, mm.
const RCM_LIMIT_MM: f64 = 0.5;
/// Share of the damaged tissue that must be gone, %. Held on the phantom; a straight jaw does not
/// reach everywhere on a given surface.
const DAMAGED_REMOVED_LIMIT_PERCENT: f64 = 95.0;

/// Everything a demo found out.
#[derive(Debug)]
pub struct Summary {
    pub source: Source,
    pub seed: u64,
    pub registration: RegistrationResult,
    pub score: ScoreRegistrationResponse,
    pub plan: ResectionPlan,
    pub procedure: Procedure,
    pub account: GetAccountResponse,
    /// Wall time of the procedure, s.
    pub wall_seconds: f64,
    /// Wall time from the first call to the last, s.
    pub total_seconds: f64,
}

/// A figure and its limit.
#[derive(Debug)]
pub struct Check {
    pub what: &'static str,
    pub value: String,
    pub limit: String,
    pub kept: bool,
}

impl Summary {
    /// Largest true distance of either shaft to its portal while inside, mm.
    pub fn rcm_max_mm(&self) -> f64 {
        self.account
            .shafts
            .iter()
            .map(|shaft| shaft.rcm_max_mm)
            .fold(0.0, f64::max)
    }

    /// The limits of the demo.
    pub fn checks(&self) -> Vec<Check> {
        let phantom = self.source == Source::Phantom;
        let tre_limit_mm = TRE_LIMIT_MM[usize::from(!phantom)];
        let damaged = self.account.damaged_removed_percent;
        let collisions = self.account.collisions.len();
        let (coarse, fine) = (self.registration.coarse_mse_mm2, self.registration.mse_mm2);
        vec![
            Check {
                what: "target registration error",
                value: format!("{:.2} mm rms", self.score.tre_rms_mm),
                limit: format!("<= {tre_limit_mm} mm"),
                kept: self.score.tre_rms_mm <= tre_limit_mm,
            },
            Check {
                what: "shaft to portal, worst tick",
                value: format!("{:.3} mm", self.rcm_max_mm()),
                limit: format!("<= {RCM_LIMIT_MM} mm"),
                kept: self.rcm_max_mm() <= RCM_LIMIT_MM,
            },
            Check {
                what: "damaged tissue removed",
                value: format!("{damaged:.1} %"),
                limit: if phantom {
                    format!(">= {DAMAGED_REMOVED_LIMIT_PERCENT} %")
                } else {
                    "reported".to_owned()
                },
                kept: !phantom || damaged >= DAMAGED_REMOVED_LIMIT_PERCENT,
            },
            Check {
                what: "collisions",
                value: collisions.to_string(),
                limit: "0".to_owned(),
                kept: collisions == 0,
            },
            Check {
                what: "fine below coarse residual",
                value: format!("{fine:.3} < {coarse:.3} mm2"),
                limit: "fine < coarse".to_owned(),
                kept: fine < coarse,
            },
        ]
    }

    /// `Ok` if every limit was kept.
    pub fn limits_kept(&self) -> Result<(), Failure> {
        let missed: Vec<String> = self
            .checks()
            .into_iter()
            .filter(|check| !check.kept)
            .map(|check| format!("{} {} (limit {})", check.what, check.value, check.limit))
            .collect();
        if missed.is_empty() {
            return Ok(());
        }
        Err(Failure::new(
            Kind::LimitMissed,
            "LIMIT_MISSED",
            missed.join("; "),
        ))
    }

    /// The last line of `arthro demo --json`.
    pub fn json(&self) -> Value {
        let evaluation = self.plan.evaluation.clone().unwrap_or_default();
        json!({
            "model": self.source,
            "seed": self.seed,
            "registration": show::registration(&self.registration),
            "plan": {
                "targets": self.plan.bites.len(),
                "seconds": self.plan.seconds,
                "evaluation": show::evaluation(&evaluation),
            },
            "procedure": {
                "state": crate::gateway::state_word(self.procedure.state()),
                "bites": self.procedure.bites_done,
                "robot_seconds": self.procedure.robot_seconds,
                "wall_seconds": self.wall_seconds,
                "rcm_reported_max_mm": self.procedure.rcm_deviation_max_mm,
            },
            "referee": {
                "tre_rms_mm": self.score.tre_rms_mm,
                "tre_max_mm": self.score.tre_max_mm,
                "lesion_tre_rms_mm": self.score.lesion_tre_rms_mm,
                "rcm_max_mm": self.rcm_max_mm(),
                "damaged_removed_percent": self.account.damaged_removed_percent,
                "healthy_removed_mm3": self.account.healthy_removed_mm3,
                "rim_min_mm": self.account.rim_min_mm,
                "collisions": self.account.collisions.len(),
                "bites": self.account.bites,
                "empty_bites": self.account.empty_bites,
                "delivered_to_tray_mm3": self.account.delivered_to_tray_mm3,
                "dropped_inside_mm3": self.account.dropped_inside_mm3,
            },
            "limits_kept": self.checks().iter().all(|check| check.kept),
            "seconds": self.total_seconds,
        })
    }

    /// The same for a person.
    pub fn table(&self) -> String {
        let mut lines = vec![
            String::new(),
            format!(
                "{} bites in {:.0} s of robot time ({:.0} s on the wall); {} planned",
                self.procedure.bites_done,
                self.procedure.robot_seconds,
                self.wall_seconds,
                self.plan.bites.len()
            ),
            format!(
                "healthy tissue removed {:.1} mm3, narrowest rim {:.1} mm, {:.1} mm3 delivered to the tray",
                self.account.healthy_removed_mm3,
                self.account.rim_min_mm,
                self.account.delivered_to_tray_mm3
            ),
            String::new(),
            format!(
                "{:<30} {:>20}  {}",
                "referee's account", "measured", "limit"
            ),
        ];
        lines.extend(self.checks().iter().map(|check| {
            format!(
                "{:<30} {:>20}  {}{}",
                check.what,
                check.value,
                check.limit,
                if check.kept { "" } else { "   MISSED" }
            )
        }));
        lines.extend(self.account.collisions.iter().map(|collision| {
            format!(
                "  collision at {:.1} s: {} with {}, {:.2} mm deep",
                collision.cell_time_s, collision.first, collision.second, collision.penetration_mm
            )
        }));
        lines.join("\n")
    }
}
