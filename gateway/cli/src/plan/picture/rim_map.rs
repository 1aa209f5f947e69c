//! The rim that the bites leave, over the angle about the crescent: left and right as in the view from superior.

use arthro_planning::evaluation::Task;
use arthro_planning::evaluation::edge::{Edge, Ray};
use arthro_planning::evaluation::time::Timing;
use arthro_planning::jaw::Cut;
use arthro_planning::lesion::Lesion;
use arthro_planning::tissue::THROAT_LIMIT;

use super::{ALARM, CONTOUR, FAINT, INK, PANEL, Panel, Scene, TEXT_MM};
use crate::drawing::{Anchor, At, Color, Drawing, Pen, width_mm};
use crate::plan::site::Site;

const TISSUE: Color = Color::solid([222, 205, 180]);
const LEFT: Color = Color::solid([70, 150, 120]);
const TICK_DEG: i32 = 30;
/// The rim ends in points at the horns; words stand further in, mm.
const LIMIT_INSET_MM: f64 = 3.0;

/// Where angles and widths lie on the page.
struct Axes {
    plot: Panel,
    first_rad: f64,
    last_rad: f64,
    top_mm: f64,
}

impl Axes {
    fn x(&self, angle_rad: f64) -> f64 {
        let share = (self.last_rad - angle_rad) / (self.last_rad - self.first_rad);
        self.plot.left + share * self.plot.width
    }

    fn y(&self, width_mm: f64) -> f64 {
        self.plot.bottom() - (width_mm / self.top_mm).clamp(0.0, 1.0) * self.plot.height
    }

    fn at(&self, angle_rad: f64, width_mm: f64) -> At {
        [self.x(angle_rad), self.y(width_mm)]
    }
}

pub fn draw(page: &mut Drawing, panel: &Panel, scene: &Scene<'_>) {
    page.rectangle(panel.corner(), panel.size(), PANEL);
    let rays = rays(scene);
    let (Some(first), Some(last)) = (rays.first(), rays.last()) else {
        return;
    };
    let widest_mm = rays.iter().map(whole_mm).fold(1.0, f64::max);
    let axes = Axes {
        plot: Panel {
            left: panel.left + 4.0,
            top: panel.top + 4.0,
            width: panel.width - 7.0,
            height: panel.height - 7.5,
        },
        first_rad: first.angle_rad,
        last_rad: last.angle_rad,
        top_mm: widest_mm + 1.0,
    };
    let title = [panel.left + 1.0, panel.top + 1.0 + TEXT_MM];
    page.text(
        title,
        TEXT_MM,
        Anchor::Left,
        INK,
        "rim left (mm) over the angle (deg)",
    );
    grid(page, &axes);
    fill(
        page,
        &axes,
        rays.iter().map(|ray| (ray.angle_rad, whole_mm(ray))),
        TISSUE,
    );
    fill(
        page,
        &axes,
        rays.iter().map(|ray| (ray.angle_rad, ray.rim_mm)),
        LEFT.sheer(0.75),
    );
    contour(page, &axes, scene);
    let narrowest = rays
        .iter()
        .filter(|ray| ray.is_bitten)
        .min_by(|a, b| a.rim_mm.total_cmp(&b.rim_mm));
    if let Some(limit_mm) = scene.picture.rim_min_mm {
        limit(page, &axes, limit_mm, narrowest);
    }
    if let Some(narrowest) = narrowest {
        let limit_mm = scene.picture.rim_min_mm.unwrap_or(0.0);
        let is_below = narrowest.rim_mm < limit_mm;
        minimum(page, &axes, narrowest, if is_below { ALARM } else { INK });
    }
}

/// The edge that the bites leave, as the evaluation measures it.
fn rays(scene: &Scene<'_>) -> Vec<Ray> {
    let picture = scene.picture;
    let Site {
        crescent, voxels, ..
    } = picture.site;
    let task = Task {
        crescent,
        voxels,
        lesion: &Lesion::of_voxels(vec![false; voxels.centers().len()], voxels),
        band: None,
        jaw: picture.jaw,
        portals: &scene.portals,
        timing: Timing::default(),
        throat_limit: THROAT_LIMIT,
    };
    let cuts = scene.bites.iter().map(|bite| bite.cut(&picture.jaw));
    let cuts: Vec<Cut> = cuts.collect();
    Edge::after(&task, &cuts).rays
}

/// Width of the whole tissue on a ray, mm.
fn whole_mm(ray: &Ray) -> f64 {
    ray.rim_mm + ray.new_mm - ray.old_mm
}

fn grid(page: &mut Drawing, axes: &Axes) {
    let plot = &axes.plot;
    let pen = Pen::new(FAINT.sheer(0.35), 0.08);
    let step_mm = if axes.top_mm > 12.0 { 4 } else { 2 };
    for width_mm in (0..=axes.top_mm.floor() as i32).step_by(step_mm) {
        let y = axes.y(f64::from(width_mm));
        page.line(vec![[plot.left, y], [plot.right(), y]], pen);
        let at = [plot.left - 0.6, y + 0.5 * TEXT_MM];
        page.text(at, TEXT_MM, Anchor::Right, FAINT, &width_mm.to_string());
    }
    for tick in -6..=6 {
        let angle_deg = tick * TICK_DEG;
        let angle_rad = f64::from(angle_deg).to_radians();
        if !(axes.first_rad..=axes.last_rad).contains(&angle_rad) {
            continue;
        }
        let x = axes.x(angle_rad);
        page.line(vec![[x, plot.top], [x, plot.bottom()]], pen);
        let at = [x, plot.bottom() + 0.8 + TEXT_MM];
        page.text(at, TEXT_MM, Anchor::Middle, FAINT, &angle_deg.to_string());
    }
}

fn fill(
    page: &mut Drawing,
    axes: &Axes,
    curve: impl DoubleEndedIterator<Item = (f64, f64)>,
    color: Color,
) {
    let mut corners: Vec<At> = vec![axes.at(axes.first_rad, 0.0)];
    corners.extend(curve.map(|(angle_rad, width_mm)| axes.at(angle_rad, width_mm)));
    corners.push(axes.at(axes.last_rad, 0.0));
    page.area(corners, color);
}

fn contour(page: &mut Drawing, axes: &Axes, scene: &Scene<'_>) {
    let crescent = &scene.picture.site.crescent;
    let points = scene.contour.iter().filter_map(|point| {
        let angle_rad = crescent.angle_rad(point);
        let rim_mm = crescent.rim_mm(angle_rad)?;
        Some(axes.at(angle_rad, rim_mm - point.xy().coords.norm()))
    });
    let points: Vec<At> = points.collect();
    if !points.is_empty() {
        page.line(points, Pen::new(CONTOUR, 0.24));
    }
}

fn limit(page: &mut Drawing, axes: &Axes, limit_mm: f64, narrowest: Option<&Ray>) {
    let (plot, y) = (&axes.plot, axes.y(limit_mm));
    page.line(
        vec![[plot.left, y], [plot.right(), y]],
        Pen::new(ALARM, 0.18).dashed(0.8),
    );
    // On the side that the words on the minimum leave free.
    let is_left =
        narrowest.is_some_and(|ray| ray.angle_rad < 0.5 * (axes.first_rad + axes.last_rad));
    let (x, anchor) = if is_left {
        (plot.left + LIMIT_INSET_MM, Anchor::Left)
    } else {
        (plot.right() - LIMIT_INSET_MM, Anchor::Right)
    };
    let text = format!("limit {limit_mm:.1}");
    page.text([x, y + 0.5 + TEXT_MM], TEXT_MM, anchor, ALARM, &text);
}

fn minimum(page: &mut Drawing, axes: &Axes, ray: &Ray, color: Color) {
    let at = axes.at(ray.angle_rad, ray.rim_mm);
    let words = format!(
        "min {:.1} at {:+.0} deg",
        ray.rim_mm,
        ray.angle_rad.to_degrees()
    );
    let half_mm = 0.5 * width_mm(&words, TEXT_MM) + 0.5;
    let middle = at[0].clamp(axes.plot.left + half_mm, axes.plot.right() - half_mm);
    // On the axis below the mark, or over everything if there is no room.
    let below = axes.plot.bottom() - 0.6;
    let above = axes.plot.top + TEXT_MM;
    let has_room = at[1] < below - TEXT_MM - 1.0;
    let (baseline, end) = if has_room {
        (below, below - TEXT_MM - 0.3)
    } else {
        (above, above + 0.3)
    };
    page.line(vec![at, [at[0], end]], Pen::new(color, 0.09));
    page.disc(at, 0.55, Color::solid([255; 3]));
    page.disc(at, 0.42, color);
    page.text([middle, baseline], TEXT_MM, Anchor::Middle, color, &words);
}
