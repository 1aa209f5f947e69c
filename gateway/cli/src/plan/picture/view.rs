//! The meniscus seen from superior, the body at the top: tissue by its thickness, damage, contour, jaws in order.

use arthro_geometry::{Point3, Vector3};
use arthro_planning::jaw::Bite;
use arthro_planning::tissue::THROAT_LIMIT;

use super::labels::{self, Label};
use super::{
    ALARM, AROUND_MM, CONTOUR, FAINT, HINGE, INK, LESION, PANEL, Panel, Scene, TEXT_MM, TISSUE,
    across, portal_color,
};
use crate::drawing::{Anchor, At, Color, Drawing, Pen, Shape};
use crate::plan::site::Site;

/// Steps of the shading, and cells across the tissue.
const SHADES: usize = 9;
const CELLS: usize = 24;
/// Rays to each side over which the shading is averaged.
const WINDOW: usize = 5;
/// Lesion points nearer than this in the plane are drawn as one, mm.
const LESION_CELL_MM: f64 = 0.25;
const SCALE_BAR_MM: f64 = 10.0;
const ARROW_MM: f64 = 5.0;
const BORDER_MM: f64 = 0.8;
/// Around the number of a bite, in the colour of its portal, mm.
const RING_MM: f64 = 0.25;

/// How the plane of the crescent lies in the panel.
pub struct Frame {
    x_max: f64,
    y_max: f64,
    size_mm: [f64; 2],
}

impl Frame {
    /// Holds the tissue with some room around it.
    pub fn around(site: &Site) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for center in site.voxels.centers() {
            for (axis, value) in [center.x, center.y].into_iter().enumerate() {
                low[axis] = low[axis].min(value - AROUND_MM);
                high[axis] = high[axis].max(value + AROUND_MM);
            }
        }
        Self {
            x_max: high[0],
            y_max: high[1],
            size_mm: [high[1] - low[1], high[0] - low[0]],
        }
    }

    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    fn place(&self, panel: &Panel, point: &Point3) -> At {
        [
            panel.left + self.y_max - point.y,
            panel.top + self.x_max - point.x,
        ]
    }
}

pub fn draw(page: &mut Drawing, panel: &Panel, frame: &Frame, scene: &Scene<'_>) {
    page.rectangle(panel.corner(), panel.size(), PANEL);
    let place = |point: &Point3| frame.place(panel, point);
    tissue(page, scene.picture.site, &place);
    for order in 0..scene.bites.len() {
        footprint(page, scene, order, &place);
    }
    lesion(page, scene, &place);
    for (order, bite) in scene.bites.iter().enumerate() {
        let [_, jaw] = rectangles(scene, bite, &place);
        let color = scene.portal_of(order).map(portal_color);
        let pen = Pen::new(color.unwrap_or_else(|| scene.color(order)), 0.16);
        page.outline(jaw, pen);
    }
    let contour: Vec<At> = scene.contour.iter().map(place).collect();
    if !contour.is_empty() {
        page.line(contour, Pen::new(CONTOUR, 0.28));
    }
    for point in &scene.measured {
        cross(page, place(point));
    }
    numbers(page, scene, &place);
    let arrows = arrows(panel, scene, &place);
    for (index, arrow) in arrows.iter().enumerate() {
        let name = match arrows.len() {
            1 => "portal".to_owned(),
            _ => format!("portal {}", index + 1),
        };
        if let Some(arrow) = arrow {
            arrow.draw(page, panel, &name, portal_color(index));
        }
    }
    scale_bar(page, panel, &arrows);
}

/// The tissue as cells between its free edge and its rim, thicker ones painted over thinner ones.
fn tissue(page: &mut Drawing, site: &Site, place: &impl Fn(&Point3) -> At) {
    let crescent = &site.crescent;
    let rays: Vec<(f64, f64, f64)> = crescent
        .rays()
        .step_by(2)
        .filter_map(|angle_rad| {
            Some((
                angle_rad,
                crescent.edge_mm(angle_rad)?,
                crescent.rim_mm(angle_rad)?,
            ))
        })
        .collect();
    let at = |(angle_rad, edge_mm, rim_mm): (f64, f64, f64), share: f64| {
        let radius_mm = edge_mm + share * (rim_mm - edge_mm);
        Point3::new(
            radius_mm * angle_rad.cos(),
            radius_mm * angle_rad.sin(),
            0.0,
        )
    };
    let share_of = |cell: usize| cell as f64 / CELLS as f64;
    let thickness_mm: Vec<Vec<f64>> = rays
        .iter()
        .map(|ray| {
            let middles = (0..CELLS).map(|cell| at(*ray, share_of(cell) + 0.5 / CELLS as f64));
            middles
                .map(|point| site.thickness_mm(point.x, point.y).unwrap_or(0.0))
                .collect()
        })
        .collect();
    let smooth_mm: Vec<Vec<f64>> = (0..rays.len())
        .map(|ray| {
            (0..CELLS)
                .map(|cell| mean_along(&thickness_mm, ray, cell))
                .collect()
        })
        .collect();
    let thickest_mm = smooth_mm
        .iter()
        .flatten()
        .copied()
        .fold(f64::MIN_POSITIVE, f64::max);
    for shade in 0..SHADES {
        let share = shade as f64 / SHADES as f64;
        let mut rings: Vec<Vec<At>> = Vec::new();
        for (pair, cells) in rays.windows(2).zip(&smooth_mm) {
            for (from, to) in runs(cells, share * thickest_mm) {
                let (inner, outer) = (share_of(from), share_of(to));
                let corners = [
                    at(pair[0], inner),
                    at(pair[0], outer),
                    at(pair[1], outer),
                    at(pair[1], inner),
                ];
                rings.push(corners.iter().map(place).collect());
            }
        }
        let fill = Color::along(&TISSUE, share);
        page.shapes.push(Shape::Area { rings, fill });
    }
    let inner = rays.iter().map(|ray| place(&at(*ray, 0.0)));
    let outer = rays.iter().rev().map(|ray| place(&at(*ray, 1.0)));
    page.outline(inner.chain(outer).collect(), Pen::new(FAINT, 0.12));
}

/// The mean over neighbouring rays, which takes the steps of the voxels out of the shading.
fn mean_along(rays: &[Vec<f64>], ray: usize, cell: usize) -> f64 {
    let (from, to) = (
        ray.saturating_sub(WINDOW),
        (ray + WINDOW + 1).min(rays.len()),
    );
    let sum: f64 = rays[from..to].iter().map(|cells| cells[cell]).sum();
    sum / (to - from) as f64
}

/// The first index and the one after the last of each run of values that are at least `least`.
fn runs(values: &[f64], least: f64) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (index, _) in values
        .iter()
        .enumerate()
        .filter(|(_, value)| **value >= least)
    {
        match runs.last_mut() {
            Some((_, end)) if *end == index => *end += 1,
            _ => runs.push((index, index + 1)),
        }
    }
    runs
}

fn lesion(page: &mut Drawing, scene: &Scene<'_>, place: &impl Fn(&Point3) -> At) {
    let spacing_mm = scene.picture.lesion.map_or(0.0, |lesion| lesion.spacing_mm);
    let mut cells: Vec<(i64, i64)> = scene
        .lesion
        .iter()
        .map(|point| [point.x, point.y].map(|value| (value / LESION_CELL_MM).round() as i64))
        .map(|[i, j]| (i, j))
        .collect();
    cells.sort_unstable();
    cells.dedup();
    let half_mm = 0.5 * spacing_mm;
    let rings: Vec<Vec<At>> = cells
        .into_iter()
        .map(|(i, j)| {
            let [x, y] = place(&Point3::new(
                i as f64 * LESION_CELL_MM,
                j as f64 * LESION_CELL_MM,
                0.0,
            ));
            let (left, right, top, bottom) = (x - half_mm, x + half_mm, y - half_mm, y + half_mm);
            vec![[left, top], [right, top], [right, bottom], [left, bottom]]
        })
        .collect();
    if !rings.is_empty() {
        let fill = LESION.sheer(0.75);
        page.shapes.push(Shape::Area { rings, fill });
    }
}

/// What the jaw cuts, and behind it the place of its hinge.
fn footprint(page: &mut Drawing, scene: &Scene<'_>, order: usize, place: &impl Fn(&Point3) -> At) {
    let [hinge, jaw] = rectangles(scene, &scene.bites[order], place);
    page.area(jaw, scene.color(order).sheer(0.18));
    if scene.throat_shares[order] > THROAT_LIMIT {
        page.area(hinge, ALARM.sheer(0.45));
    } else {
        page.area(hinge, HINGE.sheer(0.18));
    }
}

/// The corners of the hinge's and of the jaw's footprint.
fn rectangles(scene: &Scene<'_>, bite: &Bite, place: &impl Fn(&Point3) -> At) -> [Vec<At>; 2] {
    let size = &scene.picture.jaw;
    let (ahead_mm, aside_mm) = (0.5 * size.length_mm, 0.5 * size.width_mm);
    let at = |along_mm: f64, across_mm: f64| {
        place(&(bite.center + bite.approach * along_mm + across(bite) * across_mm))
    };
    [
        (-ahead_mm - size.throat_mm, -ahead_mm),
        (-ahead_mm, ahead_mm),
    ]
    .map(|(from_mm, to_mm)| {
        vec![
            at(from_mm, -aside_mm),
            at(to_mm, -aside_mm),
            at(to_mm, aside_mm),
            at(from_mm, aside_mm),
        ]
    })
}

fn numbers(page: &mut Drawing, scene: &Scene<'_>, place: &impl Fn(&Point3) -> At) {
    let centers: Vec<At> = scene.bites.iter().map(|bite| place(&bite.center)).collect();
    let marks: Vec<At> = scene.measured.iter().map(place).collect();
    let hole = place(&Point3::origin());
    let labels = labels::spread(&centers, &marks, hole);
    for Label { center, at } in &labels {
        if center != at {
            page.line(vec![*center, *at], Pen::new(INK, 0.09));
            page.disc(*center, 0.22, INK);
        }
    }
    for (order, Label { at, .. }) in labels.iter().enumerate() {
        if let Some(portal) = scene.portal_of(order) {
            page.disc(*at, labels::RADIUS_MM + RING_MM, portal_color(portal));
        }
        page.disc(*at, labels::RADIUS_MM, scene.color(order));
        let baseline = [at[0], at[1] + 0.5 * labels::TEXT_MM];
        let white = Color::solid([255; 3]);
        page.text(
            baseline,
            labels::TEXT_MM,
            Anchor::Middle,
            white,
            &(order + 1).to_string(),
        );
    }
}

fn cross(page: &mut Drawing, [x, y]: At) {
    let pen = Pen::new(INK, 0.12);
    page.line(vec![[x - 0.4, y], [x + 0.4, y]], pen);
    page.line(vec![[x, y - 0.4], [x, y + 0.4]], pen);
}

/// An arrow from the border of the panel, where the shaft comes in.
struct Arrow {
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

    fn draw(&self, page: &mut Drawing, panel: &Panel, name: &str, color: Color) {
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
fn arrows(panel: &Panel, scene: &Scene<'_>, place: &impl Fn(&Point3) -> At) -> Vec<Option<Arrow>> {
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

fn scale_bar(page: &mut Drawing, panel: &Panel, arrows: &[Option<Arrow>]) {
    let y = panel.bottom() - 1.5;
    let corners = [panel.left + 1.5, panel.right() - 1.5 - SCALE_BAR_MM];
    let between = 0.5 * (corners[0] + corners[1]);
    // Arrows with their names keep the bar away.
    let is_free = |left: &f64| {
        let mut taken = arrows
            .iter()
            .flatten()
            .map(|arrow| arrow.at(0.5 * ARROW_MM, 0.0));
        taken.all(|[x, above]| above < y - 5.0 || x < left - 6.0 || x > left + SCALE_BAR_MM + 6.0)
    };
    let left = [corners[0], corners[1], between]
        .into_iter()
        .find(is_free)
        .unwrap_or(between);
    let pen = Pen::new(INK, 0.2);
    page.line(vec![[left, y], [left + SCALE_BAR_MM, y]], pen);
    for x in [left, left + SCALE_BAR_MM] {
        page.line(vec![[x, y - 0.5], [x, y + 0.5]], pen);
    }
    let middle = left + 0.5 * SCALE_BAR_MM;
    page.text([middle, y - 0.8], TEXT_MM, Anchor::Middle, INK, "10 mm");
    let corner = [panel.right() - 1.5, panel.top + 1.0 + TEXT_MM];
    page.text(corner, TEXT_MM, Anchor::Right, FAINT, "seen from superior");
}
