//! The bones around the meniscus.
//!
//! All of it is in the axes of the crescent, z superior, in which opening the joint lifts the femur
//! along z. Bones come as meshes from a scan or, when there is none, as a sphere and a plane that
//! stand for condyle and plateau.

use arthro_geometry::{Mesh, Point3};

use crate::error::Error;

/// A bone.
#[derive(Clone, Debug)]
pub enum Obstacle {
    /// Triangles in the axes of the crescent, mm. If they are closed what is inside is bone; otherwise
    /// they are a thin wall.
    Mesh(Mesh),
    /// A ball that stands for a condyle.
    Ball {
        /// Its middle, mm.
        center: Point3,
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// Everything below a height stands for the plateau.
    Below {
        /// The height, mm.
        height_mm: f64,
    },
}

/// The joint around a meniscus.
#[derive(Clone, Debug, Default)]
pub struct Joint {
    /// The femur where it was scanned.
    pub femur: Option<Obstacle>,
    /// The tibia.
    pub tibia: Option<Obstacle>,
    /// How far the femur is lifted from there, mm; negative when it is lowered.
    pub opening_mm: f64,
}

/// The sizes of a joint of which no bone was scanned; the defaults are those of the simulated knee.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Generic {
    /// Radius of the condyle, mm.
    pub condyle_radius_mm: f64,
    /// Between the underside of the meniscus and the tibia's bone, mm.
    pub cartilage_mm: f64,
}

impl Default for Generic {
    fn default() -> Self {
        Self {
            condyle_radius_mm: 24.0,
            cartilage_mm: 3.0,
        }
    }
}

impl Generic {
    /// A condyle above the centre of the hole that would rest at the height of the meniscus' top.
    /// `meniscus` is in the axes of its crescent. The joint's opening then is the gap between
    /// them, negative while the condyle dips into the hollow.
    ///
    /// # Errors
    /// When the mesh is empty.
    pub fn femur(&self, meniscus: &Mesh) -> Result<Obstacle, Error> {
        let (_, high) = bounds(meniscus)?;
        Ok(Obstacle::Ball {
            center: Point3::new(0.0, 0.0, high.z + self.condyle_radius_mm),
            radius_mm: self.condyle_radius_mm,
        })
    }

    /// A plateau below the cartilage on which the meniscus lies.
    ///
    /// # Errors
    /// When the mesh is empty.
    pub fn tibia(&self, meniscus: &Mesh) -> Result<Obstacle, Error> {
        let (low, _) = bounds(meniscus)?;
        Ok(Obstacle::Below {
            height_mm: low.z - self.cartilage_mm,
        })
    }

    /// Both with a gap between the top of the meniscus and the condyle.
    ///
    /// # Errors
    /// When the mesh is empty.
    pub fn joint(&self, meniscus: &Mesh, gap_mm: f64) -> Result<Joint, Error> {
        Ok(Joint {
            femur: Some(self.femur(meniscus)?),
            tibia: Some(self.tibia(meniscus)?),
            opening_mm: gap_mm,
        })
    }
}

fn bounds(meniscus: &Mesh) -> Result<(Point3, Point3), Error> {
    Ok(meniscus
        .bounds()
        .ok_or(arthro_geometry::volume::Error::Empty)?)
}
