//! One surface through every kind of file, and how a file's kind is told.
//!
//! Real menisci come from the folder `$ARTHRO_DATA`, by default `../shared/data` beside the workspace. Without it the
//! test that needs it says so and passes.

// Helpers of a test may panic as the test itself does.
#![allow(clippy::unwrap_used)]

use std::error::Error as _;
use std::path::PathBuf;

use arthro_geometry::phantom::Phantom;
use arthro_geometry::stated::{Space, Stated, Statements, Unit};
use arthro_geometry::surface::{self, Kind};
use arthro_geometry::surface_file::{
    Error, read_as_it_stands, read_cloud, read_mesh, write_cloud, write_mesh,
};
use arthro_geometry::{Cloud, Mesh, Point3, obj, pcd, ply, stl};

/// Corners of the triangles, one after the other: what is left of a mesh when the numbering is forgotten.
fn corners(mesh: &Mesh) -> Vec<[Point3; 3]> {
    (0..mesh.triangles.len())
        .map(|index| mesh.corners(index))
        .collect()
}

/// PLY to OBJ to STL and the vertices to PCD: nothing may change on the way.
fn assert_every_kind_holds(mesh: &Mesh) {
    let from_ply = read_mesh("a.ply", &write_mesh("a.ply", mesh).unwrap(), None).unwrap();
    let from_obj = read_mesh("a.obj", &write_mesh("a.obj", &from_ply).unwrap(), None).unwrap();
    assert_eq!(from_obj, from_ply);

    let from_stl = read_mesh("a.stl", &write_mesh("a.stl", &from_obj).unwrap(), None).unwrap();
    assert_eq!(corners(&from_stl), corners(&from_ply));
    let ascii = stl::write_mesh_as(&from_obj, stl::Encoding::Ascii);
    assert_eq!(read_mesh("a.stl", &ascii, None).unwrap(), from_stl);

    let cloud = Cloud::new(from_stl.vertices);
    for encoding in [
        pcd::Encoding::Ascii,
        pcd::Encoding::Binary,
        pcd::Encoding::BinaryCompressed,
    ] {
        let file = pcd::write_cloud_as(&cloud, None, encoding);
        assert_eq!(read_cloud("a.pcd", &file, None).unwrap(), cloud);
    }
}

#[test]
fn a_surface_goes_through_every_kind_of_file_unchanged() {
    assert_every_kind_holds(&Phantom::default().mesh());
}

#[test]
fn real_menisci_go_through_every_kind_of_file_unchanged() {
    let folder = std::env::var_os("ARTHRO_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let Ok(files) = std::fs::read_dir(folder.join("menisci")) else {
        eprintln!("SKIPPED: no menisci in {}", folder.display());
        return;
    };
    for file in files {
        let bytes = std::fs::read(file.unwrap().path()).unwrap();
        assert_every_kind_holds(&ply::read_mesh(&bytes, Some(Stated::LPS_MM)).unwrap());
    }
}

#[test]
fn the_content_decides_before_the_name() {
    let mesh = Phantom::default().mesh();
    let cloud = Cloud::new(mesh.vertices.clone());
    for (file, kind) in [
        (ply::write_mesh(&mesh), Kind::Ply),
        (pcd::write_cloud(&cloud, None), Kind::Pcd),
        (stl::write_mesh(&mesh), Kind::Stl),
        (stl::write_mesh_as(&mesh, stl::Encoding::Ascii), Kind::Stl),
    ] {
        for name in ["scan", "scan.dat", "scan.obj", "folder.obj/scan.PLY"] {
            assert_eq!(read_as_it_stands(name, &file).unwrap().kind, kind);
        }
    }
    let file = obj::write_mesh(&mesh);
    for name in ["scan.obj", "scan.v2.OBJ"] {
        assert_eq!(read_as_it_stands(name, &file).unwrap().kind, Kind::Obj);
    }
    let error = read_as_it_stands("scan.xyz", &file).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\"scan.xyz\" is no known kind of file, known are .ply, .pcd, .stl and .obj"
    );
}

#[test]
fn a_refusal_names_the_kind_and_what_is_wrong() {
    let cloud = Cloud::new(vec![Point3::origin(), Point3::new(0.0, f64::NAN, 0.0)]);
    let error = read_cloud("scan", &pcd::write_cloud(&cloud, None), None).unwrap_err();
    assert_eq!(error.to_string(), "not an acceptable PCD file");
    assert_eq!(
        error.source().unwrap().to_string(),
        "vertex[1].y is NaN, must be finite"
    );
    let stl = stl::write_mesh(&Phantom::default().mesh());
    let error = read_mesh("a.stl", &stl[..1000], None).unwrap_err();
    assert_eq!(error.to_string(), "not an acceptable STL file");
}

#[test]
fn what_a_kind_cannot_hold_is_neither_read_nor_written() {
    let cloud = Cloud::new(vec![Point3::origin()]);
    let refused = read_mesh("a.pcd", &write_cloud("a.pcd", &cloud).unwrap(), None).unwrap_err();
    let expected = Error::Refused {
        kind: Kind::Pcd,
        source: surface::Error::Missing("faces"),
    };
    assert_eq!(refused, expected);
    let error = write_cloud("a.stl", &cloud).unwrap_err().to_string();
    assert_eq!(error, "STL files cannot hold a cloud");
    let error = write_mesh("a.pcd", &Mesh::default()).unwrap_err();
    assert_eq!(error.to_string(), "PCD files cannot hold a mesh");
    assert!(write_mesh("a.vtk", &Mesh::default()).is_err());
}

#[test]
fn a_file_is_read_as_it_stands_and_tells_what_it_states() {
    let read = |comments: &str| {
        let file = format!("{comments}v 1 2 3\nvn 0 1 0\n");
        read_as_it_stands("a.obj", file.as_bytes()).unwrap()
    };
    let untagged = read("");
    assert_eq!(untagged.statements, Statements::default());
    assert_eq!(untagged.cloud.points, [Point3::new(1.0, 2.0, 3.0)]);

    let slicer = read("# 3D Slicer output. SPACE=RAS\n");
    assert_eq!(slicer.statements.space, Some(Space::Ras));
    assert_eq!(slicer.statements.unit, None);
    assert_eq!(slicer.cloud, untagged.cloud);

    let stated = Stated {
        space: Space::Ras,
        unit: Unit::Metre,
    };
    let carried = slicer.into_lps_mm(Some(stated)).unwrap();
    assert_eq!(
        carried.cloud.points,
        [Point3::new(-1000.0, -2000.0, 3000.0)]
    );
    assert_eq!(carried.cloud.normals[0].y, -1.0);
    assert_eq!(carried.statements.space, Some(Space::Lps));
    assert_eq!(carried.statements.unit, Some(Unit::Millimetre));
}

#[test]
fn a_coordinate_too_large_for_millimetres_is_refused() {
    let file = b"# space LPS\n# unit m\nv 0 0 1e307\n";
    let error = obj::read_cloud(file, None).unwrap_err();
    assert_eq!(error.to_string(), "vertex[0].z is inf, must be finite");
}
