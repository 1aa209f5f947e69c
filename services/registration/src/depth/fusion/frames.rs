//! The average of several depth images of one camera that stood still, pixel by pixel.
//!
//! A depth far from the median of its pixel, by the median absolute deviation, is left out: a hand that passed, or a
//! pixel that jumps between two surfaces. Medians are lower ones, so that of two surfaces the one seen more often
//! wins, and on a tie the nearer: never the empty middle between them.

use rayon::prelude::*;

use super::super::lens::Lens;
use super::super::noise::{DepthNoise, StereoNoise};
use crate::error::{Error, Violation};

/// One depth image as it came.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The camera that took it.
    pub lens: &'a Lens,
    /// Millimetres a depth unit.
    pub depth_unit_mm: f64,
    /// Depth units, row by row: 0 where there is no measurement, [`SATURATED`] where it is more than 16 bits can say.
    pub depth: &'a [u16],
}

/// The mean of several depth images.
#[derive(Clone, Debug, PartialEq)]
pub struct Averaged {
    /// Mean depth of each pixel, mm; 0 where no frame has one, infinite where all that frames have is saturated.
    pub depth_mm: Vec<f64>,
    /// How many frames each mean is made of.
    pub frames: Vec<u32>,
    /// How many depths of each frame were left out as outlying.
    pub clipped: Vec<usize>,
}

/// Most frames of an average.
pub const MAX_FRAMES: usize = 256;
/// Largest depth unit, mm.
pub const MAX_DEPTH_UNIT_MM: f64 = 10.0;
/// The depth that stands for everything beyond.
pub const SATURATED: u16 = u16::MAX;
/// A depth farther from the median than this many standard deviations is left out.
const CLIP: f64 = 3.5;
/// Standard deviation of a normal distribution by its median absolute deviation.
const SIGMA_BY_MAD: f64 = 1.4826;
/// Pixels a task.
const PIXELS_PER_TASK: usize = 8192;

/// Averages `frames`, telling outlying depths by their spread, but never closer to the median than `noise` explains.
///
/// # Errors
/// [`Error::Invalid`] without frames, with more than [`MAX_FRAMES`], and for every frame whose size, intrinsics,
/// distortion or unit is not that of the first.
pub fn average(frames: &[Frame<'_>], noise: &StereoNoise) -> Result<Averaged, Error> {
    let violations = violations(frames);
    let Some(first) = frames.first().filter(|_| violations.is_empty()) else {
        return Err(Error::Invalid(violations));
    };
    let law = noise.of_camera(first.lens.intrinsics().fx_px, first.depth_unit_mm);
    let pixels = first.depth.len();
    let mut averaged = Averaged {
        depth_mm: vec![0.0; pixels],
        frames: vec![0; pixels],
        clipped: vec![0; frames.len()],
    };
    averaged.clipped = averaged
        .depth_mm
        .par_chunks_mut(PIXELS_PER_TASK)
        .zip(averaged.frames.par_chunks_mut(PIXELS_PER_TASK))
        .enumerate()
        .map(|(task, (means_mm, counts))| {
            let mut clipped = vec![0; frames.len()];
            let mut depths = Vec::with_capacity(frames.len());
            for (place, (mean_mm, count)) in means_mm.iter_mut().zip(counts).enumerate() {
                let pixel = task * PIXELS_PER_TASK + place;
                (*mean_mm, *count) = pixel_mean(frames, pixel, &law, &mut depths, &mut clipped);
            }
            clipped
        })
        .reduce(
            || vec![0; frames.len()],
            |mut sum, clipped| {
                sum.iter_mut().zip(clipped).for_each(|(s, c)| *s += c);
                sum
            },
        );
    Ok(averaged)
}

/// Mean depth of a pixel, mm, and the number of frames in it. `depths` is room to work in.
fn pixel_mean(
    frames: &[Frame<'_>],
    pixel: usize,
    law: &DepthNoise,
    depths: &mut Vec<u16>,
    clipped: &mut [usize],
) -> (f64, u32) {
    let measured = |depth: u16| depth != 0 && depth != SATURATED;
    depths.clear();
    depths.extend(
        frames
            .iter()
            .map(|frame| frame.depth[pixel])
            .filter(|d| measured(*d)),
    );
    depths.sort_unstable();
    let unit_mm = frames[0].depth_unit_mm;
    let Some(median) = lower_median(depths) else {
        let saturated = frames.iter().any(|frame| frame.depth[pixel] == SATURATED);
        return (if saturated { f64::INFINITY } else { 0.0 }, 0);
    };
    let law_units = law.sigma_mm(f64::from(median) * unit_mm, 1) / unit_mm;
    let mut kept = (0u64, 0u32);
    let deviation = |depth: u16| depth.abs_diff(median);
    let reach = {
        let mut deviations: Vec<u16> = depths.iter().map(|depth| deviation(*depth)).collect();
        deviations.sort_unstable();
        let mad = lower_median(&deviations).map_or(0.0, f64::from);
        CLIP * law_units.max(SIGMA_BY_MAD * mad)
    };
    for (frame, clipped) in frames.iter().zip(clipped) {
        let depth = frame.depth[pixel];
        if !measured(depth) {
            continue;
        }
        if f64::from(deviation(depth)) <= reach {
            kept = (kept.0 + u64::from(depth), kept.1 + 1);
        } else {
            *clipped += 1;
        }
    }
    // The median itself is always kept.
    (kept.0 as f64 / f64::from(kept.1) * unit_mm, kept.1)
}

fn lower_median(sorted: &[u16]) -> Option<u16> {
    let middle = sorted.len().checked_sub(1)? / 2;
    Some(sorted[middle])
}

/// What is wrong with a depth unit.
pub fn unit_violation(depth_unit_mm: f64) -> Option<Violation> {
    (!(depth_unit_mm > 0.0 && depth_unit_mm <= MAX_DEPTH_UNIT_MM)).then(|| {
        Violation::new(
            "header.depth_unit_mm",
            format!("is {depth_unit_mm}, must be greater than 0 and at most {MAX_DEPTH_UNIT_MM}"),
        )
    })
}

/// What is wrong with a number of frames.
pub fn count_violation(frames: usize) -> Option<Violation> {
    (frames == 0 || frames > MAX_FRAMES).then(|| {
        Violation::new(
            "header.frame_count",
            format!("is {frames}, must be 1 to {MAX_FRAMES}"),
        )
    })
}

/// What is wrong with the frames.
pub fn violations(frames: &[Frame<'_>]) -> Vec<Violation> {
    let mut violations: Vec<Violation> = count_violation(frames.len()).into_iter().collect();
    let Some(first) = frames.first() else {
        return violations;
    };
    violations.extend(unit_violation(first.depth_unit_mm));
    for (index, frame) in frames.iter().enumerate() {
        let field = if frames.len() == 1 {
            "depth".to_owned()
        } else {
            format!("depth[{index}]")
        };
        let intrinsics = frame.lens.intrinsics();
        if let Some(difference) = difference(frame, first) {
            violations.push(Violation::new(format!("{field}.intrinsics"), difference));
        }
        if frame.depth.len() as u64 != intrinsics.pixels() {
            violations.push(Violation::new(
                field,
                format!(
                    "has {} pixels, must have {}",
                    frame.depth.len(),
                    intrinsics.pixels()
                ),
            ));
        }
    }
    violations
}

/// In what `frame` is not of the same camera as `first`.
fn difference(frame: &Frame<'_>, first: &Frame<'_>) -> Option<String> {
    let (its, wanted) = (frame.lens.intrinsics(), first.lens.intrinsics());
    if (its.width_px, its.height_px) != (wanted.width_px, wanted.height_px) {
        return Some(format!(
            "is {} x {} px, must be {} x {} px as depth[0]",
            its.width_px, its.height_px, wanted.width_px, wanted.height_px
        ));
    }
    let named = [
        ("depth_unit_mm", frame.depth_unit_mm, first.depth_unit_mm),
        ("fx_px", its.fx_px, wanted.fx_px),
        ("fy_px", its.fy_px, wanted.fy_px),
        ("cx_px", its.cx_px, wanted.cx_px),
        ("cy_px", its.cy_px, wanted.cy_px),
    ];
    if let Some((name, is, must)) = named.into_iter().find(|(_, is, must)| is != must) {
        return Some(format!("{name} is {is}, must be {must} as of depth[0]"));
    }
    (frame.lens.distortion() != first.lens.distortion()).then(|| {
        format!(
            "distortion is {:?}, must be {:?} as of depth[0]",
            frame.lens.distortion(),
            first.lens.distortion()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::distortion::Distortion;
    use super::super::super::intrinsics::Intrinsics;
    use super::*;

    fn lens(width_px: u32, fx_px: f64) -> Lens {
        let intrinsics = Intrinsics {
            width_px,
            height_px: 1,
            fx_px,
            fy_px: 700.0,
            cx_px: 0.0,
            cy_px: 0.0,
        };
        Lens::new(intrinsics, Distortion::None).unwrap()
    }

    fn averaged(depths: &[&[u16]]) -> Averaged {
        let lens = lens(depths[0].len() as u32, 700.0);
        let frames: Vec<Frame<'_>> = depths
            .iter()
            .map(|depth| Frame {
                lens: &lens,
                depth_unit_mm: 0.1,
                depth,
            })
            .collect();
        average(&frames, &StereoNoise::default()).unwrap()
    }

    #[test]
    fn depths_are_averaged_over_the_frames_that_have_one() {
        let mean = averaged(&[
            &[3000, 0, 0, SATURATED],
            &[3002, 3001, 0, SATURATED],
            &[3004, 3002, 0, 0],
        ]);
        assert_eq!(mean.frames, [3, 2, 0, 0]);
        assert!((mean.depth_mm[0] - 300.2).abs() < 1e-9);
        assert!((mean.depth_mm[1] - 300.15).abs() < 1e-9);
        assert_eq!(mean.depth_mm[2], 0.0);
        assert_eq!(mean.depth_mm[3], f64::INFINITY);
        assert_eq!(mean.clipped, [0, 0, 0]);
    }

    #[test]
    fn a_hand_that_passed_is_left_out_and_told_by_its_frame() {
        let mean = averaged(&[&[3000], &[3001], &[1200], &[3001], &[2999]]);
        assert!((mean.depth_mm[0] - 300.025).abs() < 1e-9);
        assert_eq!(mean.clipped, [0, 0, 1, 0, 0]);
    }

    #[test]
    fn a_pixel_that_jumps_between_two_surfaces_stays_on_one() {
        let seen_more_often = averaged(&[&[3000], &[4000], &[4001], &[4002], &[3001]]);
        assert!((seen_more_often.depth_mm[0] - 400.1).abs() < 1e-9);
        let as_often = averaged(&[&[3000], &[4000], &[4000], &[3000]]);
        assert!((as_often.depth_mm[0] - 300.0).abs() < 1e-9);
    }

    #[test]
    fn frames_of_another_size_or_camera_are_named() {
        let (wide, narrow, other) = (lens(4, 700.0), lens(2, 700.0), lens(4, 701.0));
        let frame = |lens, depth| Frame {
            lens,
            depth_unit_mm: 0.1,
            depth,
        };
        let frames = [
            frame(&wide, &[1; 4][..]),
            frame(&narrow, &[1; 2]),
            frame(&wide, &[1; 3]),
            frame(&other, &[1; 4]),
        ];
        let error = average(&frames, &StereoNoise::default()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "depth[1].intrinsics: is 2 x 1 px, must be 4 x 1 px as depth[0]; \
             depth[2]: has 3 pixels, must have 4; \
             depth[3].intrinsics: fx_px is 701, must be 700 as of depth[0]"
        );
    }

    #[test]
    fn no_frame_and_too_many_are_refused() {
        let lens = lens(1, 700.0);
        let frame = Frame {
            lens: &lens,
            depth_unit_mm: 0.1,
            depth: &[1],
        };
        for (count, said) in [(0, "is 0, must be 1 to 256"), (257, "is 257, must be")] {
            let error = average(&vec![frame; count], &StereoNoise::default()).unwrap_err();
            assert!(error.to_string().contains(said), "{error}");
        }
    }
}
