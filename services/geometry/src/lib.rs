//! Geometry shared by every room of the house: transforms typed by frame, clouds, meshes, volumes
//! and the file formats they come in.
//!
//! Millimetres and radians throughout. A transform is named `a_from_b` and typed [`Rigid<A, B>`],
//! so that `base_from_camera * camera_from_ct * point_in_ct` compiles and any other order does not.
//! Surfaces come from and go to PLY, PCD, STL and OBJ files ([`surface_file`]), of which each has a module.
//! Points and curves that somebody set on a model come as [`markups`].
//! The file formats refuse a surface whose space and unit nobody states: a mix-up of LPS and RAS is
//! a half turn that passes every shape check.

pub mod cloud;
pub mod frame;
pub mod markups;
pub mod mesh;
pub mod nrrd;
pub mod obj;
pub mod pcd;
pub mod phantom;
pub mod ply;
pub mod sampled;
pub mod scan;
pub mod stated;
pub mod stl;
pub mod surface;
pub mod surface_file;
pub mod transform;
pub mod volume;

pub use cloud::Cloud;
pub use mesh::Mesh;
pub use nalgebra;
pub use scan::Scan;
pub use transform::{Rigid, Similarity};

/// A point in millimetres.
pub type Point3 = nalgebra::Point3<f64>;
/// A displacement in millimetres, or a unit direction.
pub type Vector3 = nalgebra::Vector3<f64>;
/// A unit quaternion.
pub type Rotation = nalgebra::UnitQuaternion<f64>;
