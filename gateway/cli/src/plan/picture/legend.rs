//! What the signs of the picture mean.

use arthro_planning::tissue::THROAT_LIMIT;

use super::{
    ALARM, CONTOUR, HINGE, INK, LESION, ORDER, Panel, Scene, TEXT_MM, TISSUE, portal_color,
};
use crate::drawing::{Anchor, At, Color, Drawing, Pen};

const ROW_MM: f64 = 2.2;
const SIGN_MM: f64 = 3.4;
const COLUMNS: usize = 2;

/// A sign and its meaning.
enum Sign {
    Thickness { most_mm: f64 },
    Lesion,
    Contour,
    Bites { last: usize },
    Hinge { blocked: usize },
    Portal { index: usize, bites: Option<usize> },
    Measured,
}

pub fn height_mm(scene: &Scene<'_>) -> f64 {
    signs(scene).len().div_ceil(COLUMNS) as f64 * ROW_MM
}

pub fn draw(page: &mut Drawing, panel: &Panel, scene: &Scene<'_>) {
    let signs = signs(scene);
    let rows = signs.len().div_ceil(COLUMNS);
    for (index, sign) in signs.iter().enumerate() {
        let (column, row) = (index / rows.max(1), index % rows.max(1));
        let at = [
            panel.left + column as f64 * panel.width / COLUMNS as f64,
            panel.top + (row as f64 + 0.5) * ROW_MM,
        ];
        let meaning = show(page, sign, at);
        let text = [at[0] + SIGN_MM + 1.0, at[1] + 0.5 * TEXT_MM];
        page.text(text, TEXT_MM, Anchor::Left, INK, &meaning);
    }
}

fn signs(scene: &Scene<'_>) -> Vec<Sign> {
    let most_mm = scene.picture.site.thickest_mm();
    let mut signs = vec![Sign::Thickness { most_mm }];
    if !scene.lesion.is_empty() {
        signs.push(Sign::Lesion);
    }
    if !scene.contour.is_empty() {
        signs.push(Sign::Contour);
    }
    if !scene.bites.is_empty() {
        signs.push(Sign::Bites {
            last: scene.bites.len(),
        });
        signs.push(Sign::Hinge { blocked: 0 });
    }
    let blocked = scene
        .throat_shares
        .iter()
        .filter(|share| **share > THROAT_LIMIT)
        .count();
    if blocked > 0 {
        signs.push(Sign::Hinge { blocked });
    }
    match scene.portals.len() {
        0 => {}
        1 => signs.push(Sign::Portal {
            index: 0,
            bites: None,
        }),
        count => signs.extend((0..count).map(|index| Sign::Portal {
            index,
            bites: Some(scene.bites_through(index)),
        })),
    }
    if !scene.measured.is_empty() {
        signs.push(Sign::Measured);
    }
    signs
}

/// Draws the sign and says what it means.
fn show(page: &mut Drawing, sign: &Sign, [x, y]: At) -> String {
    let top = [x, y - 0.6];
    let box_mm = [SIGN_MM, 1.2];
    match sign {
        Sign::Thickness { most_mm } => {
            ramp(page, top, box_mm, &TISSUE);
            format!("tissue, up to {most_mm:.1} mm")
        }
        Sign::Lesion => {
            page.rectangle(top, box_mm, LESION.sheer(0.75));
            "damaged tissue".to_owned()
        }
        Sign::Contour => {
            page.line(vec![[x, y], [x + SIGN_MM, y]], Pen::new(CONTOUR, 0.28));
            "planned free edge".to_owned()
        }
        Sign::Bites { last } => {
            ramp(page, top, box_mm, &ORDER);
            format!("bites 1 to {last} in order")
        }
        Sign::Hinge { blocked: 0 } => {
            page.rectangle(top, box_mm, HINGE.sheer(0.3));
            "hinge of the jaw".to_owned()
        }
        Sign::Hinge { blocked } => {
            page.rectangle(top, box_mm, ALARM.sheer(0.45));
            format!("hinge in tissue: {blocked}")
        }
        Sign::Portal { index, bites } => {
            let color = portal_color(*index);
            page.line(vec![[x, y], [x + SIGN_MM - 1.0, y]], Pen::new(color, 0.35));
            let tip = x + SIGN_MM;
            page.area(
                vec![[tip, y], [tip - 1.4, y + 0.7], [tip - 1.4, y - 0.7]],
                color,
            );
            match bites {
                None => "from the portal".to_owned(),
                Some(1) => format!("portal {}: 1 bite", index + 1),
                Some(bites) => format!("portal {}: {bites} bites", index + 1),
            }
        }
        Sign::Measured => {
            let middle = x + 0.5 * SIGN_MM;
            let pen = Pen::new(INK, 0.12);
            page.line(vec![[middle - 0.4, y], [middle + 0.4, y]], pen);
            page.line(vec![[middle, y - 0.4], [middle, y + 0.4]], pen);
            "measured jaw".to_owned()
        }
    }
}

fn ramp(page: &mut Drawing, [x, y]: At, [width, height]: [f64; 2], colors: &[[u8; 3]]) {
    const STEPS: usize = 17;
    for step in 0..STEPS {
        let share = step as f64 / STEPS as f64;
        let rest = [width * (1.0 - share), height];
        page.rectangle([x + share * width, y], rest, Color::along(colors, share));
    }
}
