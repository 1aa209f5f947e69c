//! A move to a position, and what is left as it was after it.

use epos4_link::objects;

use super::referenced;
use crate::drives::link::{Link, Profile};
use crate::error::Failure;
use crate::positioning::Sample;

pub(super) async fn move_to(link: &Link, target: f64) -> Result<Sample, Failure> {
    referenced(link).await?;
    let spec = link.spec();
    let profile = Profile {
        target,
        speed: spec.speed,
        current_limit_ma: spec.current_limit_ma,
        following_error: spec.following_error,
    };
    let watch = link.begin_profile(profile).await?;
    loop {
        if let Some(ended) = watch.observe(&link.sample().await?) {
            ended?;
            break;
        }
    }
    let window = spec.drivetrain.to_quadcount_distance(spec.following_error);
    link.node()
        .write(objects::FOLLOWING_ERROR_WINDOW, window)
        .await?;
    link.ask().await
}
