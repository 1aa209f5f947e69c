//! The figures of a demo, beside the limits they are held to.
//!
//! What is said of tissue, target error, portal and collisions is the referee's account of the
//! simulated truth, never the services' own belief.

use arthro_proto::gateway::v1::Procedure;
use arthro_proto::planning::v1::{ResectionEvaluation, ResectionPlan};
use arthro_proto::registration::v1::RegistrationResult;
use arthro_proto::simulator::v1::{GetAccountResponse, ScoreRegistrationResponse};
use arthro_simulator::scenario::Source;
use serde_json::{Value, json};

use crate::arguments::ScenarioName;
use crate::commands::show;
use crate::exit::{Failure, Kind};

/// Target registration error allowed on the phantom and on a given surface, mm.
const TRE_LIMIT_MM: [f64; 2] = [1.0, 1.5];
/// Distance of the shaft to the portal allowed at every controller tick while inside, mm.
const RCM_LIMIT_MM: f64 = 0.5;
/// Share of the damaged tissue that must be gone, %. Held on the phantom; a straight jaw does not
/// reach everywhere on a given surface.
const DAMAGED_REMOVED_LIMIT_PERCENT: f64 = 95.0;

/// How far what is truly removed may be from what was planned: so much, or this share of it, mm3. Nothing but voxels of
/// 0.5 mm against the referee's of 0.3 mm is between them when all goes well: at most 4.8 mm3 or 7.6 % on the phantom
/// and 1.1 mm3 or 6.8 % on four menisci, seeds 1 to 5.
const REMOVED_LIMIT_MM3: f64 = 2.0;
const REMOVED_LIMIT_SHARE: f64 = 0.1;

/// Everything a demo found out.
#[derive(Debug)]
pub struct Summary {
    pub source: Source,
    pub scenario: ScenarioName,
    pub seed: u64,
    pub registration: RegistrationResult,
    pub score: ScoreRegistrationResponse,
    pub plan: ResectionPlan,
    /// The plan as the planning service scores it.
    pub evaluation: ResectionEvaluation,
    /// The paper's bites on the plan's contour, scored likewise.
    pub paper: ResectionEvaluation,
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

    /// Tissue that is truly gone, mm3.
    pub fn removed_mm3(&self) -> f64 {
        self.account.damaged_removed_mm3 + self.account.healthy_removed_mm3
    }

    /// How much more is gone than the plan said, mm3.
    pub fn removed_beyond_plan_mm3(&self) -> f64 {
        self.removed_mm3() - self.evaluation.removed_mm3
    }

    /// Most that truth may be off the plan in either direction, mm3.
    fn removed_limit_mm3(&self) -> f64 {
        REMOVED_LIMIT_MM3.max(REMOVED_LIMIT_SHARE * self.evaluation.removed_mm3)
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
                what: "removed beyond the plan",
                value: format!("{:+.1} mm3", self.removed_beyond_plan_mm3()),
                limit: format!("within {:.1} mm3", self.removed_limit_mm3()),
                kept: self.removed_beyond_plan_mm3().abs() <= self.removed_limit_mm3(),
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
        json!({
            "model": self.source,
            "scenario": self.scenario_word(),
            "seed": self.seed,
            "registration": show::registration(&self.registration),
            "plan": {
                "targets": self.plan.bites.len(),
                "seconds": self.plan.seconds,
                "bound": self.plan.bound,
                "ended": show::ended(&self.plan),
                "complete": self.plan.complete,
                "views": self.plan.views.len(),
                "evaluation": show::evaluation(&self.evaluation),
            },
            "paper": {
                "evaluation": show::evaluation(&self.paper),
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
                "removed_mm3": self.removed_mm3(),
                "removed_beyond_plan_mm3": self.removed_beyond_plan_mm3(),
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

    /// What of the tissue the plan said and what truly happened: name, planned, truly, unit.
    pub fn tissue(&self) -> [(&'static str, f64, f64, &'static str); 4] {
        let (planned, truly) = (&self.evaluation, &self.account);
        [
            (
                "damaged tissue removed",
                planned.lesion_covered_percent,
                truly.damaged_removed_percent,
                "%",
            ),
            (
                "healthy tissue removed",
                planned.healthy_removed_mm3,
                truly.healthy_removed_mm3,
                "mm3",
            ),
            (
                "all tissue removed",
                planned.removed_mm3,
                self.removed_mm3(),
                "mm3",
            ),
            (
                "narrowest rim left",
                planned.rim_min_mm,
                truly.rim_min_mm,
                "mm",
            ),
        ]
    }

    fn scenario_word(&self) -> &'static str {
        match self.scenario {
            ScenarioName::Tear => "tear",
            ScenarioName::Band => "band",
        }
    }

    /// The same for a person.
    pub fn table(&self) -> String {
        let mut lines = vec![
            String::new(),
            format!(
                "{} bites in {:.0} s of robot time ({:.0} s on the wall); {} planned, no fewer than {} can do",
                self.procedure.bites_done,
                self.procedure.robot_seconds,
                self.wall_seconds,
                self.plan.bites.len(),
                self.plan.bound
            ),
            String::new(),
            format!(
                "{:<14} {:>5} {:>9} {:>9} {:>9} {:>12} {:>8}",
                "on one contour", "bites", "predicted", "region", "lesion", "outside", "rim"
            ),
            row("plan", &self.evaluation),
            row("paper", &self.paper),
            String::new(),
            format!(
                "{:<24} {:>10} {:>10}",
                "tissue, as refereed", "planned", "truly"
            ),
        ];
        lines.extend(self.tissue().map(|(what, planned, truly, unit)| {
            format!("{what:<24} {planned:>10.1} {truly:>10.1} {unit}")
        }));
        lines.extend([
            String::new(),
            format!(
                "{:<30} {:>20}  {}",
                "referee's account", "measured", "limit"
            ),
        ]);
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

/// One list of bites and what it does.
fn row(who: &str, evaluation: &ResectionEvaluation) -> String {
    format!(
        "{who:<14} {:>5} {:>5.1} min {:>7.1} % {:>7.1} % {:>8.1} mm3 {:>5.1} mm{}",
        evaluation.bites,
        evaluation.predicted_seconds / 60.0,
        evaluation.region_covered_percent,
        evaluation.lesion_covered_percent,
        evaluation.outside_removed_mm3,
        evaluation.rim_min_mm,
        match evaluation.infeasible_bites.len() {
            0 => String::new(),
            count => format!("   {count} blocked in this order"),
        }
    )
}
