//! Where the forceps come from: an arrow at the border of the view for each portal.

use arthro_geometry::{Point3, Vector3};

use super::{Panel, Scene, TEXT_MM};
use crate::drawing::{Anchor, At, Color, Drawing, Pen};

const ARROW_MM: f64 = 5.0;
const BORDER_MM: f64 = 0.8;

/// An arrow from the border of the panel, where the shaft comes in.
pub struct Arrow {
    begin: At,
    /// Unit direction from the border to the bites.
    along: [f64; 2],
}

impl Arrow {
    /// `None` if the portal lies in the picture.
    fn from(portal: At, target: At, panel: &Panel) -> Option<Self> {
        let way = [portal[0] - target[0], portal[1] - target[1]];
        let borders = [
            (panel.left + BORDER_MM, panel.right() - BORDER_MM),
            (panel.top + BORDER_MM, panel.bottom() - BORDER_MM),
        ];
        // Share of the way from the bites to the portal at which the shaft crosses the border.
        let share = [0, 1].map(|axis| {
            let (low, high) = borders[axis];
            let border = if way[axis] < 0.0 { low } else { high };
            match way[axis] {
                0.0 => f64::INFINITY,
                way => (border - target[axis]) / way,
            }
        });
        let share = share[0].min(share[1]);
        if !(0.0..1.0).contains(&share) {
            return None;
        }
        let length_mm = way[0].hypot(way[1]);
        Some(Self {
            begin: [target[0] + share * way[0], target[1] + share * way[1]],
            along: way.map(|value| -value / length_mm),
        })
    }

    fn at(&self, ahead_mm: f64, aside_mm: f64) -> At {
        let [x, y] = self.along;
        [
            self.begin[0] + x * ahead_mm - y * aside_mm,
            self.begin[1] + y * ahead_mm + x * aside_mm,
        ]
    }

    /// The middle of the arrow.
    pub fn middle(&self) -> At {
        self.at(0.5 * ARROW_MM, 0.0)
    }

    pub fn draw(&self, page: &mut Drawing, panel: &Panel, name: &str, color: Color) {
        page.line(
            vec![self.begin, self.at(ARROW_MM, 0.0)],
            Pen::new(color, 0.35),
        );
        let (neck_mm, tip_mm) = (ARROW_MM - 0.4, ARROW_MM + 1.2);
        page.area(
            vec![
                self.at(tip_mm, 0.0),
                self.at(neck_mm, 0.75),
                self.at(neck_mm, -0.75),
            ],
            color,
        );
        let [x, y] = self.begin;
        let is_steep = self.along[1].abs() > self.along[0].abs();
        // Beside a steep arrow; under or over a flat one, where it does not lead, if there is room.
        let baseline = match (is_steep, self.along[1] < 0.0) {
            (true, true) => y - 0.5,
            (true, false) => y + TEXT_MM,
            (false, true) => y + 1.0 + TEXT_MM,
            (false, false) => y - 1.0,
        };
        let has_room = (panel.top + TEXT_MM..=panel.bottom()).contains(&baseline);
        let beside_mm = if is_steep || !has_room { 2.4 } else { 0.0 };
        let baseline = if has_room {
            baseline
        } else {
            y + 0.6 * TEXT_MM
        };
        let is_right = x > 0.5 * (panel.left + panel.right());
        let (x, anchor) = if is_right {
            (x - beside_mm, Anchor::Right)
        } else {
            (x + beside_mm, Anchor::Left)
        };
        page.text([x, baseline], TEXT_MM, anchor, color, name);
    }
}

/// Each portal's arrow leads to the middle of its bites, or of all where it has none.
pub fn of_portals(
    panel: &Panel,
    scene: &Scene<'_>,
    place: &impl Fn(&Point3) -> At,
) -> Vec<Option<Arrow>> {
    let middle = |is_meant: &dyn Fn(usize) -> bool| {
        let meant = scene.bites.iter().enumerate();
        let meant = meant.filter(|(order, _)| is_meant(*order));
        let (sum, count) = meant.fold((Vector3::zeros(), 0usize), |(sum, count), (_, bite)| {
            (sum + bite.center.coords, count + 1)
        });
        (count > 0).then(|| place(&Point3::from(sum / count as f64)))
    };
    let portals = scene.portals.iter().enumerate();
    portals
        .map(|(index, portal)| {
            let own = middle(&|order| scene.portal_of(order) == Some(index));
            let target = own.or_else(|| middle(&|_| true));
            let target = target.unwrap_or_else(|| place(&Point3::origin()));
            Arrow::from(place(portal), target, panel)
        })
        .collect()
}
