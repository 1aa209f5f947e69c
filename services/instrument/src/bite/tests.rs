use super::*;
use crate::config::{BiteConfig, Config};

/// OPERATION_ENABLED, referenced.
const ENABLED: u16 = 0x8027;
/// And the profile has ended.
const ARRIVED: u16 = 0x8427;
const TOLERANCE_MM: f64 = 0.02;

fn sample(statusword: u16, position: f64, current_ma: f64, ms: u64) -> Sample {
    Sample {
        statusword: Statusword(statusword),
        position,
        current_ma,
        inputs: 0,
        stamp: Duration::from_millis(ms),
    }
}

fn spec_with(change: impl FnOnce(&mut BiteConfig)) -> BiteSpec {
    let mut config = Config::default();
    config.bite.force_table = vec![[40.0, 0.0], [500.0, 160.0]];
    change(&mut config.bite);
    config.check().unwrap().bite
}

/// A jaw that closes at 5 mm/s, looked at every 10 ms.
struct Bench {
    watch: Watch,
    ms: u64,
    mm: f64,
}

impl Bench {
    fn new(spec: BiteSpec) -> Self {
        let limit_ma = spec.current_limit_ma;
        let first = sample(ENABLED, 0.0, 0.0, 0);
        Self {
            watch: Watch::new(spec, limit_ma, TOLERANCE_MM, &first).unwrap(),
            ms: 0,
            mm: 0.0,
        }
    }

    fn default() -> Self {
        Self::new(spec_with(|_| {}))
    }

    fn look(&mut self, statusword: u16, current_ma: f64) -> Option<Result<BiteEnd, BiteError>> {
        self.watch
            .observe(&sample(statusword, self.mm, current_ma, self.ms))
    }

    /// On to a position, with a current that depends on it.
    fn close(&mut self, to_mm: f64, current_ma: impl Fn(f64) -> f64) {
        while self.mm < to_mm {
            self.ms += 10;
            // 5 mm/s, without what sums leave over.
            self.mm = (self.mm * 20.0 + 1.0).round() / 20.0;
            let current_ma = current_ma(self.mm);
            assert_eq!(self.look(ENABLED, current_ma), None);
        }
    }

    /// Stands until the bite is over.
    fn stand(&mut self, current_ma: f64) -> Result<BiteEnd, BiteError> {
        for _ in 0..200 {
            self.ms += 10;
            if let Some(ended) = self.look(ENABLED, current_ma) {
                return ended;
            }
        }
        panic!("the bite goes on: {:?}", self.watch);
    }

    fn arrive(&mut self, current_ma: f64) -> Result<BiteEnd, BiteError> {
        self.ms += 10;
        self.look(ARRIVED, current_ma).unwrap()
    }
}

/// The blades of a jaw that draws 40 mA when it is free.
fn empty(mm: f64) -> f64 {
    40.0 + 2000.0 * (mm - 10.0).max(0.0)
}

/// Tissue from 6 mm on, cut at 8 mm.
fn cut(mm: f64) -> f64 {
    match mm {
        6.0..8.0 => 40.0 + 150.0 * (mm - 6.0),
        mm => empty(mm),
    }
}

#[test]
fn an_empty_jaw_closes_until_its_blades_meet() {
    let mut bench = Bench::default();
    bench.close(0.2, |_| 300.0);
    bench.close(10.1, empty);
    let end = bench.arrive(240.0).unwrap();
    assert_eq!(end.result, BiteResult::ClosedEmpty);
    assert_eq!(end.contact_mm, None, "the blades are no tissue");
    assert_eq!(
        end.peak_current_ma, 300.0,
        "that of the acceleration, which is no contact"
    );
}

#[test]
fn blades_that_meet_at_the_limit_close_the_jaw_too() {
    let mut bench = Bench::default();
    bench.close(10.05, empty);
    assert_eq!(bench.stand(490.0).unwrap().result, BiteResult::ClosedEmpty);
}

#[test]
fn tissue_that_is_cut_is_felt_where_it_is() {
    let mut bench = Bench::default();
    bench.close(10.1, cut);
    let end = bench.arrive(240.0).unwrap();
    assert_eq!(end.result, BiteResult::ClosedOnTissue);
    assert!((end.contact_mm.unwrap() - 6.0).abs() < 0.1, "{end:?}");
    // 340 mA before it is cut, of 460 mA for 160 N.
    assert!((end.force_n.unwrap() - 104.0).abs() < 3.0, "{end:?}");
}

#[test]
fn a_jaw_that_stands_at_the_limit_is_closed_only_where_that_counts_as_closed() {
    let mut bench = Bench::default();
    bench.close(7.0, cut);
    let error = bench.stand(495.0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "stopped at 7.000 mm by the current limit of 500 mA; the jaw is closed from 9.7 mm on"
    );
    let end = error.end().unwrap();
    assert_eq!(
        (end.result, end.result.jaw()),
        (BiteResult::NotClosed, Jaw::Unknown)
    );
    assert!((end.contact_mm.unwrap() - 6.0).abs() < 0.1);

    let mut thin = Bench::default();
    thin.close(9.75, |mm| 40.0 + 900.0 * (mm - 9.5).max(0.0));
    let end = thin.stand(495.0).unwrap();
    assert_eq!(end.result, BiteResult::ClosedOnTissue);
    assert!((end.contact_mm.unwrap() - 9.5).abs() < 0.1);
}

#[test]
fn a_jaw_that_stands_below_the_limit_is_held_by_something_else() {
    let mut bench = Bench::default();
    bench.close(7.0, empty);
    let error = bench.stand(50.0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "stands at 7.000 mm short of 10.1 mm with 50 mA, below the limit of 500 mA"
    );
    assert_eq!(error.end().unwrap().result, BiteResult::Stalled);
    // Also where it would count as closed.
    let mut nearly = Bench::default();
    nearly.close(9.9, empty);
    let error = nearly.stand(50.0).unwrap_err();
    assert_eq!(error.end().unwrap().result, BiteResult::Stalled);
}

#[test]
fn an_encoder_that_stands_still_from_the_first_is_not_believed() {
    let error = Bench::default().stand(500.0).unwrap_err();
    assert!(matches!(error, BiteError::NeverMoved { .. }), "{error}");
    assert_eq!(error.end().unwrap().result.jaw(), Jaw::Unknown);
}

#[test]
fn an_encoder_that_stops_on_the_way_does_not_close_the_jaw() {
    let mut bench = Bench::default();
    bench.close(5.0, empty);
    let error = bench.stand(500.0).unwrap_err();
    assert!(matches!(error, BiteError::NotClosed { .. }), "{error}");
}

#[test]
fn a_belt_that_slips_is_seen_by_blades_that_are_not_felt() {
    let mut bench = Bench::default();
    bench.close(10.1, |_| 40.0);
    let error = bench.arrive(40.0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "at 10.100 mm after a rise of 0 mA over the last 0.2 mm, but blade on blade rises by 90 mA: the encoder and the \
         jaw do not go together, or the jaw is not closed"
    );
    assert_eq!(error.end().unwrap().result.jaw(), Jaw::Unknown);
    // Also on tissue, which presses back and is soft.
    let soft = |mm: f64| 40.0 + 130.0 * (mm - 8.7).max(0.0);
    let mut on_tissue = Bench::default();
    on_tissue.close(10.1, soft);
    let error = on_tissue.arrive(soft(10.1)).unwrap_err();
    assert!(matches!(error, BiteError::BladesNotFelt { .. }), "{error}");
    // Not looked for, it is not seen.
    let mut blind = Bench::new(spec_with(|bite| bite.blades_touch_current_ma = 0.0));
    blind.close(10.0, |_| 40.0);
    assert_eq!(blind.arrive(40.0).unwrap().result, BiteResult::ClosedEmpty);
}

#[test]
fn a_creeping_jaw_is_given_up() {
    let mut bench = Bench::default();
    let error = loop {
        bench.ms += 500;
        bench.mm += 0.025;
        if let Some(ended) = bench.look(ENABLED, 300.0) {
            break ended.unwrap_err();
        }
        assert!(bench.mm < 10.0);
    };
    assert!(matches!(error, BiteError::TooSlow { .. }), "{error}");
}

#[test]
fn a_drive_that_leaves_operation_or_loses_its_reference_ends_the_bite_in_doubt() {
    let fault = Bench::default().look(0x8008, 0.0).unwrap().unwrap_err();
    assert!(matches!(fault, BiteError::LeftOperation { .. }));
    let lost = Bench::default().look(0x0027, 40.0).unwrap().unwrap_err();
    assert!(matches!(lost, BiteError::ReferenceLost { .. }));
    assert_eq!((fault.end(), lost.end()), (None, None));
}

#[test]
fn a_bite_begins_with_an_open_jaw() {
    let first = sample(ENABLED, 9.0, 0.0, 0);
    let error = Watch::new(spec_with(|_| {}), 500.0, TOLERANCE_MM, &first).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the jaw stands at 9.000 mm; a bite begins at or behind 0 mm"
    );
}

#[test]
fn what_is_known_of_a_jaw_at_rest_is_given_up_when_its_axis_contradicts() {
    let spec = spec_with(|_| {});
    let held = |jaw: Jaw, statusword: u16, mm: f64| {
        jaw.held_against(&spec, TOLERANCE_MM, Some(&sample(statusword, mm, 0.0, 0)))
    };
    for jaw in [Jaw::ClosedEmpty, Jaw::ClosedOnTissue] {
        assert_eq!(held(jaw, ENABLED, 9.9), jaw);
        assert_eq!(held(jaw, ENABLED, 9.5), Jaw::Unknown, "it has opened");
        assert_eq!(held(jaw, 0x0027, 9.9), Jaw::Unknown, "no reference");
        assert_eq!(held(jaw, 0x8040, 9.9), Jaw::Unknown, "no power");
        assert_eq!(jaw.held_against(&spec, TOLERANCE_MM, None), Jaw::Unknown);
    }
    assert_eq!(held(Jaw::Open, ENABLED, -0.5), Jaw::Open);
    assert_eq!(held(Jaw::Open, ENABLED, 0.5), Jaw::Unknown);
}
