//! The jaw is never told to be closed when it is not: random jaws, tissues, limits and defects, each a motor with
//! friction, a screw and an encoder, against the watch.

use proptest::prelude::*;

use super::*;
use crate::config::Config;

const STEP_S: f64 = 0.001;
const TOLERANCE_MM: f64 = 0.02;

/// What is wrong with the jaw.
#[derive(Clone, Copy, Debug)]
enum Defect {
    None,
    /// The encoder does not count beyond this.
    Frozen {
        at_mm: f64,
    },
    /// The jaw does this share of what the encoder counts.
    Slips {
        share: f64,
    },
    /// Something holds the shaft here, at whatever current.
    Jammed {
        at_mm: f64,
    },
}

/// A piece of tissue: from where on, how stiff, and the current at which it is cut.
#[derive(Clone, Copy, Debug)]
struct Tissue {
    from_mm: f64,
    stiffness_ma_per_mm: f64,
    cut_ma: f64,
}

#[derive(Debug)]
struct Model {
    spec: BiteSpec,
    limit_ma: f64,
    friction_ma: f64,
    tissue: Option<Tissue>,
    defect: Defect,
    now_s: f64,
    true_mm: f64,
    demand_mm: f64,
    demand_mm_s: f64,
    current_ma: f64,
}

impl Model {
    fn encoder_mm(&self) -> f64 {
        match self.defect {
            Defect::Frozen { at_mm } => self.true_mm.min(at_mm),
            Defect::Slips { share } => self.true_mm / share,
            Defect::None | Defect::Jammed { .. } => self.true_mm,
        }
    }

    /// What the jaw asks of the motor at a position, mA.
    fn load_ma(&self, at_mm: f64) -> f64 {
        if let Defect::Jammed { at_mm: jam_mm } = self.defect
            && at_mm > jam_mm
        {
            return f64::INFINITY;
        }
        let blades_ma = 2000.0 * (at_mm - self.spec.closed_mm).max(0.0);
        let tissue_ma = self.tissue.map_or(0.0, |tissue| {
            tissue.stiffness_ma_per_mm * (at_mm - tissue.from_mm).max(0.0)
        });
        self.friction_ma + blades_ma + tissue_ma
    }

    fn step(&mut self) {
        self.now_s += STEP_S;
        let ContactSpec {
            speed_mm_s,
            acceleration_mm_s2,
            ..
        } = self.spec.contact;
        let left_mm = self.spec.target_mm() - self.demand_mm;
        let braking_mm_s = (2.0 * acceleration_mm_s2 * left_mm.max(0.0)).sqrt();
        let before_mm_s = self.demand_mm_s;
        self.demand_mm_s = (self.demand_mm_s + acceleration_mm_s2 * STEP_S)
            .min(speed_mm_s)
            .min(braking_mm_s);
        self.demand_mm = (self.demand_mm + self.demand_mm_s * STEP_S).min(self.spec.target_mm());
        let lag_mm = self.demand_mm - self.encoder_mm();
        // A tenth of a millimetre of lag is the whole current.
        let wanted_ma = match lag_mm {
            lag_mm if lag_mm > 0.1 => self.limit_ma,
            _ => {
                let accelerates_ma = 5.0 * (self.demand_mm_s - before_mm_s).max(0.0) / STEP_S;
                self.load_ma(self.true_mm) + accelerates_ma
            }
        };
        self.current_ma = wanted_ma.min(self.limit_ma);
        // No faster than twice the speed of closing.
        let next_mm = self.true_mm + lag_mm.clamp(0.0, 2.0 * speed_mm_s * STEP_S);
        if self.load_ma(next_mm) <= self.limit_ma {
            self.true_mm = next_mm;
        }
        if let Some(tissue) = self.tissue
            && self.load_ma(self.true_mm) >= tissue.cut_ma
        {
            self.tissue = None;
        }
    }

    fn sample(&self) -> Sample {
        let arrived = self.demand_mm >= self.spec.target_mm();
        Sample {
            statusword: Statusword(if arrived { 0x8427 } else { 0x8027 }),
            position: self.encoder_mm(),
            current_ma: self.current_ma.round(),
            inputs: 0,
            stamp: Duration::from_secs_f64(self.now_s),
        }
    }

    fn bite(&mut self) -> Result<BiteEnd, BiteError> {
        let spec = self.spec.clone();
        let mut watch = Watch::new(spec, self.limit_ma, TOLERANCE_MM, &self.sample()).unwrap();
        loop {
            for _ in 0..10 {
                self.step();
            }
            assert!(self.now_s < 100.0, "the bite goes on for ever");
            if let Some(ended) = watch.observe(&self.sample()) {
                return ended;
            }
        }
    }
}

fn tissues() -> impl Strategy<Value = Tissue> {
    (1.5..9.8_f64, 20.0..4000.0_f64, 60.0..900.0_f64).prop_map(
        |(from_mm, stiffness_ma_per_mm, cut_ma)| Tissue {
            from_mm,
            stiffness_ma_per_mm,
            cut_ma,
        },
    )
}

/// Menisci are soft beside blades; what is as stiff as they are cannot be told from them.
fn soft_tissues() -> impl Strategy<Value = Tissue> {
    tissues().prop_map(|tissue| Tissue {
        stiffness_ma_per_mm: tissue.stiffness_ma_per_mm.min(250.0),
        ..tissue
    })
}

fn jaws(
    tissues: impl Strategy<Value = Option<Tissue>>,
    defects: impl Strategy<Value = Defect>,
) -> impl Strategy<Value = Model> {
    (
        tissues,
        defects,
        150.0..500.0_f64,
        10.0..70.0_f64,
        -1.0..0.0_f64,
    )
        .prop_map(|(tissue, defect, limit_ma, friction_ma, start_mm)| Model {
            spec: Config::default().check().unwrap().bite,
            limit_ma,
            friction_ma,
            tissue,
            defect,
            now_s: 10.0,
            true_mm: start_mm,
            demand_mm: start_mm,
            demand_mm_s: 0.0,
            current_ma: 0.0,
        })
}

fn any_defect() -> impl Strategy<Value = Defect> {
    prop_oneof![
        Just(Defect::None),
        (-1.0..10.1_f64).prop_map(|at_mm| Defect::Frozen { at_mm }),
        (-1.0..10.1_f64).prop_map(|at_mm| Defect::Jammed { at_mm }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    #[test]
    fn a_jaw_that_is_told_to_be_closed_is_closed(
        mut model in jaws(proptest::option::of(tissues()), any_defect()),
    ) {
        let ended = model.bite();
        let (true_mm, encoder_mm) = (model.true_mm, model.encoder_mm());
        if let Ok(end) = ended {
            let closed_from_mm = model.spec.closed_from_mm() - TOLERANCE_MM;
            prop_assert!(true_mm >= closed_from_mm, "{:?} at {} mm, {} by the encoder", end, true_mm, encoder_mm);
        }
        prop_assert!(true_mm <= model.spec.target_mm() + 0.5);
    }

    #[test]
    fn a_jaw_whose_belt_slips_is_not_told_to_be_closed(
        mut model in jaws(
            proptest::option::of(soft_tissues()),
            (0.5..0.97_f64).prop_map(|share| Defect::Slips { share }),
        ),
    ) {
        let ended = model.bite();
        let closed_from_mm = model.spec.closed_from_mm() - TOLERANCE_MM;
        prop_assert!(
            ended.is_err() || model.true_mm >= closed_from_mm,
            "{:?} at {} mm", ended, model.true_mm
        );
    }

    #[test]
    fn a_sound_jaw_tells_tissue_from_nothing(
        mut model in jaws(proptest::option::of(tissues()), Just(Defect::None)),
    ) {
        let is_empty = model.tissue.is_none();
        let met = model.tissue.filter(|tissue| tissue.from_mm < 9.7);
        // What is cut below the current of contact is not felt, nor what is cut between two looks.
        let felt_from_ma = (model.friction_ma + 40.0).max(120.0);
        let is_felt = met.is_some_and(|tissue| {
            (tissue.cut_ma - felt_from_ma) / tissue.stiffness_ma_per_mm > 0.06
        });
        match model.bite() {
            Ok(end) if is_felt => prop_assert_eq!(end.result, BiteResult::ClosedOnTissue),
            Ok(end) if is_empty => {
                prop_assert_eq!(end.result, BiteResult::ClosedEmpty);
            }
            Ok(_) => {}
            Err(error) => {
                prop_assert!(!is_empty, "{}", error);
                // Soft and pressed to where it counts as closed is not shown to be.
                let is_doubt = matches!(error, BiteError::NotClosed { .. } | BiteError::BladesNotFelt { .. });
                prop_assert!(is_doubt, "{}", error);
            }
        }
    }
}
