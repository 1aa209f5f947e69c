//! The picture of a plan: the meniscus seen from superior with its bites in order, and beside it the rim that they leave.

use arthro_geometry::{Point3, Vector3};
use arthro_planning::jaw::{Bite, Jaw};

use super::site::Site;
use crate::bites_file::LesionPoints;
use crate::drawing::{Anchor, At, Color, Drawing, width_mm};

mod arrow;
mod labels;
mod legend;
mod rim_map;
mod view;

const INK: Color = Color::solid([31, 41, 55]);
const FAINT: Color = Color::solid([120, 130, 145]);
const PAPER: Color = Color::solid([255, 255, 255]);
const PANEL: Color = Color::solid([246, 247, 249]);
const LESION: Color = Color::solid([200, 38, 48]);
const CONTOUR: Color = Color::solid([16, 24, 60]);
const HINGE: Color = Color::solid([96, 102, 112]);
const ALARM: Color = Color::solid([214, 40, 40]);
/// One for each portal, in turn.
const PORTALS: [Color; 4] = [
    Color::solid([13, 110, 120]),
    Color::solid([190, 84, 10]),
    Color::solid([150, 40, 140]),
    Color::solid([90, 100, 20]),
];
/// From thin to thick tissue.
const TISSUE: [[u8; 3]; 3] = [[250, 240, 224], [236, 212, 176], [206, 168, 122]];
/// From the first to the last bite.
const ORDER: [[u8; 3]; 4] = [[70, 40, 130], [44, 98, 168], [24, 146, 140], [70, 170, 70]];

const MARGIN_MM: f64 = 2.0;
const HEADER_MM: f64 = 8.0;
const TITLE_MM: f64 = 1.7;
const TEXT_MM: f64 = 1.05;
/// Left free around the tissue.
const AROUND_MM: f64 = 4.5;
const SIDE_MM: f64 = 46.0;
const RIM_MAP_MM: f64 = 24.0;

/// What is drawn; all points in ct, mm.
pub struct Picture<'a> {
    /// What people call the meniscus.
    pub title: &'a str,
    /// The score in one line.
    pub headline: &'a str,
    /// The meniscus.
    pub site: &'a Site,
    /// The jaw that bites.
    pub jaw: Jaw,
    /// In the order of execution.
    pub bites: &'a [Bite],
    /// Through which of the portals each comes, if known.
    pub through: &'a [Option<usize>],
    /// The new free edge that is aimed at; may be empty.
    pub contour: &'a [Point3],
    /// The damaged tissue.
    pub lesion: Option<&'a LesionPoints>,
    /// Where the forceps enter.
    pub portals: &'a [Point3],
    /// Where the jaw was when it closed.
    pub measured: &'a [Point3],
    /// The rim that must be left, mm.
    pub rim_min_mm: Option<f64>,
}

/// The scene in the axes of the crescent.
struct Scene<'a> {
    picture: &'a Picture<'a>,
    bites: Vec<Bite>,
    contour: Vec<Point3>,
    lesion: Vec<Point3>,
    portals: Vec<Point3>,
    measured: Vec<Point3>,
    throat_shares: Vec<f64>,
}

/// A rectangle of the page, mm.
#[derive(Clone, Copy, Debug)]
struct Panel {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl Picture<'_> {
    /// The page.
    pub fn draw(&self) -> Drawing {
        let scene = Scene::of(self);
        let frame = view::Frame::around(self.site);
        let [width, height] = frame.size_mm();
        let view = Panel {
            left: MARGIN_MM,
            top: HEADER_MM,
            width,
            height,
        };
        let rim = Panel {
            left: view.right() + MARGIN_MM,
            top: HEADER_MM,
            width: SIDE_MM,
            height: RIM_MAP_MM,
        };
        let legend = Panel {
            top: rim.bottom() + 1.5,
            height: legend::height_mm(&scene),
            ..rim
        };
        let headline_mm = width_mm(self.headline, TEXT_MM) + 2.0 * MARGIN_MM;
        let size_mm = [
            (rim.right() + MARGIN_MM).max(headline_mm),
            view.bottom().max(legend.bottom()) + MARGIN_MM,
        ];
        let mut page = Drawing::new(format!("{}: {}", self.title, self.headline), size_mm);
        page.rectangle([0.0, 0.0], size_mm, PAPER);
        page.text([MARGIN_MM, 3.6], TITLE_MM, Anchor::Left, INK, self.title);
        page.text([MARGIN_MM, 6.5], TEXT_MM, Anchor::Left, INK, self.headline);
        view::draw(&mut page, &view, &frame, &scene);
        rim_map::draw(&mut page, &rim, &scene);
        legend::draw(&mut page, &legend, &scene);
        page
    }
}

impl<'a> Scene<'a> {
    fn of(picture: &'a Picture<'a>) -> Self {
        let meniscal_from_ct = picture.site.crescent.ct_from_meniscal.inverse();
        let local = |points: &[Point3]| {
            points
                .iter()
                .map(|point| meniscal_from_ct * *point)
                .collect()
        };
        let bites: Vec<Bite> = picture
            .bites
            .iter()
            .map(|bite| bite.carried(&meniscal_from_ct))
            .collect();
        Self {
            throat_shares: picture.site.throat_shares(&bites, &picture.jaw),
            bites,
            contour: local(picture.contour),
            lesion: picture
                .lesion
                .map_or_else(Vec::new, |lesion| local(&lesion.points)),
            portals: local(picture.portals),
            measured: local(picture.measured),
            picture,
        }
    }

    /// The portal of a bite, where there is more than one.
    fn portal_of(&self, order: usize) -> Option<usize> {
        let portal = self.picture.through.get(order).copied().flatten();
        portal.filter(|_| self.portals.len() > 1)
    }

    /// How many bites come through a portal.
    fn bites_through(&self, portal: usize) -> usize {
        let bites = (0..self.bites.len()).filter(|order| self.portal_of(*order) == Some(portal));
        bites.count()
    }

    /// The colour of the bite that is made as number `order`, counted from 0.
    fn color(&self, order: usize) -> Color {
        let last = self.bites.len().saturating_sub(1).max(1);
        Color::along(&ORDER, order as f64 / last as f64)
    }
}

/// The colour of the portal with this index.
fn portal_color(portal: usize) -> Color {
    PORTALS[portal % PORTALS.len()]
}

impl Panel {
    fn right(&self) -> f64 {
        self.left + self.width
    }

    fn bottom(&self) -> f64 {
        self.top + self.height
    }

    fn corner(&self) -> At {
        [self.left, self.top]
    }

    fn size(&self) -> [f64; 2] {
        [self.width, self.height]
    }
}

/// Across the shaft.
fn across(bite: &Bite) -> Vector3 {
    bite.opening.cross(&bite.approach)
}
