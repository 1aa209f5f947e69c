//! The jaw of the forceps: what lies between its blades, when it cuts, what it holds, and what that
//! asks of the feed drive.
//!
//! The feed closes it: open at 0 mm, the empty blades touch at [`JawSpec::closed_feed_mm`]. The
//! rotation axis turns it about the shaft; at 0 it opens along the tool's z.

use arthro_geometry::frame::{ForcepsBase, Tool};
use arthro_geometry::{Rigid, Rotation, Vector3};

use crate::cell::axes::{FEED_N_PER_MA, JawLoad};
use crate::knee::{Bitten, JawBox, Knee, Volume};
use crate::scenario::spec::JawSpec;

/// The one jaw of the cell.
#[derive(Clone, Debug)]
pub struct Jaw {
    spec: JawSpec,
    grip: Grip,
    looked_at: Option<(Rigid<ForcepsBase, Tool>, Bitten)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Grip {
    /// Open or closing.
    Open,
    /// Closed, with what was cut.
    Closed(Volume),
}

/// Something irreversible that the jaw did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// It closed and cut this much, which may be nothing.
    Bit(Volume),
    /// It opened and let go of this much.
    Released(Volume),
}

/// From this share of the way the tissue between the blades is cut.
const CUTS_AT: f64 = 0.9;
/// Opened to this share, it lets go.
const LETS_GO_AT: f64 = 0.5;
/// Tissue is pressed together by this much before the blades cut into it, mm.
const PRESSED_MM: f64 = 0.5;
/// Blade against blade, N for each mm beyond closed.
pub(crate) const BLADES_N_PER_MM: f64 = 700.0;
/// The spring that opens the jaw, N at the screw for each mm.
pub(crate) const SPRING_N_PER_MM: f64 = 0.5;
/// A jaw that moved less than this has the same tissue between its blades.
const SAME_PLACE_MM: f64 = 0.01;
const SAME_DIRECTION_RAD: f64 = 1e-3;

impl Jaw {
    /// Open and empty.
    pub fn new(spec: &JawSpec) -> Self {
        Self {
            spec: spec.clone(),
            grip: Grip::Open,
            looked_at: None,
        }
    }

    /// What it holds.
    pub fn held(&self) -> Volume {
        match self.grip {
            Grip::Open => Volume::default(),
            Grip::Closed(volume) => volume,
        }
    }

    /// Looks at what lies between the blades, once for each place where the jaw is about to close.
    pub fn look(
        &mut self,
        forceps_base_from_jaw: Rigid<ForcepsBase, Tool>,
        feed_mm: f64,
        knee: &Knee,
    ) {
        let closing = self.grip == Grip::Open && self.closure(feed_mm) > 0.05;
        if !closing {
            self.looked_at = None;
            return;
        }
        let same_place = self.looked_at.is_some_and(|(pose, _)| {
            let moved = pose.inverse() * forceps_base_from_jaw;
            moved.translation_mm().norm() < SAME_PLACE_MM
                && moved.rotation().angle() < SAME_DIRECTION_RAD
        });
        if !same_place {
            let bitten = knee.between(&self.reach(forceps_base_from_jaw));
            self.looked_at = Some((forceps_base_from_jaw, bitten));
        }
    }

    /// What the feed drive must overcome at this feed.
    pub fn load(&self, feed_mm: f64) -> JawLoad {
        let blades_n = (feed_mm - self.spec.closed_feed_mm).max(0.0) * BLADES_N_PER_MM;
        let tissue_n = match (&self.grip, &self.looked_at) {
            (Grip::Open, Some((_, bitten))) if bitten.thickness_mm > 0.0 => {
                let aperture_mm = self.spec.opening_mm * (1.0 - self.closure(feed_mm));
                let pressed_mm = (bitten.thickness_mm - aperture_mm).clamp(0.0, PRESSED_MM);
                let footprint_mm2 = bitten.volume.total_mm3() / bitten.thickness_mm;
                let share = footprint_mm2 / (self.spec.width_mm * self.spec.length_mm);
                let cutting_n = self.spec.cutting_current_ma * FEED_N_PER_MA;
                cutting_n * share.min(1.0).sqrt() * pressed_mm / PRESSED_MM
            }
            _ => 0.0,
        };
        JawLoad {
            spring_n: feed_mm.max(0.0) * SPRING_N_PER_MM,
            bite_n: blades_n + tissue_n,
        }
    }

    /// The feed is here now: cuts when it passes closed, lets go when it passes half open.
    pub fn feed(
        &mut self,
        feed_mm: f64,
        forceps_base_from_jaw: Rigid<ForcepsBase, Tool>,
        knee: &mut Knee,
    ) -> Option<Event> {
        let closure = self.closure(feed_mm);
        match self.grip {
            Grip::Open if closure >= CUTS_AT => {
                let volume = knee.cut(&self.reach(forceps_base_from_jaw));
                self.grip = Grip::Closed(volume);
                self.looked_at = None;
                Some(Event::Bit(volume))
            }
            Grip::Closed(volume) if closure <= LETS_GO_AT => {
                self.grip = Grip::Open;
                Some(Event::Released(volume))
            }
            _ => None,
        }
    }

    fn closure(&self, feed_mm: f64) -> f64 {
        feed_mm / self.spec.closed_feed_mm
    }

    fn reach(&self, forceps_base_from_jaw: Rigid<ForcepsBase, Tool>) -> JawBox {
        JawBox {
            forceps_base_from_jaw,
            half_mm: 0.5
                * Vector3::new(
                    self.spec.length_mm,
                    self.spec.width_mm,
                    self.spec.opening_mm,
                ),
        }
    }
}

/// Turns the tool's axes into the jaw's: by the angle of the rotation axis about the shaft.
pub fn turned(
    forceps_base_from_tool: Rigid<ForcepsBase, Tool>,
    rotation_rad: f64,
) -> Rigid<ForcepsBase, Tool> {
    let about_shaft = Rotation::from_scaled_axis(Vector3::x() * rotation_rad);
    forceps_base_from_tool * Rigid::<Tool, Tool>::new(about_shaft, Vector3::zeros())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Scenario, Spec};

    /// A jaw over the middle of the tear, opening along the knee's z.
    fn over_the_tear() -> (Jaw, Knee, Rigid<ForcepsBase, Tool>) {
        let scenario = Scenario::phantom(Spec::default()).unwrap();
        let tear = &scenario.preoperative.lesion;
        let middle = tear.iter().map(|p| p.coords).sum::<Vector3>() / tear.len() as f64;
        let knee = Knee::new(&scenario);
        let pose = Rigid::<ForcepsBase, Tool>::new(
            knee.forceps_base_from_knee().rotation(),
            (*knee.forceps_base_from_ct() * arthro_geometry::Point3::from(middle)).coords,
        );
        (Jaw::new(&scenario.spec.jaw), knee, pose)
    }

    /// Feeds to a position in steps of 0.1 mm; returns the events and the peak force between the blades.
    fn drive(
        jaw: &mut Jaw,
        knee: &mut Knee,
        pose: Rigid<ForcepsBase, Tool>,
        from: f64,
        to: f64,
    ) -> (Vec<Event>, f64) {
        let (mut events, mut peak_n) = (Vec::new(), 0.0_f64);
        for step in 0..=100 {
            let feed_mm = from + (to - from) * f64::from(step) / 100.0;
            jaw.look(pose, feed_mm, knee);
            peak_n = peak_n.max(jaw.load(feed_mm).bite_n);
            events.extend(jaw.feed(feed_mm, pose, knee));
        }
        (events, peak_n)
    }

    #[test]
    fn a_bite_cuts_once_and_lets_go_once() {
        let (mut jaw, mut knee, pose) = over_the_tear();
        let (events, peak_n) = drive(&mut jaw, &mut knee, pose, 0.0, 10.0);
        let [Event::Bit(volume)] = events[..] else {
            panic!("{events:?}")
        };
        assert!(
            volume.damaged_mm3 > 1.0 && volume.healthy_mm3 > 1.0,
            "{volume:?}"
        );
        assert!(peak_n > 35.0, "{peak_n} N");
        assert_eq!(jaw.held(), volume);
        let (events, _) = drive(&mut jaw, &mut knee, pose, 10.0, 0.0);
        assert_eq!(events, [Event::Released(volume)]);
        let (events, peak_n) = drive(&mut jaw, &mut knee, pose, 0.0, 10.0);
        assert_eq!(events, [Event::Bit(Volume::default())]);
        assert!(peak_n < 1e-9, "an empty jaw presses with {peak_n} N");
    }

    #[test]
    fn a_jaw_that_does_not_close_cuts_nothing() {
        let (mut jaw, mut knee, pose) = over_the_tear();
        let (events, peak_n) = drive(&mut jaw, &mut knee, pose, 0.0, 8.9);
        assert!(events.is_empty() && peak_n > 35.0);
        let (events, _) = drive(&mut jaw, &mut knee, pose, 8.9, 0.0);
        assert!(events.is_empty());
    }

    #[test]
    fn blades_pressed_on_each_other_stop_the_drive() {
        let (jaw, ..) = over_the_tear();
        assert!(jaw.load(10.0).bite_n.abs() < 1e-9);
        assert!(jaw.load(10.5).bite_n > 300.0);
    }
}
