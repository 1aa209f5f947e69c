//! `arthro reconstruct`: the surface of a label or threshold of a volume file, made in this process.

use std::path::Path;
use std::time::Instant;

use arthro_geometry::scan::{Label, labels};
use arthro_geometry::{Point3, Scan, nrrd, ply};
use arthro_registration::budget::Budget;
use arthro_registration::reconstruct::{
    Decimation, Inside, Options, Reconstruction, reconstruct, sample,
};
use serde_json::{Value, json};
use tonic::Status;

use crate::arguments::Reconstruct;
use crate::commands::{read, show, stated, unreadable};
use crate::exit::Failure;
use crate::output::Output;

/// Runs the command to its end.
pub fn run(arguments: &Reconstruct, output: &Output) -> Result<(), Failure> {
    let began = Instant::now();
    let scan = scan(arguments)?;
    if arguments.list {
        return list(&scan, output);
    }
    let inside = match (arguments.label, arguments.threshold) {
        (Some(label), _) => Inside::Label(label),
        (None, Some(threshold)) => Inside::Threshold(threshold),
        // The command line demands one of them.
        (None, None) => return Ok(()),
    };
    let read_seconds = began.elapsed().as_secs_f64();
    let surface = reconstruct(&scan, &options(arguments, inside), &Budget::default())
        .map_err(Status::from)?;
    let seconds = began.elapsed().as_secs_f64();
    if let Some(path) = &arguments.out {
        write(path, &ply::write_mesh(&surface.mesh))?;
    }
    if let Some(path) = &arguments.cloud {
        write(
            path,
            &ply::write_cloud(&sample(&surface.mesh, arguments.points)),
        )?;
    }
    if surface.touches_border {
        output.note("it reaches the border of the volume; the surface is closed there");
    }
    let mut value = figures(arguments, &surface);
    value["read_seconds"] = json!(read_seconds);
    value["seconds"] = json!(seconds);
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

fn scan(arguments: &Reconstruct) -> Result<Scan, Failure> {
    let (path, stated) = (&arguments.volume, stated(arguments.stated));
    let file = read(path)?;
    let scan = match &arguments.data {
        Some(data) => nrrd::read_detached(&file, &read(data)?, stated),
        None => nrrd::read(&file, stated),
    };
    scan.map_err(|error| unreadable(path, &error))
}

fn options(arguments: &Reconstruct, inside: Inside) -> Options {
    let known = Options::new(inside);
    Options {
        smoothing_passes: arguments.smooth,
        min_piece_share: arguments.min_piece_share.unwrap_or(known.min_piece_share),
        decimation: match (arguments.triangles, arguments.max_error_mm) {
            (Some(triangles), _) => Decimation::Triangles(triangles),
            (None, Some(error_mm)) => Decimation::WithinMm(error_mm),
            (None, None) => known.decimation,
        },
        ..known
    }
}

fn list(scan: &Scan, output: &Output) -> Result<(), Failure> {
    let labels = labels(scan).map_err(|error| Failure::refused_because("NO_LABEL_MAP", &error))?;
    output.line(format!(
        "{:>8}  {:>10}  {:>12}  bounds in LPS, mm",
        "label", "voxels", "mm3"
    ));
    for Label {
        value,
        voxels,
        volume_mm3,
        bounds: (low, high),
    } in &labels
    {
        output.line(format!(
            "{value:>8}  {voxels:>10}  {volume_mm3:>12.1}  {:.1} {:.1} {:.1} to {:.1} {:.1} {:.1}",
            low.x, low.y, low.z, high.x, high.y, high.z
        ));
    }
    let lattice = scan.lattice();
    let listed = labels.iter().map(|label| {
        json!({
            "label": label.value,
            "voxels": label.voxels,
            "volume_mm3": label.volume_mm3,
            "bounds": bounds(Some(label.bounds)),
        })
    });
    output.result(&json!({
        "sizes": lattice.size(),
        "spacing_mm": lattice.spacing_mm(),
        "labels": listed.collect::<Vec<_>>(),
    }));
    Ok(())
}

fn figures(arguments: &Reconstruct, surface: &Reconstruction) -> Value {
    let mesh = &surface.mesh;
    json!({
        "label": arguments.label,
        "threshold": arguments.threshold,
        "volume_mm3": mesh.volume_mm3(),
        "voxel_volume_mm3": surface.voxel_volume_mm3,
        "area_mm2": mesh.area_mm2(),
        "vertices": mesh.vertices.len(),
        "triangles": mesh.triangles.len(),
        "watertight": mesh.is_watertight(),
        "bounds": bounds(mesh.bounds()),
        "max_deviation_mm": surface.max_deviation_mm,
        "dropped_pieces": surface.dropped_pieces,
        "touches_border": surface.touches_border,
    })
}

/// Lowest and highest corner, LPS, mm.
fn bounds(corners: Option<(Point3, Point3)>) -> Value {
    corners.map_or(
        Value::Null,
        |(low, high)| json!({"min": [low.x, low.y, low.z], "max": [high.x, high.y, high.z]}),
    )
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| {
        Failure::refused("FILE_UNWRITABLE", format!("{}: {error}", path.display()))
    })
}
